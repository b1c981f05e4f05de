//! Errors as RFC 9457 "problem+json", with the field, its value and the allowed range where there are any.

use crate::device::{LinkError, SessionError};
use crate::model::ModelError;
use crate::planner::PlanError;
use crate::response::ResponseError;
use crate::scene::{PixelError, SceneError};
use axum::http::{HeaderValue, StatusCode, header};
use axum::response::{IntoResponse, Response};
use era_shared::protocol::Refusal;
use serde::Serialize;
use serde_json::Value;

/// One problem, boxed: it travels through many results.
#[derive(Clone, Debug, Serialize)]
#[serde(transparent)]
pub struct Problem(Box<Content>);

#[derive(Clone, Debug, Serialize)]
struct Content {
    /// Kind of problem, stable for programs.
    #[serde(rename = "type")]
    kind: String,
    /// The kind in words.
    title: &'static str,
    /// HTTP status.
    status: u16,
    /// This case in words.
    detail: String,
    /// The request's field, if one is wrong.
    #[serde(skip_serializing_if = "Option::is_none")]
    field: Option<String>,
    /// Its value.
    #[serde(skip_serializing_if = "Option::is_none")]
    value: Option<Value>,
    /// What is allowed.
    #[serde(skip_serializing_if = "Option::is_none")]
    allowed: Option<String>,
    /// Line of a scene, from 1.
    #[serde(skip_serializing_if = "Option::is_none")]
    line: Option<usize>,
    /// When to ask again, in ms.
    #[serde(skip_serializing_if = "Option::is_none")]
    retry_after_ms: Option<u64>,
    /// How many wait before this.
    #[serde(skip_serializing_if = "Option::is_none")]
    depth: Option<usize>,
    /// All mistakes of a scene; the first is the one above.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    mistakes: Vec<MistakeView>,
}

#[derive(Clone, Debug, Serialize)]
struct MistakeView {
    line: Option<usize>,
    detail: String,
}

impl Problem {
    /// A problem of the kind `kind` (a word or two, made into a URN).
    #[must_use]
    pub fn new(status: StatusCode, kind: &str, title: &'static str, detail: impl Into<String>) -> Self {
        Self(Box::new(Content {
            kind: format!("urn:era:problem:{kind}"),
            title,
            status: status.as_u16(),
            detail: detail.into(),
            field: None,
            value: None,
            allowed: None,
            line: None,
            retry_after_ms: None,
            depth: None,
            mistakes: Vec::new(),
        }))
    }

    /// With the field that is wrong, its value, what is allowed, and its line in the scene.
    #[must_use]
    pub fn at(mut self, field: &str, value: Value, allowed: String, line: Option<usize>) -> Self {
        self.0.field = Some(field.into());
        self.0.value = Some(value);
        self.0.allowed = Some(allowed);
        self.0.line = line;
        self
    }

    /// To be asked again after so many ms; so many wait before it.
    #[must_use]
    pub fn retry(mut self, after_ms: u64, depth: Option<usize>) -> Self {
        self.0.retry_after_ms = Some(after_ms);
        self.0.depth = depth;
        self
    }

    /// HTTP status.
    #[must_use]
    pub fn status(&self) -> StatusCode {
        StatusCode::from_u16(self.0.status).unwrap_or(StatusCode::INTERNAL_SERVER_ERROR)
    }

    /// A number outside its range.
    #[must_use]
    pub fn range(field: &str, value: f64, min: impl std::fmt::Display, max: impl std::fmt::Display) -> Self {
        let max = max.to_string();
        let allowed = if max == "inf" { format!("{min} and above") } else { format!("{min} to {max}") };
        let detail = format!("{field} is {value}, but must be in {allowed}");
        Self::new(StatusCode::BAD_REQUEST, "out-of-range", "A value is out of range", detail).at(
            field,
            value.into(),
            allowed,
            None,
        )
    }

    /// A body that could not be read.
    #[must_use]
    pub fn body(detail: String) -> Self {
        Self::new(StatusCode::BAD_REQUEST, "bad-body", "The request's body cannot be used", detail)
    }

    /// The same in a part of the request, `also[0]` say; as it is without one.
    #[must_use]
    pub fn of(mut self, part: Option<String>) -> Self {
        if let (Some(part), Some(field)) = (part, &mut self.0.field) {
            *field = format!("{part}.{field}");
            self.0.detail = format!("{part}.{}", self.0.detail);
        }
        self
    }

    /// Whether it is of this kind.
    #[must_use]
    pub fn is(&self, kind: &str) -> bool {
        self.0.kind.rsplit(':').next() == Some(kind)
    }

    /// In words.
    #[must_use]
    pub fn detail(&self) -> &str {
        &self.0.detail
    }
}

impl IntoResponse for Problem {
    fn into_response(self) -> Response {
        let body = serde_json::to_vec(&self).unwrap_or_default();
        let mut response = (self.status(), [(header::CONTENT_TYPE, "application/problem+json")], body).into_response();
        if let Some(ms) = self.0.retry_after_ms {
            // Whole seconds, the least of which is one (RFC 9110, 10.2.3); the body says it in ms.
            response.headers_mut().insert(header::RETRY_AFTER, HeaderValue::from(ms.div_ceil(1000)));
        }
        response
    }
}

