//! Errors as RFC 9457 "problem+json", with the field, its value and the allowed range where there are any.

pub use super::kinds::ProblemKind;
use super::kinds::URN;
use crate::device::{LinkError, SessionError};
use crate::model::ModelError;
use crate::planner::PlanError;
use crate::response::ResponseError;
use crate::scene::{PixelError, SceneError};
use axum::http::{HeaderName, HeaderValue, StatusCode, header};
use axum::response::{IntoResponse, Response};
use era_shared::protocol::Refusal;
use serde::Serialize;
use serde_json::Value;
use std::borrow::Cow;
use utoipa::openapi::{RefOr, Schema};
use utoipa::{PartialSchema, ToSchema};

/// After how long a device that is late may be tried again: it is asked so often itself (`device::timing::REAL_TIME`).
const LATE_AGAIN_MS: u64 = 100;

/// One problem, boxed: it travels through many results.
#[derive(Clone, Debug, Serialize)]
#[serde(transparent)]
pub struct Problem(Box<ProblemContent>);

/// An error (RFC 9457).
#[derive(Clone, Debug, Serialize, ToSchema)]
#[schema(as = Problem)]
struct ProblemContent {
    /// Type of the problem, which programs can rely on: `urn:era:problem:` and a name.
    #[serde(rename = "type")]
    kind: String,
    /// Short text for the type.
    title: &'static str,
    /// HTTP status of the answer.
    status: u16,
    /// Text for this occurrence of the problem.
    detail: String,
    /// The field of the request that is wrong; absent if the problem is not about one field.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schema(nullable = false)]
    field: Option<String>,
    /// The `id` of the finger that the problem is about; only on a live socket.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schema(nullable = false)]
    finger: Option<i64>,
    /// The value of `field`.
    #[serde(skip_serializing_if = "Option::is_none")]
    value: Option<Value>,
    /// The values that are allowed for `field`.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schema(nullable = false)]
    allowed: Option<String>,
    /// Line of the mistake in the scene file, from 1.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schema(nullable = false, minimum = 1)]
    line: Option<usize>,
    /// Time after which to send the request again, in ms.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schema(nullable = false)]
    retry_after_ms: Option<u64>,
    /// Number of requests, clients or sockets that already wait or are open.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schema(nullable = false)]
    depth: Option<usize>,
    /// All mistakes of the scene or the study; the fields above describe the first mistake.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    mistakes: Vec<MistakeView>,
    /// What goes beside it into the head of an answer.
    #[serde(skip)]
    headers: Vec<(HeaderName, HeaderValue)>,
}

/// One mistake of a scene or a study.
#[derive(Clone, Debug, Serialize, ToSchema)]
#[schema(as = Mistake)]
struct MistakeView {
    /// Line of the mistake, from 1; null if the mistake has no line.
    #[schema(minimum = 1)]
    line: Option<usize>,
    /// The mistake in words.
    detail: String,
}

impl Problem {
    /// A problem of a kind.
    #[must_use]
    pub fn new(kind: ProblemKind, detail: impl Into<String>) -> Self {
        Self(Box::new(ProblemContent {
            kind: format!("{URN}{}", kind.name()),
            title: kind.title(),
            status: kind.http_status().as_u16(),
            detail: detail.into(),
            field: None,
            finger: None,
            value: None,
            allowed: None,
            line: None,
            retry_after_ms: None,
            depth: None,
            mistakes: Vec::new(),
            headers: Vec::new(),
        }))
    }

    /// With the field that is wrong, its value, what is allowed, and its line in the scene.
    #[must_use]
    pub fn with_field_and_value(mut self, field: &str, value: Value, allowed: String, line: Option<usize>) -> Self {
        self.0.field = Some(field.into());
        self.0.value = Some(value);
        self.0.allowed = Some(allowed);
        self.0.line = line;
        self
    }

    /// With the field that it is about, which has no value.
    #[must_use]
    pub fn with_field(mut self, field: String) -> Self {
        self.0.field = Some(field);
        self
    }

