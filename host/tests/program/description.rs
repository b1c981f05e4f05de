//! The description of the daemon's interface in itself: it is OpenAPI 3.1, nothing in it points nowhere, its examples are what it
//! says, and the manual (docs/src/http.md) names the same paths, roles and problems.

use crate::support;
use era::scene::STARTING_PLATE;
use serde_json::{Value, json};
use std::collections::{BTreeMap, BTreeSet};
use support::Daemon;
use support::described::described;

const MANUAL: &str = include_str!("../../../docs/src/http.md");

fn description() -> Value {
    serde_json::from_str(era::daemon::description()).unwrap()
}

/// What of OpenAPI 3.1.0 the description uses, written down from the specification (4.8): each object with the keys that it may and must
/// have. Schemas are looked at by the dialect's own schema.
fn structure() -> Value {
    let text = || json!({"type": "string", "minLength": 1});
    json!({
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "type": "object",
        "required": ["openapi", "info", "paths"],
        "additionalProperties": false,
        "properties": {
            "openapi": {"pattern": "^3\\.1\\.\\d+$"},
            "info": {"type": "object", "required": ["title", "version"], "additionalProperties": false,
                "properties": {"title": text(), "version": text(), "description": text()}},
            "servers": {"type": "array", "items": {"type": "object", "required": ["url"], "additionalProperties": false,
                "properties": {"url": text(), "description": text()}}},
            "paths": {"type": "object", "additionalProperties": false,
                "patternProperties": {"^/": {"$ref": "#/$defs/item"}}},
            "components": {"type": "object", "additionalProperties": false, "properties": {
                "schemas": {"type": "object", "propertyNames": {"pattern": "^[a-zA-Z0-9._-]+$"}},
                "responses": {"type": "object", "additionalProperties": {"$ref": "#/$defs/response"}},
                "securitySchemes": {"type": "object", "additionalProperties": {
                    "type": "object", "required": ["type", "scheme"], "additionalProperties": false,
                    "properties": {"type": {"const": "http"}, "scheme": {"const": "bearer"}, "description": text()}}},
            }},
        },
        "$defs": {
            "item": {"type": "object", "minProperties": 1, "additionalProperties": false,
                "properties": {"get": {"$ref": "#/$defs/operation"}, "post": {"$ref": "#/$defs/operation"}}},
            "operation": {"type": "object", "additionalProperties": false,
                "required": ["summary", "operationId", "responses", "security", "x-role"],
                "properties": {
                    "summary": text(), "description": text(), "operationId": text(),
                    "tags": {"type": "array", "items": text()},
                    "parameters": {"type": "array", "items": {"$ref": "#/$defs/parameter"}},
                    "requestBody": {"type": "object", "required": ["content", "required"], "additionalProperties": false,
                        "properties": {"content": {"$ref": "#/$defs/content"}, "required": {"const": true},
                            "description": text()}},
                    "responses": {"type": "object", "minProperties": 1, "additionalProperties": false,
                        "patternProperties": {"^[1-5][0-9][0-9]$": {"$ref": "#/$defs/response"}}},
                    "security": {"type": "array", "items": {"type": "object", "additionalProperties": false,
                        "properties": {"token": {"type": "array", "maxItems": 0}}}},
                },
                "patternProperties": {"^x-": true}},
            "parameter": {"type": "object", "required": ["name", "in", "schema", "description"], "additionalProperties": false,
                "properties": {"name": text(), "in": {"enum": ["query", "header", "path"]}, "description": text(),
                    "required": {"type": "boolean"}, "schema": {"$ref": "#/$defs/schema"}},
                "if": {"properties": {"in": {"const": "path"}}}, "then": {"properties": {"required": {"const": true}}, "required": ["required"]}},
            "content": {"type": "object", "minProperties": 1, "propertyNames": {"pattern": "^[a-z]+/[a-z+.-]+(; .*)?$"},
                "additionalProperties": {"type": "object", "required": ["schema"], "additionalProperties": false,
                    "properties": {"schema": {"$ref": "#/$defs/schema"}}}},
            "response": {"type": "object", "required": ["description"], "additionalProperties": false,
                "properties": {"description": text(), "content": {"$ref": "#/$defs/content"},
                    "headers": {"type": "object", "additionalProperties": {"type": "object", "required": ["schema"],
                        "additionalProperties": false,
                        "properties": {"description": text(), "schema": {"$ref": "#/$defs/schema"}}}}}},
            "schema": {"$ref": "https://json-schema.org/draft/2020-12/schema"},
        },
    })
}

