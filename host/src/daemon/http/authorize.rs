//! Whether a request may be carried out: the role that its path needs, and the middleware that asks for it.

use super::page_files;
use crate::daemon::access::head::check_head_and_find_authority;
use crate::daemon::access::permissions::{Access, Role};
use axum::extract::{Request, State};
use axum::http::{HeaderValue, Method, StatusCode, header};
use axum::middleware::Next;
use axum::response::{IntoResponse, Response};
use std::sync::Arc;

/// For how long a browser may remember that another page's requests are allowed, in s.
const PREFLIGHT_S: u32 = 600;
/// The role that a request needs; `None` for the page's own files, which everybody may read: the page brings the token.
pub fn find_needed_role_unless_public(method: &Method, path: &str) -> Option<Role> {
    let only_reads = matches!(*method, Method::GET | Method::HEAD | Method::OPTIONS);
    match path {
        "/v1/arm" | "/v1/faults/clear" => Some(Role::Arm),
        "/openapi.json" if only_reads => None,
        path if only_reads && page_files::list_page_paths().any(|known| known == path) => None,
        _ if only_reads => Some(Role::View),
        _ => Some(Role::Touch),
    }
}

/// Lets a request through whose origin, name and token are allowed, or answers why not.
pub async fn authorize_request_or_answer_preflight_and_add_cors_headers(
    State(access): State<Arc<Access>>,
    mut request: Request,
    next: Next,
) -> Response {
    let source = check_head_and_find_authority(&request).and_then(|host| {
        let scheme = request.extensions().get().copied();
        access.check_host_and_origin_and_return_allowed_foreign_origin(
            request.method(),
            request.headers(),
            host.as_ref(),
            scheme,
        )
    });
    let origin = match source {
        Ok(origin) => origin,
        Err(problem) => return problem.into_response(),
    };
    let is_preflight =
        *request.method() == Method::OPTIONS && request.headers().contains_key(header::ACCESS_CONTROL_REQUEST_METHOD);
    let mut response = if is_preflight && origin.is_some() {
        // A browser asks without the page's token whether the page may ask with it.
        let allowed = [
            (header::ACCESS_CONTROL_ALLOW_METHODS, "GET, POST"),
            (header::ACCESS_CONTROL_ALLOW_HEADERS, "authorization, content-type, x-request-id"),
        ];
        let age = [(header::ACCESS_CONTROL_MAX_AGE, PREFLIGHT_S.to_string())];
        (StatusCode::NO_CONTENT, allowed, age).into_response()
    } else {
        match access.check_token_if_required_and_find_number_and_role(
            &request,
            find_needed_role_unless_public(request.method(), request.uri().path()),
        ) {
            Ok(token) => {
                if let Some((token, role)) = token {
                    request.extensions_mut().insert(token);
                    request.extensions_mut().insert(role);
                }
                next.run(request).await
            }
            Err(problem) => problem.into_response(),
        }
    };
    if let Some(origin) = origin {
        let headers = response.headers_mut();
        headers.insert(header::ACCESS_CONTROL_ALLOW_ORIGIN, origin);
        headers.insert(header::ACCESS_CONTROL_EXPOSE_HEADERS, HeaderValue::from_static("retry-after, x-request-id"));
        headers.append(header::VARY, HeaderValue::from_static("origin"));
    }
    response
}

#[cfg(test)]
mod tests {
    use super::*;

    const TOKENS: &str = "view AAAAAAAAAAAAAAAAAAAAAA\ntouch BBBBBBBBBBBBBBBBBBBBBBBB\narm CCCCCCCCCCCCCCCCCCCCCCCC\n";

    #[test]
    fn a_token_opens_its_role_and_those_below() {
        let access = Access { tokens: Access::parse_tokens(TOKENS).unwrap(), ..Access::default() };
        let status = |method: &str, path: &str, token: Option<&str>| {
            let mut request = axum::http::Request::builder().method(method).uri(path);
            if let Some(token) = token {
                request = request.header("authorization", format!("Bearer {token}"));
            }
            let result = {
                let request = request.body(axum::body::Body::empty()).unwrap();
                access.check_token_if_required_and_find_number_and_role(
                    &request,
                    find_needed_role_unless_public(request.method(), request.uri().path()),
                )
            };
            result.err().map_or(200, |problem| problem.status().as_u16())
        };
        let [view, touch, arm] =
            ["AAAAAAAAAAAAAAAAAAAAAA", "BBBBBBBBBBBBBBBBBBBBBBBB", "CCCCCCCCCCCCCCCCCCCCCCCC"].map(Some);
        for (method, path, allowed) in [
            ("GET", "/v1/state", [401, 200, 200, 200]),
            ("GET", "/", [200; 4]),
            ("GET", "/link.js", [200; 4]),
            ("POST", "/link.js", [401, 403, 200, 200]),
            ("GET", "/metrics", [401, 200, 200, 200]),
            ("POST", "/v1/touch", [401, 403, 200, 200]),
            ("POST", "/v1/stop", [401, 403, 200, 200]),
            ("GET", "/v1/live", [401, 200, 200, 200]),
            ("POST", "/v1/arm", [401, 403, 403, 200]),
            ("POST", "/v1/faults/clear", [401, 403, 403, 200]),
        ] {
            let found = [None, view, touch, arm].map(|token| status(method, path, token));
            assert_eq!(found, allowed, "{method} {path}");
        }
        for wrong in ["", "A", "AAAAAAAAAAAAAAAAAAAAAB", "AAAAAAAAAAAAAAAAAAAAAAA"] {
            assert_eq!(status("GET", "/v1/state", Some(wrong)), 401, "{wrong:?}");
        }
        assert_eq!(status("GET", "/v1/live?token=BBBBBBBBBBBBBBBBBBBBBBBB", None), 200);
        assert_eq!(status("GET", "/v1/state?token=BBBBBBBBBBBBBBBBBBBBBBBB", None), 401);
        assert_eq!(status("GET", "/v1/live?send=state&token=AAAAAAAAAAAAAAAAAAAAAA", None), 200);
    }
}
