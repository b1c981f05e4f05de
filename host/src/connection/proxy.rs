//! A tunnel through a proxy (RFC 9110, 9.3.6): the proxy is told where to connect, and passes bytes on.

use super::{CONNECT, HostPort, PATIENCE};
use std::io::{self, Read, Write};
use std::net::TcpStream;
use std::time::Instant;

/// Longest answer of a proxy in bytes.
const MAX_ANSWER: usize = 8192;

/// Why a proxy is no help.
#[derive(Debug, thiserror::Error)]
#[error("the proxy {proxy} {what}")]
pub struct ProxyError {
    proxy: String,
    what: String,
}

/// Has the proxy connect to a target.
///
/// # Errors
/// [`ProxyError`] inside.
pub fn open_tunnel(proxy: &HostPort, target: &HostPort) -> io::Result<TcpStream> {
    let told = |what: String| io::Error::other(ProxyError { proxy: proxy.to_string(), what });
    let failed = |error: io::Error| told(format!("cannot be reached: {error}"));
    let mut stream = proxy.connect_within(CONNECT).map_err(failed)?;
    stream.set_read_timeout(Some(PATIENCE)).and_then(|()| stream.set_write_timeout(Some(PATIENCE))).map_err(failed)?;
    let request = format!("CONNECT {target} HTTP/1.1\r\nHost: {target}\r\n\r\n");
    stream.write_all(request.as_bytes()).map_err(failed)?;
    let (mut answer, mut byte) = (Vec::new(), [0]);
    let end = Instant::now() + PATIENCE;
    // Byte by byte: what comes after the answer is the target's.
    while !answer.ends_with(b"\r\n\r\n") && answer.len() < MAX_ANSWER && Instant::now() < end {
        match stream.read(&mut byte) {
            Ok(0) | Err(_) => break,
            Ok(_) => answer.extend(byte),
        }
    }
    let answer = String::from_utf8_lossy(&answer);
    let first = answer.lines().next().unwrap_or_default();
    let status = first.strip_prefix("HTTP/1.").and_then(|rest| rest.split(' ').nth(1)?.parse::<u16>().ok());
    match status {
        Some(200..300) => Ok(stream),
        Some(407) => Err(told(format!(
            "needs a password to connect to {target} (HTTP status 407), but era sends no \
                                       password"
        ))),
        Some(status) => Err(told(format!("answered the request to connect to {target} with the HTTP status {status}"))),
        None => Err(told(format!(
            "gave no HTTP/1 answer to the request to connect to {target}; check the address in --proxy"
        ))),
    }
}
