//! Every call on a port that does not return: whoever waits is answered, the reason is told, and when it returns everything goes on.

use crate::preloaded::Preloaded;
use crate::reader::Reader;
use crate::support::program::{ERA, build_isolated_command, run_command};
use crate::{drive, start_still_simulated_device, touches_are_driven, wait_until};
use era::device::Target;
use era::device::sim::{SimDevice, SimKnobs};
use era::flash::board::Board;
use std::time::{Duration, Instant};

/// Calls by which a port is opened, set and closed. The session looks for its board, and is held.
#[test]
fn a_session_is_not_held_by_a_port_that_does_not_open_or_close() {
    let board = start_still_simulated_device();
    let preloaded = Preloaded::new();
    for call in ["open", "ioctl", "flock", "close"] {
        let serving = preloaded.serving(&board, &["--after-outage", "touch"]);
        let daemon = &serving.daemon;
        preloaded.hold(call);
        // It is given up, and opened anew.
        board.control().set_knobs(SimKnobs { silent: true, ..SimKnobs::default() });
        let state = daemon.wait_for(|state| {
            let problem = state["device"]["problem"].as_str().unwrap_or_default();
            problem.contains("did not return within")
        });
        let problem = state["device"]["problem"].as_str().unwrap();
        assert!(problem.contains(board.port_path()), "{call}: {problem}");
        let begun = Instant::now();
        let (status, _, told) = daemon.post("/v1/stop", "");
        assert!(status == 502 && begun.elapsed() < Duration::from_secs(5), "{call}: {:?} {told}", begun.elapsed());
        assert!(told["detail"].as_str().unwrap().contains("did not return within"), "{call}: {told}");
        board.control().set_knobs(SimKnobs::default());
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
    let board = start_still_simulated_device();
    let preloaded = Preloaded::new();
    for call in ["read", "write"] {
        let serving = preloaded.serving(&board, &["--after-outage", "touch", "--clear-silence"]);
        let daemon = &serving.daemon;
        drive(daemon);
        preloaded.hold(call);
        wait_until("the board is off", || !board.control().observations_since_start().energised);
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
    let board = start_still_simulated_device();
    let preloaded = Preloaded::new();
    let serving = preloaded.serving(&board, &[]);
    drive(&serving.daemon);
    preloaded.hold("close");
    let (before, begun) = (board.control().last_stop_received_at(), Instant::now());
    serving.end();
    assert!(begun.elapsed() < Duration::from_secs(10), "{:?}", begun.elapsed());
    assert_ne!(board.control().last_stop_received_at(), before);
}

/// A board that may be live is told to stop, and its port is given up, before anything that takes time: here the look at all programs, for the one
/// that takes its answers.
#[test]
fn a_port_is_given_up_before_it_is_looked_who_has_it_open() {
    let board = start_still_simulated_device();
    let preloaded = Preloaded::new();
    let mut reader = Reader::with_open(board.port_path());
    let serving = preloaded.serving(&board, &[]);
    let daemon = &serving.daemon;
    drive(daemon);
    preloaded.hold("opendir");
    reader.reads();
    wait_until("the port is given up", || !serving.has_open(board.port_path()));
    assert!(!daemon.state().to_string().contains(&reader.name()), "it has looked");
    preloaded.let_go("opendir");
    daemon.wait_for(|state| state["device"]["problem"].to_string().contains(&reader.name()));
    serving.end();
}

/// The doctor ends, whichever call does not return, and names it.
#[test]
fn the_doctor_ends_though_a_call_does_not_return() {
    let board = start_still_simulated_device();
    let preloaded = Preloaded::new();
    for call in ["open", "ioctl", "flock", "read", "write", "close"] {
        let told = told_while_held(&preloaded, &board, call, &[ERA, "doctor", "--device", board.port_path()]);
        // It has all its answers when it closes the port.
        assert!(told.contains("PROBLEM") || call == "close", "{call}: {told}");
    }
}

/// `era flash` and `era monitor` end, whichever call does not return, and name it: what they do at a port, in a process of its own.
#[test]
fn what_the_flasher_and_the_monitor_ask_ends_though_a_call_does_not_return() {
    let board = start_still_simulated_device();
    let preloaded = Preloaded::new();
    let this = std::env::current_exe().unwrap();
    let words = [this.to_str().unwrap(), "--exact", "held_calls::in_a_process_of_its_own", "--ignored", "--nocapture"];
    for call in ["open", "ioctl", "flock", "read", "write", "close"] {
        told_while_held(&preloaded, &board, call, &words);
    }
}

/// Runs a command while this call is held; all that it has said, which names the call as one that has not returned.
fn told_while_held(preloaded: &Preloaded, board: &SimDevice, call: &str, command: &[&str]) -> String {
    preloaded.hold(call);
    let begun = Instant::now();
    let words = preloaded.words(board);
    let output = run_command(build_isolated_command(&words[0]).args(&words[1..]).args(command));
    let told = format!("{}{}", output.out, output.error);
    assert!(begun.elapsed() < Duration::from_secs(30), "{call}: {:?}", begun.elapsed());
    assert!(told.contains("did not return within"), "{call}: {told}");
    preloaded.let_go(call);
    told
}

/// Asks a board as `era flash` and `era monitor` do, at the port that is held.
#[test]
#[ignore = "no test of its own: tests of this file run it as a process whose calls are held"]
fn in_a_process_of_its_own() {
    let port = std::env::var("HELD_PORT").unwrap();
    let asked = Board::open(&Target::Serial(port)).and_then(|mut board| {
        board.check_idle()?;
        board.log()
    });
    println!("{:?}", asked.map_err(|error| error.to_string()));
}