    /// To be asked again after so many ms; so many wait before it.
    #[must_use]
    pub fn with_retry(mut self, retry_after_ms: u64, queue_depth: Option<usize>) -> Self {
        self.0.retry_after_ms = Some(retry_after_ms);
        self.0.depth = queue_depth;
        self
    }

    /// With a line in the head of its answer.
    #[must_use]
    pub fn with_header(mut self, name: HeaderName, value: &str) -> Self {
        self.0.headers.extend(HeaderValue::from_str(value).ok().map(|value| (name, value)));
        self
    }

    /// HTTP status.
    #[must_use]
    pub fn status(&self) -> StatusCode {
        StatusCode::from_u16(self.0.status).unwrap_or(StatusCode::INTERNAL_SERVER_ERROR)
    }

    /// A number outside its range.
    #[must_use]
    pub fn out_of_range(field: &str, value: f64, min: impl std::fmt::Display, max: impl std::fmt::Display) -> Self {
        let max = max.to_string();
        let (allowed, range) = if max == "inf" {
            (format!("at least {min}"), format!("at least {min}"))
        } else {
            (format!("{min} to {max}"), format!("{min} to {max}"))
        };
        let detail = format!("{field} is {value}, but must be {range}");
        Self::new(ProblemKind::OutOfRange, detail).with_field_and_value(field, value.into(), allowed, None)
    }

    /// A body that could not be read.
    #[must_use]
    pub fn bad_body(detail: String) -> Self {
        Self::new(ProblemKind::BadBody, detail)
    }

    /// The same in a part of the request, `also[0]` say; as it is without one. What is wrong with no field of it is wrong with the
    /// whole part.
    #[must_use]
    pub fn prefix_field_and_detail_if_prefix_given(mut self, prefix: Option<String>) -> Self {
        let Some(prefix) = prefix else { return self };
        let (field, detail) = match &self.0.field {
            Some(field) => (format!("{prefix}.{field}"), format!("{prefix}.{}", self.0.detail)),
            None => (prefix.clone(), format!("{prefix}: {}", self.0.detail)),
        };
        (self.0.field, self.0.detail) = (Some(field), detail);
        self
    }

    /// With the number of the finger that it is about.
    #[must_use]
    pub fn with_finger_id_and_detail_prefix(mut self, id: i64) -> Self {
        self.0.finger = Some(id);
        self.0.detail = format!("finger {id}: {}", self.0.detail);
        self
    }

    /// Whether it is of this kind.
    #[must_use]
    pub fn is_kind(&self, kind_name: &str) -> bool {
        self.0.kind.rsplit(':').next() == Some(kind_name)
    }

    /// In words.
    #[must_use]
    pub fn detail(&self) -> &str {
        &self.0.detail
    }
}

impl PartialSchema for Problem {
    fn schema() -> RefOr<Schema> {
        ProblemContent::schema()
    }
}

impl ToSchema for Problem {
    fn name() -> Cow<'static, str> {
        ProblemContent::name()
    }

    fn schemas(schemas: &mut Vec<(String, RefOr<Schema>)>) {
        ProblemContent::schemas(schemas);
    }
}

impl IntoResponse for Problem {
    fn into_response(self) -> Response {
        let body = serde_json::to_vec(&self).unwrap_or_default();
        let mut response = (self.status(), [(header::CONTENT_TYPE, "application/problem+json")], body).into_response();
        response.headers_mut().extend(self.0.headers);
        if let Some(ms) = self.0.retry_after_ms {
            // Whole seconds, the least of which is one (RFC 9110, 10.2.3); the body says it in ms.
            response.headers_mut().insert(header::RETRY_AFTER, HeaderValue::from(ms.div_ceil(1000)));
        }
        response
    }
}

