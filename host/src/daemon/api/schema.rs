//! What schemas and answers of several files have in common.

use serde_json::Value;
use std::time::Duration;
use utoipa::openapi::schema::{Object, ObjectBuilder, SchemaType, Type};

/// A time in ms.
#[must_use]
pub fn to_ms(time: Duration) -> f64 {
    time.as_secs_f64() * 1e3
}

/// The schema of a text that is one of these names, or null.
pub fn text_choice_schema(names: impl IntoIterator<Item = &'static str>, nullable: bool, description: &str) -> Object {
    let mut names: Vec<Value> = names.into_iter().map(Value::from).collect();
    let mut kind = SchemaType::Type(Type::String);
    if nullable {
        names.push(Value::Null);
        kind = SchemaType::Array(vec![Type::String, Type::Null]);
    }
    ObjectBuilder::new().schema_type(kind).enum_values(Some(names)).description(Some(description)).build()
}
