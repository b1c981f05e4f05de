//! What the system and other programs do to a program that runs: ports that somebody else uses, signals, streams that are closed or stuck,
//! a computer that sleeps, clocks that are set.

#[path = "../daily/serving.rs"]
mod serving;
#[path = "../support/mod.rs"]
mod support;

mod held_calls;
mod other_program;
mod pauses;
mod preloaded;
mod reader;
mod signals;
mod stalled;
mod streams;

use std::time::{Duration, Instant};

/// Longer than anything here takes on a busy machine.
const LIMIT: Duration = Duration::from_secs(30);

/// Waits until it is so.
#[track_caller]
fn wait_until(what: &str, mut is_so: impl FnMut() -> bool) {
    let deadline = Instant::now() + LIMIT;
    while !is_so() {
        assert!(Instant::now() < deadline, "not within {LIMIT:?}: {what}");
        std::thread::sleep(Duration::from_millis(10));
    }
}

/// A device for the example plate, on a pseudo-terminal of its own, whose panel nothing moves: the computer has time for it whatever else it does.
fn start_still_simulated_device() -> era::device::sim::SimDevice {
    era::device::sim::SimDevice::start(support::still_panel(), vec![2000.0; 2]).unwrap()
}

const TOUCH: &str = r#"{"x_px": 300, "y_px": 900, "duration_ms": 200}"#;
const LONG_TOUCH: &str = r#"{"x_px": 300, "y_px": 900, "duration_ms": 9000}"#;

/// Has the board driven for some seconds. A computer that is busy may refuse a touch, or end it, as the board is late.
#[track_caller]
fn drive(daemon: &support::Daemon) {
    let runs = || {
        let state = daemon.state();
        (state["device"]["state"] == "running").then_some(())
    };
    wait_until("the board drives", || {
        daemon.post("/v1/touch", LONG_TOUCH).0 == 200
            && (0..50).any(|_| {
                std::thread::sleep(Duration::from_millis(10));
                runs().is_some()
            })
    });
}

/// A touch is driven, as soon as the board is no longer late.
#[track_caller]
fn touches_are_driven(daemon: &support::Daemon) {
    wait_until("a touch is driven", || daemon.post("/v1/touch", TOUCH).0 == 200);
}
