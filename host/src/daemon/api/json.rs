//! Objects read from JSON. What is wrong is told with the field, its value and what is allowed.

use super::problem::Problem;
use crate::serde_messages::{describe_expected_type, describe_unknown_field, parse_unknown_field_and_find_nearest};
use serde::de::DeserializeOwned;
use serde_json::Value;
use serde_path_to_error::{Path, Segment};
use std::fmt;

/// What a text of JSON should look like: the last sentence of a message about a wrong one.
#[derive(Clone, Copy, Debug)]
pub struct ExpectedForm<'a> {
    /// What the text is, as the subject of the sentence: "the whole body", say, with a capital letter.
    pub subject: &'static str,
    /// Its keys with the types of their values.
    pub form: &'a str,
}

impl fmt::Display for ExpectedForm<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} has the form {}", self.subject, self.form)
    }
}

/// A request from JSON; `expected` says in a message what it should look like.
///
/// # Errors
/// [`Problem`] with the field, `also[0].x_px` say, where one of them is wrong, not known or missing.
pub fn parse_json_object<T: DeserializeOwned>(json_text: &[u8], expected: ExpectedForm<'_>) -> Result<T, Problem> {
    // First: what is no JSON is told so, and not of which type of this program a part of it is not.
    let whole: Value = serde_json::from_slice(json_text).map_err(|error| {
        // A number that is too large may be known as such here or only where it is wanted, by how the library was built.
        let read =
            || serde_path_to_error::deserialize::<_, T>(&mut serde_json::Deserializer::from_slice(json_text)).err();
        let problem = is_number_too_large_error(&error).then(read).flatten();
        problem
            .and_then(|error| number_too_large_problem(json_text, error.path(), error.inner(), expected))
            .unwrap_or_else(|| Problem::bad_body(format!("the body is not valid JSON: {error}. {expected}")))
    })?;
    check_body_and_list_entries_are_objects(&whole, expected)?;
    let mut deserializer = serde_json::Deserializer::from_slice(json_text);
    let value = serde_path_to_error::deserialize(&mut deserializer).map_err(|error| {
        let (path, what) = (error.path(), error.inner().to_string());
        let known = missing_unknown_or_duplicate_field_problem(&what, path, expected)
            .or_else(|| number_too_large_problem(json_text, path, error.inner(), expected));
        if let Some(problem) = known {
            return problem;
        }
        match describe_expected_type(&what).zip(find_value_at_path(&whole, path)) {
            Some((allowed, value)) if path.iter().next().is_some() => {
                let detail = format!("{path} is {value}, but must be {allowed}. {expected}");
                Problem::bad_body(detail).with_field_and_value(&path.to_string(), value, allowed, None)
            }
            _ => Problem::bad_body(format!("{what}. {expected}")),
        }
    })?;
    Ok(value)
}

/// Whether this is about a number that is beyond all that a 64-bit float holds: JSON, but without a value.
fn is_number_too_large_error(error: &serde_json::Error) -> bool {
    error.to_string().starts_with("number out of range")
}

/// The problem of such a number, which is at this path.
fn number_too_large_problem(
    json_text: &[u8],
    path: &Path,
    error: &serde_json::Error,
    expected: ExpectedForm<'_>,
) -> Option<Problem> {
    if !is_number_too_large_error(error) {
        return None;
    }
    path.iter().next()?;
    // The column, from 1, is that of the number's last character.
    let line = json_text.split(|byte| *byte == b'\n').nth(error.line().checked_sub(1)?)?;
    let before = line.get(..error.column())?;
    let digits = before.iter().rev().take_while(|byte| byte.is_ascii_digit() || b"+-.eE".contains(byte)).count();
    let number = std::str::from_utf8(before.get(before.len() - digits..)?).ok()?;
    let allowed = format!("a number between {:e} and {:e}", f64::MIN, f64::MAX);
    let detail = format!("{path} is {number}, but must be {allowed}. {expected}");
    Some(Problem::bad_body(detail).with_field_and_value(&path.to_string(), number.into(), allowed, None))
}

