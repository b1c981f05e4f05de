//! The WebSocket: touches in, state, plans and telemetry out.
//!
//! `mod` reads, `writer` writes, `fingers` drives what `finger_steps` keeps in order: none of them waits for another, so that a
//! page that reads slowly is still heard, its stop first of all. `closing` knows why a socket is closed.

mod closing;
mod finger_steps;
mod fingers;
mod incoming;
pub mod message;
mod writer;

use crate::daemon::access::client::{Client, Peer};
use crate::daemon::access::head::read_single_header;
use crate::daemon::access::permissions::Role;
use crate::daemon::api::problem::{Problem, ProblemKind};
use crate::daemon::app::{App, SOCKETS};
use crate::daemon::touch::Touch;
use crate::daemon::touch::check::CheckedFinger;
use crate::daemon::touch::request::Feel;
use crate::daemon::touch::request::Finger;
use crate::effects::NamedEffect;
use crate::planner::click::Preference;
use crate::text_file::BYTE_ORDER_MARK;
use axum::Extension;
use axum::extract::State;
use axum::extract::ws::rejection::WebSocketUpgradeRejection;
use axum::extract::ws::{CloseFrame, Message, WebSocket, WebSocketUpgrade};
use axum::http::{HeaderMap, Uri, header};
use axum::response::{IntoResponse, Response};
use finger_steps::PageFingers;
use futures_util::{FutureExt, StreamExt};
use message::LiveMessage;
use serde::Deserialize;
use serde_json::{Value, json};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use tokio::sync::mpsc;
use tokio::time::Instant;
use utoipa::{IntoParams, ToSchema};
use writer::PageTopics;

/// Longest message in bytes: ten fingers take under 1 kB.
const MAX_MESSAGE: usize = 16 * 1024;
/// A longer one than this ends the socket; one between is answered.
const MOST_READ: usize = 16 * MAX_MESSAGE;
/// Answers that may wait for a slow page.
const REPLIES: usize = 32;

/// What a page says. Plain structures, not an enum with its tag inside: serde reads such an enum by way of a copy in which
/// numbers are maps as soon as any crate of the program turns on serde_json's `arbitrary_precision`.
#[derive(Debug, Deserialize, ToSchema)]
#[schema(as = LiveIn, description = "A message from a page: the fingers that are down, or a stop.")]
#[schema(examples(
    json!({"type": "touch", "touches": [{"id": 1, "x_px": 960, "y_px": 640}], "intensity_g": 0.3}),
    json!({"type": "touch", "touches": []}),
    json!({"type": "stop"}),
))]
#[serde(deny_unknown_fields)]
pub struct PageMessage {
    /// Type of the message: `touch` or `stop`.
    #[serde(rename = "type")]
    kind: PageMessageKind,
    /// All fingers that are down now; empty if all fingers are lifted. Only in a message of the type `touch`.
    touches: Option<Vec<Finger>>,
    /// Wanted peak acceleration in g for fingers without `intensity_g`.
    intensity_g: Option<f64>,
    /// Wanted peak acceleration in dB above the threshold of feeling at the frequencies of the drives; absent with `intensity_g`.
    intensity_db: Option<f64>,
    /// Duration of the vibration in ms; with an effect, duration of the effect.
    duration_ms: Option<f64>,
    /// The effect that the board plays when a finger goes down; without an effect, the vibration has a constant intensity.
    effect: Option<NamedEffect>,
    /// Number of pulses of a `pulse_train`.
    #[serde(default, deserialize_with = "crate::whole_numbers::deserialize_whole_number_or_null")]
    count: Option<u32>,
    /// Time from one click, pulse or crest to the next, in ms.
    period_ms: Option<f64>,
    /// Longest time in ms until the vibration of a click is below a tenth of its peak.
    crisp_ms: Option<f64>,
    /// Which property a click keeps if it cannot be both strong and crisp.
    prefer: Option<Preference>,
}

/// Type of a message from a page.
#[derive(Clone, Copy, Debug, Deserialize, ToSchema)]
#[schema(as = LiveKind)]
#[serde(rename_all = "lowercase")]
enum PageMessageKind {
    /// Its fingers.
    Touch,
    /// Everything off.
    Stop,
}

