//! What a server that does nothing takes on this machine: the same load, answered at once. A daemon is slow only as far as it is slower
//! than this.

use crate::error::Error;
use crate::http::Endpoint;
use std::io::{BufRead, BufReader, Read, Write};
use std::net::{SocketAddr, TcpListener};
use std::os::unix::net::UnixListener;
use std::path::PathBuf;

/// As long as the answer to a touch.
const ANSWER_BYTES: usize = 2000;

/// Where the echo listens; its threads end with the process.
pub struct Echo {
    /// HTTP over loopback.
    pub tcp: Endpoint,
    /// HTTP over a socket in the file system.
    pub unix: Endpoint,
    /// A live socket that says everything again.
    pub live: SocketAddr,
}

impl Echo {
    /// Listens, with its socket at this path.
    ///
    /// # Errors
    /// [`Error::System`].
    pub fn start(socket: PathBuf) -> Result<Self, Error> {
        let failed = || Error::system_error("no echo");
        let (tcp, live) = (bind_loopback()?, bind_loopback()?);
        let unix = UnixListener::bind(&socket).map_err(failed())?;
        let addresses = (tcp.local_addr().map_err(failed())?, live.local_addr().map_err(failed())?);
        std::thread::spawn(move || {
            for stream in tcp.incoming().map_while(Result::ok) {
                let _ = stream.set_nodelay(true);
                std::thread::spawn(move || answer_http_requests_with_fixed_body(stream));
            }
        });
        std::thread::spawn(move || {
            for stream in unix.incoming().map_while(Result::ok) {
                std::thread::spawn(move || answer_http_requests_with_fixed_body(stream));
            }
        });
        std::thread::spawn(move || {
            for stream in live.incoming().map_while(Result::ok) {
                let _ = stream.set_nodelay(true);
                std::thread::spawn(move || echo_live_messages(stream));
            }
        });
        Ok(Self { tcp: Endpoint::Tcp(addresses.0), unix: Endpoint::Unix(socket), live: addresses.1 })
    }
}

fn bind_loopback() -> Result<TcpListener, Error> {
    TcpListener::bind("127.0.0.1:0").map_err(Error::system_error("no echo"))
}

/// Answers every request with a body that says nothing, until the other end closes.
fn answer_http_requests_with_fixed_body(stream: impl Read + Write) {
    let mut stream = BufReader::new(stream);
    let body = format!("{{\"drives\": [], \"rest\": \"{}\"}}", " ".repeat(ANSWER_BYTES));
    let answer = format!("HTTP/1.1 200 OK\r\nContent-Length: {}\r\n\r\n{body}", body.len());
    while let Some(length) = read_request_head_and_get_body_length_unless_closed(&mut stream) {
        let mut taken = vec![0; length];
        if stream.read_exact(&mut taken).is_err() || stream.get_mut().write_all(answer.as_bytes()).is_err() {
            return;
        }
    }
}

/// Reads a request's lines.
fn read_request_head_and_get_body_length_unless_closed(stream: &mut impl BufRead) -> Option<usize> {
    let (mut line, mut length) = (String::new(), 0);
    loop {
        line.clear();
        if stream.read_line(&mut line).ok()? == 0 {
            return None;
        }
        if line.trim().is_empty() {
            return Some(length);
        }
        if let Some(("content-length", value)) = line.to_ascii_lowercase().split_once(':') {
            length = value.trim().parse().ok()?;
        }
    }
}

/// Says everything again.
fn echo_live_messages(stream: std::net::TcpStream) {
    let Ok(mut socket) = tungstenite::accept(stream) else { return };
    while let Ok(message) = socket.read() {
        if message.is_text() && socket.send(message).is_err() {
            return;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::pace::measured::collect_due_to_end_times_refused_as_missing;
    use crate::pace::{Pace, over_http, over_live};

    #[test]
    fn every_touch_is_answered_over_every_way() {
        let folder = tempfile::tempdir().unwrap();
        let echo = Echo::start(folder.path().join("echo.sock")).unwrap();
        let pace = || Pace::new(200.0, 0.1);
        for touches in [
            over_http::send_touches_over_http(&echo.tcp, pace(), 200.0),
            over_http::send_touches_over_http(&echo.unix, pace(), 200.0),
            over_live::send_touches_over_live(echo.live, pace()).unwrap(),
        ] {
            let times = collect_due_to_end_times_refused_as_missing(&touches);
            assert_eq!((times.len(), times.count_missing_or_longer_than(1e9)), (20, 0), "{touches:?}");
        }
    }
}