/// The problem that a message of serde's ("missing field `y_px` at line 1 column 9") is about a field that is not there, or that should
/// not be, of what is at this path.
fn missing_unknown_or_duplicate_field_problem(
    serde_message: &str,
    path: &Path,
    expected: ExpectedForm<'_>,
) -> Option<Problem> {
    let (name, what) = match parse_unknown_field_and_find_nearest(serde_message) {
        Some((name, nearest)) => (name, describe_unknown_field(nearest)),
        None => {
            let kinds = [("missing field `", "is missing"), ("duplicate field `", "is given twice")];
            let (rest, what) =
                kinds.iter().find_map(|(begin, what)| Some((serde_message.strip_prefix(begin)?, *what)))?;
            (rest.split_once('`')?.0, what.to_owned())
        }
    };
    let at = path.to_string();
    let field = match path.iter().next_back() {
        None => name.to_owned(),
        // A key may be in the path already.
        Some(Segment::Map { key }) if key == name => at,
        Some(_) => format!("{at}.{name}"),
    };
    let end = if what.ends_with('?') { "" } else { "." };
    Some(Problem::bad_body(format!("{field} {what}{end} {expected}")).with_field(field))
}

/// Refuses lists in place of objects, which serde takes for the fields in their order: requests are objects, and so is every
/// entry of their lists.
fn check_body_and_list_entries_are_objects(body: &Value, expected: ExpectedForm<'_>) -> Result<(), Problem> {
    fn check_list_entries_below_are_objects(
        value: &Value,
        path: &str,
        expected: ExpectedForm<'_>,
    ) -> Result<(), Problem> {
        let inside = |name: String| if path.is_empty() { name } else { format!("{path}.{name}") };
        match value {
            Value::Object(map) => map.iter().try_for_each(|(key, value)| match value {
                Value::Object(_) | Value::Array(_) => {
                    check_list_entries_below_are_objects(value, &inside(key.clone()), expected)
                }
                _ => Ok(()),
            }),
            Value::Array(list) => list.iter().enumerate().try_for_each(|(i, entry)| {
                let path = format!("{path}[{i}]");
                if entry.is_object() {
                    return check_list_entries_below_are_objects(entry, &path, expected);
                }
                let detail = format!("{path} is {entry}, but must be an object. {expected}");
                Err(Problem::bad_body(detail).with_field_and_value(&path, entry.clone(), "an object".into(), None))
            }),
            _ => Ok(()),
        }
    }
    match body {
        Value::Object(_) => check_list_entries_below_are_objects(body, "", expected),
        other => {
            Err(Problem::bad_body(format!("the body is {}, but must be an object. {expected}", name_json_kind(other))))
        }
    }
}

/// What kind of JSON this is.
const fn name_json_kind(value: &Value) -> &'static str {
    match value {
        Value::Null => "null",
        Value::Bool(_) => "true or false",
        Value::Number(_) => "a number",
        Value::String(_) => "a text",
        Value::Array(_) => "a list",
        Value::Object(_) => "an object",
    }
}

