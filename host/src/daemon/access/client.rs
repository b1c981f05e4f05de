//! Who asks, as far as turns at the planner are concerned.

use super::sender::RequestSender;
use axum::extract::FromRequestParts;
use axum::http::header;
use axum::http::request::Parts;
use std::convert::Infallible;
use std::hash::{DefaultHasher, Hash, Hasher};
use std::net::{IpAddr, SocketAddr};

/// The other end of a connection, as the system tells it.
#[derive(Clone, Copy, Debug)]
pub enum Peer {
    /// An address.
    Address(IpAddr),
    /// A process that has opened the socket in the file system; `None` where the system does not say which.
    Process(Option<i32>),
}

impl Peer {
    /// The end of a connection from this address; of one that is broken already it is not known.
    pub fn from_address_or_unknown_if_error(address: std::io::Result<SocketAddr>) -> Self {
        address.map_or(Self::Process(None), |address| Self::Address(address.ip().to_canonical()))
    }
}

/// The token, by its place in the file, with which a request was let in.
#[derive(Clone, Copy, Debug)]
pub struct TokenNumber(pub usize);

/// One client: what asks under one token from one place.
///
/// From another machine that is its address, whatever its ports; through the socket in the file system it is the process. On
/// loopback all have one address. Their connections are no clients: HTTP/1.1 carries one request at a time on each, so that
/// whoever has 60 in flight has 60 connections, and turns that went round between these would be first come, first served.
/// What is left there is how a program calls itself (`User-Agent`). It may say anything; turns are for programs that do not
/// know of each other, and whoever may connect to loopback may also stop everything.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Client {
    token: Option<usize>,
    place: ClientOrigin,
}

/// Who asks for something: the client, and whether it still waits for the answer.
#[derive(Clone, Debug, Default)]
pub struct Asker {
    /// Whose turn it takes.
    pub client: Client,
    /// The other end of its connection.
    pub sender: RequestSender,
}

impl<S: Sync> FromRequestParts<S> for Asker {
    type Rejection = Infallible;

    async fn from_request_parts(parts: &mut Parts, state: &S) -> Result<Self, Infallible> {
        let client = Client::from_request_parts(parts, state).await?;
        Ok(Self { client, sender: RequestSender::from_request_parts(parts, state).await? })
    }
}

#[cfg(test)]
impl Client {
    /// One of several.
    pub const fn with_token_number(token: usize) -> Self {
        Self { token: Some(token), place: ClientOrigin::Unknown }
    }
}

impl Client {
    /// Whether what the one calls its requests is known to the other: with tokens to whoever has the same, from wherever it asks.
    #[must_use]
    pub fn shares_request_names_with(&self, other: &Self) -> bool {
        if self.token.is_some() { self.token == other.token } else { self == other }
    }
}

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
enum ClientOrigin {
    #[default]
    Unknown,
    Address(IpAddr),
    Process(i32),
    /// The hash of its name: names may be long. Two that meet share their turns.
    Program(u64),
}

impl<S: Sync> FromRequestParts<S> for Client {
    type Rejection = Infallible;

    async fn from_request_parts(parts: &mut Parts, _: &S) -> Result<Self, Infallible> {
        let token = parts.extensions.get::<TokenNumber>().map(|number| number.0);
        let place = match parts.extensions.get::<Peer>() {
            Some(Peer::Address(address)) if !address.is_loopback() => ClientOrigin::Address(*address),
            Some(Peer::Process(Some(process))) => ClientOrigin::Process(*process),
            Some(Peer::Address(_)) => {
                let mut hasher = DefaultHasher::new();
                parts.headers.get(header::USER_AGENT).map(|name| name.as_bytes()).hash(&mut hasher);
                ClientOrigin::Program(hasher.finish())
            }
            Some(Peer::Process(None)) | None => ClientOrigin::Unknown,
        };
        Ok(Self { token, place })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use axum::http::Request;

    async fn client(peer: &str, name: &str, token: Option<usize>) -> Client {
        let (mut parts, ()) = Request::builder().header("user-agent", name).body(()).unwrap().into_parts();
        parts.extensions.insert(Peer::from_address_or_unknown_if_error(Ok(peer.parse().unwrap())));
        if let Some(token) = token {
            parts.extensions.insert(TokenNumber(token));
        }
        let Ok(client) = Client::from_request_parts(&mut parts, &()).await;
        client
    }

    #[tokio::test]
    async fn a_client_is_a_token_and_a_machine_or_a_program_of_this_one() {
        let of = client;
        assert_eq!(of("10.0.0.2:1000", "curl", Some(0)).await, of("10.0.0.2:2000", "page", Some(0)).await);
        assert_eq!(of("10.0.0.2:1000", "curl", None).await, of("[::ffff:10.0.0.2]:1000", "curl", None).await);
        assert_ne!(of("10.0.0.2:1000", "curl", Some(0)).await, of("10.0.0.2:1000", "curl", Some(1)).await);
        assert_ne!(of("10.0.0.2:1000", "curl", None).await, of("10.0.0.3:1000", "curl", None).await);
        assert_eq!(of("127.0.0.1:1000", "curl", None).await, of("127.0.0.1:2000", "curl", None).await);
        assert_ne!(of("127.0.0.1:1000", "curl", None).await, of("127.0.0.1:1000", "page", None).await);
    }
}
