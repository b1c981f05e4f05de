//! The web page, inside the program.

use axum::http::{StatusCode, header};
use axum::response::{IntoResponse, Response};

/// Nothing from elsewhere, no inline code, no framing by other pages.
const POLICY: &str =
    "default-src 'self'; img-src 'self' data:; frame-ancestors 'none'; base-uri 'none'; form-action 'none'";

macro_rules! assets {
    ($($path:literal => $file:literal, $kind:literal;)*) => {
        &[$(($path, $kind, include_str!(concat!("../../../web/", $file)))),*]
    };
}

const ASSETS: &[(&str, &str, &str)] = assets! {
    "/" => "index.html", "text/html; charset=utf-8";
    "/style.css" => "style.css", "text/css; charset=utf-8";
    "/app.js" => "app.js", "text/javascript; charset=utf-8";
    "/design.js" => "design.js", "text/javascript; charset=utf-8";
    "/heat.js" => "heat.js", "text/javascript; charset=utf-8";
    "/job.js" => "job.js", "text/javascript; charset=utf-8";
    "/link.js" => "link.js", "text/javascript; charset=utf-8";
    "/panel.js" => "panel.js", "text/javascript; charset=utf-8";
    "/readout.js" => "readout.js", "text/javascript; charset=utf-8";
    "/study.js" => "study.js", "text/javascript; charset=utf-8";
    "/tolerances.js" => "tolerances.js", "text/javascript; charset=utf-8";
    "/icon.svg" => "icon.svg", "image/svg+xml";
};

/// Paths of all files of the page.
pub fn list_page_paths() -> impl Iterator<Item = &'static str> {
    ASSETS.iter().map(|(path, ..)| *path)
}

/// The same with what they are.
pub fn list_page_paths_and_types() -> impl Iterator<Item = (&'static str, &'static str)> {
    ASSETS.iter().map(|(path, kind, _)| (*path, *kind))
}

/// One file of the page.
pub fn serve_page_file(path: &str) -> Response {
    match ASSETS.iter().find(|(known, ..)| *known == path) {
        Some((_, kind, body)) => {
            let headers = [
                (header::CONTENT_TYPE, *kind),
                (header::CONTENT_SECURITY_POLICY, POLICY),
                (header::X_CONTENT_TYPE_OPTIONS, "nosniff"),
                // The page belongs to this build of the program; a newer one must not meet an old page.
                (header::CACHE_CONTROL, "no-cache"),
            ];
            (headers, *body).into_response()
        }
        None => StatusCode::NOT_FOUND.into_response(),
    }
}
