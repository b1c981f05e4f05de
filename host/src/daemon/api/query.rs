//! What stands behind the `?` of an address, read with the field that is wrong.

use super::problem::{Kind, Problem};
use axum::extract::Query;
use axum::http::Uri;
use serde::de::{DeserializeOwned, Error, Unexpected};
use serde::{Deserialize, Deserializer};

/// What axum says before what is wrong.
const BEFORE: &str = "Failed to deserialize query string: ";

/// A query; `wanted` says in a message what it should look like.
///
/// # Errors
/// [`Problem`] with the field where one of them is wrong, not known, or there twice.
pub fn read<T: DeserializeOwned>(uri: &Uri, wanted: &str) -> Result<T, Problem> {
    match Query::<T>::try_from_uri(uri) {
        Ok(Query(query)) => Ok(query),
        Err(error) => Err(problem(&error.body_text(), uri, wanted)),
    }
}

/// A number as JSON has it (RFC 8259, 6), with `#[serde(default)]`: what else Rust takes for one (`+1`, `inf`, `.5`) is none.
///
/// # Errors
/// That it is none.
pub fn read_number<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Option<f64>, D::Error> {
    let text = String::deserialize(deserializer)?;
    let is_tight = !text.contains(char::is_whitespace);
    let number = serde_json::from_str::<f64>(&text).ok().filter(|_| is_tight);
    number.map(Some).ok_or_else(|| D::Error::invalid_value(Unexpected::Str(&text), &"a float"))
}

fn problem(text: &str, uri: &Uri, wanted: &str) -> Problem {
    let text = text.strip_prefix(BEFORE).unwrap_or(text);
    let bad = |detail: String| Problem::new(Kind::BadQuery, format!("{detail}; expected {wanted}"));
    for (begin, what) in [("unknown field `", "is not known"), ("duplicate field `", "is there twice")] {
        // The field may be named before: `z: unknown field ...`.
        let rest = text.split_once(begin).and_then(|(_, rest)| rest.split_once('`'));
        if let Some((field, _)) = rest {
            return bad(format!("{field} {what}")).about(field.to_owned());
        }
    }
    let Some((field, what)) = text.split_once(": ") else { return bad(format!("the query cannot be read: {text}")) };
    let allowed = if what.contains("float") { "a number" } else { "a whole number, 0 or more" };
    let Ok(Query(pairs)) = Query::<Vec<(String, String)>>::try_from_uri(uri) else {
        return bad(format!("{field} must be {allowed}")).about(field.to_owned());
    };
    let value = pairs.into_iter().find(|(name, _)| name == field).map(|(_, value)| value).unwrap_or_default();
    bad(format!("{field} is {value:?}, but must be {allowed}")).at(field, value.into(), allowed.into(), None)
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
    }

    #[test]
    fn the_field_that_is_wrong_is_named_without_words_of_this_programs_language() {
        for (query, field, words) in [
            ("x_px=a", "x_px", "x_px is \"a\", but must be a number; expected x_px"),
            ("count=-1", "count", "count is \"-1\", but must be a whole number, 0 or more"),
            ("x_px=1&z=2", "z", "z is not known"),
            ("x_px=1&x_px=2", "x_px", "x_px is there twice"),
        ] {
            let uri = format!("/v1/field?{query}").parse().unwrap();
            let problem = read::<Wanted>(&uri, "x_px=NUMBER").unwrap_err();
            let json = serde_json::to_value(&problem).unwrap();
            assert_eq!(json["field"], field, "{json}");
            assert!(problem.detail().starts_with(words) && problem.detail().ends_with("x_px=NUMBER"), "{json}");
            assert!(!["eserialize", "literal", "`"].iter().any(|word| problem.detail().contains(word)), "{json}");
        }
        assert!(read::<Wanted>(&"/v1/field?x_px=1e3".parse().unwrap(), "").is_ok());
    }
}