/// What the reader has the writer send.
#[derive(Debug)]
enum WriterCommand {
    Ping,
    /// The last one.
    Close(CloseFrame),
}

/// What a page wants of its live socket.
#[derive(Debug, Deserialize, IntoParams)]
#[into_params(parameter_in = Query)]
#[serde(deny_unknown_fields)]
struct LiveQuery {
    /// Types of messages that the daemon sends, separated by commas: scene, state, plan, field. The default is scene, state and plan; field includes
    /// plan.
    send: Option<String>,
    /// Which taps the daemon drives if they arrive faster than they can be felt: each tap, in order (`all`, the default), or only the newest tap
    /// of those that wait (`newest`).
    #[param(inline)]
    taps: Option<TapQueue>,
    // `access` has asked for it.
    /// The token. It is in the query because a page cannot set the headers of a WebSocket.
    #[serde(rename = "token")]
    _token: Option<String>,
}

/// Which taps are driven where they come faster than they can be felt.
#[derive(Clone, Copy, Debug, Deserialize, PartialEq, Eq, ToSchema)]
#[serde(rename_all = "lowercase")]
enum TapQueue {
    /// Each, in order.
    All,
    /// Only the newest of those that wait.
    Newest,
}

/// WebSocket: touches in, state, plans and telemetry out
///
/// Text messages in JSON with a `type`: LiveIn from the page (at most 16 KiB), with all fingers that are down (none if all are lifted), and LiveOut
/// to the page. The daemon drives every tap. An effect begins when a finger goes down, and does not begin again when the finger moves. If the
/// daemon receives nothing from a page for 15 s, not even the answer to a ping, the fingers of the page count as lifted.
#[utoipa::path(
    get,
    path = "/v1/live",
    operation_id = "live",
    params(LiveQuery),
    responses((status = 101, description = "Switching protocols")),
)]
pub async fn upgrade_to_live_socket(
    State(app): State<Arc<App>>,
    client: Client,
    peer: Option<Extension<Peer>>,
    role: Option<Extension<Role>>,
    uri: Uri,
    headers: HeaderMap,
    upgrade: Result<WebSocketUpgrade, WebSocketUpgradeRejection>,
) -> Result<Response, Problem> {
    let upgrade = upgrade.map_err(|rejection| {
        let is_other_version = matches!(rejection, WebSocketUpgradeRejection::InvalidWebSocketVersionHeader(_))
            && headers.contains_key(header::SEC_WEBSOCKET_VERSION);
        let kind = match rejection.status().as_u16() {
            405 => ProblemKind::NoWebsocketMethod,
            426 => ProblemKind::NoWebsocketUpgrade,
            _ if is_other_version => ProblemKind::NoWebsocketUpgrade,
            _ => ProblemKind::NoWebsocket,
        };
        no_websocket_problem(kind, rejection.body_text())
    })?;
    check_websocket_version_and_key_headers(&headers)?;
    let bad = |detail: String| Problem::new(ProblemKind::BadQuery, detail);
    let query: LiveQuery = crate::daemon::api::query::parse_query(
        &uri,
        "send=NAMES&taps=all or send=NAMES&taps=newest; both parameters are optional",
    )?;
    let only_newest_tap = query.taps == Some(TapQueue::Newest);
    let wants = match &query.send {
        None => PageTopics::DEFAULT,
        Some(text) => PageTopics::parse(text).map_err(|name| {
            let detail = format!("`send` contains {name:?}, but may contain only {}", PageTopics::NAMES);
            bad(detail).with_field_and_value("send", text.as_str().into(), PageTopics::NAMES.into(), None)
        })?,
    };
    // Without tokens everybody may do all.
    let role = role.map_or(Role::Arm, |Extension(role)| role);
    let places = if role < Role::Touch { &app.watchers } else { &app.sockets };
    let place = Arc::clone(places).try_acquire_owned().map_err(|_| {
        let detail = format!("{SOCKETS} live sockets are open, which is the maximum");
        Problem::new(ProblemKind::SocketsFull, detail).with_retry(1000, Some(SOCKETS))
    })?;
    let serve = async move |socket| {
        let page = PageIdentity::new(role, peer.map(|Extension(peer)| peer));
        serve_page_socket(app, client, page, socket, wants, PageFingers::new(only_newest_tap)).await;
        drop(place);
    };
    // Of both: what is announced as longer is not waited for.
    Ok(upgrade.max_message_size(MOST_READ).max_frame_size(MOST_READ).on_upgrade(serve).into_response())
}

