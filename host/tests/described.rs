//! What the daemon answers is what its description (`/openapi.json`) says: every answer fits its schema, and has no key that the schema
//! does not name. The schemas are applied by a validator of JSON Schema, not by code of this project.

mod support;

use era::scene::EXAMPLE_PLATE;
use jsonschema::Validator;
use serde_json::{Map, Value, json};
use support::Daemon;

/// The description with every object closed: keys that no schema names are mistakes.
struct Described {
    whole: Value,
}

impl Described {
    fn of(daemon: &Daemon) -> Self {
        let mut whole = daemon.get("/openapi.json").1;
        // Parts of an `allOf` stay open, so that the whole may have what the others name: copies of theirs.
        let mut open = whole["components"]["schemas"].as_object().unwrap().clone();
        open.values_mut().for_each(|schema| close(schema, true));
        close(&mut whole, false);
        let schemas = whole["components"]["schemas"].as_object_mut().unwrap();
        schemas.extend(open.into_iter().map(|(name, schema)| (format!("Open{name}"), schema)));
        Self { whole }
    }

    /// The validator of what an operation takes or gives, found by a pointer into the description.
    fn schema(&self, pointer: &str) -> Validator {
        let schema = self.whole.pointer(pointer).unwrap_or_else(|| panic!("{pointer} is described"));
        let mut document = Map::new();
        document.insert("$schema".into(), json!("https://json-schema.org/draft/2020-12/schema"));
        document.insert("components".into(), self.whole["components"].clone());
        document.insert("allOf".into(), json!([schema]));
        jsonschema::validator_for(&Value::Object(document)).unwrap()
    }

    #[track_caller]
    fn holds(&self, path: &str, method: &str, status: u16, answer: &Value) {
        let path = path.replace('/', "~1");
        let kind = if status == 200 { "application~1json" } else { "application~1problem+json" };
        let schema = self.schema(&format!("/paths/{path}/{method}/responses/{status}/content/{kind}/schema"));
        let wrong: Vec<String> =
            schema.iter_errors(answer).map(|error| format!("{}: {error}", error.instance_path())).collect();
        assert!(wrong.is_empty(), "{method} {path}, {status}: {wrong:#?} in {answer}");
    }
}

fn close(schema: &mut Value, is_part: bool) {
    match schema {
        Value::Object(map) => {
            for (key, own) in map.iter_mut() {
                match own {
                    Value::Array(parts) if key == "allOf" => {
                        for part in parts {
                            if let Some(Value::String(name)) = part.get_mut("$ref") {
                                *name = name.replace("/schemas/", "/schemas/Open");
                            }
                            close(part, true);
                        }
                    }
                    own => close(own, false),
                }
            }
            let is_object = map.contains_key("allOf") || map.get("properties").is_some_and(Value::is_object);
            if is_object && !is_part && !map.contains_key("additionalProperties") {
                map.insert("unevaluatedProperties".into(), json!(false));
            }
        }
        Value::Array(list) => list.iter_mut().for_each(|part| close(part, false)),
        _ => {}
    }
}

/// Bodies of touches, one of each kind.
fn touches() -> Vec<Value> {
    let touch = |more: Value| {
        let mut body = json!({"x_px": 480, "y_px": 640, "intensity_g": 0.1, "duration_ms": 20});
        body.as_object_mut().unwrap().extend(more.as_object().unwrap().clone());
        body
    };
    vec![
        touch(json!({})),
        touch(json!({"intensity_g": 20.0})),
        touch(json!({"objective": "power"})),
        touch(json!({"objective": "reach"})),
        touch(json!({"grouping": "shared"})),
        touch(json!({"also": [{"x_px": 1500, "y_px": 700, "intensity_g": 2.0}], "trade": true})),
        touch(json!({"quiet": [{"x_px": 1500, "y_px": 700, "radius_mm": 5.0, "at_most_g": 0.01}]})),
        json!({"x_px": 480, "y_px": 640, "intensity_g": 0.1, "effect": "click"}),
        json!({"x_px": 480, "y_px": 640, "intensity_g": 0.1, "effect": "pulse_train", "count": 2, "period_ms": 50}),
        json!({"x_px": 480, "y_px": 640, "intensity_g": 0.1, "from_ms": 0, "to_ms": 30,
               "also": [{"x_px": 1500, "y_px": 700, "intensity_g": 0.1, "from_ms": 40, "to_ms": 60}]}),
    ]
}

