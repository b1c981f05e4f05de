//! Which problems each path may answer with, as responses of the description.

use crate::daemon::access::permissions::Role;
use crate::daemon::api::kinds::{ProblemKind, URN};
use serde_json::{Map, Value, json};
use std::collections::BTreeMap;

/// Whatever is asked for: who asks is looked at, and a body is read, before anything else.
const ALWAYS: &[ProblemKind] = &[
    ProblemKind::BadHeader,
    ProblemKind::ForeignOrigin,
    ProblemKind::ForeignHost,
    ProblemKind::BadBody,
    ProblemKind::LongBody,
    ProblemKind::SlowBody,
    ProblemKind::ContentCoding,
    ProblemKind::TransferCoding,
    ProblemKind::Internal,
];

/// What a path may answer with beside that.
fn list_path_specific_problem_kinds(path: &str) -> &'static [ProblemKind] {
    match path {
        "/v1/touch" => &[
            ProblemKind::ContentType,
            ProblemKind::OutOfRange,
            ProblemKind::EmptyZone,
            ProblemKind::TouchCount,
            ProblemKind::QuietCount,
            ProblemKind::Options,
            ProblemKind::InCutout,
            ProblemKind::NoPlan,
            ProblemKind::QueueFull,
            ProblemKind::Stopped,
            ProblemKind::Superseded,
            ProblemKind::DeviceFault,
            ProblemKind::DeviceRefused,
            ProblemKind::DeviceUnfit,
            ProblemKind::NotArmed,
            ProblemKind::DeviceLost,
            ProblemKind::DeviceLate,
            ProblemKind::SessionEnded,
            ProblemKind::SessionHangs,
            ProblemKind::Closing,
        ],
        "/v1/effects" => &[
            ProblemKind::ContentType,
            ProblemKind::OutOfRange,
            ProblemKind::InCutout,
            ProblemKind::TooLarge,
            ProblemKind::NoPlan,
            ProblemKind::QueueFull,
            ProblemKind::Stopped,
            ProblemKind::Superseded,
            ProblemKind::DeviceFault,
            ProblemKind::DeviceRefused,
            ProblemKind::DeviceUnfit,
            ProblemKind::NotArmed,
            ProblemKind::DeviceLost,
            ProblemKind::DeviceLate,
            ProblemKind::SessionEnded,
            ProblemKind::SessionHangs,
            ProblemKind::Closing,
        ],
        "/v1/preview" => &[
            ProblemKind::ContentType,
            ProblemKind::OutOfRange,
            ProblemKind::InCutout,
            ProblemKind::BadScene,
            ProblemKind::NoPlan,
            ProblemKind::NoModel,
            ProblemKind::TooLarge,
            ProblemKind::ComputationSuperseded,
            ProblemKind::QueueFull,
            ProblemKind::PreviewFailed,
        ],
        "/v1/study" => &[
            ProblemKind::ContentType,
            ProblemKind::BadScene,
            ProblemKind::NoModel,
            ProblemKind::TooLarge,
            ProblemKind::StudyRuns,
            ProblemKind::TolerancesRun,
            ProblemKind::ComputationSuperseded,
            ProblemKind::QueueFull,
            ProblemKind::PreviewFailed,
            ProblemKind::Closing,
        ],
        "/v1/tolerances" => &[
            ProblemKind::ContentType,
            ProblemKind::OutOfRange,
            ProblemKind::InCutout,
            ProblemKind::BadScene,
            ProblemKind::NoPlan,
            ProblemKind::NoModel,
            ProblemKind::TooLarge,
            ProblemKind::StudyRuns,
            ProblemKind::TolerancesRun,
            ProblemKind::ComputationSuperseded,
            ProblemKind::QueueFull,
            ProblemKind::PreviewFailed,
            ProblemKind::Closing,
        ],
        "/v1/requests/{id}" => &[ProblemKind::BadPath, ProblemKind::NotFound],
        "/v1/field" => &[
            ProblemKind::BadQuery,
            ProblemKind::OutOfRange,
            ProblemKind::InCutout,
            ProblemKind::NoPlan,
            ProblemKind::QueueFull,
            ProblemKind::Closing,
        ],
        "/v1/stop" => &[
            ProblemKind::DeviceRefused,
            ProblemKind::DeviceLost,
            ProblemKind::DeviceLate,
            ProblemKind::SessionEnded,
            ProblemKind::SessionHangs,
            ProblemKind::Closing,
        ],
        "/v1/faults/clear" => &[
            ProblemKind::QueueFull,
            ProblemKind::DeviceRefused,
            ProblemKind::DeviceLost,
            ProblemKind::DeviceLate,
            ProblemKind::SessionEnded,
            ProblemKind::SessionHangs,
            ProblemKind::Closing,
        ],
        "/v1/arm" => &[
            ProblemKind::QueueFull,
            ProblemKind::Stopped,
            ProblemKind::DeviceFault,
            ProblemKind::DeviceRefused,
            ProblemKind::DeviceUnfit,
            ProblemKind::DeviceLost,
            ProblemKind::DeviceLate,
            ProblemKind::SessionEnded,
            ProblemKind::SessionHangs,
            ProblemKind::Closing,
        ],
        "/v1/live" => &[
            ProblemKind::BadQuery,
            ProblemKind::NoWebsocket,
            ProblemKind::NoWebsocketMethod,
            ProblemKind::NoWebsocketUpgrade,
            ProblemKind::SocketsFull,
        ],
        _ => &[],
    }
}

