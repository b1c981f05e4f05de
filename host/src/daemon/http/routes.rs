//! The HTTP interface.

use super::authorize::authorize_request_or_answer_preflight_and_add_cors_headers;
use super::body::{BodyLimit, parse_json_body, read_uncompressed_body_within_limit};
use super::effect_routes::{
    __path_get_effects, __path_post_effect_file_to_play, get_effects, post_effect_file_to_play,
};
use super::{description, page_files};
use crate::daemon::access::client::{Asker, Client};
use crate::daemon::access::limits::Limits;
use crate::daemon::access::pace::delay_requests_above_rate_except_accepted_stop;
use crate::daemon::api::problem::{Problem, ProblemKind};
use crate::daemon::app::App;
use crate::daemon::design::preview::{MAX_SCENE, Preview, PreviewRequest};
use crate::daemon::design::studies::{StudyRequest, StudyView};
use crate::daemon::design::tolerances::{TolerancesRequest, TolerancesView};
use crate::daemon::live;
use crate::daemon::live::message::LiveMessage;
use crate::daemon::observe::scene::SceneView;
use crate::daemon::observe::state::StateView;
use crate::daemon::touch::Touch;
use crate::daemon::touch::answer::TouchedView;
use crate::daemon::touch::check::{build_planner_target_at_px, check_intensity_range};
use crate::daemon::touch::outcome::{RequestOutcome, summarize_outcome_for_recording};
use crate::daemon::touch::plan_view::FieldView;
use crate::daemon::touch::request::TouchRequest;
use crate::effect_files::MAX_TEXT_BYTES;
use crate::planner::STANDARD_GRAVITY;
use axum::body::Bytes;
use axum::extract::rejection::PathRejection;
use axum::extract::{DefaultBodyLimit, Path, State};
use axum::http::{HeaderMap, HeaderName, HeaderValue, Method, Uri, header};
use axum::middleware;
use axum::response::{IntoResponse, Response};
use axum::routing::{get, post};
use axum::{Json, Router};
use serde::Deserialize;
use serde_json::{Value, json};
use std::sync::{Arc, LazyLock};
use std::time::Duration;
use tokio::sync::Semaphore;
use utoipa::openapi::path::{HttpMethod, OperationBuilder, Paths};
use utoipa::openapi::schema::{ObjectBuilder, Type};
use utoipa::openapi::{ContentBuilder, ResponseBuilder};
use utoipa::{IntoParams, OpenApi};
use utoipa_axum::router::{OpenApiRouter, UtoipaMethodRouter};
use utoipa_axum::routes;

/// What fields without a place of their own are worked out in: one at a time, however many ask for them.
static FIELDS: Semaphore = Semaphore::const_new(1);
/// Longest request body in bytes; a touch takes under 200.
const MAX_BODY: usize = 16 * 1024;
/// The same for a preview: a scene whose every byte is escaped, and what goes with it.
const MAX_PREVIEW_BODY: usize = 2 * MAX_SCENE + MAX_BODY;
/// The same for a study, with its own file.
const MAX_STUDY_BODY: usize = 4 * MAX_SCENE + MAX_BODY;
/// The same for an effect file, every byte of which is escaped.
const MAX_EFFECT_BODY: usize = 2 * MAX_TEXT_BYTES + MAX_BODY;
/// What a client calls its request, and how the answer calls it.
const REQUEST_ID: HeaderName = HeaderName::from_static("x-request-id");
/// The description of this interface.
static DESCRIPTION: LazyLock<String> =
    LazyLock::new(|| description::build_openapi_json(&declare_routes(Limits::default().body).into_openapi()));

/// The description of this interface (OpenAPI 3.1), as JSON text.
#[must_use]
pub fn openapi_description_json() -> &'static str {
    &DESCRIPTION
}

/// What is said on the live socket, and problems, which no path names as a whole.
#[derive(OpenApi)]
#[openapi(components(schemas(live::PageMessage, LiveMessage, Problem)))]
struct CommonSchemas;

