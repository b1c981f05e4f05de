//! Touches over connections that are kept open, each with one request on its way.

use super::touches::{End, Touch};
use super::{CONNECTIONS, CONNECTIONS_PER_RATE, Pace, next};
use crate::http::{Answer, Http, Place};
use serde_json::json;
use std::io;
use std::sync::atomic::AtomicU32;
use std::time::Instant;

/// An answer as it came: it is read once all is over, so that reading it delays no touch.
struct Came {
    due: Instant,
    ended: Instant,
    answer: io::Result<Answer>,
}

/// Sends touches when they are due, or as soon as a connection is free.
pub fn run(place: &Place, pace: Pace, rate: f64) -> Vec<Touch> {
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "`as` saturates")]
    let connections = (rate * CONNECTIONS_PER_RATE).ceil().clamp(1.0, CONNECTIONS) as usize;
    let counter = AtomicU32::new(0);
    let mut all: Vec<Came> = std::thread::scope(|threads| {
        let clients: Vec<_> = (0..connections).map(|_| threads.spawn(|| connection(place, pace, &counter))).collect();
        clients.into_iter().flat_map(|client| client.join().unwrap_or_default()).collect()
    });
    all.sort_by_key(|came| came.due);
    all.into_iter().map(touch).collect()
}

fn connection(place: &Place, pace: Pace, counter: &AtomicU32) -> Vec<Came> {
    let (mut all, mut http) = (Vec::new(), Http::new(place.clone()));
    // One that cannot be opened now is tried again with the first touch, which then tells why.
    let _ = http.open();
    while let Some((k, due)) = next(counter, pace) {
        pace.wait(due);
        let body = json!({"x_px": pace.x_px(k), "y_px": 640, "intensity_g": 0.3, "duration_ms": 100}).to_string();
        let answer = http.post("/v1/touch", &body);
        all.push(Came { due, ended: Instant::now(), answer });
    }
    all
}

fn touch(came: Came) -> Touch {
    let Came { due, ended, answer } = came;
    let end = match answer {
        Ok(answer) if answer.status == 200 => End::driven(&answer.json()),
        Ok(answer) => End::problem(&answer.json()),
        Err(error) => End::Refused(format!("no answer, {error}")),
    };
    Touch { due, ended, end }
}