/// What is no WebSocket, with what is spoken here (RFC 6455, 4.4; RFC 9110, 15.5.22).
fn no_websocket_problem(kind: ProblemKind, detail: String) -> Problem {
    let problem = Problem::new(kind, detail).with_header(header::SEC_WEBSOCKET_VERSION, "13");
    match kind {
        ProblemKind::NoWebsocketUpgrade => {
            problem.with_header(header::CONNECTION, "upgrade").with_header(header::UPGRADE, "websocket")
        }
        _ => problem,
    }
}

/// That the version is there once, and a key of 16 bytes in base64 (RFC 6455, 4.2.1): 22 letters and what fills up to 24.
fn check_websocket_version_and_key_headers(headers: &HeaderMap) -> Result<(), Problem> {
    read_single_header(headers, &header::SEC_WEBSOCKET_VERSION)?;
    let key = read_single_header(headers, &header::SEC_WEBSOCKET_KEY)?.unwrap_or_default();
    let is_letter = |byte: u8| byte.is_ascii_alphanumeric() || matches!(byte, b'+' | b'/');
    match key.strip_suffix("==") {
        Some(letters) if letters.len() == 22 && letters.bytes().all(is_letter) => Ok(()),
        _ => {
            let allowed = "16 bytes in base64, which are 24 characters";
            let problem = no_websocket_problem(
                ProblemKind::NoWebsocket,
                format!("sec-websocket-key is {key:?}, but must be {allowed}"),
            );
            Err(problem.with_field_and_value("sec-websocket-key", key.into(), allowed.into(), None))
        }
    }
}

async fn serve_page_socket(
    app: Arc<App>,
    client: Client,
    page: PageIdentity,
    socket: WebSocket,
    topics: PageTopics,
    fingers: PageFingers,
) {
    let (sink, mut stream) = socket.split();
    let (letters, inbox) = mpsc::channel::<WriterCommand>(1);
    let (replies, outbox) = mpsc::channel::<Value>(REPLIES);
    let fingers = Arc::new(fingers);
    let mut writer = tokio::spawn(writer::write_messages_to_page(Arc::clone(&app), sink, inbox, outbox, topics));
    tokio::spawn(fingers::drive_fingers_until_page_is_gone(
        Arc::clone(&app),
        client,
        Arc::clone(&fingers),
        replies.clone(),
    ));
    let mut ping = tokio::time::interval(app.limits.ping);
    let mut heard = Instant::now();
    let mut is_written = true;
    let farewell = loop {
        tokio::select! {
            message = stream.next() => match message {
                Some(Ok(message)) => {
                    heard = Instant::now();
                    let bytes = length_of_message(&message);
                    match message {
                        Message::Binary(bytes) => {
                            stop_device_if_message_asks_and_page_may_touch(&app, page, &bytes, &fingers, &replies);
                            if page.role >= Role::Touch && let Ok(text) = std::str::from_utf8(&bytes) {
                                lift_fingers_left_out(&app, &incoming::IncomingMessage::from_text(text), &fingers);
                            }
                            let problem = Problem::bad_body("the message is binary, but must be text with JSON".into());
                            let _ = replies.try_send(build_error_message(&problem));
                        }
                        Message::Text(text) => {
                            let text = text.as_str();
                            let text = text.strip_prefix(BYTE_ORDER_MARK).unwrap_or(text);
                            if let Some(problem) = handle_page_message(&app, page, text, &fingers, &replies) {
                                // A page that reads nothing misses what is wrong with what it says.
                                let _ = replies.try_send(build_error_message(&problem));
                            }
                        }
                        // The writer says it back.
                        Message::Close(_) => break None,
                        _ => {}
                    }
                    // After it was carried out, so that no stop waits for this: the next one does.
                    if let Some(peer) = page.peer {
                        app.live_pace.wait_until_next_live_message(peer, bytes).await;
                    }
                }
                Some(Err(error)) => break closing::close_frame_for_error(error),
                None => break None,
            },
            _ = ping.tick() => {
                let _ = letters.try_send(WriterCommand::Ping);
            }
            // By its own clock: a page that only answers pings is heard just after one, and at the third from there a little is left.
            () = tokio::time::sleep_until(heard + app.limits.silence) => {
                tracing::info!("closing a live socket: the page sent nothing in time, not even the answer to a ping");
                break Some(closing::close_frame_for_silence(app.limits.silence));
            }
            // The page takes nothing any more, or the daemon ends.
            _ = &mut writer => {
                is_written = false;
                break None;
            }
        }
    };
    app.record_line("gone", || json!({"socket": page.number}));
    fingers.lift_all_as_page_is_gone();
    if let Some(farewell) = farewell {
        let _ = letters.send(WriterCommand::Close(farewell)).await;
    }
    drop(letters);
    // The socket's place is taken until it is closed.
    if is_written {
        let _ = writer.await;
    }
}