impl From<crate::scene::ScreenError> for Problem {
    fn from(error: crate::scene::ScreenError) -> Self {
        Self::out_of_range(error.field, error.value, error.min, error.max)
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
        let mut problem = Self::new(ProblemKind::BadScene, error.to_string());
        let line = |line: usize| (line > 0).then_some(line);
        if let Some(first) = error.mistakes.first() {
            problem.0.line = line(first.line);
            problem.0.field.clone_from(&first.field);
            problem.0.allowed.clone_from(&first.allowed);
            // Numbers and texts of TOML as those of JSON; what has no like there, as it was written.
            let value = |text: &String| serde_json::from_str(text).unwrap_or_else(|_| text.as_str().into());
            problem.0.value = first.value.as_ref().map(value);
        }
        let view = |mistake: crate::scene::FileMistake| MistakeView { line: line(mistake.line), detail: mistake.text };
        problem.0.mistakes = error.mistakes.into_iter().map(view).collect();
        problem
    }
}

impl From<ModelError> for Problem {
    fn from(error: ModelError) -> Self {
        Self::new(ProblemKind::NoModel, error.to_string())
    }
}

impl From<ResponseError> for Problem {
    fn from(error: ResponseError) -> Self {
        Self::new(ProblemKind::NoPlan, error.to_string())
    }
}

impl From<PlanError> for Problem {
    fn from(error: PlanError) -> Self {
        match error {
            PlanError::Range { field, value, min, max } => Self::out_of_range(field, value, min, max),
            PlanError::Count { .. } => Self::new(ProblemKind::TouchCount, error.to_string()),
            PlanError::Quiet { .. } => Self::new(ProblemKind::QuietCount, error.to_string()),
            PlanError::Together { option, value, allowed } => {
                let detail = error.to_string();
                Self::new(ProblemKind::Options, detail).with_field_and_value(
                    option,
                    value.into(),
                    format!("only with {allowed}"),
                    None,
                )
            }
            PlanError::EmptyZone => Self::new(ProblemKind::EmptyZone, error.to_string()),
            PlanError::Cutout(_) => Self::new(ProblemKind::InCutout, error.to_string()),
            PlanError::NoActuators | PlanError::Actuators { .. } | PlanError::NoFrequencies | PlanError::Stopped => {
                Self::new(ProblemKind::NoPlan, error.to_string())
            }
        }
    }
}

impl From<SessionError> for Problem {
    fn from(error: SessionError) -> Self {
        let detail = error.to_string();
        match error {
            SessionError::Fault { .. } => Self::new(
                ProblemKind::DeviceFault,
                format!("{detail} (`era clear`, or POST /v1/faults/clear, clears the fault)"),
            ),
            SessionError::Link(LinkError::Refused(Refusal::Duty { wait_ms, .. })) => {
                Self::new(ProblemKind::DeviceRefused, detail).with_retry(u64::from(wait_ms), None)
            }
            SessionError::Link(LinkError::Refused(_) | LinkError::TooOld { .. }) | SessionError::NotArmed { .. } => {
                Self::new(ProblemKind::DeviceRefused, detail)
            }
            SessionError::Link(_) | SessionError::Disconnected { .. } => Self::new(ProblemKind::DeviceLost, detail),
            SessionError::Late { .. } => Self::new(ProblemKind::DeviceLate, detail).with_retry(LATE_AGAIN_MS, None),
            SessionError::Away { is_faulty, .. } => {
                let first = if is_faulty {
                    "the device also has a fault: first clear the fault with `era clear` or POST /v1/faults/clear; then "
                } else {
                    ""
                };
                Self::new(
                    ProblemKind::NotArmed,
                    format!("{detail} ({first}`era arm`, or POST /v1/arm, arms the device)"),
                )
            }
            SessionError::Unfit { .. } => Self::new(ProblemKind::DeviceUnfit, detail),
            SessionError::Stopped | SessionError::Broken => Self::new(ProblemKind::Stopped, detail),
            SessionError::Closed => Self::new(ProblemKind::Closing, detail),
            SessionError::Ended => Self::new(ProblemKind::SessionEnded, detail),
            SessionError::Hangs => Self::new(ProblemKind::SessionHangs, detail),
        }
    }
}