/// All routes with what they declare: there is no other way to add one. A body has `body_time_limit` to come.
fn declare_routes(body_time_limit: Duration) -> OpenApiRouter<Arc<App>> {
    let mut router = OpenApiRouter::with_openapi(CommonSchemas::openapi())
        .routes(routes!(post_touch))
        .routes(routes!(get_effects))
        .routes(routes!(get_request_outcome))
        .routes(routes!(post_arm))
        .routes(routes!(post_clear_faults))
        .routes(routes!(get_state))
        .routes(routes!(get_scene))
        .routes(routes!(get_predicted_peak_acceleration_field))
        .routes(routes!(get_study))
        .routes(routes!(stop_study))
        .routes(routes!(get_tolerance_study))
        .routes(routes!(stop_tolerance_study))
        .routes(routes!(live::upgrade_to_live_socket))
        .routes(routes!(get_metrics))
        .routes(routes!(get_openapi));
    for (path, kind) in page_files::list_page_paths_and_types() {
        router = router.routes(declare_page_file_route(path, kind));
    }
    let most = |bytes: usize| BodyLimit { bytes, time: body_time_limit };
    let large = OpenApiRouter::new()
        .routes(routes!(post_preview))
        .routes(routes!(begin_tolerance_study_of_requested_touch))
        .layer(middleware::from_fn_with_state(most(MAX_PREVIEW_BODY), read_uncompressed_body_within_limit));
    let files = OpenApiRouter::new()
        .routes(routes!(post_effect_file_to_play))
        .layer(middleware::from_fn_with_state(most(MAX_EFFECT_BODY), read_uncompressed_body_within_limit));
    let larger = OpenApiRouter::new()
        .routes(routes!(begin_study))
        .layer(middleware::from_fn_with_state(most(MAX_STUDY_BODY), read_uncompressed_body_within_limit));
    router
        .layer(middleware::from_fn_with_state(most(MAX_BODY), read_uncompressed_body_within_limit))
        .merge(large)
        .merge(files)
        .merge(larger)
        // Of a stop nothing is read: it counts though its body never comes.
        .routes(routes!(post_stop))
}

/// A file of the page.
fn declare_page_file_route(path: &'static str, content_type: &'static str) -> UtoipaMethodRouter<Arc<App>> {
    let text = ObjectBuilder::new().schema_type(Type::String).build();
    let file = ResponseBuilder::new()
        .description("The contents of the file")
        .content(content_type, ContentBuilder::new().schema(Some(text)).build())
        .build();
    let name = if path == "/" { "page".to_owned() } else { path.trim_start_matches('/').replace('.', "_") };
    let operation = OperationBuilder::new()
        .operation_id(Some(name))
        .summary(Some(if path == "/" { "The web page" } else { "A file of the web page" }))
        .response("200", file)
        .build();
    let mut paths = Paths::new();
    paths.add_path_operation(path, vec![HttpMethod::Get], operation);
    (Vec::new(), paths, get(move || async move { page_files::serve_page_file(path) }))
}

/// All routes.
pub fn build_router(app: Arc<App>) -> Router {
    Router::from(declare_routes(app.limits.body))
        .fallback(answer_not_found)
        .method_not_allowed_fallback(answer_wrong_method)
        // The bounds above hold; this one would cut previews short.
        .layer(DefaultBodyLimit::disable())
        .layer(middleware::from_fn_with_state(
            Arc::clone(&app.access),
            authorize_request_or_answer_preflight_and_add_cors_headers,
        ))
        .layer(middleware::from_fn_with_state(Arc::clone(&app.pace), delay_requests_above_rate_except_accepted_stop))
        .with_state(app)
}

/// Only the way to stop, where all other places are taken.
pub fn build_stop_only_router(app: Arc<App>) -> Router {
    Router::new()
        .route("/v1/stop", post(post_stop))
        .fallback(answer_too_many_connections)
        .layer(middleware::from_fn_with_state(
            Arc::clone(&app.access),
            authorize_request_or_answer_preflight_and_add_cors_headers,
        ))
        .layer(middleware::from_fn_with_state(Arc::clone(&app.pace), delay_requests_above_rate_except_accepted_stop))
        .layer(middleware::map_response(close_connection_after_failure))
        .with_state(app)
}

