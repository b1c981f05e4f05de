//! JSON as other programs write it: with a mark of byte order before it and commas before closing brackets.

use super::error::ReadError;
use super::format::FileFormat;
use serde_json::Value;

/// Parses a text; what is no JSON is tried again without commas before closing brackets, which Core Haptics and the reference software of
/// ISO/IEC 23090-31 take.
///
/// # Errors
/// [`ReadError::Syntax`].
pub fn parse_lenient_json(text: &str, format: FileFormat) -> Result<Value, ReadError> {
    let text = text.trim_start_matches('\u{feff}');
    serde_json::from_str(text).or_else(|error| {
        let detail = format!("it is not valid JSON ({error})");
        serde_json::from_str(&remove_trailing_commas(text)).map_err(|_| ReadError::Syntax { format, detail })
    })
}

fn remove_trailing_commas(text: &str) -> String {
    let mut out = String::with_capacity(text.len());
    let (mut is_in_string, mut is_escaped) = (false, false);
    for (i, sign) in text.char_indices() {
        if is_in_string {
            is_in_string = is_escaped || sign != '"';
            is_escaped = !is_escaped && sign == '\\';
        } else if sign == '"' {
            is_in_string = true;
        } else if sign == ',' && text.get(i + 1..).is_some_and(|rest| rest.trim_start().starts_with([']', '}'])) {
            continue;
        }
        out.push(sign);
    }
    out
}

/// A number of an object; `None` also if its value is no number.
#[must_use]
pub fn number_at(value: &Value, key: &str) -> Option<f64> {
    value.get(key)?.as_f64()
}

/// A text of an object.
#[must_use]
pub fn text_at<'a>(value: &'a Value, key: &str) -> Option<&'a str> {
    value.get(key)?.as_str()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn commas_go_where_nothing_follows() {
        let text = "\u{feff}{\"a\": [1, 2,\n ], \"b\": \"x, ]\\\", }\", }";
        let found = parse_lenient_json(text, FileFormat::Ahap).unwrap();
        assert_eq!(found, serde_json::json!({"a": [1, 2], "b": "x, ]\", }"}));
    }
}
