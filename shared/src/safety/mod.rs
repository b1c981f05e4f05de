//! The safety state machine, the dead-man timer, the self-test before arming and the budget of each channel.
//!
//! The machine is a table ([`transition`]) with an outcome for every state and every event, so that nothing can happen
//! that nobody thought of: `tests/safety.rs` walks all of it. [`Safety`] holds the state, the first fault and the
//! dead-man timer; it decides, and its caller carries out the [`Action`] it is given before doing anything else.

mod arming;
mod budget;
mod charge;
mod machine;
mod table;

pub use crate::limits::{DEADMAN_DEFAULT_MS, DEADMAN_MAX_MS, DEADMAN_MIN_MS};
pub use arming::{SelfTest, Verdict};
pub use budget::Budget;
pub use charge::Charge;
pub use machine::{LinkId, Safety};
pub use table::{Action, Event, Outcome, State, transition};
