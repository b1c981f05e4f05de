//! Boards that are late: an effect's start that has passed, a self-test that does not end in time.

use crate::support::Daemon;
use crate::support::timed_board::TimedBoard;
use era::device::session::policy::SessionPolicy;
use era::scene::STARTING_PLATE;
use serde_json::json;
use std::time::{Duration, Instant};

fn daemon_with(board: &TimedBoard) -> Daemon {
    let daemon = Daemon::at(STARTING_PLATE, &board.behind_a_terminal(), SessionPolicy::default());
    daemon.wait_for(|state| state["device"]["connected"] == true);
    daemon
}

/// A frame that the link holds up for longer than the board takes effects after their start.
#[test]
fn an_effect_whose_start_has_passed_is_tried_once_more() {
    let board = TimedBoard::new();
    let daemon = daemon_with(&board);
    // The board takes effects up to 100 ms late, and gives its host up after 250 ms.
    board.lock().jump_us = 200_000;
    let (status, _, answer) = daemon.post("/v1/touch", r#"{"x_px": 300, "y_px": 900, "effect": "pulse_train"}"#);
    assert_eq!(status, 200, "{answer}");
    let start_us = answer["device"]["effect"]["start_board_us"].as_u64().unwrap();
    let plays = board.lock().plays;
    // The first was refused, and then one for each channel came.
    assert_eq!(plays, 3, "{answer}");
    assert!(start_us > 200_000 && daemon.state()["device"]["fault"].is_null(), "{answer}");
}

#[test]
fn drives_are_taken_back_when_arming_ends_late() {
    for (path, body) in [
        ("/v1/touch", r#"{"x_px": 300, "y_px": 900, "duration_ms": 9000}"#),
        ("/v1/touch", r#"{"x_px": 300, "y_px": 900, "effect": "buzz"}"#),
        ("/v1/arm", ""),
    ] {
        is_taken_back(path, body);
    }
}

/// What is asked for before a self-test that ends too late is neither driven later, nor does it leave the board armed.
fn is_taken_back(path: &str, body: &str) {
    let board = TimedBoard::new();
    let daemon = daemon_with(&board);
    daemon.wait_for(|state| state["device"]["state"] == "safe");
    // The self-test, some 20 ms of the board's time, then takes longer than the 1.5 s that are waited for.
    board.lock().slower = 1000;
    let (status, _, problem) = daemon.post(path, body);
    assert_eq!((status, &problem["type"]), (409, &json!("urn:era:problem:device-refused")), "{problem}");
    assert!(problem["detail"].as_str().unwrap().contains("did not become ready"), "{problem}");
    // Time enough for a self-test to end and for what was held until then to be driven.
    let until_us = {
        let mut board = board.lock();
        board.slower = 1;
        board.now_us() + 300_000
    };
    let deadline = Instant::now() + Duration::from_secs(30);
    while board.lock().now_us() < until_us {
        assert!(Instant::now() < deadline, "the board's time stands still");
        std::thread::sleep(Duration::from_millis(5));
    }
    assert!(!board.lock().has_run, "{path} {body} was refused, and driven all the same");
    let state = daemon.state();
    assert!(["safe", "discharging"].map(Some).contains(&state["device"]["state"].as_str()), "{path} {body}: {state}");
    // The next touch is driven.
    assert_eq!(daemon.post("/v1/touch", r#"{"x_px": 300, "y_px": 900, "duration_ms": 200}"#).0, 200);
    assert!(board.lock().has_run);
}
