//! Which problems each path may answer with, as responses of the description.

use crate::daemon::access::permissions::Role;
use crate::daemon::api::kinds::{Kind, URN};
use serde_json::{Map, Value, json};
use std::collections::BTreeMap;

/// Whatever is asked for: who asks is looked at, and a body is read, before anything else.
const ALWAYS: &[Kind] = &[
    Kind::BadHeader,
    Kind::ForeignOrigin,
    Kind::ForeignHost,
    Kind::BadBody,
    Kind::LongBody,
    Kind::SlowBody,
    Kind::ContentCoding,
    Kind::TransferCoding,
    Kind::Internal,
];

/// What a path may answer with beside that.
fn own(path: &str) -> &'static [Kind] {
    match path {
        "/v1/touch" => &[
            Kind::ContentType,
            Kind::OutOfRange,
            Kind::EmptyZone,
            Kind::TouchCount,
            Kind::QuietCount,
            Kind::Options,
            Kind::InCutout,
            Kind::NoPlan,
            Kind::QueueFull,
            Kind::Stopped,
            Kind::Superseded,
            Kind::DeviceFault,
            Kind::DeviceRefused,
            Kind::DeviceUnfit,
            Kind::NotArmed,
            Kind::DeviceLost,
            Kind::DeviceLate,
            Kind::SessionEnded,
            Kind::SessionHangs,
            Kind::Closing,
        ],
        "/v1/preview" => &[
            Kind::ContentType,
            Kind::OutOfRange,
            Kind::InCutout,
            Kind::BadScene,
            Kind::NoPlan,
            Kind::NoModel,
            Kind::TooLarge,
            Kind::PreviewSuperseded,
            Kind::QueueFull,
            Kind::PreviewFailed,
        ],
        "/v1/study" => &[
            Kind::ContentType,
            Kind::BadScene,
            Kind::NoModel,
            Kind::TooLarge,
            Kind::StudyRuns,
            Kind::TolerancesRun,
            Kind::PreviewFailed,
        ],
        "/v1/tolerances" => &[
            Kind::ContentType,
            Kind::OutOfRange,
            Kind::InCutout,
            Kind::BadScene,
            Kind::NoPlan,
            Kind::NoModel,
            Kind::TooLarge,
            Kind::StudyRuns,
            Kind::TolerancesRun,
            Kind::PreviewFailed,
            Kind::Closing,
        ],
        "/v1/requests/{id}" => &[Kind::BadPath, Kind::NotFound],
        "/v1/field" => {
            &[Kind::BadQuery, Kind::OutOfRange, Kind::InCutout, Kind::NoPlan, Kind::QueueFull, Kind::Closing]
        }
        "/v1/stop" => &[
            Kind::DeviceRefused,
            Kind::DeviceLost,
            Kind::DeviceLate,
            Kind::SessionEnded,
            Kind::SessionHangs,
            Kind::Closing,
        ],
        "/v1/faults/clear" => &[
            Kind::QueueFull,
            Kind::DeviceRefused,
            Kind::DeviceLost,
            Kind::DeviceLate,
            Kind::SessionEnded,
            Kind::SessionHangs,
            Kind::Closing,
        ],
        "/v1/arm" => &[
            Kind::QueueFull,
            Kind::Stopped,
            Kind::DeviceFault,
            Kind::DeviceRefused,
            Kind::DeviceUnfit,
            Kind::DeviceLost,
            Kind::DeviceLate,
            Kind::SessionEnded,
            Kind::SessionHangs,
            Kind::Closing,
        ],
        "/v1/live" => {
            &[Kind::BadQuery, Kind::NoWebsocket, Kind::NoWebsocketMethod, Kind::NoWebsocketUpgrade, Kind::SocketsFull]
        }
        _ => &[],
    }
}

