//! The daemon's live socket, opened with the options of every command that talks to it.

use super::Failure;
use super::args::DaemonOptions;
use super::client::DaemonContact;
use crate::connection::{DaemonConnection, describe_redirect};
use crate::doctor::reach::RequestTrouble;
use serde_json::Value;
use tungstenite::client::IntoClientRequest;
use tungstenite::handshake::HandshakeError;
use tungstenite::http::{HeaderValue, header};
use tungstenite::{Error, WebSocket};

/// Where it is.
const PATH: &str = "/v1/live";

/// A socket to a daemon.
pub type Socket = WebSocket<DaemonConnection>;

/// Opens `/v1/live` with what is behind its `?`.
///
/// # Errors
/// That the daemon is not there, is not trusted, or does not let this client in.
pub fn open_live_socket(daemon: &DaemonOptions, query: &str) -> Result<Socket, Failure> {
    // `http` becomes `ws`, and `https` becomes `wss`.
    let url = format!("{}{PATH}?{query}", daemon.url.replacen("http", "ws", 1));
    let failed =
        |what: &dyn std::fmt::Display| Failure::runtime_error(format!("cannot open the live socket {url}: {what}"));
    let mut request = url.as_str().into_client_request().map_err(|error| failed(&error))?;
    let DaemonContact { way, bearer } = DaemonContact::from_options_refusing_token_over_proxy_without_tls(daemon)?;
    if let Some(bearer) = bearer {
        let mut value = HeaderValue::try_from(bearer).map_err(|error| failed(&error))?;
        value.set_sensitive(true);
        request.headers_mut().insert(header::AUTHORIZATION, value);
    }
    let line = way.open_connection(request.uri()).map_err(|error| failed(&error))?;
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
            let told =
                RequestTrouble::find_trouble_probing_address_for_tls(&error, &daemon.url, daemon.proxy.is_some())
                    .describe_with_advice(&daemon.url, daemon.ca.is_some());
            Err(told.map_or_else(|| failed(&error), |(found, advice)| failed(&format!("{found}: {advice}"))))
        }
        Err(error) => Err(failed(&error)),
    }
}
