//! The live sockets of a recording's pages, while it is replayed.

use crate::cli::Failure;
use crate::cli::args::DaemonOptions;
use crate::cli::live::{self, Socket};
use serde_json::Value;
use std::collections::{BTreeMap, HashMap};
use std::io::ErrorKind;
use std::time::{Duration, Instant};
use tungstenite::{Error, Message};

/// For what a page has been sent meanwhile.
const LISTEN: Duration = Duration::from_millis(1);
/// How often it is listened to while nobody speaks: the daemon asks for a sign of life every 5 s.
const EVERY: Duration = Duration::from_millis(50);

/// The pages, and what became of what they said.
pub struct ReplayedPages<'d> {
    daemon: &'d DaemonOptions,
    open: HashMap<u64, Socket>,
    /// Number of messages, including the lost messages.
    pub said: u64,
    /// Errors that came back, by their kind.
    pub refused: BTreeMap<String, u64>,
    /// Number of messages that could not be sent to the daemon.
    pub lost: u64,
    /// Why the last lost message was lost.
    pub reason: Option<String>,
}

impl<'d> ReplayedPages<'d> {
    /// None is open yet.
    pub fn new(daemon: &'d DaemonOptions) -> Self {
        Self { daemon, open: HashMap::new(), said: 0, refused: BTreeMap::new(), lost: 0, reason: None }
    }

    /// Waits until then, and reads what comes meanwhile: that answers the daemon's questions for a sign of life, without which it lets a
    /// page go.
    pub fn read_page_messages_until(&mut self, due: Instant) {
        while Instant::now() < due {
            self.read_pending_messages_counting_errors_and_dropping_closed();
            std::thread::sleep(due.saturating_duration_since(Instant::now()).min(EVERY));
        }
    }

    fn read_pending_messages_counting_errors_and_dropping_closed(&mut self) {
        let refused = &mut self.refused;
        self.open.retain(|_, socket| {
            loop {
                match socket.read() {
                    Ok(Message::Text(text)) => count_kind_if_error_message(refused, text.as_str()),
                    Ok(_) => {}
                    Err(Error::Io(error)) if matches!(error.kind(), ErrorKind::WouldBlock | ErrorKind::TimedOut) => {
                        return true;
                    }
                    // Opened anew when the page speaks again.
                    Err(_) => return false,
                }
            }
        });
    }

    /// Says a page's message over a socket of its own. One that the daemon has closed is opened anew; what it takes neither way is lost, and
    /// what was recorded after it goes on.
    pub fn send_recorded_message_of_page_to_daemon_or_count_lost(&mut self, page: u64, message: &Value) {
        self.said += 1;
        // One that is no JSON is kept as it came.
        let text = message.as_str().map_or_else(|| message.to_string(), str::to_owned);
        if let Some(socket) = self.open.get_mut(&page)
            && socket.send(Message::text(text.clone())).is_ok()
        {
            return;
        }
        let said = self.open_page_socket().and_then(|mut socket| {
            socket.send(Message::text(text)).map_err(Failure::runtime_error)?;
            Ok(socket)
        });
        match said {
            Ok(socket) => {
                self.open.insert(page, socket);
            }
            Err(failure) => {
                self.open.remove(&page);
                self.lost += 1;
                self.reason = Some(failure.message_or_empty_if_already_reported());
            }
        }
    }

    fn open_page_socket(&self) -> Result<Socket, Failure> {
        let socket = live::open_live_socket(self.daemon, "send=")?;
        socket.get_ref().tcp_stream().set_read_timeout(Some(LISTEN)).map_err(Failure::runtime_error)?;
        Ok(socket)
    }

    /// A page goes away.
    pub fn close_page(&mut self, page: u64) {
        self.read_pending_messages_counting_errors_and_dropping_closed();
        if let Some(mut socket) = self.open.remove(&page) {
            let _ = socket.close(None).and_then(|()| socket.flush());
        }
    }
}

/// Counts an error by its kind; nothing else is asked for.
fn count_kind_if_error_message(refused: &mut BTreeMap<String, u64>, text: &str) {
    let message: Value = serde_json::from_str(text).unwrap_or_default();
    if message["type"] == "error" {
        let kind = message["problem"]["type"].as_str().and_then(|kind| kind.rsplit(':').next()).unwrap_or("unknown");
        *refused.entry(kind.to_owned()).or_default() += 1;
    }
}
