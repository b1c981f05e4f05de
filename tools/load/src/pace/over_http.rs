//! Touches over connections that are kept open, each with one request on its way.

use super::touches::{Touch, TouchEnd};
use super::{CONNECTIONS, CONNECTIONS_PER_RATE, Pace, take_number_and_due_time_of_next_touch};
use crate::http::{Answer, Endpoint, Http};
use serde_json::json;
use std::io;
use std::sync::atomic::AtomicU32;
use std::time::Instant;

/// An answer as it came: it is read once all is over, so that reading it delays no touch.
struct ReceivedAnswer {
    due: Instant,
    ended: Instant,
    answer: io::Result<Answer>,
}

/// Sends touches when they are due, or as soon as a connection is free.
pub fn send_touches_over_http(endpoint: &Endpoint, pace: Pace, rate: f64) -> Vec<Touch> {
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "`as` saturates")]
    let connections = (rate * CONNECTIONS_PER_RATE).ceil().clamp(1.0, CONNECTIONS) as usize;
    let counter = AtomicU32::new(0);
    let mut all: Vec<ReceivedAnswer> = std::thread::scope(|threads| {
        let clients: Vec<_> =
            (0..connections).map(|_| threads.spawn(|| send_touches_on_connection(endpoint, pace, &counter))).collect();
        clients.into_iter().flat_map(|client| client.join().unwrap_or_default()).collect()
    });
    all.sort_by_key(|came| came.due);
    all.into_iter().map(classify_touch_answer).collect()
}

fn send_touches_on_connection(endpoint: &Endpoint, pace: Pace, counter: &AtomicU32) -> Vec<ReceivedAnswer> {
    let (mut all, mut http) = (Vec::new(), Http::new(endpoint.clone()));
    // One that cannot be opened now is tried again with the first touch, which then tells why.
    let _ = http.open();
    while let Some((k, due)) = take_number_and_due_time_of_next_touch(counter, pace) {
        pace.sleep_until_due(due);
        let body = json!({"x_px": pace.touch_x_px(k), "y_px": 640, "intensity_g": 0.3, "duration_ms": 100}).to_string();
        let answer = http.post("/v1/touch", &body);
        all.push(ReceivedAnswer { due, ended: Instant::now(), answer });
    }
    all
}

fn classify_touch_answer(received: ReceivedAnswer) -> Touch {
    let ReceivedAnswer { due, ended, answer } = received;
    let end = match answer {
        Ok(answer) if answer.status == 200 => {
            TouchEnd::driven_from_plan_or_refused_if_unreadable(&answer.parse_json_body_or_null())
        }
        Ok(answer) => TouchEnd::overtaken_if_problem_is_superseded_else_refused(&answer.parse_json_body_or_null()),
        Err(error) => TouchEnd::Refused(format!("no answer, {error}")),
    };
    Touch { due, ended, end }
}
