//! The description of the daemon's interface (OpenAPI), applied to answers by a validator of JSON Schema.

use jsonschema::Validator;
use serde_json::{Map, Value, json};
use std::collections::HashMap;
use std::sync::{Arc, Mutex, OnceLock};

/// The description with every object closed: keys that no schema names are mistakes.
pub struct Described {
    pub whole: Value,
    /// By the pointer to their schema: tests that poll ask for the same one again and again.
    validators: Mutex<HashMap<String, Arc<Validator>>>,
}

/// That of the program under test.
pub fn described() -> &'static Described {
    static DESCRIBED: OnceLock<Described> = OnceLock::new();
    DESCRIBED.get_or_init(|| Described::of(era::daemon::description()))
}

impl Described {
    pub fn of(text: &str) -> Self {
        let mut whole: Value = serde_json::from_str(text).unwrap();
        // Parts of an `allOf` stay open, so that the whole may have what the others name: copies of theirs.
        let mut open = whole["components"]["schemas"].as_object().unwrap().clone();
        open.values_mut().for_each(|schema| close(schema, true));
        close(&mut whole, false);
        let schemas = whole["components"]["schemas"].as_object_mut().unwrap();
        schemas.extend(open.into_iter().map(|(name, schema)| (format!("Open{name}"), schema)));
        Self { whole, validators: Mutex::default() }
    }

    /// The validator of a schema, found by a pointer into the description.
    pub fn schema(&self, pointer: &str) -> Arc<Validator> {
        let mut validators = self.validators.lock().unwrap();
        let made = validators.entry(pointer.to_owned()).or_insert_with(|| {
            let schema = self.whole.pointer(pointer).unwrap_or_else(|| panic!("{pointer} is described"));
            let mut document = Map::new();
            document.insert("$schema".into(), json!("https://json-schema.org/draft/2020-12/schema"));
            document.insert("components".into(), self.whole["components"].clone());
            document.insert("allOf".into(), json!([schema]));
            Arc::new(jsonschema::validator_for(&Value::Object(document)).unwrap())
        });
        Arc::clone(made)
    }

    /// What of an answer is not as described: its status, its content type, its keys and values, the kind of problem.
    pub fn wrong(&self, method: &str, path: &str, status: u16, kind: &str, answer: &Value) -> Vec<String> {
        let response = match self.response(method, path, status) {
            Ok(response) => response,
            Err(wrong) => return vec![wrong],
        };
        let kind = kind.split(';').next().unwrap().trim().replace('/', "~1");
        let pointer = format!("{response}/content/{kind}/schema");
        if self.whole.pointer(&pointer).is_none() {
            return vec![format!("{pointer} is not declared")];
        }
        let tell = |error: jsonschema::ValidationError<'_>| format!("{}: {error}", error.instance_path());
        self.schema(&pointer).iter_errors(answer).map(tell).collect()
    }

    #[track_caller]
    pub fn check(&self, method: &str, path: &str, status: u16, kind: &str, answer: &Value) {
        let wrong = self.wrong(method, path, status, kind, answer);
        assert!(wrong.is_empty(), "{method} {path}, {status}: {wrong:#?} in {answer}");
    }

    /// The pointer to the response with a status.
    fn response(&self, method: &str, path: &str, status: u16) -> Result<String, String> {
        let path = path.split('?').next().unwrap();
        let declared = self.whole["paths"].as_object().unwrap().keys().find(|template| is_of(template, path));
        let (pointer, otherwise) = match declared {
            Some(template) => {
                let item = format!("/paths/{}", template.replace('/', "~1"));
                (format!("{item}/{method}/responses/{status}"), "WrongMethod")
            }
            None => (String::new(), "NotFound"),
        };
        let operation = pointer.rsplit_once("/responses").map_or("", |(operation, _)| operation);
        match (self.whole.pointer(&pointer), status) {
            _ if operation.is_empty() || self.whole.pointer(operation).is_none() => match (otherwise, status) {
                ("NotFound", 404) | ("WrongMethod", 405) => Ok(format!("/components/responses/{otherwise}")),
                _ => Err(format!("{method} {path} is not declared, and not answered with {otherwise} but {status}")),
            },
            (Some(_), _) => Ok(pointer),
            (None, _) => Err(format!("{pointer} is not declared")),
        }
    }
}

/// Whether a path is one of a template's.
fn is_of(template: &str, path: &str) -> bool {
    let (mut wanted, mut given) = (template.split('/'), path.split('/'));
    loop {
        match (wanted.next(), given.next()) {
            (None, None) => return true,
            (Some(wanted), Some(given)) if wanted == given || wanted.starts_with('{') && !given.is_empty() => {}
            _ => return false,
        }
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