/// The responses of a path that tell of problems, by their status.
pub fn of(path: &str, role: Option<Role>) -> Map<String, Value> {
    let mut kinds = ALWAYS.to_vec();
    // Its body is not read.
    let is_of_a_body =
        |kind: &Kind| matches!(kind, Kind::BadBody | Kind::LongBody | Kind::SlowBody | Kind::ContentCoding);
    kinds.retain(|kind| path != "/v1/stop" || !is_of_a_body(kind));
    kinds.extend(own(path));
    kinds.extend(role.map(|_| Kind::Token));
    // Every token may look.
    kinds.extend(role.filter(|role| *role > Role::View).map(|_| Kind::Role));
    // There is always a way to stop.
    kinds.extend((path != "/v1/stop").then_some(Kind::ConnectionsFull));
    let mut by_status: BTreeMap<u16, Vec<Kind>> = BTreeMap::new();
    for kind in kinds {
        by_status.entry(kind.status().as_u16()).or_default().push(kind);
    }
    by_status.into_iter().map(|(status, kinds)| (status.to_string(), response(&kinds))).collect()
}

/// What is answered where there is nothing, or not by that method.
pub fn everywhere() -> Value {
    json!({"NotFound": response(&[Kind::NotFound]), "WrongMethod": response(&[Kind::WrongMethod])})
}

/// A response with one of several problems of one status.
fn response(kinds: &[Kind]) -> Value {
    let told: Vec<String> = kinds.iter().map(|kind| format!("`{}`: {}", kind.name(), kind.meaning())).collect();
    let status = kinds.first().map(|kind| kind.status().as_u16());
    let mut types: Vec<String> = kinds.iter().map(|kind| urn(*kind)).collect();
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
    if kinds.iter().any(|kind| may_be_asked_again(*kind)) {
        headers.insert("retry-after".into(), json!({
            "description": "When to ask again, in whole seconds; `retry_after_ms` says it in ms. Absent where that is not known",
            "schema": {"type": "integer", "minimum": 1},
        }));
    }
    for (name, about) in kinds.iter().filter_map(|kind| header_of(*kind)) {
        headers.insert(name.into(), json!({"description": about, "schema": {"type": "string"}}));
    }
    if !headers.is_empty() {
        response["headers"] = headers.into();
    }
    response
}

/// The header that says what is wanted instead, and what it says.
const fn header_of(kind: Kind) -> Option<(&'static str, &'static str)> {
    match kind {
        Kind::Token | Kind::Role => {
            Some(("www-authenticate", "That a token is wanted (RFC 6750), and what is wrong with the one that came"))
        }
        Kind::ContentCoding => Some(("accept-encoding", "`identity`: no compression is taken")),
        Kind::NoWebsocketUpgrade => Some(("sec-websocket-version", "The version that is spoken: 13")),
        _ => None,
    }
}

/// Whether it may say when to ask again.
const fn may_be_asked_again(kind: Kind) -> bool {
    matches!(kind, Kind::QueueFull | Kind::ConnectionsFull | Kind::SocketsFull | Kind::DeviceRefused | Kind::DeviceLate)
}

fn urn(kind: Kind) -> String {
    format!("{URN}{}", kind.name())
}

/// Puts the list of all types among the schemas, and into that of a problem.
pub fn put_kinds(schemas: &mut Map<String, Value>) {
    let mut all: Vec<(String, Vec<Kind>)> = Vec::new();
    for kind in Kind::ALL {
        let urn = urn(*kind);
        match all.iter_mut().find(|(known, _)| *known == urn) {
            Some((_, kinds)) => kinds.push(*kind),
            None => all.push((urn, vec![*kind])),
        }
    }
    let one = |(urn, kinds): (String, Vec<Kind>)| {
        let mut status: Vec<u16> = kinds.iter().map(|kind| kind.status().as_u16()).collect();
        status.sort_unstable();
        status.dedup();
        let told: Vec<String> =
            kinds.iter().map(|kind| format!("{}: {}", kind.status().as_u16(), kind.meaning())).collect();
        json!({"const": urn, "description": told.join(" "), "x-status": status})
    };
    let list: Vec<Value> = all.into_iter().map(one).collect();
    let about = "All types of problems, with their statuses: programs go by these.";
    schemas.insert("ProblemType".into(), json!({"type": "string", "description": about, "oneOf": list}));
    if let Some(kind) = schemas.get_mut("Problem").and_then(|problem| problem.pointer_mut("/properties/type")) {
        *kind = json!({"$ref": "#/components/schemas/ProblemType"});
    }
}
