//! What serde says of a wrong text, in the words of who wrote it.

use crate::scene::find_nearest_name;

/// The field that a message ("unknown field `z_px`, expected `x_px` or `y_px`") says is not known, and the known field that it is mistyped from, if one is
/// near. `None` of another message.
#[must_use]
pub fn parse_unknown_field_and_find_nearest(serde_message: &str) -> Option<(&str, Option<&str>)> {
    // The field may be named before: `z: unknown field ...`.
    let (_, rest) = serde_message.split_once("unknown field `")?;
    // `z_px`, then in turn what is between names, and the names that are expected.
    let mut names = rest.split('`').step_by(2);
    let name = names.next()?;
    Some((name, find_nearest_name(name, names)))
}

/// What to say of a field that is not known, behind its name.
#[must_use]
pub fn describe_unknown_field(nearest: Option<&str>) -> String {
    let hint = nearest.map(|nearest| format!("; did you mean {nearest}?")).unwrap_or_default();
    format!("is not a known field{hint}")
}

/// What a message ("invalid type: string "x", expected f64 at line 1 column 9") says should have been there, if it is about a value's type.
#[must_use]
pub fn describe_expected_type(serde_message: &str) -> Option<String> {
    // Of a number where one of several texts is wanted, serde_json only says that.
    if serde_message.starts_with("expected value") {
        return Some("one of the texts that this field allows".into());
    }
    let (_, rest) = split_value_and_expected_type(serde_message)?;
    let what = rest.rsplit_once(" at line").map_or(rest, |(what, _)| what);
    Some(match what {
        "f64" | "f32" => "a number".into(),
        "u32" => format!("a whole number from 0 to {}", u32::MAX),
        "u8" | "u16" | "u64" | "usize" => "a whole number, 0 or more".into(),
        "unit" => "a text, not an object".into(),
        "i8" | "i16" | "i32" | "i64" => "a whole number".into(),
        "a boolean" => "true or false".into(),
        "a string" => "a text".into(),
        "a sequence" => "a list".into(),
        "a map" => "an object".into(),
        other if other.starts_with("struct ") => "an object".into(),
        other => other.replace('`', ""),
    })
}

/// What a message about a value's type says is there instead (`string "x"`).
#[must_use]
pub fn parse_wrong_value(serde_message: &str) -> Option<&str> {
    let (value, _) = split_value_and_expected_type(serde_message)?;
    value.split_once(": ").map_or_else(|| value.split_once(" variant "), Some).map(|(_, value)| value)
}

fn split_value_and_expected_type(serde_message: &str) -> Option<(&str, &str)> {
    let is_of_a_value =
        ["invalid type", "invalid value", "unknown variant"].iter().any(|what| serde_message.starts_with(what));
    serde_message.split_once(", expected ").filter(|_| is_of_a_value)
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde::Deserialize;

    #[derive(Debug, Deserialize)]
    #[serde(deny_unknown_fields)]
    #[expect(dead_code, reason = "it is only read")]
    struct Wanted {
        x_px: Option<f64>,
        count: Option<u32>,
        queue: Option<Queue>,
    }

    #[derive(Debug, Deserialize)]
    #[serde(rename_all = "lowercase")]
    enum Queue {
        All,
        Newest,
    }

    /// With the messages of the libraries that are used, as their words are theirs.
    #[test]
    fn what_the_libraries_say_is_understood() {
        let messages = |json: &str, toml: &str| {
            let json = serde_json::from_str::<Wanted>(json).unwrap_err().to_string();
            let toml = toml::from_str::<Wanted>(toml).unwrap_err().message().to_owned();
            [json, toml]
        };
        for message in messages(r#"{"cuont": 1}"#, "cuont = 1") {
            assert_eq!(parse_unknown_field_and_find_nearest(&message), Some(("cuont", Some("count"))), "{message}");
        }
        for message in messages(r#"{"voltage": 1}"#, "voltage = 1") {
            assert_eq!(parse_unknown_field_and_find_nearest(&message), Some(("voltage", None)), "{message}");
        }
        for message in messages(r#"{"x_px": "much"}"#, "x_px = \"much\"") {
            assert_eq!(describe_expected_type(&message).as_deref(), Some("a number"), "{message}");
            assert_eq!(parse_wrong_value(&message), Some("string \"much\""), "{message}");
            assert_eq!(parse_unknown_field_and_find_nearest(&message), None, "{message}");
        }
        for message in messages(r#"{"queue": "old"}"#, "queue = \"old\"") {
            assert_eq!(describe_expected_type(&message).as_deref(), Some("all or newest"), "{message}");
            assert_eq!(parse_wrong_value(&message), Some("`old`"), "{message}");
        }
    }
}
