//! The daemon's live socket, opened with the options of every command that talks to it.

use super::Failure;
use super::args::Daemon;
use super::client;
use serde_json::Value;
use std::io::{self, Read, Write};
use std::net::TcpStream;
use std::sync::Arc;
use std::time::Duration;
use tokio_rustls::rustls::pki_types::{CertificateDer, ServerName};
use tokio_rustls::rustls::{ClientConfig, ClientConnection, RootCertStore, StreamOwned};
use tungstenite::client::IntoClientRequest;
use tungstenite::handshake::HandshakeError;
use tungstenite::http::{HeaderValue, Uri, header};
use tungstenite::{Error, WebSocket};

/// For the handshakes.
const PATIENCE: Duration = Duration::from_secs(30);

/// A socket to a daemon.
pub type Socket = WebSocket<Line>;

/// What it goes over.
pub enum Line {
    Plain(TcpStream),
    Tls(Box<StreamOwned<ClientConnection, TcpStream>>),
}

impl Line {
    /// How long reading waits for something to come.
    pub fn set_read_timeout(&self, time: Duration) -> io::Result<()> {
        match self {
            Self::Plain(stream) => stream.set_read_timeout(Some(time)),
            Self::Tls(stream) => stream.sock.set_read_timeout(Some(time)),
        }
    }
}

impl Read for Line {
    fn read(&mut self, into: &mut [u8]) -> io::Result<usize> {
        match self {
            Self::Plain(stream) => stream.read(into),
            Self::Tls(stream) => stream.read(into),
        }
    }
}

impl Write for Line {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        match self {
            Self::Plain(stream) => stream.write(bytes),
            Self::Tls(stream) => stream.write(bytes),
        }
    }

    fn flush(&mut self) -> io::Result<()> {
        match self {
            Self::Plain(stream) => stream.flush(),
            Self::Tls(stream) => stream.flush(),
        }
    }
}

/// Opens `/v1/live` with what is behind its `?`.
///
/// # Errors
/// That the daemon is not there, is not trusted, or does not let this client in.
pub fn open(daemon: &Daemon, query: &str) -> Result<Socket, Failure> {
    // `http` becomes `ws`, and `https` becomes `wss`.
    let url = format!("{}/v1/live?{query}", daemon.url.replacen("http", "ws", 1));
    let failed = |what: &dyn std::fmt::Display| Failure::failed(format!("no live socket at {url}: {what}"));
    let mut request = url.as_str().into_client_request().map_err(|error| failed(&error))?;
    if let Some(bearer) = client::bearer(daemon)? {
        let mut value = HeaderValue::try_from(bearer).map_err(|_| failed(&"the token has characters beyond ASCII"))?;
        value.set_sensitive(true);
        request.headers_mut().insert(header::AUTHORIZATION, value);
    }
    let line = line(daemon, request.uri(), &failed)?;
    match tungstenite::client(request, line) {
        Ok((socket, _)) => Ok(socket),
        Err(HandshakeError::Failure(Error::Http(answer))) => {
            let problem: Option<Value> = answer.body().as_ref().and_then(|body| serde_json::from_slice(body).ok());
            let detail = problem.as_ref().and_then(|problem| problem["detail"].as_str());
            Err(failed(&detail.map_or_else(|| answer.status().to_string(), str::to_owned)))
        }
        Err(error) => Err(failed(&error)),
    }
}

fn line(daemon: &Daemon, uri: &Uri, failed: &dyn Fn(&dyn std::fmt::Display) -> Failure) -> Result<Line, Failure> {
    let is_tls = uri.scheme_str() == Some("wss");
    let host = uri.host().unwrap_or_default().trim_start_matches('[').trim_end_matches(']');
    let port = uri.port_u16().unwrap_or(if is_tls { 443 } else { 80 });
    let stream = TcpStream::connect((host, port)).map_err(|error| failed(&error))?;
    let prepared = stream.set_nodelay(true).and_then(|()| stream.set_read_timeout(Some(PATIENCE)));
    prepared.and_then(|()| stream.set_write_timeout(Some(PATIENCE))).map_err(|error| failed(&error))?;
    if !is_tls {
        return Ok(Line::Plain(stream));
    }
    let mut roots = RootCertStore::empty();
    match client::trusted(daemon.ca.as_deref())? {
        Some(own) => roots.add(CertificateDer::from_slice(own.der())).map_err(|error| failed(&error))?,
        None => roots.extend(webpki_roots::TLS_SERVER_ROOTS.iter().cloned()),
    }
    let config = ClientConfig::builder().with_root_certificates(roots).with_no_client_auth();
    let name = ServerName::try_from(host.to_owned()).map_err(|error| failed(&error))?;
    let connection = ClientConnection::new(Arc::new(config), name).map_err(|error| failed(&error))?;
    Ok(Line::Tls(Box::new(StreamOwned::new(connection, stream))))
}