#[test]
fn it_is_openapi() {
    let document = description();
    let structure = jsonschema::validator_for(&structure()).unwrap();
    let wrong: Vec<String> =
        structure.iter_errors(&document).map(|error| format!("{}: {error}", error.instance_path())).collect();
    assert!(wrong.is_empty(), "{wrong:#?}");
    for (name, schema) in document["components"]["schemas"].as_object().unwrap() {
        let valid = jsonschema::meta::validate(schema);
        assert!(valid.is_ok(), "{name}: {:?}", valid.err().map(|error| error.to_string()));
        assert!(schema.get("description").is_some(), "{name} says what it is");
    }
    // Whatever the scheme, name, port or socket it was asked at.
    assert_eq!(document["servers"][0]["url"], "/");
    let mut names = BTreeSet::new();
    for (path, item) in document["paths"].as_object().unwrap() {
        let wanted: BTreeSet<&str> = path.split(['{', '}']).skip(1).step_by(2).collect();
        for (method, operation) in item.as_object().unwrap() {
            assert!(names.insert(operation["operationId"].as_str().unwrap()), "{method} {path} has a name of its own");
            let parameters = operation["parameters"].as_array().into_iter().flatten();
            let in_path = parameters.filter(|parameter| parameter["in"] == "path");
            let given: BTreeSet<&str> = in_path.map(|parameter| parameter["name"].as_str().unwrap()).collect();
            assert_eq!(given, wanted, "{method} {path}");
        }
    }
}

fn each<'a>(value: &'a Value, seen: &mut impl FnMut(&'a serde_json::Map<String, Value>)) {
    match value {
        Value::Object(map) => {
            seen(map);
            map.values().for_each(|own| each(own, seen));
        }
        Value::Array(list) => list.iter().for_each(|own| each(own, seen)),
        _ => {}
    }
}

/// What is pointed at is there, and what is there is pointed at from a path, however many steps away.
#[test]
fn nothing_points_nowhere_and_nothing_is_left_over() {
    let document = description();
    let mut wanted: BTreeSet<&str> = BTreeSet::new();
    each(&document, &mut |map| wanted.extend(map.get("$ref").and_then(Value::as_str)));
    for pointer in &wanted {
        assert!(document.pointer(pointer.trim_start_matches('#')).is_some(), "{pointer} is not there");
    }
    for name in document["components"]["schemas"].as_object().unwrap().keys() {
        assert!(wanted.contains(format!("#/components/schemas/{name}").as_str()), "{name} is of no use");
    }
}

#[test]
fn examples_are_what_it_says() {
    let document = description();
    let mut count = 0;
    for (name, schema) in document["components"]["schemas"].as_object().unwrap() {
        let validator = described().schema(&format!("/components/schemas/{name}"));
        let list = schema["examples"].as_array().into_iter().flatten().chain(schema.get("example"));
        for example in list {
            let wrong: Vec<String> = validator.iter_errors(example).map(|error| error.to_string()).collect();
            assert!(wrong.is_empty(), "{name}: {wrong:?} in {example}");
            count += 1;
        }
    }
    assert!(count >= 5, "{count} examples");
}

/// Each property says what it is.
#[test]
fn nothing_is_unexplained() {
    let document = description();
    each(&document["components"], &mut |schema| {
        for (name, own) in schema.get("properties").and_then(Value::as_object).into_iter().flatten() {
            // Which of several messages or problems it is says itself.
            let parts = own["oneOf"].as_array().into_iter().flatten();
            let is_told = parts.chain([own]).any(|part| part.get("description").is_some());
            assert!(is_told || name == "type" || name == "status", "{name} in {schema:?}");
        }
    });
}

/// Rows of the manual's table whose head begins so, by their cells.
fn table(head: &str) -> Vec<Vec<String>> {
    let lines = MANUAL.lines().skip_while(|line| !line.starts_with(head)).skip(2);
    let cells = |line: &str| line.trim_matches('|').split('|').map(|cell| cell.trim().to_owned()).collect();
    lines.take_while(|line| line.starts_with('|')).map(cells).collect()
}

#[test]
fn the_manual_names_all_paths_and_their_roles() {
    let mut manual = BTreeSet::new();
    for row in table("| request |") {
        for request in row[0].split('`').filter_map(|text| text.split_once(' ')) {
            if request.1.starts_with('/') {
                manual.insert((request.0.to_lowercase(), request.1.to_owned(), row[1].clone()));
            }
        }
    }
    let mut declared = BTreeSet::new();
    for (path, item) in description()["paths"].as_object().unwrap() {
        // The page's files are one row.
        if path == "/" || !path.contains('.') || path.ends_with(".json") {
            for (method, operation) in item.as_object().unwrap() {
                let role = operation["x-role"].as_str().unwrap_or("none");
                declared.insert((method.clone(), path.clone(), role.to_owned()));
            }
        }
    }
    assert_eq!(manual, declared);
}