fn length_of_message(message: &Message) -> usize {
    match message {
        Message::Text(text) => text.len(),
        Message::Binary(bytes) | Message::Ping(bytes) | Message::Pong(bytes) => bytes.len(),
        Message::Close(_) => 0,
    }
}

/// Who is at the other end.
#[derive(Clone, Copy, Debug)]
struct PageIdentity {
    /// In recordings.
    number: u64,
    /// What its token opens.
    role: Role,
    /// Whose messages are read at one pace.
    peer: Option<Peer>,
}

impl PageIdentity {
    fn new(role: Role, peer: Option<Peer>) -> Self {
        static PAGES: AtomicU64 = AtomicU64::new(0);
        Self { number: PAGES.fetch_add(1, Ordering::Relaxed) + 1, role, peer }
    }
}

/// Carries out what a page said; what is wrong with it, if anything is.
fn handle_page_message(
    app: &Arc<App>,
    page: PageIdentity,
    text: &str,
    fingers: &PageFingers,
    replies: &mpsc::Sender<Value>,
) -> Option<Problem> {
    if page.role < Role::Touch {
        return Some(page.role.insufficient_role_problem(Role::Touch));
    }
    if text.len() > MAX_MESSAGE {
        stop_device_if_message_asks_and_page_may_touch(app, page, text.as_bytes(), fingers, replies);
        lift_fingers_left_out(app, &incoming::IncomingMessage::from_text(text), fingers);
        return Some(Problem::bad_body(format!(
            "the message has {} bytes, but may have at most {MAX_MESSAGE}",
            text.len()
        )));
    }
    let message = incoming::IncomingMessage::from_text(text);
    match &message.rest {
        Ok(PageMessage { kind: PageMessageKind::Touch, touches: Some(_), .. }) => {
            queue_touch_of_message_reporting_wrong_fingers(app, page, text, &message, fingers, replies)
        }
        Ok(PageMessage { kind: PageMessageKind::Touch, touches: None, .. }) => {
            Some(incoming::IncomingMessage::missing_fingers_problem())
        }
        Ok(PageMessage { kind: PageMessageKind::Stop, .. }) => {
            stop_device_for_page(app, page, fingers, replies);
            let has_more = message.count_fingers().is_some_and(|count| count > 0);
            has_more.then(|| {
                Problem::bad_body(
                    "`touches` is given, but is allowed only with the type `touch`; the daemon stopped the device"
                        .into(),
                )
                .with_field("touches".into())
            })
        }
        Err(problem) => {
            stop_device_if_message_asks_and_page_may_touch(app, page, text.as_bytes(), fingers, replies);
            lift_fingers_left_out(app, &message, fingers);
            Some(problem.clone())
        }
    }
}

