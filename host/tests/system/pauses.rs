//! A computer that sleeps, a process that is held, and clocks that are set, while a board is armed and while it is driven.

use crate::preloaded::Preloaded;
use crate::serving::Serving;
use crate::{TOUCH, drive, start_still_simulated_device, touches_are_driven, wait_until};
use serde_json::json;
use std::io::{Read, Write};
use std::time::Duration;

/// Nothing is driven until a person has armed it.
#[track_caller]
fn waits_for_a_person(serving: &Serving) {
    let daemon = &serving.daemon;
    // Told one after the other.
    daemon.wait_for(|state| state["device"]["waits_to_be_armed"] == true && state["device"]["state"] != "running");
    // What comes in the first moments is refused as late, and then as not armed.
    let mut told = json!(null);
    wait_until("a touch is refused, as nobody has armed the board", || {
        let (status, _, answer) = daemon.post("/v1/touch", TOUCH);
        assert_ne!(status, 200, "{answer}");
        told = answer;
        status == 409
    });
    let detail = told["detail"].as_str().unwrap();
    assert!(detail.contains("slept") && detail.contains("suspended"), "{told}");
    daemon.post("/v1/faults/clear", "");
    wait_until("it is armed by hand", || daemon.post("/v1/arm", "").0 == 200);
    touches_are_driven(daemon);
}

/// The clock that counts while the computer sleeps is an hour ahead all at once: so it is after a sleep of that time. The board had a supply of its own.
#[test]
fn a_sleep_ends_what_was_driven_and_armed() {
    let board = start_still_simulated_device();
    let preloaded = Preloaded::new();
    let serving = preloaded.serving(&board, &[]);
    for (hours, is_driven) in [(1, true), (2, false)] {
        if is_driven {
            drive(&serving.daemon);
        } else {
            wait_until("it is armed", || serving.daemon.post("/v1/arm", "").0 == 200);
        }
        let before = board.control().last_stop_received_at();
        preloaded.set_ahead("boottime", hours * 3600);
        wait_until("a stop is heard", || board.control().last_stop_received_at() != before);
        waits_for_a_person(&serving);
    }
    let log = serving.end();
    let told = log.iter().find(|line| line["message"].as_str().unwrap().contains("did not run")).expect("a line");
    assert!(told["paused_s"].as_f64().unwrap() > 3599.0, "{told}");
}

/// The process is held for longer than anything takes. A touch that came meanwhile is not driven, whether its sender still waits or not.
#[test]
fn what_comes_while_the_process_is_held_is_not_driven() {
    let board = start_still_simulated_device();
    for is_armed in [false, true] {
        let serving = Serving::start(&board, &[]);
        if is_armed {
            drive(&serving.daemon);
        }
        serving.signal("STOP");
        wait_until("the board is off", || !board.control().observations_since_start().energised);
        let before = board.control().last_drives_received_at();
        let address = serving.daemon.url.trim_start_matches("http://").to_owned();
        let request = format!(
            "POST /v1/touch HTTP/1.1\r\nHost: {address}\r\nContent-Type: application/json\r\nConnection: close\r\nContent-Length: {}\r\n\r\n{TOUCH}",
            TOUCH.len()
        );
        let mut sent: Vec<_> = (0..2).map(|_| std::net::TcpStream::connect(&address).unwrap()).collect();
        sent.iter_mut().for_each(|stream| stream.write_all(request.as_bytes()).unwrap());
        // One of them has gone.
        sent.pop();
        std::thread::sleep(Duration::from_secs(5));
        serving.signal("CONT");
        let mut answer = String::new();
        sent[0].read_to_string(&mut answer).unwrap();
        assert!(answer.starts_with("HTTP/1.1 503") || answer.starts_with("HTTP/1.1 409"), "{answer}");
        std::thread::sleep(Duration::from_millis(500));
        assert_eq!(board.control().last_drives_received_at(), before, "{answer}");
        waits_for_a_person(&serving);
        serving.end();
    }
}

/// The board has gone while the process was held, as one whose USB port was without power during a sleep.
#[test]
fn a_board_that_went_meanwhile_is_reported() {
    let board = start_still_simulated_device();
    // By a name of its own: what comes to be at the board's path is another's.
    let folder = tempfile::tempdir().unwrap();
    let port = folder.path().join("port");
    std::os::unix::fs::symlink(board.port_path(), &port).unwrap();
    let serving = Serving::start_at(&[], port.to_str().unwrap(), board.control(), &[]);
    drive(&serving.daemon);
    serving.signal("STOP");
    std::fs::remove_file(&port).unwrap();
    drop(board);
    std::thread::sleep(Duration::from_secs(4));
    serving.signal("CONT");
    let state = serving.daemon.wait_for(|state| state["device"]["connected"] == false);
    assert!(state["device"]["problem"].is_string(), "{state}");
    assert_eq!(serving.daemon.post("/v1/stop", "").0, 502);
    assert_ne!(serving.daemon.post("/v1/touch", TOUCH).0, 200);
    serving.end();
}

/// The time of day is set while the board is driven: nothing ends early or late, and nothing is latched.
#[test]
fn a_clock_that_is_set_changes_nothing() {
    let board = start_still_simulated_device();
    let preloaded = Preloaded::new();
    let serving = preloaded.serving(&board, &[]);
    let daemon = &serving.daemon;
    for seconds in [86_400, -86_400] {
        drive(daemon);
        preloaded.set_ahead("realtime", seconds);
        std::thread::sleep(Duration::from_secs(1));
        let state = daemon.state();
        let told = (&state["device"]["faults"], &state["device"]["waits_to_be_armed"]);
        assert_eq!(told, (&json!(0), &json!(false)), "{state}");
        touches_are_driven(daemon);
        daemon.wait_for(|state| state["device"]["state"] == "armed");
    }
    serving.end();
}
