//! What became of a request.

use super::answer::TouchedView;
use crate::daemon::api::problem::Problem;
use crate::daemon::api::schema::text_choice_schema;
use serde::Serialize;
use serde_json::Value;
use utoipa::ToSchema;
use utoipa::openapi::schema::Object;

/// What became of a touch.
#[derive(Clone, Debug, Serialize, ToSchema)]
#[schema(as = Outcome)]
pub struct RequestOutcome {
    /// The request's number, which is its plan's.
    pub id: u64,
    /// As its client called it, in x-request-id.
    pub name: Option<String>,
    /// Where it is.
    #[schema(schema_with = outcome_state_schema)]
    pub state: &'static str,
    /// Since it arrived, in ms.
    pub age_ms: f64,
    /// From its arrival to its outcome, in ms.
    pub took_ms: Option<f64>,
    /// HTTP status of its answer.
    pub status: Option<u16>,
    /// Its answer, as it was given.
    #[schema(value_type = Option<TouchedView>)]
    pub answer: Option<Value>,
    /// Largest acceleration in g that the board's sensor has shown under it until the next touch began, or until now; null without a simulated
    /// sensor, and before it is driven.
    pub acceleration_peak_g: Option<f64>,
    /// What was wrong with it.
    pub problem: Option<Problem>,
}

fn outcome_state_schema() -> Object {
    text_choice_schema(["waiting", "done", "failed"], false, "Where it is.")
}