/// The value at a path, if there is one.
fn find_value_at_path(whole: &Value, path: &Path) -> Option<Value> {
    let step = |value: &'_ Value, segment: &Segment| match segment {
        Segment::Seq { index } => value.get(index).cloned(),
        Segment::Map { key } => value.get(key).cloned(),
        Segment::Enum { .. } | Segment::Unknown => Some(value.clone()),
    };
    path.iter().try_fold(whole.clone(), |value, segment| step(&value, segment))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::daemon::touch::request::TouchRequest;

    const TOUCH: ExpectedForm<'_> = ExpectedForm { subject: "A touch", form: "{...}" };

    #[test]
    fn the_field_of_the_wrong_type_is_named() {
        let cases = [
            (r#"{"x_px": 1, "y_px": 2, "intensity_g": "x"}"#, "intensity_g", "\"x\"", "a number"),
            (r#"{"x_px": 1, "y_px": 2, "count": -1}"#, "count", "-1", "a whole number from 0 to 4294967295"),
            (r#"{"x_px": 1, "y_px": 2, "effect": "clack"}"#, "effect", "\"clack\"", "click"),
            (r#"{"x_px": 1, "y_px": 2, "effect": 5}"#, "effect", "5", "one of the texts"),
            (r#"{"x_px": 1, "y_px": 2, "also": [{"x_px": null, "y_px": 2}]}"#, "also[0].x_px", "null", "a number"),
            // A list is no object, though serde could read one as the fields in their order.
            (r#"{"x_px": 1, "y_px": 2, "also": [[3, 4]]}"#, "also[0]", "[3,4]", "an object"),
            (r#"{"x_px": 1, "y_px": 2, "also": 3}"#, "also", "3", "a list"),
            (r#"{"x_px": 1, "y_px": 2, "trade": 3}"#, "trade", "3", "true or false"),
        ];
        for (text, field, value, allowed) in cases {
            let problem = parse_json_object::<TouchRequest>(text.as_bytes(), TOUCH).unwrap_err();
            let json = serde_json::to_value(&problem).unwrap();
            assert_eq!((json["field"].as_str(), json["value"].to_string().as_str()), (Some(field), value), "{json}");
            assert!(json["allowed"].as_str().unwrap().contains(allowed), "{json}");
            assert!(problem.detail().starts_with(&format!("{field} is {value}, but must be ")), "{json}");
        }
        // What is not there, or not known, is named.
        for (text, field, what) in [
            (r#"{"x_px": 1}"#, "y_px", "is missing"),
            (r#"{"x_px": 1, "y_px": 2, "z": 3}"#, "z", "is not a known field"),
            (r#"{"x_px": 1, "y_px": 2, "y_px": 3}"#, "y_px", "is given twice"),
            (r#"{"x_px": 1, "y_px": 2, "also": [{"x_px": 3}]}"#, "also[0].y_px", "is missing"),
            (
                r#"{"x_px": 1, "y_px": 2, "also": [{"x_px": 3, "y_px": 4, "z": 5}]}"#,
                "also[0].z",
                "is not a known field",
            ),
            (
                r#"{"x_px": 1, "y_px": 2, "quiet": [{"x_px": 3, "y_px": 4, "radius_mm": 5}]}"#,
                "quiet[0].at_most_g",
                "is missing",
            ),
        ] {
            let problem = parse_json_object::<TouchRequest>(text.as_bytes(), TOUCH).unwrap_err();
            let json = serde_json::to_value(&problem).unwrap();
            assert_eq!(json["field"], field, "{json}");
            assert!(problem.detail().starts_with(&format!("{field} {what}. A touch has the form {{...}}")), "{json}");
        }
        let mistyped = br#"{"x_px": 1, "y_px": 2, "quiet": [{"x_px": 3, "y_px": 4, "radius_m": 5}]}"#;
        let problem = parse_json_object::<TouchRequest>(mistyped, TOUCH).unwrap_err();
        let detail = "quiet[0].radius_m is not a known field; did you mean radius_mm? A touch has the form {...}";
        assert_eq!(problem.detail(), detail);
        // What is no JSON has no field, and no types of this program, though a part before that has the wrong one.
        for text in ["{", "[]", r#"{"x_px": 1, "y_px": 2} x"#, r#"{"x_px": [1, 2}"#] {
            let problem = parse_json_object::<TouchRequest>(text.as_bytes(), TOUCH).unwrap_err();
            assert!(serde_json::to_value(&problem).unwrap().get("field").is_none(), "{text}");
            assert!(!problem.detail().contains("f64") && !problem.detail().contains("struct"), "{}", problem.detail());
        }
        // Nothing is what an absent field is.
        let null = br#"{"x_px": 1, "y_px": 2, "intensity_g": null}"#;
        assert!(parse_json_object::<TouchRequest>(null, TOUCH).unwrap().intensity_g.is_none());
    }
}
