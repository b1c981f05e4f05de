//! The description of the HTTP interface (OpenAPI 3.1), made from the routes and types that serve it.
//!
//! What a path takes and answers with comes from its handler and the types there; here it gets what they have in common: who
//! may ask, which problems there are (`problems`), and the ranges of numbers (`ranges`).

mod problems;
mod ranges;

use super::authorize::find_needed_role_unless_public;
use crate::daemon::access::permissions::Role;
use axum::http::Method;
use serde_json::{Map, Value, json};
use utoipa::openapi::OpenApi;

const ABOUT: &str = "Localized touch feedback: a touch at screen pixels becomes drives for electrostatic actuators. All numbers \
    are in SI units unless the name of the field has another unit. The daemon refuses requests of pages other than its own page, unless \
    --allow-origin names the origin of the page. If the daemon requires tokens, every request needs a token; `x-role` is the role that \
    the path needs. The daemon answers a path that is not described here with 404 (`#/components/responses/NotFound`), and a described \
    path with another method with 405 (`#/components/responses/WrongMethod`). Every path that accepts GET also accepts HEAD. If \
    --allow-origin names the origin of a page, browsers may send an OPTIONS request before a request of this page.";
const SERVER: &str = "The daemon that sent this description: use the scheme, host name and port with which you \
    requested this description, or the daemon's Unix socket";
const TOKEN: &str = "Required if the daemon was started with --token-file; /v1/live also accepts ?token=TOKEN";

/// The whole description as JSON text, of what the routes declare.
#[must_use]
pub fn build_openapi_json(declared: &OpenApi) -> String {
    let mut document = json!(declared);
    document["info"] = json!({"title": "ERA haptics daemon", "version": "1", "description": ABOUT});
    document["servers"] = json!([{"url": "/", "description": SERVER}]);
    document["components"]["securitySchemes"] =
        json!({"token": {"type": "http", "scheme": "bearer", "description": TOKEN}});
    document["components"]["responses"] = problems::build_not_found_and_wrong_method_responses();
    if let Some(schemas) = document.pointer_mut("/components/schemas").and_then(Value::as_object_mut) {
        schemas.values_mut().for_each(require_nullable_fields_unless_schema_is_closed);
        problems::insert_problem_types(schemas);
    }
    ranges::insert_ranges_lengths_and_patterns_of_request_fields(&mut document);
    join_description_lines_and_make_nonnegative_formats_unsigned(&mut document);
    if let Some(paths) = document["paths"].as_object_mut() {
        for (path, operations) in paths {
            for (method, operation) in operations.as_object_mut().into_iter().flatten() {
                complete_openapi_operation(path, method, operation);
            }
        }
    }
    document.to_string()
}

/// What belongs to an operation beside what its handler says.
fn complete_openapi_operation(path: &str, method: &str, operation: &mut Value) {
    let Ok(method) = Method::from_bytes(method.to_ascii_uppercase().as_bytes()) else { return };
    let role = find_needed_role_unless_public(&method, path);
    operation["security"] = if role.is_some() { json!([{}, {"token": []}]) } else { json!([]) };
    operation["x-role"] = role.map(Role::name).into();
    if path == "/v1/live" {
        let message = |name: &str| json!({"$ref": format!("#/components/schemas/{name}")});
        operation["x-websocket"] = json!({"receives": message("LiveIn"), "sends": message("LiveOut")});
    }
    if let Some(responses) = operation["responses"].as_object_mut() {
        responses.extend(problems::build_problem_responses_of_path(path, role));
    }
}

/// In what the daemon tells, an `Option` is null where there is nothing: its key is always there. One that may be left out says so
/// by not being null. Requests, which are closed, may leave out what may be null.
fn require_nullable_fields_unless_schema_is_closed(schema: &mut Value) {
    let Value::Object(map) = schema else { return };
    if map.get("additionalProperties") == Some(&Value::Bool(false)) {
        return;
    }
    let nullable: Vec<Value> = map
        .get("properties")
        .and_then(Value::as_object)
        .map(|properties| properties.iter().filter(|(_, own)| may_be_null(own)).map(|(name, _)| json!(name)).collect())
        .unwrap_or_default();
    if !nullable.is_empty() {
        let required = map.entry("required").or_insert_with(|| json!([]));
        if let Value::Array(required) = required {
            required.extend(nullable.into_iter().filter(|name| !required.contains(name)).collect::<Vec<_>>());
        }
    }
    for key in ["allOf", "oneOf", "anyOf"] {
        if let Some(Value::Array(parts)) = map.get_mut(key) {
            parts.iter_mut().for_each(require_nullable_fields_unless_schema_is_closed);
        }
    }
}

fn may_be_null(schema: &Value) -> bool {
    let is_null = |kind: &Value| kind == "null";
    match &schema["type"] {
        Value::Array(kinds) => kinds.iter().any(is_null),
        kind => is_null(kind) || schema["oneOf"].as_array().is_some_and(|parts| parts.iter().any(may_be_null)),
    }
}

/// Comments of the source are broken at its width; and a whole number from 0 on has no sign, whose largest are beyond those of one
/// with a sign.
fn join_description_lines_and_make_nonnegative_formats_unsigned(value: &mut Value) {
    match value {
        Value::Object(map) => {
            if let Some(Value::String(text)) = map.get_mut("description") {
                let parts: Vec<String> = text.split("\n\n").map(|part| part.replace('\n', " ")).collect();
                *text = parts.join("\n\n");
            }
            if map.get("minimum").and_then(Value::as_f64).is_some_and(|least| least >= 0.0) {
                match map.get("format").and_then(Value::as_str) {
                    Some("int32") => map.insert("format".into(), "uint32".into()),
                    Some("int64") => map.insert("format".into(), "uint64".into()),
                    _ => None,
                };
            }
            map.values_mut().for_each(join_description_lines_and_make_nonnegative_formats_unsigned);
        }
        Value::Array(list) => list.iter_mut().for_each(join_description_lines_and_make_nonnegative_formats_unsigned),
        _ => {}
    }
}

/// A schema of the components, by its name.
fn find_component_schema<'a>(document: &'a mut Value, name: &str) -> Option<&'a mut Map<String, Value>> {
    document.pointer_mut(&format!("/components/schemas/{name}")).and_then(Value::as_object_mut)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_may_be_null_is_always_there() {
        let mut answer = json!({"properties": {
            "a": {"type": ["number", "null"]}, "b": {"oneOf": [{"type": "null"}, {"$ref": "#"}]}, "c": {"type": "number"},
        }, "required": ["a"]});
        require_nullable_fields_unless_schema_is_closed(&mut answer);
        assert_eq!(answer["required"], json!(["a", "b"]));
        let mut request = json!({"properties": {"a": {"type": ["number", "null"]}}, "additionalProperties": false});
        require_nullable_fields_unless_schema_is_closed(&mut request);
        assert!(request.get("required").is_none());
    }
}
