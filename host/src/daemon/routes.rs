//! The HTTP interface.

use super::app::App;
use super::body::{Most, whole_body};
use super::client::Client;
use super::messages;
use super::preview::{MAX_SCENE, PreviewRequest};
use super::problem::Problem;
use super::touch::TouchRequest;
use super::view::FieldView;
use super::{access, assets, live};
use axum::body::Bytes;
use axum::extract::rejection::PathRejection;
use axum::extract::{DefaultBodyLimit, Path, Query, State};
use axum::http::{HeaderMap, HeaderName, HeaderValue, Method, StatusCode, Uri, header};
use axum::middleware;
use axum::response::{IntoResponse, Response};
use axum::routing::{get, post};
use axum::{Json, Router};
use serde::Deserialize;
use serde::de::DeserializeOwned;
use serde_json::{Value, json};
use std::sync::Arc;

/// Longest request body in bytes; a touch takes under 200.
const MAX_BODY: usize = 16 * 1024;
/// The same for a preview: a scene whose every byte is escaped, and what goes with it.
const MAX_PREVIEW_BODY: usize = 2 * MAX_SCENE + MAX_BODY;
/// What a client calls its request, and how the answer calls it.
const REQUEST_ID: HeaderName = HeaderName::from_static("x-request-id");
/// The description of this interface.
const OPENAPI: &str = include_str!("openapi.json");

/// All routes.
pub fn router(app: Arc<App>) -> Router {
    let most = |bytes: usize| Most { bytes, time: app.limits.body };
    let mut router = Router::new()
        .route("/v1/touch", post(touch))
        .route("/v1/requests/{id}", get(request))
        .route("/v1/stop", post(stop))
        .route("/v1/arm", post(arm))
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
    let large = Router::new()
        .route("/v1/preview", post(preview))
        .layer(middleware::from_fn_with_state(most(MAX_PREVIEW_BODY), whole_body));
    router
        .layer(middleware::from_fn_with_state(most(MAX_BODY), whole_body))
        .merge(large)
        .fallback(not_found)
        .method_not_allowed_fallback(wrong_method)
        // The bounds above hold; this one would cut previews short.
        .layer(DefaultBodyLimit::disable())
        .layer(middleware::from_fn_with_state(Arc::clone(&app.access), access::check))
        .with_state(app)
}

/// Only the way to stop, where all other places are taken.
pub fn stop_only(app: Arc<App>) -> Router {
    Router::new()
        .route("/v1/stop", post(stop))
        .fallback(busy)
        .layer(middleware::from_fn_with_state(Most { bytes: MAX_BODY, time: app.limits.body }, whole_body))
        .layer(middleware::from_fn_with_state(Arc::clone(&app.access), access::check))
        .with_state(app)
}

async fn busy() -> Problem {
    let detail = "as many connections are open as there may be; only POST /v1/stop is taken on this one";
    Problem::new(StatusCode::SERVICE_UNAVAILABLE, "busy", "Too many connections", detail).retry(1000, None)
}

/// The request in a JSON body; `wanted` says in a message what it should look like.
fn from_body<T: DeserializeOwned>(headers: &HeaderMap, body: &Bytes, wanted: &str) -> Result<T, Problem> {
    super::body::check_type(headers)?;
    super::body::from_json(body, wanted)
}

async fn touch(
    State(app): State<Arc<App>>,
    client: Client,
    headers: HeaderMap,
    body: Bytes,
) -> Result<Response, Problem> {
    let stops = app.stops();
    let wanted = r#"{"x_px": number, "y_px": number, "intensity_g"?: number or "intensity_db"?: number, "duration_ms"?: number, "effect"?: "click" | "double_click" | "buzz" | "swell" | "pulse_train" | "texture", "count"?: number, "period_ms"?: number, "from_ms"?: number, "to_ms"?: number, "also"?: [{"x_px": number, "y_px": number, "intensity_g"?: number, "from_ms"?: number, "to_ms"?: number}, ...], "quiet"?: [{"x_px": number, "y_px": number, "radius_mm": number, "at_most_g": number}, ...], "objective"?: "contrast" | "reach" | "power", "grouping"?: "distinct" | "shared", "weigh"?: "equal" | "felt", "trade"?: boolean}"#;
    let request: TouchRequest = from_body(&headers, &body, wanted)?;
    let name = super::body::name(&headers)?;
    let id = app.admission.arrived(name.clone());
    // It has just been read as such.
    app.note("touch", || json!({"id": id, "body": serde_json::from_slice::<Value>(&body).unwrap_or_default()}));
    let answer = app.touch(client, id, stops, &request).await.map(messages::touched);
    app.note("outcome", || outcome(id, &answer));
    app.admission.done(id, answer.clone());
    let mut response = answer.map(Json).into_response();
    let name = HeaderValue::try_from(name.unwrap_or_else(|| id.to_string()));
    response.headers_mut().extend(name.ok().map(|name| (REQUEST_ID, name)));
    Ok(response)
}

/// What a recording keeps of an outcome: what was driven, or why not.
fn outcome(id: u64, answer: &Result<Value, Problem>) -> Value {
    match answer {
        Ok(answer) => json!({
            "id": id, "status": 200, "drives": answer["drives"], "predicted": answer["predicted"], "device": answer["device"],
        }),
        Err(problem) => json!({"id": id, "status": problem.status().as_u16(), "problem": problem}),
    }
}

async fn request(State(app): State<Arc<App>>, key: Result<Path<String>, PathRejection>) -> Result<Response, Problem> {
    let Path(key) = key.map_err(|error| {
        Problem::new(StatusCode::BAD_REQUEST, "bad-query", "The path cannot be used", error.body_text())
    })?;
    Ok(Json(app.admission.told(&key)?).into_response())
}

async fn arm(State(app): State<Arc<App>>) -> Result<Response, Problem> {
    app.note("arm", || json!({}));
    app.arm().await?;
    Ok(Json(messages::state(&app)).into_response())
}

async fn preview(State(app): State<Arc<App>>, headers: HeaderMap, body: Bytes) -> Result<Response, Problem> {
    let wanted = r#"{"x_px": number, "y_px": number, "intensity_g"?: number, "scene"?: TOML text, "moves"?: {"support[1]": {"x_mm": number, "y_mm"?: number}, ...}}"#;
    let request: PreviewRequest = from_body(&headers, &body, wanted)?;
    Ok(Json(app.preview(request).await?).into_response())
}

async fn stop(State(app): State<Arc<App>>) -> Result<Response, Problem> {
    app.note("stop", || json!({}));
    app.stop().await?;
    Ok(Json(messages::state(&app)).into_response())
}

async fn clear_faults(State(app): State<Arc<App>>) -> Result<Response, Problem> {
    app.note("clear", || json!({}));
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

async fn field(State(app): State<Arc<App>>, client: Client, uri: Uri) -> Result<Response, Problem> {
    let Query(query) = Query::<FieldQuery>::try_from_uri(&uri).map_err(|error| {
        Problem::new(StatusCode::BAD_REQUEST, "bad-query", "The query cannot be used", error.body_text())
    })?;
    let view = match (query.x_px, query.y_px) {
        (Some(x_px), Some(y_px)) => {
            let (x_m, y_m) = app.table.scene.place_px(x_px, y_px)?.xy_m();
            super::touch::check_intensity(query.intensity_g)?;
            let target = crate::planner::Target { x_m, y_m, intensity_g: query.intensity_g };
            let _place = app.admission.place(client).await?;
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
    let text = app.metrics.text(&app.device().borrow(), &app.admission);
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