impl From<crate::scene::ScreenError> for Problem {
    fn from(error: crate::scene::ScreenError) -> Self {
        Self::range(error.field, error.value, error.min, error.max)
    }
}

impl From<PixelError> for Problem {
    fn from(error: PixelError) -> Self {
        match error {
            PixelError::Screen(error) => error.into(),
            PixelError::Place(error) => PlanError::from(error).into(),
        }
    }
}

impl From<SceneError> for Problem {
    fn from(error: SceneError) -> Self {
        let mut problem =
            Self::new(StatusCode::BAD_REQUEST, "bad-scene", "The scene cannot be used", error.to_string());
        let line = |line: usize| (line > 0).then_some(line);
        if let Some(first) = error.mistakes.first() {
            problem.0.line = line(first.line);
            problem.0.field.clone_from(&first.field);
            problem.0.allowed.clone_from(&first.allowed);
            // Numbers and texts of TOML as those of JSON; what has no like there, as it was written.
            let value = |text: &String| serde_json::from_str(text).unwrap_or_else(|_| text.as_str().into());
            problem.0.value = first.value.as_ref().map(value);
        }
        let view = |mistake: crate::scene::Mistake| MistakeView { line: line(mistake.line), detail: mistake.text };
        problem.0.mistakes = error.mistakes.into_iter().map(view).collect();
        problem
    }
}

impl From<ModelError> for Problem {
    fn from(error: ModelError) -> Self {
        Self::new(StatusCode::UNPROCESSABLE_ENTITY, "no-model", "This scene has no model", error.to_string())
    }
}

impl From<ResponseError> for Problem {
    fn from(error: ResponseError) -> Self {
        Self::new(StatusCode::UNPROCESSABLE_ENTITY, "no-plan", "This scene has no plan", error.to_string())
    }
}

impl From<PlanError> for Problem {
    fn from(error: PlanError) -> Self {
        match error {
            PlanError::Range { field, value, min, max } => Self::range(field, value, min, max),
            PlanError::Count { .. } => {
                Self::new(StatusCode::BAD_REQUEST, "touch-count", "Too many or too few touches", error.to_string())
            }
            PlanError::Quiet { .. } => {
                Self::new(StatusCode::BAD_REQUEST, "quiet-count", "Too many quiet zones", error.to_string())
            }
            PlanError::Together { option, value, allowed } => {
                let detail = error.to_string();
                Self::new(StatusCode::BAD_REQUEST, "options", "Options that do not go together", detail).at(
                    option,
                    value.into(),
                    format!("only with {allowed}"),
                    None,
                )
            }
            PlanError::EmptyZone => {
                Self::new(StatusCode::BAD_REQUEST, "out-of-range", "A zone without a point", error.to_string())
            }
            PlanError::Cutout { .. } => {
                Self::new(StatusCode::BAD_REQUEST, "in-cutout", "There is no surface at this point", error.to_string())
            }
            PlanError::NoActuators | PlanError::Actuators { .. } | PlanError::NoFrequencies => {
                Self::new(StatusCode::UNPROCESSABLE_ENTITY, "no-plan", "This scene has no plan", error.to_string())
            }
        }
    }
}

impl From<SessionError> for Problem {
    fn from(error: SessionError) -> Self {
        let detail = error.to_string();
        match error {
            SessionError::Fault { .. } => Self::new(
                StatusCode::CONFLICT,
                "device-fault",
                "The device is in a fault",
                format!("{detail} (`era clear`, or POST /v1/faults/clear, clears it)"),
            ),
            SessionError::Link(LinkError::Refused(Refusal::Duty { wait_ms, .. })) => {
                Self::new(StatusCode::CONFLICT, "device-refused", "The device refused", detail)
                    .retry(u64::from(wait_ms), None)
            }
            SessionError::Link(LinkError::Refused(_) | LinkError::TooOld { .. }) | SessionError::NotArmed { .. } => {
                Self::new(StatusCode::CONFLICT, "device-refused", "The device refused", detail)
            }
            SessionError::Link(_) | SessionError::Disconnected { .. } => {
                Self::new(StatusCode::BAD_GATEWAY, "device-lost", "The device does not answer", detail)
            }
            SessionError::Away { .. } => Self::new(
                StatusCode::CONFLICT,
                "not-armed",
                "The device waits to be armed",
                format!("{detail} (`era arm`, or POST /v1/arm, arms it)"),
            ),
            SessionError::Unfit { .. } => {
                Self::new(StatusCode::CONFLICT, "device-unfit", "The device does not fit the scene", detail)
            }
            SessionError::Stopped => Self::new(StatusCode::CONFLICT, "stopped", "Stopped meanwhile", detail),
            SessionError::Closed => {
                Self::new(StatusCode::SERVICE_UNAVAILABLE, "closing", "The daemon is shutting down", detail)
            }
        }
    }
}