/// Whoever is not stopped by this connection is to come again on another, which may have all paths by then.
async fn close_connection_after_failure(mut response: Response) -> Response {
    if !response.status().is_success() {
        response.headers_mut().insert(header::CONNECTION, HeaderValue::from_static("close"));
    }
    response
}

async fn answer_too_many_connections() -> Problem {
    let detail = "the maximum number of connections is open; this connection accepts POST /v1/stop only";
    Problem::new(ProblemKind::ConnectionsFull, detail).with_retry(1000, None)
}

/// Plan a touch and drive the plan
#[utoipa::path(
    post,
    path = "/v1/touch", operation_id = "touch",
    params(("x-request-id" = Option<String>, Header, description = "The client's own name for the request: 1 to 64 \
        characters (letters, digits, '-', '_' and '.'), at least one of them not a digit")),
    request_body = TouchRequest,
    responses((
        status = 200,
        description = "The plan, and the drives that the device achieves",
        body = TouchedView,
        headers(("x-request-id" = String, description = "The client's name for the request; without a name, the number of the request")),
    )),
)]
async fn post_touch(
    State(app): State<Arc<App>>,
    asker: Asker,
    headers: HeaderMap,
    body: Bytes,
) -> Result<Response, Problem> {
    let stops = app.driver.stop_count();
    let wanted = r#"{"x_px": number, "y_px": number, "intensity_g"?: number or "intensity_db"?: number, "duration_ms"?: number, "effect"?: "click" | "double_click" | "buzz" | "swell" | "pulse_train" | "texture", "count"?: number, "period_ms"?: number, "crisp_ms"?: number, "prefer"?: "strength" | "crispness", "from_ms"?: number, "to_ms"?: number, "also"?: [{"x_px": number, "y_px": number, "intensity_g"?: number, "from_ms"?: number, "to_ms"?: number}, ...], "quiet"?: [{"x_px": number, "y_px": number, "radius_mm": number, "at_most_g": number}, ...], "objective"?: "contrast" | "reach" | "power", "grouping"?: "distinct" | "shared", "weigh"?: "equal" | "felt", "trade"?: boolean}"#;
    let request: TouchRequest = parse_json_body(&headers, &body, wanted)?;
    let name = super::body::read_client_request_name(&headers)?;
    let id = app.driver.admission.register_request(asker.client, name.clone());
    // It has just been read as such.
    app.record_line("touch", || json!({"id": id, "body": serde_json::from_slice::<Value>(&body).unwrap_or_default()}));
    let touched = match Touch::from_request(&request, &app.table.scene) {
        Ok(touch) => app.driver.plan_and_drive_touch_counting_outcome(&asker, id, stops, &touch).await,
        Err(problem) => {
            app.metrics.count_touch(false);
            Err(problem)
        }
    };
    let answer = touched.map(|touched| json!(touched));
    app.record_line("outcome", || summarize_outcome_for_recording(id, &answer));
    app.driver.admission.record_outcome(id, answer.clone());
    let mut response = answer.map(Json).into_response();
    let name = HeaderValue::try_from(name.unwrap_or_else(|| id.to_string()));
    response.headers_mut().extend(name.ok().map(|name| (REQUEST_ID, name)));
    Ok(response)
}

/// The outcome of a touch; the daemon keeps the outcomes of 256 touches
#[utoipa::path(
    get,
    path = "/v1/requests/{id}", operation_id = "request",
    params(("id" = String, Path, description = "The number of the request (plan_id of its answer), or the client's name for the request (x-request-id)")),
    responses((status = 200, description = "The state of the request, and its answer or problem", body = RequestOutcome)),
)]
async fn get_request_outcome(
    State(app): State<Arc<App>>,
    client: Client,
    key: Result<Path<String>, PathRejection>,
) -> Result<Response, Problem> {
    let Path(key) = key.map_err(|error| Problem::new(ProblemKind::BadPath, error.body_text()))?;
    let mut told = app.driver.admission.find_outcome_by_request_number_or_own_name(client, &key)?;
    told.acceleration_peak_g = app.driver.find_simulated_sensor_peak_of_touch_g(told.id);
    Ok(Json(told).into_response())
}

