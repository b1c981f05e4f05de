//! The daemon's live socket, opened with the options of every command that talks to it.

use super::Failure;
use super::args::Daemon;
use super::client::Contact;
use crate::connection::{Line, describe_redirect};
use crate::doctor::reach::Trouble;
use serde_json::Value;
use tungstenite::client::IntoClientRequest;
use tungstenite::handshake::HandshakeError;
use tungstenite::http::{HeaderValue, header};
use tungstenite::{Error, WebSocket};

/// Where it is.
const PATH: &str = "/v1/live";

/// A socket to a daemon.
pub type Socket = WebSocket<Line>;

/// Opens `/v1/live` with what is behind its `?`.
///
/// # Errors
/// That the daemon is not there, is not trusted, or does not let this client in.
pub fn open(daemon: &Daemon, query: &str) -> Result<Socket, Failure> {
    // `http` becomes `ws`, and `https` becomes `wss`.
    let url = format!("{}{PATH}?{query}", daemon.url.replacen("http", "ws", 1));
    let failed = |what: &dyn std::fmt::Display| Failure::failed(format!("no live socket at {url}: {what}"));
    let mut request = url.as_str().into_client_request().map_err(|error| failed(&error))?;
    let Contact { way, bearer } = Contact::of(daemon)?;
    if let Some(bearer) = bearer {
        let mut value = HeaderValue::try_from(bearer).map_err(|error| failed(&error))?;
        value.set_sensitive(true);
        request.headers_mut().insert(header::AUTHORIZATION, value);
    }
    let line = way.open_line(request.uri()).map_err(|error| failed(&error))?;
    match tungstenite::client(request, line) {
        Ok((socket, _)) => Ok(socket),
        Err(HandshakeError::Failure(Error::Http(answer))) if answer.status().is_redirection() => {
            let location = answer.headers().get("location").map(|value| String::from_utf8_lossy(value.as_bytes()));
            let (found, advice) = describe_redirect(&daemon.url, PATH, answer.status().as_u16(), location.as_deref());
            Err(failed(&format!("{found}: {advice}")))
        }
        Err(HandshakeError::Failure(Error::Http(answer))) => {
            let problem: Option<Value> = answer.body().as_ref().and_then(|body| serde_json::from_slice(body).ok());
            let detail = problem.as_ref().and_then(|problem| problem["detail"].as_str());
            Err(failed(&detail.map_or_else(|| answer.status().to_string(), str::to_owned)))
        }
        Err(HandshakeError::Failure(Error::Io(error))) => {
            let error = ureq::Error::Io(error);
            let told = Trouble::of(&error, &daemon.url).told(&daemon.url, daemon.ca.is_some());
            Err(told.map_or_else(|| failed(&error), |(found, advice)| failed(&format!("{found}: {advice}"))))
        }
        Err(error) => Err(failed(&error)),
    }
}
