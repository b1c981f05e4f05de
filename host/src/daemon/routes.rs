//! The HTTP interface.

use super::app::App;
use super::messages;
use super::preview::{MAX_SCENE, PreviewRequest};
use super::problem::Problem;
use super::touch::TouchRequest;
use super::view::FieldView;
use super::{assets, live};
use axum::body::Bytes;
use axum::extract::rejection::BytesRejection;
use axum::extract::{DefaultBodyLimit, Query, Request, State};
use axum::http::{HeaderMap, Method, StatusCode, Uri, header};
use axum::middleware::{self, Next};
use axum::response::{IntoResponse, Response};
use axum::routing::{get, post};
use axum::{Json, Router};
use serde::Deserialize;
use serde::de::DeserializeOwned;
use std::sync::Arc;

/// Longest request body in bytes; a touch takes under 200.
const MAX_BODY: usize = 16 * 1024;
/// The same for a preview: a scene whose every byte is escaped, and what goes with it.
const MAX_PREVIEW_BODY: usize = 2 * MAX_SCENE + MAX_BODY;
/// The description of this interface.
const OPENAPI: &str = include_str!("openapi.json");

/// All routes.
pub fn router(app: Arc<App>) -> Router {
    let mut router = Router::new()
        .route("/v1/touch", post(touch))
        .route("/v1/preview", post(preview).layer(DefaultBodyLimit::max(MAX_PREVIEW_BODY)))
        .route("/v1/stop", post(stop))
        .route("/v1/faults/clear", post(clear_faults))
        .route("/v1/state", get(state))
        .route("/v1/scene", get(scene))
        .route("/v1/field", get(field))
        .route("/v1/live", get(live::upgrade))
        .route("/metrics", get(metrics))
        .route("/openapi.json", get(openapi));
    for path in assets::paths() {
        router = router.route(path, get(move || async move { assets::asset(path) }));
    }
    router
        .fallback(not_found)
        .method_not_allowed_fallback(wrong_method)
        .layer(DefaultBodyLimit::max(MAX_BODY))
        .layer(middleware::from_fn(same_origin))
        .with_state(app)
}

/// Refuses requests that a page from elsewhere makes a browser send: this daemon moves hardware.
async fn same_origin(request: Request, next: Next) -> Response {
    let headers = request.headers();
    // A name that someone else's DNS may point here is not ours, whatever page it comes from ("DNS rebinding").
    if let Some(host) = text(headers, header::HOST)
        && !is_own(host)
    {
        let detail = format!("requests for {host} are not taken; use localhost or the daemon's address in numbers");
        return Problem::new(StatusCode::FORBIDDEN, "foreign-host", "Foreign host", detail).into_response();
    }
    if let Some(origin) = text(headers, header::ORIGIN) {
        let own = text(headers, header::HOST).unwrap_or_default();
        if origin.split_once("://").is_none_or(|(_, authority)| authority != own) {
            let detail = format!("requests from pages of {origin} are not taken; open the page of this daemon itself");
            return Problem::new(StatusCode::FORBIDDEN, "foreign-origin", "Foreign page", detail).into_response();
        }
    }
    next.run(request).await
}

/// Whether a Host header names this machine beyond doubt: localhost, or an address in numbers.
fn is_own(host: &str) -> bool {
    let name = host.rsplit_once(':').filter(|(_, port)| port.parse::<u16>().is_ok()).map_or(host, |(name, _)| name);
    let address = name.trim_start_matches('[').trim_end_matches(']');
    name.eq_ignore_ascii_case("localhost") || address.parse::<std::net::IpAddr>().is_ok()
}

fn text(headers: &HeaderMap, name: header::HeaderName) -> Option<&str> {
    headers.get(name).and_then(|value| value.to_str().ok())
}

/// The request in a body of at most `most` bytes; `wanted` says in a message what it should look like.
fn from_body<T: DeserializeOwned>(
    body: Result<Bytes, BytesRejection>,
    most: usize,
    wanted: &str,
) -> Result<T, Problem> {
    let body = body.map_err(|rejection| {
        let detail = format!("{}; at most {most} bytes are taken", rejection.body_text());
        Problem::new(rejection.status(), "bad-body", "The request's body cannot be used", detail)
    })?;
    super::body::from_json(&body, wanted)
}

