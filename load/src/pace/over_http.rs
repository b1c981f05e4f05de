//! Touches over connections that are kept open, each with one request on its way.

use super::{CONNECTIONS, CONNECTIONS_PER_RATE, Measured, Pace, next, x_px};
use crate::http::{Http, Place};
use era::device::sim::SimControl;
use serde_json::json;
use std::sync::atomic::AtomicU32;
use std::time::Instant;

/// Sends touches when they are due, or as soon as a connection is free.
pub fn run(place: &Place, pace: Pace, rate: f64, control: &SimControl) -> Measured {
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "`as` saturates")]
    let connections = (rate * CONNECTIONS_PER_RATE).ceil().clamp(1.0, CONNECTIONS) as usize;
    let counter = AtomicU32::new(0);
    let mut all = Measured::default();
    std::thread::scope(|threads| {
        let one = || connection(place, pace, &counter, control);
        let clients: Vec<_> = (0..connections).map(|_| threads.spawn(one)).collect();
        for client in clients {
            all.join(client.join().unwrap_or_default());
        }
    });
    all
}

fn connection(place: &Place, pace: Pace, counter: &AtomicU32, control: &SimControl) -> Measured {
    let (mut measured, mut http) = (Measured::default(), Http::new(place.clone()));
    while let Some((k, due)) = next(counter, pace) {
        std::thread::sleep(due.saturating_duration_since(Instant::now()));
        let body = json!({"x_px": x_px(k), "y_px": 640, "intensity_g": 0.3, "duration_ms": 100}).to_string();
        let begun = Instant::now();
        let answer = http.post("/v1/touch", &body);
        let answered = Instant::now();
        measured.sent += 1;
        if answer.is_ok_and(|answer| answer.status == 200) {
            measured.answer.add(answered - begun);
            if let Some(at) = control.drives_received().filter(|at| *at >= begun) {
                measured.frame.add(at - begun);
            }
        } else {
            measured.refused += 1;
        }
    }
    measured.took = pace.from.elapsed();
    measured
}
