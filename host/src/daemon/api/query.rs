//! What stands behind the `?` of an address, read with the field that is wrong.

use super::problem::{Problem, ProblemKind};
use crate::serde_messages::{describe_expected_type, describe_unknown_field, parse_unknown_field_and_find_nearest};
use axum::extract::Query;
use axum::http::Uri;
use serde::de::{DeserializeOwned, Error, Unexpected};
use serde::{Deserialize, Deserializer};

/// What axum says before what is wrong.
const BEFORE: &str = "Failed to deserialize query string: ";

/// A query; `expected` says in a message what it should look like.
///
/// # Errors
/// [`Problem`] with the field where one of them is wrong, not known, or there twice.
pub fn parse_query<T: DeserializeOwned>(uri: &Uri, expected: &str) -> Result<T, Problem> {
    match Query::<T>::try_from_uri(uri) {
        Ok(Query(query)) => Ok(query),
        Err(error) => Err(query_problem_from_error_text(&error.body_text(), uri, expected)),
    }
}

/// A number as JSON has it (RFC 8259, 6), with `#[serde(default)]`: what else Rust takes for one (`+1`, `inf`, `.5`) is none.
///
/// # Errors
/// That it is none.
pub fn deserialize_present_query_number_as_some<'de, D: Deserializer<'de>>(
    deserializer: D,
) -> Result<Option<f64>, D::Error> {
    let text = String::deserialize(deserializer)?;
    let is_tight = !text.contains(char::is_whitespace);
    let number = serde_json::from_str::<f64>(&text).ok().filter(|_| is_tight);
    number.map(Some).ok_or_else(|| D::Error::invalid_value(Unexpected::Str(&text), &"a number"))
}

fn query_problem_from_error_text(error_text: &str, uri: &Uri, expected: &str) -> Problem {
    let error_text = error_text.strip_prefix(BEFORE).unwrap_or(error_text);
    let bad = |detail: String| {
        let end = if detail.ends_with('?') { "" } else { "." };
        Problem::new(ProblemKind::BadQuery, format!("{detail}{end} The query must have the form {expected}"))
    };
    if let Some((field, nearest)) = parse_unknown_field_and_find_nearest(error_text) {
        return bad(format!("{field} {}", describe_unknown_field(nearest))).with_field(field.to_owned());
    }
    let twice = error_text.split_once("duplicate field `").and_then(|(_, rest)| rest.split_once('`'));
    if let Some((field, _)) = twice {
        return bad(format!("{field} is given twice")).with_field(field.to_owned());
    }
    let field_and_allowed =
        error_text.split_once(": ").and_then(|(field, what)| Some((field, describe_expected_type(what)?)));
    let Some((field, allowed)) = field_and_allowed else {
        return bad(format!("the query cannot be read: {error_text}"));
    };
    let Ok(Query(pairs)) = Query::<Vec<(String, String)>>::try_from_uri(uri) else {
        return bad(format!("{field} must be {allowed}")).with_field(field.to_owned());
    };
    let value = pairs.into_iter().find(|(name, _)| name == field).map(|(_, value)| value).unwrap_or_default();
    bad(format!("{field} is {value:?}, but must be {allowed}")).with_field_and_value(field, value.into(), allowed, None)
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde::Deserialize;

    #[derive(Debug, Deserialize)]
    #[serde(deny_unknown_fields)]
    #[expect(dead_code, reason = "it is only read")]
    struct Wanted {
        #[serde(default, deserialize_with = "deserialize_present_query_number_as_some")]
        x_px: Option<f64>,
        taps: Option<Queue>,
    }

    #[derive(Debug, Deserialize)]
    #[serde(rename_all = "lowercase")]
    enum Queue {
        All,
        Newest,
    }

    #[test]
    fn the_field_that_is_wrong_is_named_without_words_of_this_programs_language() {
        for (query, field, words) in [
            ("x_px=a", "x_px", "x_px is \"a\", but must be a number. The query must have the form x_px"),
            ("x_px=1e", "x_px", "x_px is \"1e\", but must be a number"),
            ("taps=-1", "taps", "taps is \"-1\", but must be all or newest"),
            ("taps=al", "taps", "taps is \"al\", but must be all or newest"),
            ("taps=", "taps", "taps is \"\", but must be all or newest"),
            ("x_px=1&z=2", "z", "z is not a known field"),
            ("tabs=2", "tabs", "tabs is not a known field; did you mean taps? The query must have the form x_px"),
            ("x_px=1&x_px=2", "x_px", "x_px is given twice"),
        ] {
            let uri = format!("/v1/field?{query}").parse().unwrap();
            let problem = parse_query::<Wanted>(&uri, "x_px=NUMBER").unwrap_err();
            let json = serde_json::to_value(&problem).unwrap();
            assert_eq!(json["field"], field, "{json}");
            assert!(problem.detail().starts_with(words) && problem.detail().ends_with("x_px=NUMBER"), "{json}");
            assert!(!["eserialize", "literal", "`"].iter().any(|word| problem.detail().contains(word)), "{json}");
        }
        assert!(parse_query::<Wanted>(&"/v1/field?x_px=1e3".parse().unwrap(), "").is_ok());
    }
}
