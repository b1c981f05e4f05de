//! HTTP by hand over one connection that is kept, so that what was sent, when, and over which connection is known.
//!
//! Why no client from a crate: `ureq`, which the program uses, keeps its connections in a pool and does not say when it opens one,
//! but here each connection and each lost answer is counted and timed. It knows no sockets in the file system either: a transport
//! for it takes 92 lines (`host/src/connection/transport.rs`), and all of `Http` with `read_answer` 115, documentation included.
//! `hyper` needs a runtime, whose scheduling would be part of each measured time.

use serde_json::Value;
use std::io::{self, BufRead, BufReader, ErrorKind, Read, Write};
use std::net::{SocketAddr, TcpStream};
use std::os::unix::net::UnixStream;
use std::path::PathBuf;
use std::time::Duration;

/// Longest wait for an answer.
pub const PATIENCE: Duration = Duration::from_secs(10);
/// Longest answer that is read.
const MOST_BYTES: usize = 4 << 20;

/// Where a daemon listens.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Endpoint {
    /// Loopback.
    Tcp(SocketAddr),
    /// A socket in the file system.
    Unix(PathBuf),
}

trait Stream: Read + Write + Send {}
impl<T: Read + Write + Send> Stream for T {}

/// An answer.
#[derive(Debug)]
pub struct Answer {
    /// Of HTTP.
    pub status: u16,
    /// As it came.
    pub body: Vec<u8>,
    /// Whether the connection ends with it.
    pub closes: bool,
}

impl Answer {
    /// The body as JSON; `null` if it is none.
    #[must_use]
    pub fn parse_json_body_or_null(&self) -> Value {
        serde_json::from_slice(&self.body).unwrap_or(Value::Null)
    }
}

/// A connection that is opened when it is asked for or first needed, and again after it has broken.
pub struct Http {
    place: Endpoint,
    stream: Option<BufReader<Box<dyn Stream>>>,
    /// How often it was opened.
    pub opened: u64,
}

impl Http {
    /// Nothing is opened yet.
    #[must_use]
    pub fn new(place: Endpoint) -> Self {
        Self { place, stream: None, opened: 0 }
    }

    fn ensure_connected(&mut self) -> io::Result<&mut BufReader<Box<dyn Stream>>> {
        if self.stream.is_none() {
            let stream: Box<dyn Stream> = match &self.place {
                Endpoint::Tcp(address) => Box::new(connect_tcp(*address)?),
                Endpoint::Unix(path) => {
                    let stream = UnixStream::connect(path)?;
                    stream.set_read_timeout(Some(PATIENCE))?;
                    stream.set_write_timeout(Some(PATIENCE))?;
                    Box::new(stream)
                }
            };
            self.opened += 1;
            self.stream = Some(BufReader::new(stream));
        }
        self.stream.as_mut().ok_or_else(|| ErrorKind::NotConnected.into())
    }

    /// Opens the connection, if it is not open.
    ///
    /// # Errors
    /// As the system has it.
    pub fn open(&mut self) -> io::Result<()> {
        self.ensure_connected().map(|_| ())
    }

    /// One request and its answer; the connection is closed if there is none.
    ///
    /// # Errors
    /// As the system has it, or [`ErrorKind::InvalidData`]; whether the daemon has heard of the request is not known.
    pub fn send_request(
        &mut self,
        method: &str,
        path: &str,
        request_id: Option<&str>,
        body: &str,
    ) -> io::Result<Answer> {
        let result = self.ensure_connected().and_then(|stream| {
            let request_id = request_id.map(|request_id| format!("X-Request-Id: {request_id}\r\n")).unwrap_or_default();
            let length = body.len();
            let head = format!(
                "{method} {path} HTTP/1.1\r\nHost: localhost\r\n{request_id}Content-Type: application/json\r\n"
            );
            stream.get_mut().write_all(format!("{head}Content-Length: {length}\r\n\r\n{body}").as_bytes())?;
            read_answer(stream)
        });
        if result.as_ref().map_or(true, |answer| answer.closes) {
            self.stream = None;
        }
        result
    }

    /// A request without a body.
    ///
    /// # Errors
    /// As [`Self::send_request`].
    pub fn get(&mut self, path: &str) -> io::Result<Answer> {
        self.send_request("GET", path, None, "")
    }

    /// A request with a body.
    ///
    /// # Errors
    /// As [`Self::send_request`].
    pub fn post(&mut self, path: &str, body: &str) -> io::Result<Answer> {
        self.send_request("POST", path, None, body)
    }
}

/// A connection without delays, on which nothing is waited for longer than [`PATIENCE`].
///
/// # Errors
/// As the system has it.
pub fn connect_tcp(address: SocketAddr) -> io::Result<TcpStream> {
    let stream = TcpStream::connect_timeout(&address, PATIENCE)?;
    stream.set_nodelay(true)?;
    stream.set_read_timeout(Some(PATIENCE))?;
    stream.set_write_timeout(Some(PATIENCE))?;
    Ok(stream)
}

fn read_answer(stream: &mut impl BufRead) -> io::Result<Answer> {
    let bad = |what: &str| io::Error::new(ErrorKind::InvalidData, what.to_owned());
    let mut line = String::new();
    if stream.read_line(&mut line)? == 0 {
        return Err(ErrorKind::UnexpectedEof.into());
    }
    let status = line.split(' ').nth(1).and_then(|status| status.parse().ok()).ok_or_else(|| bad("no status line"))?;
    let (mut length, mut closes) = (0, false);
    loop {
        line.clear();
        if stream.read_line(&mut line)? == 0 {
            return Err(ErrorKind::UnexpectedEof.into());
        }
        let Some((name, value)) = line.split_once(':') else { break };
        if name.eq_ignore_ascii_case("content-length") {
            length = value.trim().parse().map_err(|_| bad("no content length"))?;
        }
        closes |= name.eq_ignore_ascii_case("connection") && value.trim().eq_ignore_ascii_case("close");
    }
    if length > MOST_BYTES {
        return Err(bad("a body that is too long"));
    }
    let mut body = vec![0; length];
    stream.read_exact(&mut body)?;
    Ok(Answer { status, body, closes })
}

/// The value of a metric in Prometheus text.
#[must_use]
pub fn find_metric(text: &str, name: &str) -> Option<f64> {
    text.lines().find_map(|line| line.strip_prefix(name)?.strip_prefix(' ')?.trim().parse().ok())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_answer_is_read_to_its_last_byte_and_no_further() {
        let mut text: &[u8] =
            b"HTTP/1.1 409 Conflict\r\nContent-Length: 4\r\nx-request-id: a\r\n\r\n{\"a\"HTTP/1.1 200 OK\r\n\r\n";
        let first = read_answer(&mut text).unwrap();
        assert_eq!((first.status, first.body.as_slice()), (409, b"{\"a\"".as_slice()));
        assert_eq!(read_answer(&mut text).unwrap().status, 200);
        assert_eq!(read_answer(&mut text).unwrap_err().kind(), ErrorKind::UnexpectedEof);
    }

    #[test]
    fn a_metric_is_found_by_its_whole_name() {
        let text = "# HELP era_a x\nera_a_total 3\nera_a 1.5\n";
        assert_eq!((find_metric(text, "era_a"), find_metric(text, "era_b")), (Some(1.5), None));
    }
}