/// The responses of a path that tell of problems, by their status.
pub fn build_problem_responses_of_path(path: &str, role: Option<Role>) -> Map<String, Value> {
    let mut kinds = ALWAYS.to_vec();
    // Its body is not read.
    let is_of_a_body = |kind: &ProblemKind| {
        matches!(
            kind,
            ProblemKind::BadBody | ProblemKind::LongBody | ProblemKind::SlowBody | ProblemKind::ContentCoding
        )
    };
    kinds.retain(|kind| path != "/v1/stop" || !is_of_a_body(kind));
    kinds.extend(list_path_specific_problem_kinds(path));
    kinds.extend(role.map(|_| ProblemKind::Token));
    // Every token may look.
    kinds.extend(role.filter(|role| *role > Role::View).map(|_| ProblemKind::Role));
    // There is always a way to stop.
    kinds.extend((path != "/v1/stop").then_some(ProblemKind::ConnectionsFull));
    let mut by_status: BTreeMap<u16, Vec<ProblemKind>> = BTreeMap::new();
    for kind in kinds {
        by_status.entry(kind.http_status().as_u16()).or_default().push(kind);
    }
    by_status.into_iter().map(|(status, kinds)| (status.to_string(), build_problem_response(&kinds))).collect()
}

/// What is answered where there is nothing, or not by that method.
pub fn build_not_found_and_wrong_method_responses() -> Value {
    json!({"NotFound": build_problem_response(&[ProblemKind::NotFound]), "WrongMethod": build_problem_response(&[ProblemKind::WrongMethod])})
}

/// A response with one of several problems of one status.
fn build_problem_response(kinds: &[ProblemKind]) -> Value {
    let told: Vec<String> =
        kinds.iter().map(|kind| format!("`{}`: {}", kind.name(), kind.meaning_in_words())).collect();
    let status = kinds.first().map(|kind| kind.http_status().as_u16());
    let mut types: Vec<String> = kinds.iter().map(|kind| format_problem_urn(*kind)).collect();
    types.dedup();
    types.sort();
    types.dedup();
    let schema = json!({"allOf": [
        {"$ref": "#/components/schemas/Problem"},
        {"type": "object", "properties": {"type": {"enum": types}, "status": {"const": status}}},
    ]});
    let mut response =
        json!({"description": told.join(" "), "content": {"application/problem+json": {"schema": schema}}});
    let mut headers = Map::new();
    if kinds.iter().any(|kind| may_have_retry_time(*kind)) {
        headers.insert("retry-after".into(), json!({
            "description": "Time after which to send the request again, in whole seconds; `retry_after_ms` is the same time in ms. \
                Absent if this time is not known",
            "schema": {"type": "integer", "minimum": 1},
        }));
    }
    for (name, about) in
        kinds.iter().filter_map(|kind| name_and_description_of_answer_header_besides_retry_after(*kind))
    {
        headers.insert(name.into(), json!({"description": about, "schema": {"type": "string"}}));
    }
    if !headers.is_empty() {
        response["headers"] = headers.into();
    }
    response
}

/// The header that says what is wanted instead, and what it says.
const fn name_and_description_of_answer_header_besides_retry_after(
    kind: ProblemKind,
) -> Option<(&'static str, &'static str)> {
    match kind {
        ProblemKind::Token | ProblemKind::Role => Some((
            "www-authenticate",
            "Says that a token is required (RFC 6750), and why the token in the request is not sufficient",
        )),
        ProblemKind::ContentCoding => Some(("accept-encoding", "`identity`: compression is not accepted")),
        ProblemKind::NoWebsocketUpgrade => Some(("sec-websocket-version", "The WebSocket version of the daemon: 13")),
        _ => None,
    }
}

/// Whether it may say when to ask again.
const fn may_have_retry_time(kind: ProblemKind) -> bool {
    matches!(
        kind,
        ProblemKind::QueueFull
            | ProblemKind::ConnectionsFull
            | ProblemKind::SocketsFull
            | ProblemKind::DeviceRefused
            | ProblemKind::DeviceLate
    )
}

fn format_problem_urn(kind: ProblemKind) -> String {
    format!("{URN}{}", kind.name())
}

/// Puts the list of all types among the schemas, and into that of a problem.
pub fn insert_problem_types(schemas: &mut Map<String, Value>) {
    let mut all: Vec<(String, Vec<ProblemKind>)> = Vec::new();
    for kind in ProblemKind::ALL {
        let urn = format_problem_urn(*kind);
        match all.iter_mut().find(|(known, _)| *known == urn) {
            Some((_, kinds)) => kinds.push(*kind),
            None => all.push((urn, vec![*kind])),
        }
    }
    let one = |(urn, kinds): (String, Vec<ProblemKind>)| {
        let mut status: Vec<u16> = kinds.iter().map(|kind| kind.http_status().as_u16()).collect();
        status.sort_unstable();
        status.dedup();
        let told: Vec<String> =
            kinds.iter().map(|kind| format!("{}: {}", kind.http_status().as_u16(), kind.meaning_in_words())).collect();
        json!({"const": urn, "description": told.join(" "), "x-status": status})
    };
    let list: Vec<Value> = all.into_iter().map(one).collect();
    let about = "All types of problems, with their statuses. Programs should use these types to recognise problems.";
    schemas.insert("ProblemType".into(), json!({"type": "string", "description": about, "oneOf": list}));
    if let Some(kind) = schemas.get_mut("Problem").and_then(|problem| problem.pointer_mut("/properties/type")) {
        *kind = json!({"$ref": "#/components/schemas/ProblemType"});
    }
}
