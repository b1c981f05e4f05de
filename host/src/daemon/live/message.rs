//! What a page is told on its live socket.

use crate::daemon::api::problem::Problem;
use crate::daemon::drive::active::ActivePlan;
use crate::daemon::observe::scene::SceneView;
use crate::daemon::observe::state::StateView;
use crate::daemon::touch::answer::PlayedEffect;
use crate::daemon::touch::plan_view::{FieldView, PlanView};
use crate::daemon::touch::request::Finger;
use crate::planner::PlanTable;
use serde::Serialize;
use utoipa::ToSchema;

/// A message to a page.
#[derive(Clone, Debug, Serialize, ToSchema)]
#[schema(as = LiveOut)]
#[serde(tag = "type", rename_all = "lowercase")]
pub enum LiveMessage {
    /// The scene, once.
    #[expect(dead_code, reason = "part of the description; `SceneTexts` writes it once for all pages")]
    Scene(Box<SceneView>),
    /// The state, whenever it changes.
    State(Box<StateView>),
    /// A plan that is driven, or that none is any more.
    Plan(Box<PlanMessage>),
    /// What is wrong with something that the page has said or done.
    Error(ErrorMessage),
}

/// A plan that is driven.
#[derive(Clone, Debug, Serialize, ToSchema)]
pub struct PlanMessage {
    /// The plan; null when the one that was told before is over, by its end or by a stop.
    plan: Option<PlanView>,
    /// Its number, which is its request's; null without a plan.
    plan_id: Option<u64>,
    /// Its field, where the page has asked for it.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schema(nullable = false)]
    field: Option<FieldView>,
    /// The fingers that it is for.
    touches: Vec<Finger>,
    /// The effect that is played; null if none is.
    effect: Option<PlayedEffect>,
}

/// What is wrong.
#[derive(Clone, Debug, Serialize, ToSchema)]
pub struct ErrorMessage {
    /// What is wrong; `field` names the finger, as `touches[0].x_px`.
    problem: Problem,
}

impl LiveMessage {
    /// The plan, with its field by this table or without.
    #[must_use]
    pub fn from_plan(active: &ActivePlan, table: Option<&PlanTable>) -> Self {
        Self::Plan(Box::new(PlanMessage {
            plan: Some(active.plan.clone()),
            plan_id: Some(active.id),
            field: table.map(|table| active.get_or_compute_field(table).clone()),
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