#[test]
fn answers_are_as_described() {
    let daemon = Daemon::start(EXAMPLE_PLATE);
    let described = Described::of(&daemon);
    for path in ["/v1/state", "/v1/scene", "/v1/field"] {
        let (status, answer) = daemon.get(path);
        assert_eq!(status, 200, "{path}");
        described.holds(path, "get", status, &answer);
    }
    let asked = described.schema("/paths/~1v1~1touch/post/requestBody/content/application~1json/schema");
    for body in touches() {
        assert!(asked.is_valid(&body), "{body}: {:?}", asked.validate(&body));
        let (status, _, answer) = daemon.post("/v1/touch", &body.to_string());
        assert_eq!(status, 200, "{body}: {answer}");
        described.holds("/v1/touch", "post", status, &answer);
        described.holds("/v1/state", "get", 200, &daemon.state());
    }
    for wrong in
        [json!({"x_px": -1, "y_px": 1}), json!({"x_px": "left"}), json!({"x_px": 1, "y_px": 1, "objective": "noise"})]
    {
        let (status, _, answer) = daemon.post("/v1/touch", &wrong.to_string());
        assert_eq!(status, 400);
        described.holds("/v1/touch", "post", status, &answer);
    }
    let preview = json!({"x_px": 480, "y_px": 640, "moves": {"actuator[1]": {"x_mm": 80.0}}});
    let (status, _, answer) = daemon.post("/v1/preview", &preview.to_string());
    assert_eq!(status, 200, "{answer}");
    described.holds("/v1/preview", "post", status, &answer);
    let (status, told) = daemon.get("/v1/requests/1");
    described.holds("/v1/requests/{id}", "get", status, &told);
    let (status, told) = daemon.get("/v1/requests/none");
    described.holds("/v1/requests/{id}", "get", status, &told);
    for path in ["/v1/arm", "/v1/stop", "/v1/faults/clear"] {
        let (status, _, answer) = daemon.post(path, "");
        described.holds(path, "post", status, &answer);
    }
}

/// A key that nothing names, one that is missing and one of another type are found.
#[test]
fn what_is_not_described_is_found() {
    let daemon = Daemon::start(EXAMPLE_PLATE);
    let described = Described::of(&daemon);
    let (_, _, right) = daemon.post("/v1/touch", &touches()[0].to_string());
    let schema = described.schema("/components/schemas/Touched");
    assert!(schema.is_valid(&right), "{:?}", schema.validate(&right));
    for (pointer, key) in [("", "more"), ("/predicted", "more"), ("/drives/0", "more"), ("/device", "more")] {
        let mut wrong = right.clone();
        wrong.pointer_mut(pointer).unwrap()[key] = json!(1);
        assert!(!schema.is_valid(&wrong), "{pointer}/{key}");
    }
    for (pointer, key) in
        [("", "drives"), ("", "optimality_gap"), ("/predicted", "target_peak_g"), ("/drives/0", "force_n")]
    {
        let mut wrong = right.clone();
        wrong.pointer_mut(pointer).unwrap().as_object_mut().unwrap().remove(key).unwrap();
        assert!(!schema.is_valid(&wrong), "{pointer}/{key} is missing");
    }
    let mut wrong = right.clone();
    wrong["drives"][0]["frequency_hz"] = json!("fast");
    assert!(!schema.is_valid(&wrong));
}