/// Arm the device unless it is armed, so that the next touch does not wait for the self-test
#[utoipa::path(post, path = "/v1/arm", operation_id = "arm", responses((status = 200, description = "The state after arming", body = StateView)))]
async fn post_arm(State(app): State<Arc<App>>, client: Client) -> Result<Response, Problem> {
    app.record_line("arm", || json!({}));
    let armed = app.driver.arm_device(client).await;
    app.record_line("armed", || json!({"problem": armed.as_ref().err()}));
    armed?;
    Ok(Json(app.build_state_view()).into_response())
}

/// Compute the plan and the field of a touch on a changed scene, without driving anything
///
/// The daemon computes two previews at a time, at most one for each client. One more preview of each client can wait; a newer request replaces
/// the waiting one, which is then answered with 409. A preview ends if its client closes the connection, and after 10 s at the latest. The relative
/// tolerance of the model is 1e-2.
#[utoipa::path(
    post,
    path = "/v1/preview", operation_id = "preview",
    request_body = PreviewRequest,
    responses((status = 200, description = "The plan, the field and the scene of the preview", body = Preview)),
)]
async fn post_preview(
    State(app): State<Arc<App>>,
    asker: Asker,
    headers: HeaderMap,
    body: Bytes,
) -> Result<Response, Problem> {
    let wanted = r#"{"x_px": number, "y_px": number, "intensity_g"?: number, "scene"?: TOML text, "moves"?: {"support[1]": {"x_mm": number, "y_mm"?: number}, ...}}"#;
    let read = move || parse_json_body::<PreviewRequest>(&headers, &body, wanted);
    Ok(Json(app.compute_preview(&asker, read).await?).into_response())
}

/// Begin a small design study, without driving anything
///
/// One study runs at a time, on half of the processors. The daemon keeps the results until the next study begins.
#[utoipa::path(
    post,
    path = "/v1/study",
    request_body = StudyRequest,
    responses((status = 200, description = "The study has begun", body = StudyView)),
)]
async fn begin_study(
    State(app): State<Arc<App>>,
    asker: Asker,
    headers: HeaderMap,
    body: Bytes,
) -> Result<Response, Problem> {
    let wanted = r#"{"study": TOML text, "scene"?: TOML text}"#;
    let read = move || parse_json_body::<StudyRequest>(&headers, &body, wanted);
    Ok(Json(app.studies.begin_study(&asker, read).await?).into_response())
}

/// The progress and the results of the study
#[utoipa::path(get, path = "/v1/study", operation_id = "study", responses((status = 200, description = "The progress and the results of the study", body = StudyView)))]
async fn get_study(State(app): State<Arc<App>>) -> Response {
    Json(app.studies.view_newest_study()).into_response()
}

/// End the study; `stage` becomes `stopped` when the designs that have begun have ended
#[utoipa::path(post, path = "/v1/study/stop", responses((status = 200, description = "The progress and the results of the study", body = StudyView)))]
async fn stop_study(State(app): State<Arc<App>>) -> Response {
    app.studies.stop_newest_study();
    Json(app.studies.view_newest_study()).into_response()
}

/// Begin to compute the effect of manufacturing tolerances on a plan, without driving anything
///
/// The drives of the plan stay the same. The daemon models 128 panels whose springs, material, thickness and places differ from the scene: 64
/// panels with all differences together, and 16 panels with each kind of difference alone. One tolerance study or study runs at a time, on half of
/// the processors. The daemon keeps the results until the next tolerance study begins.
#[utoipa::path(
    post,
    path = "/v1/tolerances", operation_id = "begin_tolerances",
    request_body = TolerancesRequest,
    responses((status = 200, description = "The tolerance study has begun", body = TolerancesView)),
)]
async fn begin_tolerance_study_of_requested_touch(
    State(app): State<Arc<App>>,
    asker: Asker,
    headers: HeaderMap,
    body: Bytes,
) -> Result<Response, Problem> {
    let wanted = r#"{"x_px": number, "y_px": number, "intensity_g"?: number, "scene"?: TOML text, "moves"?: {"support[1]": {"x_mm": number, "y_mm"?: number}, ...}, "tolerances"?: {"springs"?: number, "youngs_modulus"?: number, "thickness"?: number, "places_mm"?: number}}"#;
    let read = move || parse_json_body::<TolerancesRequest>(&headers, &body, wanted);
    Ok(Json(app.begin_tolerance_study_of_requested_touch(&asker, read).await?).into_response())
}

