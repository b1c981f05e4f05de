//! The WebSocket: touches in, state, plans and telemetry out.
//!
//! `mod` reads, `writer` writes, `fingers` drives: none of them waits for another, so that a page that reads slowly is still
//! heard, its stop first of all.

mod fingers;
mod writer;

use super::app::{App, SOCKETS};
use super::client::Client;
use super::problem::Problem;
use super::touch::Feel;
use super::view::TouchView;
use crate::effects::NamedEffect;
use axum::extract::ws::rejection::WebSocketUpgradeRejection;
use axum::extract::ws::{Message, WebSocket, WebSocketUpgrade};
use axum::extract::{Query, State};
use axum::http::{StatusCode, Uri};
use axum::response::{IntoResponse, Response};
use fingers::Fingers;
use futures_util::StreamExt;
use serde::Deserialize;
use serde_json::{Value, json};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use tokio::sync::mpsc;
use tokio::time::Instant;
use writer::Wants;

/// Longest message in bytes: ten fingers take under 1 kB.
const MAX_MESSAGE: usize = 16 * 1024;
/// Answers that may wait for a slow page.
const REPLIES: usize = 32;

/// What a page says. Plain structures, not an enum with its tag inside: serde reads such an enum by way of a copy in which
/// numbers are maps as soon as any crate of the program turns on serde_json's `arbitrary_precision`.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct Incoming {
    #[serde(rename = "type")]
    kind: Kind,
    /// The fingers that are down now; none when all are lifted.
    touches: Option<Vec<TouchView>>,
    intensity_g: Option<f64>,
    intensity_db: Option<f64>,
    duration_ms: Option<f64>,
    effect: Option<NamedEffect>,
    count: Option<u32>,
    period_ms: Option<f64>,
}

#[derive(Clone, Copy, Debug, Deserialize)]
#[serde(rename_all = "lowercase")]
enum Kind {
    Touch,
    /// Everything off.
    Stop,
}

/// What the reader has the writer send.
#[derive(Debug)]
enum Letter {
    Ping,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct LiveQuery {
    send: Option<String>,
    /// Which `access` has asked for.
    #[serde(rename = "token")]
    _token: Option<String>,
}

/// Takes the upgrade.
pub async fn upgrade(
    State(app): State<Arc<App>>,
    client: Client,
    uri: Uri,
    upgrade: Result<WebSocketUpgrade, WebSocketUpgradeRejection>,
) -> Result<Response, Problem> {
    let upgrade = upgrade.map_err(|rejection| {
        Problem::new(rejection.status(), "no-websocket", "A WebSocket is served here", rejection.body_text())
    })?;
    let bad = |detail: String| Problem::new(StatusCode::BAD_REQUEST, "bad-query", "The query cannot be used", detail);
    let Query(query) = Query::<LiveQuery>::try_from_uri(&uri).map_err(|error| bad(error.body_text()))?;
    let wants = match &query.send {
        None => Wants::ALL,
        Some(text) => Wants::parse(text).map_err(|name| {
            let detail = format!("send names {name:?}, but takes {}", Wants::NAMES);
            bad(detail).at("send", text.as_str().into(), Wants::NAMES.into(), None)
        })?,
    };
    let place = Arc::clone(&app.sockets).try_acquire_owned().map_err(|_| {
        let detail = format!("{SOCKETS} sockets are open, which is as many as there may be");
        Problem::new(StatusCode::SERVICE_UNAVAILABLE, "busy", "Too many sockets", detail).retry(1000, Some(SOCKETS))
    })?;
    let serve = async move |socket| {
        serve(app, client, socket, wants).await;
        drop(place);
    };
    Ok(upgrade.max_message_size(MAX_MESSAGE).on_upgrade(serve).into_response())
}

async fn serve(app: Arc<App>, client: Client, socket: WebSocket, wants: Wants) {
    // Names the page in recordings.
    static PAGES: AtomicU64 = AtomicU64::new(0);
    let page = PAGES.fetch_add(1, Ordering::Relaxed) + 1;
    let (sink, mut stream) = socket.split();
    let (letters, inbox) = mpsc::channel::<Letter>(1);
    let (replies, outbox) = mpsc::channel::<Value>(REPLIES);
    let fingers = Arc::new(Fingers::default());
    let mut writer = tokio::spawn(writer::write(Arc::clone(&app), sink, inbox, outbox, wants));
    tokio::spawn(fingers::drive(Arc::clone(&app), client, Arc::clone(&fingers), replies.clone()));
    let mut ping = tokio::time::interval(app.limits.ping);
    let mut heard = Instant::now();
    loop {
        tokio::select! {
            message = stream.next() => match message {
                Some(Ok(message)) => {
                    heard = Instant::now();
                    match message {
                        Message::Text(text) => {
                            if let Some(problem) = take(&app, page, text.as_str(), &fingers, &replies) {
                                // A page that reads nothing misses what is wrong with what it says.
                                let _ = replies.try_send(error_message(&problem));
                            }
                        }
                        Message::Close(_) => break,
                        _ => {}
                    }
                }
                Some(Err(_)) | None => break,
            },
            _ = ping.tick() => {
                if heard.elapsed() >= app.limits.silence {
                    tracing::info!("a page that has fallen silent is let go");
                    break;
                }
                let _ = letters.try_send(Letter::Ping);
            }
            // The page takes nothing any more, or the daemon ends.
            _ = &mut writer => break,
        }
    }
    app.note("gone", || json!({"socket": page}));
    fingers.go();
    drop(letters);
}

/// Carries out what a page said; what is wrong with it, if anything is.
fn take(app: &Arc<App>, page: u64, text: &str, fingers: &Fingers, replies: &mpsc::Sender<Value>) -> Option<Problem> {
    let wanted = r#"{"type": "touch", "touches": [...]} or {"type": "stop"}"#;
    match super::body::from_json(text.as_bytes(), wanted) {
        Ok(Incoming {
            kind: Kind::Touch,
            touches: Some(touches),
            intensity_g,
            intensity_db,
            duration_ms,
            effect,
            count,
            period_ms,
        }) => {
            let effect = effect.or_else(|| touches.iter().find_map(|touch| touch.effect));
            app.note(
                "fingers",
                || json!({"socket": page, "message": serde_json::from_str::<Value>(text).unwrap_or_default()}),
            );
            let feel = Feel { intensity_g, intensity_db, duration_ms, effect, count, period_ms };
            fingers.are(touches, feel, app.stops());
            None
        }
        Ok(Incoming { kind: Kind::Touch, touches: None, .. }) => {
            Some(Problem::body(format!("missing field `touches`; expected {wanted}")))
        }
        Ok(Incoming { kind: Kind::Stop, .. }) => {
            app.note("stop", || json!({"socket": page}));
            fingers.forget();
            // Of its own, so that the next message is read whatever the device does.
            let (app, replies) = (Arc::clone(app), replies.clone());
            tokio::spawn(async move {
                if let Err(error) = app.stop().await {
                    let _ = replies.try_send(error_message(&error.into()));
                }
            });
            None
        }
        Err(problem) => Some(problem),
    }
}

fn error_message(problem: &Problem) -> Value {
    json!({ "type": "error", "problem": problem })
}
