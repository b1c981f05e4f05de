//! A plan that is driven, as clients are shown it.

use super::answer::PlayedEffect;
use super::plan_view::{FieldView, PlanView};
use super::request::Finger;
use crate::planner::PlanTable;
use std::sync::OnceLock;

/// A plan that is driven, and what goes with it.
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
    pub fn get_or_compute_peak_acceleration_field(&self, table: &PlanTable) -> &FieldView {
        self.field.get_or_init(|| self.plan.compute_peak_acceleration_field(table, self.id))
    }
}
