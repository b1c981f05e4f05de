//! What is driven, and what a touch has led to.

use crate::daemon::touch::active_plan::ActivePlan;
use crate::device::AskedAt;
use crate::planner::Plan;
use std::sync::Arc;
use std::time::Instant;

/// What is driven now, as it is shown.
#[derive(Clone, Debug)]
pub struct CurrentPlan {
    /// The plan.
    pub active: Arc<ActivePlan>,
    /// When its drive ends.
    pub until: Instant,
    /// When its touch was asked for; the board's interruptions are those before its drive began.
    pub asked_at: AskedAt,
}

/// What open pages are told at once.
#[derive(Clone, Debug)]
pub enum Update {
    /// There is a new plan.
    Plan(Arc<ActivePlan>),
    /// Everything was stopped.
    Stopped,
    /// The plan ends sooner than it was to.
    Ends,
}

/// An even drive that the controller looks after for as long as it goes on.
#[derive(Clone, Debug)]
pub struct SustainedDrive {
    /// Its drives are the last that have begun for as long as `DriveState::note_begun_drives_and_return_their_serial_number` has returned no other number.
    pub begun: u64,
    /// When its touch was asked for.
    pub asked_at: AskedAt,
    /// The plan first made.
    pub whole_plan: Plan,
    /// The fraction of its forces that the channels' credit allows ([`super::credit`]).
    pub credit_fraction: f64,
    /// The fraction of these for which there is room beside what is left of the touches before.
    pub force_fraction: f64,
    /// What is shown of it.
    pub active: Arc<ActivePlan>,
}
