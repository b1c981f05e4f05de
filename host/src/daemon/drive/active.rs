//! What is driven, and what a touch has led to.

use crate::daemon::touch::answer::{Achieved, PlayedEffect, TouchedView};
use crate::daemon::touch::plan_view::{FieldView, PlanView};
use crate::daemon::touch::request::Finger;
use crate::planner::schedule::Stretch;
use crate::planner::trade::Trade;
use crate::planner::{Plan, PlanTable};
use std::sync::{Arc, OnceLock};
use std::time::Instant;

/// What is driven now, as it is shown.
#[derive(Clone, Debug)]
pub struct Current {
    /// The plan.
    pub active: Arc<Active>,
    /// When its drive ends.
    pub until: Instant,
    /// [`AskedAt::stops`] of its touch.
    pub stops: u64,
}

/// The current plan and what goes with it.
#[derive(Clone, Debug)]
pub struct Active {
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

impl Active {
    /// What is driven for these fingers.
    #[must_use]
    pub const fn new(id: u64, plan: PlanView, touches: Vec<Finger>, effect: Option<PlayedEffect>) -> Self {
        Self { id, plan, field: OnceLock::new(), touches, effect }
    }

    /// The same with what is shown of its plan changed; its field stays.
    #[must_use]
    pub fn shown_as(&self, plan: PlanView) -> Self {
        Self { plan, ..self.clone() }
    }

    /// Its field. Worked out when it is first asked for: most plans of a moving finger, and all where no page is open, are never looked
    /// at, and 1600 points at each touch would take the processor from the touches after it.
    #[must_use]
    pub fn field(&self, table: &PlanTable) -> &FieldView {
        self.field.get_or_init(|| self.plan.field(table, self.id))
    }
}

/// What open pages are told at once.
#[derive(Clone, Debug)]
pub enum Update {
    /// There is a new plan.
    Plan(Arc<Active>),
    /// Everything was stopped.
    Stopped,
    /// The plan ends sooner than it was to.
    Ends,
}

/// What a touch has led to.
#[derive(Clone, Debug)]
pub struct Touched {
    /// The plan, of several stretches that in which the first target begins.
    pub active: Arc<Active>,
    /// What the device achieves with what begins at once.
    pub device: Achieved,
    /// All stretches, where there are time windows.
    pub stretches: Option<Vec<Stretch>>,
    /// What can be had, where it cannot be had in full and that was asked for.
    pub trade: Option<Trade>,
}

impl Touched {
    /// As its sender is answered.
    #[must_use]
    pub fn view(self) -> TouchedView {
        let Self { active, device, stretches, trade, .. } = self;
        TouchedView { plan: active.plan.clone(), plan_id: active.id, device, stretches, trade }
    }
}

/// When a touch was asked for: it is not driven if any of this has happened since.
#[derive(Clone, Copy, Debug)]
pub struct AskedAt {
    /// `Session::stops` at its arrival.
    pub stops: u64,
    /// `DeviceSnapshot::breaks` then, for what begins later or is driven again.
    pub breaks: Option<u64>,
}

/// An even drive that the controller looks after for as long as it goes on.
#[derive(Clone, Debug)]
pub struct Sustained {
    /// Its drives are the last that have begun for as long as `DriveState::begin` has returned no other number.
    pub begun: u64,
    /// When its touch was asked for.
    pub since: AskedAt,
    /// The plan first made.
    pub whole: Plan,
    /// The fraction of its forces that the channels' credit allows ([`super::credit`]).
    pub thin: f64,
    /// The fraction of these for which there is room beside what is left of the touches before.
    pub part: f64,
    /// What is shown of it.
    pub active: Arc<Active>,
}
