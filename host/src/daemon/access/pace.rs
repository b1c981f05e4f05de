//! How often one client is answered.
//!
//! Requests that are refused or answered from memory take some tens of microseconds each. A client that asks again as soon as it has an answer keeps every
//! processor at that, and a stop then waits for the scheduler: up to a second was measured on two processors beside 50 000 requests a second. So
//! requests beyond a pace wait, whatever they ask, but for a stop that is not refused. Nobody is shut out. Messages on live sockets have the same pace: the next one is
//! read when it is due.

use super::client::Peer;
use axum::extract::{Request, State};
use axum::http::Method;
use axum::middleware::Next;
use axum::response::Response;
use std::collections::HashMap;
use std::net::{IpAddr, Ipv6Addr};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

/// Between two requests of one client in the long run: 2000 a second, some 4 % of one processor. A page that follows ten fingers needs 120.
const BETWEEN: Duration = Duration::from_micros(500);
/// How far a client may be ahead of that: 200 requests at once, as of a page that is loaded by many.
const AHEAD: Duration = Duration::from_millis(100);
/// Clients that are kept at a time. Where there are more, those whose requests wait least are forgotten.
const MOST_CLIENTS: usize = 1024;

/// Who is paced together.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
enum PacedClient {
    /// An address; of IPv6 the network.
    Network(IpAddr),
    /// A process that uses the socket in the file system.
    Process(Option<i32>),
}

impl From<Peer> for PacedClient {
    fn from(peer: Peer) -> Self {
        match peer {
            Peer::Address(address) => Self::Network(mask_ipv6_to_network(address)),
            Peer::Process(process) => Self::Process(process),
        }
    }
}

/// Of every client when its next request is due at the pace.
#[derive(Debug, Default)]
pub struct RequestRateLimiter {
    due: Mutex<HashMap<PacedClient, Instant>>,
}

impl RequestRateLimiter {
    /// Counts a message of `bytes` bytes on a live socket of `peer`, and waits until the next one may be read. Each 2 KiB count as one
    /// request: to read them takes as long.
    pub async fn count_live_message_and_wait_until_next_is_allowed(&self, peer: Peer, bytes: usize) {
        let requests = Self::requests_that_a_message_counts_as(bytes);
        sleep_if_positive(self.count_requests_and_find_wait(peer, Instant::now(), requests)).await;
    }

    fn requests_that_a_message_counts_as(bytes: usize) -> u32 {
        u32::try_from(1 + bytes / 2048).unwrap_or(u32::MAX)
    }

    /// Counts `requests` requests of `peer` that have come at `now`, and returns how long they have to wait (the generic cell rate algorithm of
    /// ITU-T I.371).
    fn count_requests_and_find_wait(&self, peer: Peer, now: Instant, requests: u32) -> Duration {
        let mut due = self.due.lock().unwrap_or_else(PoisonError::into_inner);
        let client = peer.into();
        if due.len() >= MOST_CLIENTS && !due.contains_key(&client) {
            due.retain(|_, due| *due > now);
            let least = due.iter().min_by_key(|(_, due)| **due).map(|(client, _)| *client);
            if let Some(least) = least.filter(|_| due.len() >= MOST_CLIENTS) {
                due.remove(&least);
            }
        }
        let own = due.entry(client).or_insert(now);
        *own = (*own).max(now);
        let delay = own.saturating_duration_since(now).saturating_sub(AHEAD);
        *own += BETWEEN * requests;
        delay
    }
}

/// Has a request wait where its client asks faster than the pace. A stop does not wait. What is answered to a stop that is refused does: it stops nothing, and
/// tells whether a token is right.
pub async fn delay_requests_above_rate_except_accepted_stop(
    State(pace): State<Arc<RequestRateLimiter>>,
    request: Request,
    next: Next,
) -> Response {
    let peer = request.extensions().get::<Peer>().copied();
    let wait_for_pace = async || {
        if let Some(peer) = peer {
            sleep_if_positive(pace.count_requests_and_find_wait(peer, Instant::now(), 1)).await;
        }
    };
    if *request.method() != Method::POST || request.uri().path() != "/v1/stop" {
        wait_for_pace().await;
        return next.run(request).await;
    }
    let response = next.run(request).await;
    if response.status().is_client_error() {
        wait_for_pace().await;
    }
    response
}

/// Even the shortest sleep takes until the next whole ms: whoever need not wait must not sleep.
async fn sleep_if_positive(delay: Duration) {
    if !delay.is_zero() {
        tokio::time::sleep(delay).await;
    }
}

