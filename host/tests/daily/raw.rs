//! HTTP by hand, for senders that do what libraries do not.

use crate::support::Daemon;
use std::io::{Read, Write};
use std::net::{Shutdown, TcpStream};
use std::time::Duration;

pub fn address(daemon: &Daemon) -> String {
    daemon.url.trim_start_matches("http://").to_owned()
}

pub fn connect(daemon: &Daemon) -> TcpStream {
    let stream = TcpStream::connect(address(daemon)).unwrap();
    stream.set_read_timeout(Some(Duration::from_secs(30))).unwrap();
    stream.set_nodelay(true).unwrap();
    stream
}

pub fn post(path: &str, body: &str) -> String {
    post_with(path, "", body)
}

/// With more header lines, each ended by CR LF.
pub fn post_with(path: &str, headers: &str, body: &str) -> String {
    let length = body.len();
    format!("POST {path} HTTP/1.1\r\nHost: localhost\r\n{headers}Content-Length: {length}\r\n\r\n{body}")
}

/// Sends and hangs up at once, both ways.
pub fn send_and_go(daemon: &Daemon, request: &str) {
    let mut stream = connect(daemon);
    stream.write_all(request.as_bytes()).unwrap();
    stream.shutdown(Shutdown::Both).unwrap();
}

/// Sends, closes the sending half, and reads all that comes, which need not be text: a live socket may have begun to send its frames.
pub fn send_and_listen(daemon: &Daemon, request: &str) -> String {
    let mut stream = connect(daemon);
    stream.write_all(request.as_bytes()).unwrap();
    stream.shutdown(Shutdown::Write).unwrap();
    let mut answer = Vec::new();
    stream.read_to_end(&mut answer).unwrap();
    String::from_utf8_lossy(&answer).into_owned()
}