async fn touch(State(app): State<Arc<App>>, body: Result<Bytes, BytesRejection>) -> Result<Response, Problem> {
    let wanted = r#"{"x_px": number, "y_px": number, "intensity_g"?: number or "intensity_db"?: number, "duration_ms"?: number, "effect"?: "click" | "double_click" | "buzz" | "swell" | "pulse_train" | "texture", "count"?: number, "period_ms"?: number, "from_ms"?: number, "to_ms"?: number, "also"?: [{"x_px": number, "y_px": number, "intensity_g"?: number, "from_ms"?: number, "to_ms"?: number}, ...], "quiet"?: [{"x_px": number, "y_px": number, "radius_mm": number, "at_most_g": number}, ...], "objective"?: "contrast" | "reach" | "power", "grouping"?: "distinct" | "shared", "weigh"?: "equal" | "felt", "trade"?: boolean}"#;
    let request: TouchRequest = from_body(body, MAX_BODY, wanted)?;
    Ok(Json(messages::touched(app.touch(&request).await?)).into_response())
}

async fn preview(State(app): State<Arc<App>>, body: Result<Bytes, BytesRejection>) -> Result<Response, Problem> {
    let wanted = r#"{"x_px": number, "y_px": number, "intensity_g"?: number, "scene"?: TOML text, "moves"?: {"support[1]": {"x_mm": number, "y_mm"?: number}, ...}}"#;
    let request: PreviewRequest = from_body(body, MAX_PREVIEW_BODY, wanted)?;
    Ok(Json(app.preview(request).await?).into_response())
}

async fn stop(State(app): State<Arc<App>>) -> Result<Response, Problem> {
    app.stop().await?;
    Ok(Json(messages::state(&app)).into_response())
}

async fn clear_faults(State(app): State<Arc<App>>) -> Result<Response, Problem> {
    app.clear_faults().await?;
    Ok(Json(messages::state(&app)).into_response())
}

async fn state(State(app): State<Arc<App>>) -> Response {
    Json(messages::state(&app)).into_response()
}

async fn scene(State(app): State<Arc<App>>) -> Response {
    Json(&app.scene).into_response()
}

/// The field of the current plan, or of the plan for `x_px`, `y_px` without driving anything.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct FieldQuery {
    x_px: Option<f64>,
    y_px: Option<f64>,
    intensity_g: Option<f64>,
}

async fn field(State(app): State<Arc<App>>, uri: Uri) -> Result<Response, Problem> {
    let Query(query) = Query::<FieldQuery>::try_from_uri(&uri).map_err(|error| {
        Problem::new(StatusCode::BAD_REQUEST, "bad-query", "The query cannot be used", error.body_text())
    })?;
    let view = match (query.x_px, query.y_px) {
        (Some(x_px), Some(y_px)) => {
            let (x_m, y_m) = app.table.scene.place_px(x_px, y_px)?.xy_m();
            let target = crate::planner::Target { x_m, y_m, intensity_g: query.intensity_g };
            tokio::task::block_in_place(|| -> Result<_, Problem> {
                let plan = app.table.plan(&[target])?;
                Ok(FieldView::new(&app.table, Some(&plan), 0))
            })?
        }
        (None, None) => app.active().map_or_else(|| FieldView::new(&app.table, None, 0), |active| active.field.clone()),
        _ => {
            let detail = "give both x_px and y_px, or neither for the field of the current plan";
            return Err(Problem::new(StatusCode::BAD_REQUEST, "bad-query", "The query cannot be used", detail));
        }
    };
    Ok(Json(view).into_response())
}

async fn metrics(State(app): State<Arc<App>>) -> Response {
    let text = app.metrics.text(&app.device().borrow());
    ([(header::CONTENT_TYPE, "text/plain; version=0.0.4; charset=utf-8")], text).into_response()
}

async fn openapi() -> Response {
    ([(header::CONTENT_TYPE, "application/json")], OPENAPI).into_response()
}

async fn not_found(uri: Uri) -> Problem {
    let detail = format!("there is nothing at {}; see /openapi.json for what there is", uri.path());
    Problem::new(StatusCode::NOT_FOUND, "not-found", "Not found", detail)
}

async fn wrong_method(method: Method, uri: Uri) -> Problem {
    let detail = format!("{} does not take {method}; see /openapi.json", uri.path());
    Problem::new(StatusCode::METHOD_NOT_ALLOWED, "method-not-allowed", "Wrong method", detail)
}
