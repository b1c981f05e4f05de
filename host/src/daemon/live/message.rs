//! What a page is told on its live socket.

use crate::daemon::api::problem::Problem;
use crate::daemon::observe::scene::SceneView;
use crate::daemon::observe::state::StateView;
use crate::daemon::touch::active_plan::ActivePlan;
use crate::daemon::touch::answer::PlayedEffect;
use crate::daemon::touch::plan_view::{FieldView, PlanView};
use crate::daemon::touch::request::Finger;
use crate::planner::PlanTable;
use serde::Serialize;
use utoipa::ToSchema;

/// A message from the daemon to a page.
#[derive(Clone, Debug, Serialize, ToSchema)]
#[schema(as = LiveOut)]
#[serde(tag = "type", rename_all = "lowercase")]
pub enum LiveMessage {
    /// The scene; sent once, at the start.
    #[expect(dead_code, reason = "part of the description; `SceneTexts` writes it once for all pages")]
    Scene(Box<SceneView>),
    /// The state; sent whenever it changes.
    State(Box<StateView>),
    /// A plan that is driven, or the message that no plan is driven any more.
    Plan(Box<PlanMessage>),
    /// A problem with a message or a finger of the page.
    Error(ErrorMessage),
}

/// A plan that is driven, or none.
#[derive(Clone, Debug, Serialize, ToSchema)]
pub struct PlanMessage {
    /// The plan; null if the previous plan has ended or was stopped.
    plan: Option<PlanView>,
    /// Number of the plan, which is also the number of its request; null without a plan.
    plan_id: Option<u64>,
    /// Predicted peak acceleration over the surface; absent unless the page has requested `field`.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schema(nullable = false)]
    field: Option<FieldView>,
    /// The fingers for which the plan is driven.
    touches: Vec<Finger>,
    /// The effect that the board plays; null if the board plays none.
    effect: Option<PlayedEffect>,
}

/// A problem with a message or a finger.
#[derive(Clone, Debug, Serialize, ToSchema)]
pub struct ErrorMessage {
    /// The problem; `field` names the field of the message, such as `touches[0].x_px`.
    problem: Problem,
}

impl LiveMessage {
    /// The plan, with its field by this table or without.
    #[must_use]
    pub fn from_plan_with_field_if_table_given(active: &ActivePlan, table: Option<&PlanTable>) -> Self {
        Self::Plan(Box::new(PlanMessage {
            plan: Some(active.plan.clone()),
            plan_id: Some(active.id),
            field: table.map(|table| active.get_or_compute_peak_acceleration_field(table).clone()),
            touches: active.touches.clone(),
            effect: active.effect.clone(),
        }))
    }

    /// That no plan is driven any more.
    #[must_use]
    pub fn without_plan() -> Self {
        Self::Plan(Box::new(PlanMessage { plan: None, plan_id: None, field: None, touches: Vec::new(), effect: None }))
    }

    /// What is wrong.
    #[must_use]
    pub fn from_problem(problem: &Problem) -> Self {
        Self::Error(ErrorMessage { problem: problem.clone() })
    }
}