/// Has the fingers of a message driven; each one that is wrong is told, and takes nothing from the others. What is wrong with the whole is given
/// back; of the fingers only those that are lifted count then.
fn queue_touch_of_message_reporting_wrong_fingers(
    app: &Arc<App>,
    page: PageIdentity,
    text: &str,
    message: &incoming::IncomingMessage,
    fingers: &PageFingers,
    replies: &mpsc::Sender<Value>,
) -> Option<Problem> {
    let Ok(rest) = &message.rest else { return None };
    app.record_line("fingers", || {
        // What is no JSON is kept as it came.
        let message = serde_json::from_str::<Value>(text).unwrap_or_else(|_| text.into());
        json!({"socket": page.number, "message": message})
    });
    let incoming::CheckedFingers { fingers: down, problems } =
        message.check_fingers(&app.table.scene, &fingers.list_ids_of_fingers_down());
    for problem in &problems {
        let _ = replies.try_send(build_error_message(problem));
    }
    let mut down = down;
    loop {
        let own_effect = if rest.effect.is_none() { fingers.choose_effect_of_newest_finger(&down) } else { None };
        let feel = Feel {
            intensity_g: rest.intensity_g,
            intensity_db: rest.intensity_db,
            duration_ms: rest.duration_ms,
            effect: rest.effect.or(own_effect),
            count: rest.count,
            period_ms: rest.period_ms,
            crisp_ms: rest.crisp_ms,
            prefer: rest.prefer,
        };
        let problem = match Touch::from_fingers(&down, feel) {
            Ok(touch) => {
                return fingers.queue_fingers_down_dropping_oldest_if_full(touch, app.driver.stop_count()).err();
            }
            Err(problem) => problem,
        };
        let (refused, others): (Vec<CheckedFinger>, Vec<CheckedFinger>) =
            down.iter().partition(|checked| own_effect.is_some() && checked.finger.effect == own_effect);
        if refused.is_empty() || others.is_empty() {
            let ids: Vec<i64> = down.iter().map(|checked| checked.finger.id).collect();
            let _ = fingers.lift_all_except_dropping_oldest_if_full(&ids, app.driver.stop_count());
            return Some(problem);
        }
        // The effect that these fingers have of their own does not go with the message: that is wrong with them alone.
        for checked in &refused {
            let _ = replies.try_send(build_error_message(&problem.clone().with_finger_id(checked.finger.id)));
        }
        down = others;
    }
}

/// The fingers that a message which cannot be used leaves out are lifted all the same, if it is about fingers at all.
fn lift_fingers_left_out(app: &Arc<App>, message: &incoming::IncomingMessage, fingers: &PageFingers) {
    if message.is_touch && message.count_fingers().is_some() {
        let _ = fingers.lift_all_except_dropping_oldest_if_full(&message.list_finger_ids(), app.driver.stop_count());
    }
}

/// Stops everything.
fn stop_device_for_page(app: &Arc<App>, page: PageIdentity, fingers: &PageFingers, replies: &mpsc::Sender<Value>) {
    app.record_line("stop", || json!({"socket": page.number}));
    fingers.discard_steps_and_lift_all();
    let (app, replies) = (Arc::clone(app), replies.clone());
    let mut stopping = Box::pin(async move {
        if let Err(error) = app.stop_device().await {
            let _ = replies.try_send(build_error_message(&error.into()));
        }
    });
    // Counted and on its way here, so that what the page says next comes after it; the answer is waited for in a task of its own, so
    // that the next message is read whatever the device does.
    if (&mut stopping).now_or_never().is_none() {
        tokio::spawn(stopping);
    }
}

/// The same for a message that cannot be used, but says that it is a stop: whatever else is wrong with it is told besides.
fn stop_device_if_message_asks_and_page_may_touch(
    app: &Arc<App>,
    page: PageIdentity,
    message: &[u8],
    fingers: &PageFingers,
    replies: &mpsc::Sender<Value>,
) {
    if page.role >= Role::Touch && incoming::list_type_values_of_message(message).iter().any(|kind| kind == "stop") {
        stop_device_for_page(app, page, fingers, replies);
    }
}

fn build_error_message(problem: &Problem) -> Value {
    json!(LiveMessage::from_problem(problem))
}
