//! What the daemon answers, as types: what is serialised is what its description is made from.
//!
//! `state` is everything there is to know, `device` the board's part of it; `touched` is what a touch has led to, `told` what
//! became of a request; `scene` is the panel as a page draws it; `live` what is said on a live socket.

pub mod device;
pub mod live;
pub mod scene;
pub mod state;
pub mod told;
pub mod touched;

use serde_json::Value;
use std::time::Duration;
use utoipa::openapi::schema::{Object, ObjectBuilder, SchemaType, Type};

fn ms(time: Duration) -> f64 {
    time.as_secs_f64() * 1e3
}

/// A text that is one of these, or null.
fn one_of(names: impl IntoIterator<Item = &'static str>, nullable: bool, description: &str) -> Object {
    let mut names: Vec<Value> = names.into_iter().map(Value::from).collect();
    let mut kind = SchemaType::Type(Type::String);
    if nullable {
        names.push(Value::Null);
        kind = SchemaType::Array(vec![Type::String, Type::Null]);
    }
    ObjectBuilder::new().schema_type(kind).enum_values(Some(names)).description(Some(description)).build()
}