/// What counts as one machine: of IPv6 the network of 64 bits, as every machine has all of its addresses.
fn mask_ipv6_to_network(address: IpAddr) -> IpAddr {
    match address.to_canonical() {
        IpAddr::V6(v6) if !v6.is_loopback() => Ipv6Addr::from_bits(v6.to_bits() >> 64 << 64).into(),
        other => other,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use axum::Router;
    use axum::body::Body;
    use axum::http::StatusCode;
    use axum::middleware::from_fn_with_state;
    use axum::routing::post;
    use std::pin::pin;
    use std::task::{Context, Waker};
    use tower_service::Service;

    fn parse_peer(text: &str) -> Peer {
        Peer::Address(text.parse().unwrap())
    }

    #[test]
    fn only_what_is_faster_than_the_pace_waits() {
        let (pace, start) = (RequestRateLimiter::default(), Instant::now());
        let one = parse_peer("192.0.2.1");
        for number in 0..=200 {
            assert_eq!(pace.count_requests_and_find_wait(one, start, 1), Duration::ZERO, "{number}");
        }
        assert_eq!(pace.count_requests_and_find_wait(one, start, 1), BETWEEN);
        assert_eq!(pace.count_requests_and_find_wait(one, start, 1), 2 * BETWEEN);
        assert_eq!(pace.count_requests_and_find_wait(parse_peer("192.0.2.2"), start, 1), Duration::ZERO);
        assert_eq!(pace.count_requests_and_find_wait(Peer::Process(Some(7)), start, 1), Duration::ZERO);
        // One that asks a thousand times a second never waits; one that was too fast does no longer a second later.
        for number in 0..5000 {
            assert_eq!(
                pace.count_requests_and_find_wait(parse_peer("192.0.2.3"), start + 2 * BETWEEN * number, 1),
                Duration::ZERO,
                "{number}"
            );
        }
        assert_eq!(pace.count_requests_and_find_wait(one, start + Duration::from_secs(1), 1), Duration::ZERO);
    }

    /// Of messages of 256 KiB, the longest that are read, some 15 a second are read; of short ones as many as requests are answered.
    #[tokio::test]
    async fn messages_within_the_pace_wait_for_nothing() {
        let (pace, one) = (RequestRateLimiter::default(), Peer::Process(None));
        for number in 0..100 {
            let mut wait = pin!(pace.count_live_message_and_wait_until_next_is_allowed(one, 200));
            let polled = wait.as_mut().poll(&mut Context::from_waker(Waker::noop()));
            assert!(polled.is_ready(), "message {number}");
        }
    }

    /// A stop waits for nothing, but whoever tries tokens on stops is answered at the pace.
    #[tokio::test]
    async fn only_refused_stops_wait() {
        let pace = Arc::new(RequestRateLimiter::default());
        let one = parse_peer("192.0.2.1");
        // Two seconds ahead, however slow this computer is.
        pace.count_requests_and_find_wait(one, Instant::now(), 4000);
        for (answer, waits) in [
            (StatusCode::OK, false),
            (StatusCode::SERVICE_UNAVAILABLE, false),
            (StatusCode::UNAUTHORIZED, true),
            (StatusCode::FORBIDDEN, true),
            (StatusCode::BAD_REQUEST, true),
        ] {
            let mut router = Router::new()
                .route("/v1/stop", post(async move || answer))
                .layer(from_fn_with_state(Arc::clone(&pace), delay_requests_above_rate_except_accepted_stop));
            let mut request = Request::post("/v1/stop").body(Body::empty()).unwrap();
            request.extensions_mut().insert(one);
            let mut answered = pin!(router.call(request));
            let polled = answered.as_mut().poll(&mut Context::from_waker(Waker::noop()));
            assert_eq!(polled.is_pending(), waits, "{answer}");
        }
    }

    #[test]
    fn long_messages_wait_longer() {
        for (bytes, per_second) in [(200, 2000), (16 * 1024, 222), (256 * 1024, 15)] {
            let (pace, start, one) = (RequestRateLimiter::default(), Instant::now(), Peer::Process(None));
            let requests = RequestRateLimiter::requests_that_a_message_counts_as(bytes);
            let (mut now, mut count) = (start, 0);
            while now < start + Duration::from_secs(10) {
                now += pace.count_requests_and_find_wait(one, now, requests);
                count += 1;
            }
            assert!((10 * per_second..=11 * per_second + 200).contains(&count), "{bytes}: {count}");
        }
    }

    #[test]
    fn a_network_is_one_client_and_many_take_no_more_memory() {
        let (pace, start) = (RequestRateLimiter::default(), Instant::now());
        for number in 0..=200 {
            assert_eq!(
                pace.count_requests_and_find_wait(parse_peer(&format!("2001:db8:1:2::{number:x}")), start, 1),
                Duration::ZERO
            );
        }
        assert!(pace.count_requests_and_find_wait(parse_peer("2001:db8:1:2:ffff::1"), start, 1) > Duration::ZERO);
        for number in 0..3 * u32::try_from(MOST_CLIENTS).unwrap() {
            pace.count_requests_and_find_wait(Peer::Address(std::net::Ipv4Addr::from_bits(number).into()), start, 1);
            assert!(pace.due.lock().unwrap().len() <= MOST_CLIENTS);
        }
        // Who waits longest is not forgotten.
        assert!(pace.count_requests_and_find_wait(parse_peer("2001:db8:1:2::1"), start, 1) > Duration::ZERO);
    }
}