/// The progress and the results of the tolerance study
#[utoipa::path(
    get,
    path = "/v1/tolerances", operation_id = "tolerances",
    responses((status = 200, description = "The plan, the progress of the tolerance study, and its results", body = TolerancesView)),
)]
async fn get_tolerance_study(State(app): State<Arc<App>>) -> Response {
    Json(app.tolerances.view_newest_study()).into_response()
}

/// End the tolerance study; `stage` becomes `stopped` when the panels that have begun have ended
#[utoipa::path(
    post,
    path = "/v1/tolerances/stop", operation_id = "stop_tolerances",
    responses((status = 200, description = "The plan, the progress of the tolerance study, and its results", body = TolerancesView)),
)]
async fn stop_tolerance_study(State(app): State<Arc<App>>) -> Response {
    app.tolerances.stop_newest_study();
    Json(app.tolerances.view_newest_study()).into_response()
}

/// End all drives and disarm the device
///
/// If the device does not answer (502), the daemon sends the stop nevertheless, and the dead-man timer of the device switches the high voltage off
/// 250 ms after the last frame that the device received.
#[utoipa::path(post, path = "/v1/stop", operation_id = "stop", responses((status = 200, description = "The state after the stop", body = StateView)))]
async fn post_stop(State(app): State<Arc<App>>) -> Result<Response, Problem> {
    app.record_line("stop", || json!({}));
    app.stop_device().await?;
    Ok(Json(app.build_state_view()).into_response())
}

/// Clear the fault that the device has latched
#[utoipa::path(
    post,
    path = "/v1/faults/clear", operation_id = "clear_faults",
    responses((status = 200, description = "The state after the fault was cleared", body = StateView)),
)]
async fn post_clear_faults(State(app): State<Arc<App>>, client: Client) -> Result<Response, Problem> {
    app.record_line("clear", || json!({}));
    let cleared = app.driver.clear_faults(client).await;
    app.record_line("cleared", || json!({"problem": cleared.as_ref().err()}));
    cleared?;
    Ok(Json(app.build_state_view()).into_response())
}

/// Latest state of the device, the plan, the telemetry and the link
#[utoipa::path(get, path = "/v1/state", operation_id = "state", responses((status = 200, description = "The state of the device, the plan, the telemetry and the link", body = StateView)))]
async fn get_state(State(app): State<Arc<App>>) -> Response {
    Json(app.build_state_view()).into_response()
}

/// The scene, with the values that a page needs to draw it
#[utoipa::path(get, path = "/v1/scene", operation_id = "scene", responses((status = 200, description = "The scene that the daemon serves", body = SceneView)))]
async fn get_scene(State(app): State<Arc<App>>) -> Response {
    ([(header::CONTENT_TYPE, "application/json")], app.scene.answer.clone()).into_response()
}

/// The field of the current plan, or of the plan for `x_px`, `y_px` without driving anything.
#[derive(Debug, Deserialize, IntoParams)]
#[into_params(parameter_in = Query)]
#[serde(deny_unknown_fields)]
struct FieldQuery {
    /// Distance of a touch, which is not driven, from the left edge of the screen in pixels. Without `x_px` and `y_px`, the field is that of the
    /// current plan.
    #[serde(default, deserialize_with = "crate::daemon::api::query::deserialize_present_query_number_as_some")]
    x_px: Option<f64>,
    /// Distance of the touch from the top edge of the screen in pixels; only together with `x_px`.
    #[serde(default, deserialize_with = "crate::daemon::api::query::deserialize_present_query_number_as_some")]
    y_px: Option<f64>,
    /// Wanted peak acceleration of the touch in g; 0.5 if absent.
    #[serde(default, deserialize_with = "crate::daemon::api::query::deserialize_present_query_number_as_some")]
    intensity_g: Option<f64>,
}

