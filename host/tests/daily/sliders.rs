//! A finger that moves along a slider: each detent is a click of its own, which the moves between them do not end.

use crate::fingers::{Socket, live, next, say};
use crate::line::{CALM, Ear};
use crate::support::Daemon;
use era::planner::STANDARD_GRAVITY;
use era::scene::STARTING_PLATE;
use era_shared::protocol::Request;
use serde_json::{Value, json};
use std::time::{Duration, Instant};

/// Between two messages of a finger: 60 a second.
const MOVE: Duration = Duration::from_millis(16);

fn x_of_step(step: u32) -> f64 {
    f64::from(300 + 20 * step)
}

/// The finger is down and comes to a detent, then it moves a few times.
fn slide_over_detent(socket: &mut Socket, detent: u32, moves: u32) {
    for step in detent * moves..(detent + 1) * moves {
        let touches = json!([{"id": 1, "x_px": x_of_step(step), "y_px": 640.0}]);
        let message = if step % moves == 0 {
            json!({"type": "touch", "touches": touches, "effect": "click", "intensity_g": 0.2})
        } else {
            json!({"type": "touch", "touches": touches, "intensity_g": 0.0})
        };
        say(socket, &message);
        std::thread::sleep(MOVE);
    }
}

fn slide_and_lift(socket: &mut Socket, detents: u32, moves_per_detent: u32) {
    (0..detents).for_each(|detent| slide_over_detent(socket, detent, moves_per_detent));
    say(socket, &json!({"type": "touch", "touches": []}));
}

/// The next plan that is a click.
fn next_click(socket: &mut Socket) -> Value {
    loop {
        let plan = next(socket, "plan");
        if plan["effect"]["name"] == "click" {
            return plan;
        }
    }
}

#[test]
fn each_detent_of_a_slider_is_felt() {
    let daemon = Daemon::start(STARTING_PLATE);
    assert_eq!(daemon.post("/v1/arm", "").0, 200);
    let mut socket = live(&daemon, "?send=plan");
    let (detents, moves) = (12, 5);
    for detent in 0..detents {
        slide_over_detent(&mut socket, detent, moves);
        let plan = next_click(&mut socket);
        assert_eq!(plan["touches"][0]["x_px"], x_of_step(detent * moves), "detent {detent}: {}", plan["touches"]);
        let predicted = &plan["effect"]["predicted"];
        let [least, most] = ["peak_least_g", "peak_most_g"].map(|key| predicted[key].as_f64().unwrap());
        // Motion above 500 Hz, which is not felt, rings from one detent into the next, and the sensor shows it.
        // The moves after a click drive nothing. On a busy computer the sensor may be put under one of them before the click has its peak.
        let find_peak_g = |state: &Value| {
            let peaks = state["telemetry"]["touch_peaks"].as_array()?.iter();
            let from_click = peaks.filter(|peak| peak["plan_id"].as_u64() >= plan["plan_id"].as_u64());
            from_click.filter_map(|peak| peak["peak_g"].as_f64()).reduce(f64::max)
        };
        let felt = daemon.wait_for(|state| find_peak_g(state).is_some_and(|peak| peak > 0.7 * least));
        let peak = find_peak_g(&felt).unwrap();
        assert!(peak < 1.5 * most, "detent {detent}: measured {peak} g, {predicted}");
    }
}

/// Fifteen detents a second, with moves that drive nothing between them: each detent's click has its peak before the next detent. (Before, the moves
/// took the rails down, so that every second click waited for its rails and was replaced.)
#[test]
fn detents_in_quick_succession_are_felt() {
    let daemon = Daemon::start(STARTING_PLATE);
    assert_eq!(daemon.post("/v1/arm", "").0, 200);
    let mut missed = Vec::new();
    // Other programs may hold the computer up for longer than a detent lasts.
    for _ in 0..4 {
        let mut socket = live(&daemon, "?send=plan");
        slide_and_lift(&mut socket, 13, 4);
        // The first waits for the rails.
        next_click(&mut socket);
        let clicks: Vec<Value> = (1..13).map(|_| next_click(&mut socket)).collect();
        let told = |click: &Value| {
            let measured = click["plan_id"].as_u64().and_then(|id| daemon.sim.peak_of_touch_if_kept(id));
            let least_g = click["effect"]["predicted"]["peak_least_g"].as_f64().unwrap();
            (measured.map_or(0.0, |peak| peak.peak_m_per_s2 / STANDARD_GRAVITY), least_g)
        };
        missed = clicks.iter().map(told).filter(|(measured_g, least_g)| *measured_g < 0.7 * least_g).collect();
        if missed.is_empty() {
            break;
        }
    }
    assert!(missed.is_empty(), "measured and told in g: {missed:.3?}");
}

/// When the line took windows, and when anything else that drives or ends a drive.
fn times_of_clicks_and_others(ear: &Ear) -> (Vec<Instant>, Vec<Instant>) {
    let (mut clicks, mut others) = (Vec::new(), Vec::new());
    for (request, at) in ear.asked.iter().zip(&ear.at) {
        match request {
            Request::PlayWindows(_) => clicks.push(*at),
            Request::SetDrives { .. } | Request::Prepare { .. } | Request::Stop => others.push(*at),
            _ => {}
        }
    }
    (clicks, others)
}

#[test]
fn moves_do_not_end_a_detent() {
    let (daemon, line) = crate::line::daemon(CALM);
    assert_eq!(daemon.post("/v1/arm", "").0, 200);
    let mut socket = live(&daemon, "?send=plan");
    slide_and_lift(&mut socket, 6, 8);
    // Each place has a click of its own.
    let length_of = |click: Value| click["effect"]["duration_ms"].as_f64().unwrap_or_else(|| panic!("{click}"));
    let length_ms = (0..6).map(|_| length_of(next_click(&mut socket))).fold(f64::INFINITY, f64::min);
    let (clicks, others) = times_of_clicks_and_others(&line.ear());
    assert!(clicks.len() >= 6, "{} messages with windows", clicks.len());
    for click in clicks {
        let ended_by =
            others.iter().find(|at| **at >= click && at.duration_since(click).as_secs_f64() < length_ms / 1e3);
        assert!(ended_by.is_none(), "after {:?} of {length_ms} ms", ended_by.map(|at| at.duration_since(click)));
    }
}

/// More of them than can be told apart: what waits is replaced, so that the last one is played in time, and in their order.
#[test]
fn detents_that_come_too_fast_do_not_queue() {
    let daemon = Daemon::start(STARTING_PLATE);
    let mut socket = live(&daemon, "?send=plan");
    slide_and_lift(&mut socket, 26, 2);
    let (mut last, mut count) = (0.0, 0);
    while last != x_of_step(50) {
        let x_px = next_click(&mut socket)["touches"][0]["x_px"].as_f64().unwrap();
        assert!(x_px > last, "{x_px} after {last}");
        (last, count) = (x_px, count + 1);
    }
    assert!((1..=26).contains(&count), "{count}");
}
