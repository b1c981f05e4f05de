//! Effects with names, and effects as files.

use super::body::parse_json_body;
use crate::daemon::access::client::Asker;
use crate::daemon::api::problem::Problem;
use crate::daemon::app::App;
use crate::daemon::touch::effect_file::{CheckedEffectFile, EffectFileRequest, PlayedEffectFileView};
use crate::effect_files::named::{NamedEffectView, list_named_effects};
use axum::Json;
use axum::body::Bytes;
use axum::extract::State;
use axum::http::HeaderMap;
use axum::response::{IntoResponse, Response};
use serde_json::{Value, json};
use std::sync::Arc;

/// The effects that have names
///
/// Those of touches are asked for with `effect` of a touch; those of files are what an effect file puts together.
#[utoipa::path(
    get,
    path = "/v1/effects", operation_id = "named_effects",
    responses((status = 200, description = "The effects", body = Vec<NamedEffectView>)),
)]
pub async fn get_effects() -> Response {
    Json(list_named_effects()).into_response()
}

/// Play an effect file
///
/// All parts are designed before the first one begins, and are then played at their times. A stop, a newer touch or an outage ends it.
#[utoipa::path(
    post,
    path = "/v1/effects", operation_id = "play_effect_file",
    request_body = EffectFileRequest,
    responses((status = 200, description = "What is played, and what the device achieves of the first part", body = PlayedEffectFileView)),
)]
pub async fn post_effects(
    State(app): State<Arc<App>>,
    asker: Asker,
    headers: HeaderMap,
    body: Bytes,
) -> Result<Response, Problem> {
    let stops = app.driver.stop_count();
    let wanted = r#"{"x_px": number, "y_px": number, "intensity_g"?: number, "effect"?: {"version": 1, "events": [...]} or "file"?: text, "format"?: "toml" | "json" | "ahap" | "hjif" | "haptic"}"#;
    let request: EffectFileRequest = parse_json_body(&headers, &body, wanted)?;
    let id = app.driver.admission.allocate_request_number();
    app.record_line(
        "effect_file",
        || json!({"id": id, "body": serde_json::from_slice::<Value>(&body).unwrap_or_default()}),
    );
    let file = tokio::task::block_in_place(|| CheckedEffectFile::from_request(&request, &app.table.scene))?;
    let played = app.driver.play_effect_file(&asker, id, stops, &file).await;
    app.metrics.count_touch(played.is_ok());
    Ok(Json(played?).into_response())
}
