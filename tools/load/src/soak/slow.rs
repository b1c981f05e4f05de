//! Clients that keep a connection and do not get on with it; the daemon must end each, and serve everybody else meanwhile.

use super::world::{ServingDaemon, SoakState};
use crate::http::connect_tcp;
use crate::live::Live;
use std::io::{ErrorKind, Read, Write};
use std::net::{SocketAddr, TcpStream};
use std::time::{Duration, Instant};

/// Longest time that the daemon may bear one: 30 s for headers, 15 s for a page that does not answer, and some for a busy machine.
const LONGEST: Duration = Duration::from_secs(40);
/// How long a page reads nothing at first.
const UNREAD: Duration = Duration::from_secs(25);
/// Then no message for so long means that none comes any more.
const QUIET: Duration = Duration::from_secs(8);
/// More messages than wait for a page that was let go: what the system keeps for it.
const MOST_LEFT: usize = 20_000;

/// A way of not getting on.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum SlowClient {
    /// Connects and says nothing.
    Nothing,
    /// Ends in the middle of a header line.
    HalfHeader,
    /// Ends in the middle of a body.
    HalfBody,
    /// Takes the live socket and reads nothing.
    Unread,
}

impl SlowClient {
    /// All of them.
    pub const ALL: [Self; 4] = [Self::Nothing, Self::HalfHeader, Self::HalfBody, Self::Unread];

    const fn incomplete_request_text_or_empty(self) -> &'static str {
        match self {
            Self::HalfHeader => "POST /v1/touch HTTP/1.1\r\nHost: loc",
            Self::HalfBody => {
                "POST /v1/touch HTTP/1.1\r\nHost: localhost\r\nContent-Type: application/json\r\nContent-Length: 60\r\n\r\n{\"x_px\": 9"
            }
            Self::Nothing | Self::Unread => "",
        }
    }
}

/// What became of one.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SlowClientEnd {
    /// The daemon has ended it, after so long.
    Ended(Duration),
    /// It is still served.
    Borne,
    /// It could not connect, so that it was never slow.
    NotConnected,
    /// The daemon was gone before that could be told.
    Unknown,
}

/// Is slow in this way until the daemon has had enough.
pub fn run_slow_client(state: &SoakState, serving: ServingDaemon, slow: SlowClient) -> SlowClientEnd {
    let begun = Instant::now();
    let ended = match slow {
        SlowClient::Unread => is_live_socket_closed_by_daemon_after_leaving_it_unread(serving.address),
        _ => does_daemon_end_half_request_or_answer_half_body_within_limit(serving.address, slow),
    };
    match ended {
        _ if !state.is_current_daemon(serving) => SlowClientEnd::Unknown,
        Some(true) => SlowClientEnd::Ended(begun.elapsed()),
        Some(false) => SlowClientEnd::Borne,
        None => SlowClientEnd::NotConnected,
    }
}

/// `None` if the client could not connect.
fn does_daemon_end_half_request_or_answer_half_body_within_limit(
    address: SocketAddr,
    slow: SlowClient,
) -> Option<bool> {
    let connected = || -> std::io::Result<TcpStream> {
        let mut stream = connect_tcp(address)?;
        stream.set_read_timeout(Some(LONGEST))?;
        stream.write_all(slow.incomplete_request_text_or_empty().as_bytes())?;
        Ok(stream)
    };
    let mut stream = connected().ok()?;
    let mut buffer = [0; 1024];
    loop {
        match stream.read(&mut buffer) {
            Ok(0) => return Some(true),
            // It is told why, before the end or instead of it.
            Ok(_) if slow == SlowClient::HalfBody => return Some(true),
            Ok(_) => {}
            Err(error) => return Some(!matches!(error.kind(), ErrorKind::TimedOut | ErrorKind::WouldBlock)),
        }
    }
}

/// `None` if the client could not connect.
fn is_live_socket_closed_by_daemon_after_leaving_it_unread(address: SocketAddr) -> Option<bool> {
    let mut live = Live::open(address, "scene,state,plan,field").ok()?;
    std::thread::sleep(UNREAD);
    Some(live.is_closed_by_daemon_reading_until_quiet(QUIET, MOST_LEFT))
}
