//! What is driven, and what a touch has led to.

use crate::daemon::touch::answer::PlayedEffect;
use crate::daemon::touch::plan_view::{FieldView, PlanView};
use crate::daemon::touch::request::Finger;
use crate::planner::{Plan, PlanTable};
use std::sync::{Arc, OnceLock};
use std::time::Instant;

/// What is driven now, as it is shown.
#[derive(Clone, Debug)]
pub struct CurrentPlan {
    /// The plan.
    pub active: Arc<ActivePlan>,
    /// When its drive ends.
    pub until: Instant,
    /// [`AskedAt::stops`] of its touch.
    pub stops: u64,
}

/// The current plan and what goes with it.
#[derive(Clone, Debug)]
pub struct ActivePlan {
    /// Counts plans from 1.
    pub id: u64,
    /// The plan as sent to clients.
    pub plan: PlanView,
    /// Its field, once somebody has asked for it.
    field: OnceLock<FieldView>,
    /// The fingers it is for.
    pub touches: Vec<Finger>,
    /// The effect that is played, if one is.
    pub effect: Option<PlayedEffect>,
}

impl ActivePlan {
    /// What is driven for these fingers.
    #[must_use]
    pub const fn new(id: u64, plan: PlanView, touches: Vec<Finger>, effect: Option<PlayedEffect>) -> Self {
        Self { id, plan, field: OnceLock::new(), touches, effect }
    }

    /// The same with what is shown of its plan changed; its field stays.
    #[must_use]
    pub fn with_plan_view(&self, plan: PlanView) -> Self {
        Self { plan, ..self.clone() }
    }

    /// Its field. Worked out when it is first asked for: most plans of a moving finger, and all where no page is open, are never looked
    /// at, and 1600 points at each touch would take the processor from the touches after it.
    #[must_use]
    pub fn get_or_compute_field(&self, table: &PlanTable) -> &FieldView {
        self.field.get_or_init(|| self.plan.compute_field(table, self.id))
    }
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

/// When a touch was asked for: it is not driven if any of this has happened since.
#[derive(Clone, Copy, Debug)]
pub struct AskedAt {
    /// `Session::stop_count` at its arrival.
    pub stops: u64,
    /// `DeviceSnapshot::interruptions` then, for what begins later or is driven again.
    pub interruptions: Option<u64>,
}

/// An even drive that the controller looks after for as long as it goes on.
#[derive(Clone, Debug)]
pub struct SustainedDrive {
    /// Its drives are the last that have begun for as long as `DriveState::note_and_count_begun_drives` has returned no other number.
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
