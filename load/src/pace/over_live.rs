//! A finger that moves, on one live socket. Places that were never driven, as a newer one stood in their stead, count as refused.

use super::{Measured, Pace, x_px};
use crate::live::Live;
use era::device::sim::SimControl;
use serde_json::{Value, json};
use std::collections::VecDeque;
use std::net::SocketAddr;
use std::time::{Duration, Instant};

/// Time for the last plans to come.
const LAST: Duration = Duration::from_millis(300);
/// Places of which the plan may still come.
const KEPT: usize = 4096;

/// Moves the finger when that is due, and reads in between.
///
/// # Errors
/// What is wrong with the socket.
pub fn run(address: SocketAddr, pace: Pace, control: &SimControl) -> Result<Measured, String> {
    let mut live = Live::open(address, "plan")?;
    let (mut measured, mut on_the_way) = (Measured::default(), VecDeque::new());
    let mut k = 0;
    while let Some(due) = pace.due(k) {
        let now = Instant::now();
        if now < due {
            if let Some(message) = live.read_until(due)? {
                seen(&message, &mut on_the_way, control, &mut measured);
            }
            continue;
        }
        let finger = json!({"id": 1, "x_px": x_px(k), "y_px": 640, "intensity_g": 0.3});
        live.send(&json!({"type": "touch", "touches": [finger]}))?;
        if on_the_way.len() == KEPT {
            on_the_way.pop_front();
        }
        on_the_way.push_back((x_px(k), now));
        measured.sent += 1;
        k += 1;
    }
    measured.took = pace.from.elapsed();
    let last = Instant::now() + LAST;
    while Instant::now() < last {
        if let Some(message) = live.read_until(last)? {
            seen(&message, &mut on_the_way, control, &mut measured);
        }
    }
    live.send(&json!({"type": "touch", "touches": []}))?;
    measured.refused = measured.sent - measured.answer.len() as u64;
    Ok(measured)
}

/// Notes the plan for a place that the finger was at.
fn seen(message: &Value, on_the_way: &mut VecDeque<(f64, Instant)>, control: &SimControl, measured: &mut Measured) {
    let now = Instant::now();
    let x_px = message["touches"][0]["x_px"].as_f64();
    let Some(place) = on_the_way.iter().position(|(x, _)| Some(*x) == x_px) else { return };
    // Those before it are not driven any more.
    let begun = on_the_way.drain(..=place).next_back().map(|(_, begun)| begun);
    let Some(begun) = begun else { return };
    measured.answer.add(now - begun);
    if let Some(at) = control.drives_received().filter(|at| *at >= begun) {
        measured.frame.add(at - begun);
    }
}
