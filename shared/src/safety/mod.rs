//! The safety state machine and the dead-man timer.
//!
//! The machine is a table ([`transition`]) with one entry for every state and every event, so that nothing can happen
//! that nobody thought of: `tests/safety.rs` walks all of it. [`Safety`] holds the state, the first fault and the
//! dead-man timer; it decides, and its caller carries out the [`Action`] it is given before doing anything else.

mod machine;
mod table;

pub use machine::{DEADMAN_DEFAULT_MS, DEADMAN_MAX_MS, DEADMAN_MIN_MS, LinkId, Safety};
pub use table::{Action, Event, Outcome, State, transition};
