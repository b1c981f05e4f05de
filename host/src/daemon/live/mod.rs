//! The WebSocket: touches in, state, plans and telemetry out.
//!
//! `mod` reads, `writer` writes, `fingers` drives what `finger_steps` keeps in order: none of them waits for another, so that a
//! page that reads slowly is still heard, its stop first of all. `reading` carries out what a page says, with `incoming`, which makes out what that
//! is, and `controls`, which knows what fingers feel of the controls that the page has declared. `closing` knows why a socket is closed.

mod closing;
pub mod controls;
mod finger_steps;
mod fingers;
mod incoming;
pub mod message;
mod reading;
mod writer;

use crate::daemon::access::client::{Client, Peer};
use crate::daemon::access::head::read_single_header;
use crate::daemon::access::permissions::Role;
use crate::daemon::access::sender::RequestSender;
use crate::daemon::api::problem::{Problem, ProblemKind};
use crate::daemon::app::{App, SOCKETS};
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
use controls::DeclaredControl;
use finger_steps::PageFingers;
use futures_util::StreamExt;
use futures_util::stream::SplitStream;
use message::LiveMessage;
use reading::{PageIdentity, PageReader};
use serde::Deserialize;
use serde_json::{Value, json};
use std::sync::Arc;
use tokio::sync::mpsc;
use tokio::time::Instant;
use utoipa::{IntoParams, ToSchema};
use writer::PageTopics;

/// Longest message in bytes: ten fingers take under 1 kB.
const MAX_MESSAGE: usize = 16 * 1024;
/// A longer one than this ends the socket; one between is answered.
const MOST_READ: usize = 16 * MAX_MESSAGE;
/// The most bytes that are read of a connection for one message: a message may have many parts, each with a head, and the next one is read ahead.
/// The parts of a message are put together without an end, if all are empty; so what they take is bounded by this.
const MOST_READ_FOR_MESSAGE: usize = 2 * MOST_READ;
/// Answers that may wait for a slow page.
const REPLIES: usize = 32;

/// What a page says. Plain structures, not an enum with its tag inside: serde reads such an enum by way of a copy in which
/// numbers are maps as soon as any crate of the program turns on serde_json's `arbitrary_precision`.
#[derive(Debug, Deserialize, ToSchema)]
#[schema(as = LiveIn, description = "A message from a page: the fingers that are down, the controls on the screen, or a stop.")]
#[schema(examples(
    json!({"type": "touch", "touches": [{"id": 1, "x_px": 960, "y_px": 640}], "intensity_g": 0.3}),
    json!({"type": "touch", "touches": []}),
    json!({"type": "controls", "controls": [
        {"kind": "button", "x_px": 100, "y_px": 100, "width_px": 200, "height_px": 80},
        {"kind": "slider", "x_px": 400, "y_px": 100, "width_px": 800, "height_px": 60, "detents": 11, "intensity_g": 0.3}]}),
    json!({"type": "stop"}),
))]
#[serde(deny_unknown_fields)]
pub struct PageMessage {
    /// Type of the message: `touch`, `controls` or `stop`.
    #[serde(rename = "type")]
    kind: PageMessageKind,
    /// All fingers that are down now; empty if all fingers are lifted. Only in a message of the type `touch`.
    touches: Option<Vec<Finger>>,
    /// All controls on the screen; empty if there are none. The daemon decides what the fingers feel of them. Of two controls in one place, the later
    /// one is on top. Only in a message of the type `controls`.
    controls: Option<Vec<DeclaredControl>>,
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
    /// Its controls.
    Controls,
    /// Everything off.
    Stop,
}

