//! The WebSocket: touches in, state, plans and telemetry out.

use super::active::Update;
use super::app::App;
use super::messages;
use super::problem::Problem;
use super::touch::{Feel, MAX_DURATION_MS, Manner};
use super::view::TouchView;
use crate::effects::NamedEffect;
use axum::extract::State;
use axum::extract::ws::rejection::WebSocketUpgradeRejection;
use axum::extract::ws::{Message, WebSocket, WebSocketUpgrade};
use axum::response::{IntoResponse, Response};
use futures_util::{SinkExt, StreamExt};
use serde::Deserialize;
use serde_json::{Value, json};
use std::sync::Arc;
use std::time::{Duration, Instant};
use tokio::sync::{mpsc, watch};

/// Least time for which a tap vibrates, however short the finger was down.
const TAP: Duration = Duration::from_millis(400);
/// Between two looks whether a touch that nobody wants any more has begun to wait for its turn.
const AGAIN: Duration = Duration::from_millis(10);
/// Longest message in bytes: ten fingers take under 1 kB.
const MAX_MESSAGE: usize = 16 * 1024;
/// Messages that may wait for a slow page.
const OUTBOX: usize = 32;

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

/// The fingers of one page.
#[derive(Clone, Debug, Default)]
struct Fingers {
    touches: Vec<TouchView>,
    feel: Feel,
}

/// Takes the upgrade.
pub async fn upgrade(
    State(app): State<Arc<App>>,
    upgrade: Result<WebSocketUpgrade, WebSocketUpgradeRejection>,
) -> Response {
    let upgrade = match upgrade {
        Ok(upgrade) => upgrade,
        Err(rejection) => {
            return Problem::new(
                rejection.status(),
                "no-websocket",
                "A WebSocket is served here",
                rejection.body_text(),
            )
            .into_response();
        }
    };
    upgrade.max_message_size(MAX_MESSAGE).on_upgrade(move |socket| serve(app, socket))
}

async fn serve(app: Arc<App>, socket: WebSocket) {
    let (mut sink, mut stream) = socket.split();
    let (outbox, mut letters) = mpsc::channel::<Value>(OUTBOX);
    let writer = tokio::spawn(async move {
        while let Some(letter) = letters.recv().await {
            if sink.send(Message::Text(letter.to_string().into())).await.is_err() {
                return;
            }
        }
        let _ = sink.close().await;
    });
    // Only the newest set of fingers matters: a device slower than the page skips what came in between.
    let (fingers, newest) = watch::channel(Fingers::default());
    let driver = tokio::spawn(drive(Arc::clone(&app), newest, outbox.clone()));

    let (mut device, mut updates, closing) = (app.device(), app.updates(), app.closing());
    let mut closing = closing.subscribe();
    let mut first = vec![messages::typed("scene", &app.scene), messages::typed("state", &messages::state(&app))];
    first.extend(app.active().map(|active| messages::plan_message(&active)));
    for letter in first {
        if outbox.send(letter).await.is_err() {
            return;
        }
    }
    loop {
        let letter = tokio::select! {
            message = stream.next() => match message {
                Some(Ok(Message::Text(text))) => take(&app, text.as_str(), &fingers).await,
                Some(Ok(Message::Close(_)) | Err(_)) | None => break,
                Some(Ok(_)) => None,
            },
            changed = device.changed() => match changed {
                Ok(()) => Some(messages::typed("state", &messages::state(&app))),
                Err(_) => break,
            },
            update = updates.recv() => match update {
                Ok(Update::Plan(active)) => Some(messages::plan_message(&active)),
                Ok(Update::Stopped) => Some(messages::typed("state", &messages::state(&app))),
                // A slow page missed some; the next ones are newer anyway.
                Err(_) => None,
            },
            () = closed(&mut closing) => break,
        };
        if let Some(letter) = letter
            && outbox.send(letter).await.is_err()
        {
            break;
        }
    }
    // A page that goes away has lifted its fingers: the driver notices when the channel closes.
    drop(fingers);
    let _ = driver.await;
    drop(outbox);
    let _ = writer.await;
}

/// Resolves when the daemon shuts down.
async fn closed(closing: &mut watch::Receiver<bool>) {
    // An error means that the daemon is gone already.
    let _ = closing.wait_for(|closing| *closing).await.map(|_| ());
}

/// Carries out what a page said; the answer, if there is one.
async fn take(app: &App, text: &str, fingers: &watch::Sender<Fingers>) -> Option<Value> {
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
            let feel = Feel { intensity_g, intensity_db, duration_ms, effect, count, period_ms };
            fingers.send_replace(Fingers { touches, feel });
            None
        }
        Ok(Incoming { kind: Kind::Touch, touches: None, .. }) => {
            Some(error_message(&Problem::body(format!("missing field `touches`; expected {wanted}"))))
        }
        Ok(Incoming { kind: Kind::Stop, .. }) => {
            fingers.send_replace(Fingers::default());
            app.stop().await.err().map(|error| error_message(&error.into()))
        }
        Err(problem) => Some(error_message(&problem)),
    }
}

/// Drives what the fingers ask for until the page goes away.
async fn drive(app: Arc<App>, mut newest: watch::Receiver<Fingers>, outbox: mpsc::Sender<Value>) {
    // When the fingers went down, and the plan that is driven for them.
    let mut down: Option<(Instant, u64)> = None;
    // Fingers that came while others waited for their turn.
    let (mut is_changed, mut is_gone) = (false, false);
    while is_changed || newest.changed().await.is_ok() {
        is_changed = false;
        let Fingers { touches, feel } = newest.borrow_and_update().clone();
        if touches.is_empty() {
            if let Some((since, plan)) = down.take() {
                app.release(plan, since + TAP);
            }
            continue;
        }
        let driven = match feel.check(MAX_DURATION_MS) {
            Ok((intensity, manner)) => {
                let mut touch = std::pin::pin!(app.touch_all(touches, intensity, manner));
                // To its end in any case, but without waiting for its turn once there are newer fingers, or none.
                let done = loop {
                    tokio::select! {
                        done = &mut touch => break done,
                        changed = newest.changed(), if !is_changed && !is_gone => {
                            (is_changed, is_gone) = (changed.is_ok(), changed.is_err());
                        }
                        () = tokio::time::sleep(AGAIN), if is_changed || is_gone => {}
                    }
                    app.drop_waiting();
                };
                done.map(|done| (done, manner))
            }
            Err(problem) => Err(problem),
        };
        match driven {
            // An effect ends by itself, whatever the fingers do meanwhile.
            Ok((_, Manner::Effect(_))) => down = None,
            Ok((done, Manner::Hold(_))) => {
                down = Some((down.map_or_else(Instant::now, |(since, _)| since), done.active.id));
            }
            // The page itself has asked for something newer.
            Err(problem) if (is_changed || is_gone) && problem.is("superseded") => {}
            Err(problem) => {
                let _ = outbox.send(error_message(&problem)).await;
            }
        }
    }
    if let Some((since, plan)) = down {
        app.release(plan, since + TAP);
    }
}

fn error_message(problem: &Problem) -> Value {
    json!({ "type": "error", "problem": problem })
}
