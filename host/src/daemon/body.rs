//! Requests read from JSON, with the field that is wrong.

use super::problem::Problem;
use serde::de::DeserializeOwned;
use serde_json::Value;
use serde_path_to_error::{Path, Segment};

/// A request from JSON; `wanted` says in a message what it should look like.
///
/// # Errors
/// [`Problem`] with the field, its value and what is allowed where one of them has the wrong type, `also[0].x_px` say.
pub fn from_json<T: DeserializeOwned>(text: &[u8], wanted: &str) -> Result<T, Problem> {
    let mut deserializer = serde_json::Deserializer::from_slice(text);
    let value = serde_path_to_error::deserialize(&mut deserializer).map_err(|error| {
        let (path, what) = (error.path(), error.inner().to_string());
        match expected(&what).zip(found(text, path)) {
            Some((allowed, value)) if path.iter().next().is_some() => {
                let detail = format!("{path} is {value}, but must be {allowed}; expected {wanted}");
                Problem::body(detail).at(&path.to_string(), value, allowed, None)
            }
            _ => Problem::body(format!("{what}; expected {wanted}")),
        }
    })?;
    deserializer.end().map_err(|error| Problem::body(format!("{error}; expected {wanted}")))?;
    Ok(value)
}

/// What a message of serde's ("invalid type: string "x", expected f64 at line 1 column 9") says should have been there, if
/// it is about a value's type.
fn expected(message: &str) -> Option<String> {
    let is_of_a_value =
        ["invalid type", "invalid value", "unknown variant"].iter().any(|what| message.starts_with(what));
    let (_, rest) = message.split_once("expected ").filter(|_| is_of_a_value)?;
    let what = rest.rsplit_once(" at line").map_or(rest, |(what, _)| what);
    Some(match what {
        "f64" => "a number".into(),
        "u32" | "u64" => "a whole number, 0 or more".into(),
        other => other.replace('`', ""),
    })
}

/// The value at a path, if there is one: all of the body is known by the time that something is found to be wrong with it.
fn found(text: &[u8], path: &Path) -> Option<Value> {
    let body: Value = serde_json::from_slice(text).ok()?;
    let step = |value: Value, segment: &Segment| match segment {
        Segment::Seq { index } => value.get(index).cloned(),
        Segment::Map { key } => value.get(key).cloned(),
        Segment::Enum { .. } | Segment::Unknown => Some(value),
    };
    path.iter().try_fold(body, step)
}

#[cfg(test)]
mod tests {
    use super::super::touch::TouchRequest;
    use super::*;

    #[test]
    fn the_field_of_the_wrong_type_is_named() {
        let cases = [
            (r#"{"x_px": 1, "y_px": 2, "intensity_g": "x"}"#, "intensity_g", "\"x\"", "a number"),
            (r#"{"x_px": 1, "y_px": 2, "count": -1}"#, "count", "-1", "a whole number, 0 or more"),
            (r#"{"x_px": 1, "y_px": 2, "effect": "clack"}"#, "effect", "\"clack\"", "click"),
            (r#"{"x_px": 1, "y_px": 2, "also": [{"x_px": null, "y_px": 2}]}"#, "also[0].x_px", "null", "a number"),
        ];
        for (text, field, value, allowed) in cases {
            let problem = from_json::<TouchRequest>(text.as_bytes(), "a touch").unwrap_err();
            let json = serde_json::to_value(&problem).unwrap();
            assert_eq!((json["field"].as_str(), json["value"].to_string().as_str()), (Some(field), value), "{json}");
            assert!(json["allowed"].as_str().unwrap().contains(allowed), "{json}");
            assert!(problem.detail().starts_with(&format!("{field} is {value}, but must be ")), "{json}");
        }
        // What is not there, not known, or no JSON has no value to tell of.
        for text in [r#"{"x_px": 1}"#, r#"{"x_px": 1, "y_px": 2, "z": 3}"#, "{", "[]", r#"{"x_px": 1, "y_px": 2} x"#] {
            let problem = from_json::<TouchRequest>(text.as_bytes(), "a touch").unwrap_err();
            assert!(serde_json::to_value(&problem).unwrap().get("field").is_none(), "{text}");
        }
        // Nothing is what an absent field is.
        let null = br#"{"x_px": 1, "y_px": 2, "intensity_g": null}"#;
        assert!(from_json::<TouchRequest>(null, "a touch").unwrap().intensity_g.is_none());
    }
}
