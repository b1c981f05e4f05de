//! Effects with names, and effects as files.

use super::body::parse_json_body;
use crate::daemon::access::client::Asker;
use crate::daemon::api::problem::Problem;
use crate::daemon::app::App;
use crate::daemon::touch::effect_file::{CheckedEffectFile, EffectFileRequest, PlayedEffectFileView};
use crate::daemon::touch::outcome::summarize_outcome_for_recording;
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
/// A touch names an effect in `effect`; an effect file names primitives in `primitive`.
#[utoipa::path(
    get,
    path = "/v1/effects", operation_id = "named_effects",
    responses((status = 200, description = "The effects that have names", body = Vec<NamedEffectView>)),
)]
pub async fn get_effects() -> Response {
    Json(list_named_effects()).into_response()
}

/// Play an effect file
///
/// The daemon designs all parts before the first part begins; the board then plays each part at its time. A stop, a newer touch or an outage
/// ends the effect.
/// Two files are designed at a time, one of each client, and one of each client waits; a newer request takes the place of the one that waits.
#[utoipa::path(
    post,
    path = "/v1/effects", operation_id = "play_effect_file",
    request_body = EffectFileRequest,
    responses((
        status = 200,
        description = "The parts that the board plays, and the drives that the device achieves for the first part",
        body = PlayedEffectFileView,
    )),
)]
pub async fn post_effect_file_to_play(
    State(app): State<Arc<App>>,
    asker: Asker,
    headers: HeaderMap,
    body: Bytes,
) -> Result<Response, Problem> {
    let stops = app.driver.stop_count();
    let wanted = r#"{"x_px": number, "y_px": number, "intensity_g"?: number, "effect"?: {"version": 1, "events": [...]} or "file"?: text or "file_base64"?: text, "format"?: "toml" | "json" | "ahap" | "hjif" | "hmpg" | "haptic" | "wav"}"#;
    let id = app.driver.admission.allocate_request_number();
    let (table, weak_app) = (Arc::clone(&app.table), Arc::downgrade(&app));
    let read = move || {
        let request: EffectFileRequest = parse_json_body(&headers, &body, wanted)?;
        if let Some(app) = weak_app.upgrade() {
            let line = || json!({"id": id, "body": serde_json::from_slice::<Value>(&body).unwrap_or_default()});
            app.record_line("effect_file", line);
        }
        CheckedEffectFile::from_request(request, &table.scene)
    };
    let played = app.driver.design_effect_file_and_begin_to_play_it(&asker, id, stops, read).await;
    app.metrics.count_touch(played.is_ok());
    app.record_line("outcome", || {
        summarize_outcome_for_recording(id, &played.as_ref().map(|view| json!(view)).map_err(Clone::clone))
    });
    Ok(Json(played?).into_response())
}
