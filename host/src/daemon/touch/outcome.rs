//! What became of a request.

use super::answer::TouchedView;
use crate::daemon::api::problem::Problem;
use crate::daemon::api::schema::text_choice_schema;
use serde::Serialize;
use serde_json::{Value, json};
use utoipa::ToSchema;
use utoipa::openapi::schema::Object;

/// The outcome of a touch.
#[derive(Clone, Debug, Serialize, ToSchema)]
#[schema(as = Outcome)]
pub struct RequestOutcome {
    /// Number of the request, which is also the number of its plan.
    pub id: u64,
    /// Name that the client gave the request in x-request-id; null without a name.
    pub name: Option<String>,
    /// Progress of the request.
    #[schema(schema_with = outcome_state_schema)]
    pub state: &'static str,
    /// Time since the request arrived, in ms.
    pub age_ms: f64,
    /// Time from the arrival of the request to its outcome, in ms; null while the request waits.
    pub took_ms: Option<f64>,
    /// HTTP status of the answer; null while the request waits.
    pub status: Option<u16>,
    /// The answer, as the daemon sent it; null without an answer.
    #[schema(value_type = Option<TouchedView>)]
    pub answer: Option<Value>,
    /// Largest acceleration in g that the board's sensor measured under the touch until the next touch began, or until now; null without a
    /// simulated sensor, and before the touch is driven.
    pub acceleration_peak_g: Option<f64>,
    /// The problem with which the request failed; null if it did not fail.
    pub problem: Option<Problem>,
}

fn outcome_state_schema() -> Object {
    text_choice_schema(["waiting", "done", "failed"], false, "Progress of the request.")
}

/// The content of a recording's line about the outcome of request `id`: what was driven, or why not. `answer` is the body of the answer.
#[must_use]
pub fn summarize_outcome_for_recording(id: u64, answer: &Result<Value, Problem>) -> Value {
    match answer {
        Ok(answer) => json!({
            "id": id, "status": 200, "drives": answer["drives"], "predicted": answer["predicted"], "device": answer["device"],
            "targets": answer["targets"], "limited_by": answer["limited_by"], "limits": answer["limits"],
        }),
        Err(problem) => json!({"id": id, "status": problem.status().as_u16(), "problem": problem}),
    }
}
