//! The safety state machine, the dead-man timer, the self-test before arming and the budget of each channel.
//!
//! The machine is a table ([`look_up_transition`]) with an outcome for every state and every event, so that nothing can happen
//! that nobody thought of: `tests/safety.rs` walks all of it. [`SafetyMachine`] holds the state, the first fault and the
//! dead-man timer; it decides, and its caller carries out the [`SafetyAction`] it is given before doing anything else.

mod arming;
mod budget;
mod charge;
mod electrode_test;
mod machine;
mod table;

pub use crate::limits::{DEADMAN_DEFAULT_MS, DEADMAN_MAX_MS, DEADMAN_MIN_MS};
pub(crate) use arming::{BLEED, CHARGE};
pub use arming::{SelfTest, SelfTestVerdict};
pub use budget::{DriveBudget, PlannedDrive};
pub use charge::CreditCharge;
pub use electrode_test::{
    ElectrodeFinding, ElectrodeFindings, ElectrodePulses, electrode_fault_detail, judge_electrode_pulses,
};
pub use machine::{LinkId, SafetyMachine, is_silence_over_deadman_or_its_maximum};
pub use table::{SafetyAction, SafetyEvent, SafetyState, Transition, look_up_transition};