impl PageMessage {
    /// Refuses what a message of its type does not have; `touches` beside a stop is another matter.
    fn refuse_keys_of_other_types(&self) -> Result<(), Problem> {
        let is_for_touch_only = [
            ("touches", self.touches.is_some()),
            ("intensity_g", self.intensity_g.is_some()),
            ("intensity_db", self.intensity_db.is_some()),
            ("duration_ms", self.duration_ms.is_some()),
            ("effect", self.effect.is_some()),
            ("count", self.count.is_some()),
            ("period_ms", self.period_ms.is_some()),
            ("crisp_ms", self.crisp_ms.is_some()),
            ("prefer", self.prefer.is_some()),
        ];
        let (wrong, type_name) = match self.kind {
            PageMessageKind::Controls => {
                (is_for_touch_only.into_iter().find_map(|(key, is_given)| is_given.then_some(key)), "touch")
            }
            PageMessageKind::Touch | PageMessageKind::Stop => (self.controls.as_ref().map(|_| "controls"), "controls"),
        };
        let Some(key) = wrong else { return Ok(()) };
        let detail = format!("`{key}` is given, but is allowed only in a message of the type `{type_name}`");
        Err(Problem::bad_body(detail).with_field(key.into()))
    }
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
/// Text messages in JSON with a `type`: LiveIn from the page (at most 16 KiB), with all fingers that are down (none if all are lifted) or with the
/// controls on the screen, and LiveOut to the page. The daemon drives every tap. An effect begins when a finger goes down, and does not begin again when the finger moves. If the
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
    (peer, sender): (Option<Extension<Peer>>, RequestSender),
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
        sender.fail_reads_beyond_bytes_between_takes_of_byte_count(MOST_READ_FOR_MESSAGE);
        let page = PageIdentity::new(role, peer.map(|Extension(peer)| peer));
        serve_page_socket(app, client, page, (socket, sender), wants, PageFingers::new(only_newest_tap)).await;
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
    (socket, sender): (WebSocket, RequestSender),
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
    let mut reader = PageReader::new(Arc::clone(&app), page, Arc::clone(&fingers), replies);
    let mut ping = tokio::time::interval(app.limits.ping);
    let mut heard = Instant::now();
    let mut is_written = true;
    let mut ahead = None;
    let farewell = loop {
        tokio::select! {
            message = take_or_read(&mut ahead, &mut stream) => match message {
                Some(Ok(message)) => {
                    heard = Instant::now();
                    let bytes = sender.take_read_byte_count();
                    match message {
                        Message::Binary(bytes) => reader.refuse_binary_message_after_stop_and_lifts(&bytes),
                        Message::Text(text) => {
                            let text = text.as_str();
                            reader.handle_text_and_report_problem_to_page(text.strip_prefix(BYTE_ORDER_MARK).unwrap_or(text));
                        }
                        // The writer says it back.
                        Message::Close(_) => break None,
                        _ => {}
                    }
                    // After it was carried out, so that no stop waits for this: the next one does.
                    if let Some(peer) = page.peer {
                        let wait = app.live_pace.count_live_message_and_wait_until_next_is_allowed(peer, bytes);
                        ahead = wait_reading_one_message_ahead_unless_socket_ends(wait, &mut stream).await;
                    }
                }
                Some(Err(error)) => break closing::close_frame_for_error(error),
                None => break None,
            },
            () = wait_until_or_forever_if_none(reader.find_next_time_when_a_stroke_will_rest()) => reader.end_textures_without_motion(),
            _ = ping.tick() => {
                let _ = letters.try_send(WriterCommand::Ping);
            }
            // By its own clock: a page that only answers pings is heard just after one, and at the third from there a little is left.
            () = tokio::time::sleep_until(heard + app.limits.silence) => {
                tracing::info!(
                    "closing the WebSocket of a page: the page sent nothing for {:?}, not even the answer to a ping",
                    app.limits.silence
                );
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

/// What was read of a socket: a message, what is wrong with it, or `None` at the socket's end.
type ReadMessage = Option<Result<Message, axum::Error>>;

/// What was read ahead, or else the next message. Nothing is lost if the future is dropped.
async fn take_or_read(ahead: &mut Option<ReadMessage>, stream: &mut SplitStream<WebSocket>) -> ReadMessage {
    match ahead.take() {
        Some(message) => message,
        None => stream.next().await,
    }
}

/// Waits, and returns what was read meanwhile, one message at most. If that is the socket's end, returns at once: a page that is gone keeps neither
/// its place nor its fingers because its last message was long.
async fn wait_reading_one_message_ahead_unless_socket_ends(
    wait: impl Future<Output = ()>,
    stream: &mut SplitStream<WebSocket>,
) -> Option<ReadMessage> {
    let mut wait = std::pin::pin!(wait);
    tokio::select! {
        biased;
        () = &mut wait => None,
        message = stream.next() => {
            if !matches!(message, None | Some(Err(_) | Ok(Message::Close(_)))) {
                wait.await;
            }
            Some(message)
        }
    }
}

/// Until then, if there is such a time.
async fn wait_until_or_forever_if_none(when: Option<std::time::Instant>) {
    match when {
        Some(when) => tokio::time::sleep_until(when.into()).await,
        None => std::future::pending().await,
    }
}

fn build_error_message(problem: &Problem) -> Value {
    json!(LiveMessage::from_problem(problem))
}
