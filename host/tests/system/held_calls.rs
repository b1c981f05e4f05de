//! Every call on a port that does not return: whoever waits is answered, the reason is told, and when it returns everything goes on.

use crate::preloaded::Preloaded;
use crate::{board, drive, touches_are_driven, wait_until};
use era::device::sim::Knobs;
use std::process::Command;
use std::time::{Duration, Instant};

/// Calls by which a port is opened, set and closed. The session looks for its board, and is held.
#[test]
fn a_session_is_not_held_by_a_port_that_does_not_open_or_close() {
    let board = board();
    let preloaded = Preloaded::new();
    for call in ["open", "ioctl", "flock", "close"] {
        let serving = preloaded.serving(&board, &["--after-outage", "touch"]);
        let daemon = &serving.daemon;
        preloaded.hold(call);
        // It is given up, and opened anew.
        board.control().set_knobs(Knobs { silent: true, ..Knobs::default() });
        let state = daemon.wait_for(|state| {
            let problem = state["device"]["problem"].as_str().unwrap_or_default();
            problem.contains("has not returned for")
        });
        let problem = state["device"]["problem"].as_str().unwrap();
        assert!(problem.contains(board.path()), "{call}: {problem}");
        let begun = Instant::now();
        let (status, _, told) = daemon.post("/v1/stop", "");
        assert!(status == 502 && begun.elapsed() < Duration::from_secs(5), "{call}: {:?} {told}", begun.elapsed());
        assert!(told["detail"].as_str().unwrap().contains("has not returned for"), "{call}: {told}");
        board.control().set_knobs(Knobs::default());
        preloaded.let_go(call);
        daemon.wait_for(|state| state["device"]["connected"] == true);
        touches_are_driven(daemon);
        serving.end();
    }
}

/// Calls by which a port is read and written do not wait. Where even these do not return, the board goes off by itself, whoever asks is answered, and
/// the session goes on when they return.
#[test]
fn whoever_asks_a_session_that_is_held_is_answered() {
    let board = board();
    let preloaded = Preloaded::new();
    for call in ["read", "write"] {
        let serving = preloaded.serving(&board, &["--after-outage", "touch", "--clear-silence"]);
        let daemon = &serving.daemon;
        drive(daemon);
        preloaded.hold(call);
        wait_until("the board is off", || !board.control().watch().energised);
        let begun = Instant::now();
        let (status, _, told) = daemon.post("/v1/stop", "");
        assert!(status >= 500 && begun.elapsed() < Duration::from_secs(15), "{call}: {:?} {told}", begun.elapsed());
        assert_eq!(daemon.state()["device"]["connected"], false, "{call}");
        preloaded.let_go(call);
        daemon.wait_for(|state| state["device"]["connected"] == true);
        touches_are_driven(daemon);
        serving.end();
    }
}

/// The daemon ends though its port does not close.
#[test]
fn a_daemon_ends_though_its_port_does_not_close() {
    let board = board();
    let preloaded = Preloaded::new();
    let serving = preloaded.serving(&board, &[]);
    drive(&serving.daemon);
    preloaded.hold("close");
    let (before, begun) = (board.control().stop_received(), Instant::now());
    serving.end();
    assert!(begun.elapsed() < Duration::from_secs(10), "{:?}", begun.elapsed());
    assert_ne!(board.control().stop_received(), before);
}

/// The doctor and the flasher end, whichever call does not return, and name it.
#[test]
fn the_doctor_and_the_monitor_end_though_a_call_does_not_return() {
    let board = board();
    let preloaded = Preloaded::new();
    for call in ["open", "ioctl", "flock"] {
        preloaded.hold(call);
        let begun = Instant::now();
        let words = preloaded.words(&board);
        let mut command = Command::new(&words[0]);
        command.args(&words[1..]).arg(env!("CARGO_BIN_EXE_era")).args(["doctor", "--device", board.path()]);
        let output = command.output().unwrap();
        let told = String::from_utf8_lossy(&output.stdout).into_owned();
        assert!(begun.elapsed() < Duration::from_secs(30), "{call}: {:?}", begun.elapsed());
        assert!(told.contains("PROBLEM") && told.contains("has not returned for"), "{call}: {told}");
        preloaded.let_go(call);
    }
}