#[test]
fn the_manual_names_all_problems_and_their_statuses() {
    let mut manual: BTreeMap<String, BTreeSet<u64>> = BTreeMap::new();
    for row in table("| type ends in |") {
        let kind = format!("urn:era:problem:{}", row[0].trim_matches('`'));
        manual.entry(kind).or_default().extend(row[1].split(", ").map(|status| status.parse::<u64>().unwrap()));
    }
    let document = description();
    let mut declared: BTreeMap<String, BTreeSet<u64>> = BTreeMap::new();
    for kind in document["components"]["schemas"]["ProblemType"]["oneOf"].as_array().unwrap() {
        let status = kind["x-status"].as_array().unwrap().iter().map(|status| status.as_u64().unwrap());
        declared.insert(kind["const"].as_str().unwrap().into(), status.collect());
    }
    assert_eq!(manual, declared);
    // Each of them comes from somewhere.
    let mut answered: BTreeMap<String, BTreeSet<u64>> = BTreeMap::new();
    each(&document, &mut |map| {
        if let (Some(types), Some(status)) =
            (map.get("type").and_then(|kind| kind["enum"].as_array()), map.get("status").map(|status| &status["const"]))
        {
            for kind in types {
                answered.entry(kind.as_str().unwrap().into()).or_default().extend(status.as_u64());
            }
        }
    });
    assert_eq!(answered, declared);
}

/// Names between quotation marks or backticks, in the part of `file` that begins with `from` and ends before `to`.
fn names_in(file: &str, from: &str, to: &str) -> BTreeSet<String> {
    let path = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join(file);
    let text = std::fs::read_to_string(&path).unwrap_or_else(|error| panic!("{}: {error}", path.display()));
    let (_, rest) = text.split_once(from).unwrap_or_else(|| panic!("{file} has no {from}"));
    let (part, _) = rest.split_once(to).unwrap_or_else(|| panic!("{file} has no {to} behind {from}"));
    let is_name = |text: &&str| !text.is_empty() && text.chars().all(|c| c.is_ascii_lowercase() || c == '_');
    part.split(['"', '`', '\\']).filter(is_name).map(str::to_owned).collect()
}

/// A new effect is written down in all of these places, which no compiler compares.
#[test]
fn every_list_of_effects_names_all_effects() {
    let schema = &description()["components"]["schemas"]["Effect"];
    let effects: BTreeSet<String> =
        schema["enum"].as_array().unwrap().iter().map(|name| name.as_str().unwrap().to_owned()).collect();
    assert!(effects.contains("click") && effects.len() > 5, "{schema}");
    for (file, from, to) in [
        ("src/daemon/http/routes.rs", "\"effect\"?: ", ","),
        ("python/python/era/_era.pyi", "    effect: Literal[", "]"),
        ("python/src/effect.rs", "/// effect : {", "}"),
        ("python/src/effect.rs", "let allowed = ", ";"),
        ("tests/program/effect_figures.rs", "const EFFECTS: &[&str] = &[", "]"),
    ] {
        assert_eq!(names_in(file, from, to), effects, "{file}, {from}");
    }
    let page = names_in("web/index.html", "<fieldset id=\"effects\">", "</fieldset>");
    let page: BTreeSet<_> =
        page.into_iter().filter(|name| !["effects", "radio", "effect"].contains(&&**name)).collect();
    assert_eq!(page, effects, "web/index.html");
    let link = names_in("../tools/crosscheck/reference/link.py", "\nEFFECTS = {", "\n}");
    let link: BTreeSet<_> =
        link.into_iter().filter(|name| !["count"].contains(&&**name) && !name.ends_with("_ms")).collect();
    assert_eq!(link, effects, "link.py");
}

/// What is declared is served, and another method of it is not.
#[test]
fn what_is_declared_is_served() {
    let daemon = Daemon::start(STARTING_PLATE);
    for (path, item) in description()["paths"].as_object().unwrap() {
        let url = format!("{}{}", daemon.url, path.replace("{id}", "none"));
        let agent = Daemon::agent();
        let get = agent.get(&url).call().unwrap();
        let post = agent.post(&url).send("{}").unwrap();
        let put = agent.put(&url).send("{}").unwrap();
        for (method, mut answer) in [("get", get), ("post", post), ("put", put)] {
            let status = answer.status().as_u16();
            assert_eq!(status != 405, item.get(method).is_some(), "{method} {path}: {status}");
            if status == 404 {
                // A request that is not known, not a path.
                let problem: Value = answer.body_mut().read_json().unwrap();
                assert!(problem["detail"].as_str().unwrap().contains("no request"), "{method} {path}: {problem}");
            }
        }
    }
}