/// Predicted peak acceleration over the surface
#[utoipa::path(
    get,
    path = "/v1/field", operation_id = "field",
    params(FieldQuery),
    responses((status = 200, description = "The predicted peak acceleration at the points of a grid", body = FieldView)),
)]
async fn get_predicted_peak_acceleration_field(
    State(app): State<Arc<App>>,
    client: Client,
    uri: Uri,
) -> Result<Response, Problem> {
    let query: FieldQuery = crate::daemon::api::query::parse_query(
        &uri,
        "x_px=NUMBER&y_px=NUMBER, with or without &intensity_g=NUMBER, or is empty",
    )?;
    // Whether or not it is used.
    check_intensity_range(query.intensity_g)?;
    let view = match (query.x_px, query.y_px) {
        (Some(x_px), Some(y_px)) => {
            let target = build_planner_target_at_px(&app.table.scene, x_px, y_px, query.intensity_g)?;
            let _place = app.driver.admission.wait_for_planner_place_unless_queue_full(client).await?;
            tokio::task::block_in_place(|| -> Result<_, Problem> {
                let plan = app.table.plan(&[target])?;
                Ok(FieldView::new(&app.table, Some(&plan), 0))
            })?
        }
        (None, None) => {
            let _one = FIELDS.acquire().await;
            tokio::task::block_in_place(|| match app.driver.find_active_plan() {
                Some(active) => active.get_or_compute_peak_acceleration_field(&app.table).clone(),
                None => FieldView::new(&app.table, None, 0),
            })
        }
        _ => {
            let detail = "only one of x_px and y_px is given: give both, or neither for the field of the current plan";
            return Err(Problem::new(ProblemKind::BadQuery, detail));
        }
    };
    Ok(Json(view).into_response())
}

/// Counters in the Prometheus text format
#[utoipa::path(
    get,
    path = "/metrics", operation_id = "metrics",
    responses((status = 200, description = "The counters", body = String, content_type = "text/plain")),
)]
async fn get_metrics(State(app): State<Arc<App>>) -> Response {
    let peak_g = app
        .driver
        .list_simulated_sensor_peaks_of_newest_touches(1)
        .first()
        .map(|newest| newest.peak_m_per_s2 / STANDARD_GRAVITY);
    let text = app.metrics.format_prometheus(
        &app.driver.current_device_snapshot_marked_disconnected_if_thread_hung(),
        app.driver.time_since_last_answer(),
        &app.driver.admission,
        peak_g,
    );
    ([(header::CONTENT_TYPE, "text/plain; version=0.0.4; charset=utf-8")], text).into_response()
}

/// This description
#[utoipa::path(
    get,
    path = "/openapi.json", operation_id = "openapi",
    responses((status = 200, description = "The description of this interface (OpenAPI 3.1)", body = Object, content_type = "application/json")),
)]
async fn get_openapi() -> Response {
    ([(header::CONTENT_TYPE, "application/json")], openapi_description_json()).into_response()
}

async fn answer_not_found(uri: Uri) -> Problem {
    let detail = format!("the path {} does not exist; /openapi.json lists all paths", uri.path());
    Problem::new(ProblemKind::NotFound, detail)
}

async fn answer_wrong_method(method: Method, uri: Uri) -> Problem {
    let detail = format!(
        "the path {} accepts {}, but not {method}; /openapi.json lists all paths",
        uri.path(),
        list_methods_of_path(uri.path()).join(", ")
    );
    Problem::new(ProblemKind::WrongMethod, detail)
}

/// The methods that a path takes.
fn list_methods_of_path(path: &str) -> &'static [String] {
    /// Every path with its methods, as the description has them.
    static METHODS: LazyLock<Vec<(String, Vec<String>)>> = LazyLock::new(|| {
        let description: Value = serde_json::from_str(openapi_description_json()).unwrap_or_default();
        let paths = description["paths"].as_object().into_iter().flatten();
        let names = |item: &Value| -> Vec<String> {
            item.as_object().into_iter().flatten().map(|(name, _)| name.to_uppercase()).collect()
        };
        paths.map(|(template, item)| (template.clone(), names(item))).collect()
    });
    let of = |template: &str| match template.split_once('{') {
        Some((begin, _)) => path.starts_with(begin),
        None => path == template,
    };
    METHODS.iter().find(|(template, _)| of(template)).map_or(&[], |(_, methods)| methods.as_slice())
}
