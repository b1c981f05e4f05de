//! Bodies, read whole and in time, and the headers that say what they are.

use crate::daemon::access::head::check_content_coding_is_identity_or_absent;
use crate::daemon::api::json::{ExpectedForm, parse_json_object};
use crate::daemon::api::problem::{Problem, ProblemKind};
use crate::daemon::touch::admission::MAX_NAME;
use crate::text_file::BYTE_ORDER_MARK;
use axum::body::{Body, Bytes, HttpBody};
use axum::extract::{Request, State};
use axum::http::{HeaderMap, HeaderName, header};
use axum::middleware::Next;
use axum::response::{IntoResponse, Response};
use serde::de::DeserializeOwned;
use std::time::Duration;

/// Content types that say nothing against JSON: what `curl -d`, plain sockets and HTTP libraries say of any text.
const TAKEN: [&str; 4] =
    ["application/json", "application/x-www-form-urlencoded", "text/plain", "application/octet-stream"];

/// Refuses a body that is said to be something else than JSON.
///
/// # Errors
/// [`Problem`] with status 415, or 400 if there are several types.
pub fn check_content_type_is_json_generic_or_absent(headers: &HeaderMap) -> Result<(), Problem> {
    check_header_given_at_most_once(headers, &header::CONTENT_TYPE)?;
    let Some(value) = headers.get(header::CONTENT_TYPE) else { return Ok(()) };
    let said = value.to_str().unwrap_or("not ASCII");
    let kind = said.split(';').next().unwrap_or_default().trim().to_ascii_lowercase();
    if kind.is_empty() || TAKEN.contains(&kind.as_str()) || kind.ends_with("+json") {
        return Ok(());
    }
    let detail = format!("the header content-type is {said:?}, but must be application/json");
    let problem = Problem::new(ProblemKind::ContentType, detail);
    Err(problem.with_field_and_value("content-type", said.into(), "application/json".into(), None))
}

fn check_header_given_at_most_once(headers: &HeaderMap, name: &HeaderName) -> Result<(), Problem> {
    if headers.get_all(name).iter().nth(1).is_none() {
        return Ok(());
    }
    let detail = format!("the header {name} is given several times, but is allowed only once");
    Err(Problem::new(ProblemKind::BadHeader, detail).with_field(name.to_string()))
}

/// What the client calls its request, in the header `x-request-id`.
///
/// # Errors
/// [`Problem`] if there are several, or if that is too long, or not made of letters, digits and `-_.`.
pub fn read_client_request_name(headers: &HeaderMap) -> Result<Option<String>, Problem> {
    let name = HeaderName::from_static("x-request-id");
    check_header_given_at_most_once(headers, &name)?;
    let Some(value) = headers.get(&name) else { return Ok(None) };
    let is_plain = |text: &&str| {
        let plain = |c: char| c.is_ascii_alphanumeric() || "-_.".contains(c);
        // Numbers are the daemon's own names for requests.
        let is_number = text.chars().all(|c| c.is_ascii_digit());
        (1..=MAX_NAME).contains(&text.len()) && text.chars().all(plain) && !is_number
    };
    match value.to_str().ok().filter(is_plain) {
        Some(text) => Ok(Some(text.to_owned())),
        None => {
            let said = String::from_utf8_lossy(value.as_bytes()).into_owned();
            let allowed = format!(
                "1 to {MAX_NAME} characters (letters, digits, '-', '_' and '.'), at least one of them not a digit"
            );
            let detail = format!("the header x-request-id is {said:?}, but must be {allowed}");
            let problem = Problem::new(ProblemKind::BadHeader, detail);
            Err(problem.with_field_and_value("x-request-id", said.into(), allowed, None))
        }
    }
}

/// How long a body may be in bytes, and in time.
#[derive(Clone, Copy, Debug)]
pub struct BodyLimit {
    /// Bytes.
    pub bytes: usize,
    /// From the headers to the last byte.
    pub time: Duration,
}

/// Reads a request's body before anything is done with it.
pub async fn read_uncompressed_body_within_limit(
    State(BodyLimit { bytes: most, time }): State<BodyLimit>,
    request: Request,
    next: Next,
) -> Response {
    let (parts, body) = request.into_parts();
    // Before anything is read: whoever asks whether to send it (`Expect: 100-continue`) is told to with the first look.
    if !body.is_end_stream()
        && let Err(problem) = check_content_coding_is_identity_or_absent(&parts.headers)
    {
        return problem.into_response();
    }
    let announced = body.size_hint().lower();
    if usize::try_from(announced).is_ok_and(|announced| announced > most) {
        let detail = format!("the body has {announced} bytes, but may have at most {most} bytes");
        return Problem::new(ProblemKind::LongBody, detail).into_response();
    }
    match tokio::time::timeout(time, axum::body::to_bytes(body, most)).await {
        Ok(Ok(mut bytes)) => {
            // A parser may pass over it (RFC 8259, 8.1), and no body means something else by it.
            if bytes.starts_with(BYTE_ORDER_MARK.as_bytes()) {
                bytes = bytes.slice(BYTE_ORDER_MARK.len()..);
            }
            next.run(Request::from_parts(parts, Body::from(bytes))).await
        }
        Ok(Err(error)) => unreadable_body_problem(&error, most).into_response(),
        Err(_) => {
            let detail = format!("the body was not complete within {time:?} after the headers");
            Problem::new(ProblemKind::SlowBody, detail).into_response()
        }
    }
}

fn unreadable_body_problem(error: &axum::Error, max_bytes: usize) -> Problem {
    let (mut kind, mut cause) = (ProblemKind::BadBody, Some(error as &dyn std::error::Error));
    while let Some(error) = cause {
        if error.is::<http_body_util::LengthLimitError>() {
            kind = ProblemKind::LongBody;
        }
        cause = error.source();
    }
    let detail = format!("the body cannot be read: {error}; a body may have at most {max_bytes} bytes");
    Problem::new(kind, detail)
}

/// The request in a JSON body; `expected` says in a message what it should look like.
///
/// # Errors
/// [`Problem`]: another type of content, or what is wrong in the body.
pub fn parse_json_body<T: DeserializeOwned>(headers: &HeaderMap, body: &Bytes, expected: &str) -> Result<T, Problem> {
    check_content_type_is_json_generic_or_absent(headers)?;
    parse_json_object(body, ExpectedForm { subject: "The whole body", form: expected })
}
