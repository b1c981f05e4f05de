//! What the head of a request must be before anything is done for it: whom it is for, and how its body is written (RFC 9112).

use super::origins::Authority;
use crate::daemon::api::problem::{Problem, ProblemKind};
use axum::extract::Request;
use axum::http::{HeaderMap, HeaderName, Method, Version, header};

/// A header as text, that may be there once.
///
/// # Errors
/// [`Problem`] that names the header: it is there twice, or is not plain ASCII.
pub fn read_single_header<'h>(headers: &'h HeaderMap, name: &HeaderName) -> Result<Option<&'h str>, Problem> {
    let mut all = headers.get_all(name).iter();
    let Some(value) = all.next() else { return Ok(None) };
    if all.next().is_some() {
        return Err(bad_header_problem(name, "is given twice, but must be given once"));
    }
    value.to_str().map(Some).map_err(|_| bad_header_problem(name, "must contain ASCII characters only"))
}

/// Looks at the head, and says whom the request is for; only before HTTP/1.1 may that be nobody.
///
/// # Errors
/// [`Problem`]: no host or two, a target that is none, a coding of the body that is not known.
pub fn check_head_and_find_authority(request: &Request) -> Result<Option<Authority>, Problem> {
    check_transfer_coding_is_chunked_once_or_absent_and_never_in_te(request.headers())?;
    let host = read_single_header(request.headers(), &header::HOST)?;
    let uri = request.uri();
    if host.is_none() && request.version() >= Version::HTTP_11 {
        return Err(bad_header_problem(
            &header::HOST,
            "is missing; HTTP/1.1 requires this header in every request (RFC 9112, 3.2)",
        ));
    }
    let is_all = *request.method() == Method::OPTIONS && uri.path() == "*";
    let target = match (uri.scheme_str(), uri.authority()) {
        // The target's own name counts, and Host does not (RFC 9112, 3.2.2).
        (Some("http" | "https"), Some(authority)) => Some(authority.as_str()),
        (None, None) if uri.path().starts_with('/') || is_all => None,
        (None, Some(_)) if *request.method() == Method::CONNECT => None,
        _ => {
            let detail =
                format!("the request target is {uri}, but must be a path such as /v1/state, or an http or https URL");
            return Err(Problem::new(ProblemKind::BadHeader, detail));
        }
    };
    let wrong = |said: &str| {
        let detail =
            format!("the host is {said:?}, but must be a host name with or without a port, such as localhost:7878");
        Problem::new(ProblemKind::BadHeader, detail).with_field_and_value(
            "host",
            said.into(),
            "NAME or NAME:PORT".into(),
            None,
        )
    };
    let parse = |said: &str| Authority::parse(said).ok_or_else(|| wrong(said));
    // A Host that is none is refused beside an absolute target, too (RFC 9112, 3.2).
    let host = host.map(parse).transpose()?;
    Ok(target.map(parse).transpose()?.or(host))
}

/// Only chunks are undone; whether their end can be found hyper has looked at.
fn check_transfer_coding_is_chunked_once_or_absent_and_never_in_te(headers: &HeaderMap) -> Result<(), Problem> {
    let codings = split_header_lists_into_lowercase_values_without_parameters(headers, &header::TRANSFER_ENCODING);
    if let Some(other) = codings.iter().find(|coding| *coding != "chunked") {
        let detail = format!(
            "the header transfer-encoding is {other}, but only chunked is allowed: send the body in chunks, or send a \
             content-length and no transfer-encoding"
        );
        let problem = Problem::new(ProblemKind::TransferCoding, detail);
        return Err(problem.with_field_and_value("transfer-encoding", other.as_str().into(), "chunked".into(), None));
    }
    if codings.len() > 1 {
        return Err(bad_header_problem(&header::TRANSFER_ENCODING, "contains chunked twice, but must contain it once"));
    }
    // Who lists it there means the header above (RFC 9110, 10.1.4).
    if split_header_lists_into_lowercase_values_without_parameters(headers, &header::TE)
        .iter()
        .any(|coding| coding == "chunked")
    {
        return Err(bad_header_problem(&header::TE, "contains chunked, which is allowed in transfer-encoding only"));
    }
    Ok(())
}

/// Refuses a body that is compressed.
///
/// # Errors
/// [`Problem`] with status 415, which says that none is taken.
pub fn check_content_coding_is_identity_or_absent(headers: &HeaderMap) -> Result<(), Problem> {
    match split_header_lists_into_lowercase_values_without_parameters(headers, &header::CONTENT_ENCODING)
        .into_iter()
        .find(|coding| coding != "identity")
    {
        None => Ok(()),
        Some(other) => {
            let detail = format!(
                "the header content-encoding is {other}, but must be identity or absent: send the JSON without compression"
            );
            let problem = Problem::new(ProblemKind::ContentCoding, detail);
            let problem = problem.with_header(header::ACCEPT_ENCODING, "identity");
            Err(problem.with_field_and_value("content-encoding", other.into(), "identity".into(), None))
        }
    }
}

/// Names in a header's list, over all of its lines, in lower case and without what follows a semicolon.
fn split_header_lists_into_lowercase_values_without_parameters(headers: &HeaderMap, name: &HeaderName) -> Vec<String> {
    let lines = headers.get_all(name).iter().map(|line| String::from_utf8_lossy(line.as_bytes()));
    let mut all = Vec::new();
    for line in lines {
        let names =
            line.split(',').map(|entry| entry.split(';').next().unwrap_or_default().trim().to_ascii_lowercase());
        all.extend(names.filter(|name| !name.is_empty()));
    }
    all
}

fn bad_header_problem(name: &HeaderName, complaint: &str) -> Problem {
    Problem::new(ProblemKind::BadHeader, format!("the header {name} {complaint}")).with_field(name.to_string())
}
