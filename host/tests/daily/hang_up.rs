//! Senders that hang up, send half of something, or read nothing.

use crate::line::plate;
use crate::raw::{connect, post, send_and_go, send_and_listen};
use crate::support::Daemon;
use crate::support::served::Served;
use era::daemon::Limits;
use era::device::timing::REAL_TIME;
use era::scene::STARTING_PLATE;
use serde_json::json;
use std::io::{Read, Write};
use std::sync::Arc;
use std::time::Duration;
use tungstenite::Message;

const LONG_TOUCH: &str = r#"{"x_px": 300, "y_px": 900, "duration_ms": 9000}"#;

#[test]
fn a_stop_counts_though_its_sender_hangs_up() {
    let daemon = Daemon::start(STARTING_PLATE);
    for _ in 0..10 {
        assert_eq!(daemon.post("/v1/touch", LONG_TOUCH).0, 200);
        daemon.wait_for(|state| state["device"]["state"] == "running");
        send_and_go(&daemon, &post("/v1/stop", ""));
        daemon.wait_for(|state| state["device"]["state"] != "running" && state["plan"].is_null());
    }
    // Whoever closes only the sending half still wants the answer.
    let answer = send_and_listen(&daemon, &post("/v1/stop", ""));
    assert!(answer.starts_with("HTTP/1.1 200 OK"), "{answer}");
}

/// Nothing of a stop is read but its head: it is carried out though its body never comes, or is longer than any may be.
#[test]
fn a_stop_counts_whatever_becomes_of_its_body() {
    let daemon = Daemon::start(STARTING_PLATE);
    for length in [9, 20_000_000] {
        assert_eq!(daemon.post("/v1/touch", LONG_TOUCH).0, 200);
        daemon.wait_for(|state| state["device"]["state"] == "running");
        let mut stream = connect(&daemon);
        let head = format!("POST /v1/stop HTTP/1.1\r\nHost: localhost\r\nContent-Length: {length}\r\n\r\n");
        stream.write_all(head.as_bytes()).unwrap();
        let mut answer = [0; 15];
        stream.read_exact(&mut answer).unwrap();
        assert_eq!(&answer, b"HTTP/1.1 200 OK", "{length}");
        assert!(daemon.state()["plan"].is_null());
    }
}

/// What is driven is shown, and what it leaves in the panel is counted, whoever listens.
#[test]
fn a_touch_counts_though_its_sender_hangs_up() {
    let daemon = Daemon::start(STARTING_PLATE);
    for wait_ms in [0, 1, 3, 10] {
        let mut stream = connect(&daemon);
        stream.write_all(post("/v1/touch", LONG_TOUCH).as_bytes()).unwrap();
        std::thread::sleep(Duration::from_millis(wait_ms));
        drop(stream);
        let state = daemon.wait_for(|state| state["device"]["state"] == "running" && !state["plan"].is_null());
        assert!(state["plan_id"].as_u64() > Some(0), "{state}");
        daemon.post("/v1/stop", "");
    }
}

#[test]
fn messages_of_a_page_that_reads_nothing_are_still_read() {
    let daemon = Daemon::start(STARTING_PLATE);
    let (mut socket, _) =
        tungstenite::connect(format!("{}/v1/live?send=state,field", daemon.url.replace("http", "ws"))).unwrap();
    let touch = |x_px: f64| json!({"type": "touch", "touches": [{"id": 1, "x_px": x_px, "y_px": 500.0}]}).to_string();
    socket.send(Message::text(touch(400.0))).unwrap();
    daemon.wait_for(|state| state["device"]["state"] == "running");
    // More than the system keeps for a reader: 16 kB for each.
    for i in 0..300 {
        let body = json!({"x_px": 300 + i, "y_px": 600, "intensity_g": 0.1, "duration_ms": 5000}).to_string();
        assert_eq!(daemon.post("/v1/touch", &body).0, 200);
    }
    socket.send(Message::text(r#"{"type": "stop"}"#)).unwrap();
    daemon.wait_for(|state| state["device"]["state"] != "running" && state["plan"].is_null());
}

/// The next message of a client is read 60 ms after one of 240 kB, on whichever of its sockets: 80 of them are 5 s. No socket that is gone keeps one of
/// the 64 places for so long.
#[test]
fn a_page_that_hangs_up_after_a_long_message_keeps_nothing() {
    let daemon = Daemon::start(STARTING_PLATE);
    let url = format!("{}/v1/live?send=", daemon.url.replace("http", "ws"));
    let long = format!(r#"{{"type": "{}"}}"#, "x".repeat(240_000));
    for number in 0..80 {
        let (mut socket, _) = tungstenite::connect(&url).unwrap_or_else(|error| panic!("socket {number}: {error}"));
        socket.send(Message::text(long.clone())).unwrap();
        socket.flush().unwrap();
    }
}

/// Half a request's headers, or half a body, hold up neither the device's stop nor the end, though they may come for as long as they like: the
/// device is stopped while they are waited for, and that is not for long.
#[test]
fn a_half_sent_request_does_not_keep_the_daemon() {
    let far = Duration::from_secs(3600);
    for goodbye in [far, Limits::default().goodbye] {
        let (mut app, line) = plate(REAL_TIME);
        app.limits = Limits { headers: far, body: far, goodbye, ..app.limits };
        let (mut served, url) = Served::at_a_port(&Arc::new(app), None);
        let daemon = Daemon { url, sim: line.sim(), background: None };
        daemon.wait_for(|state| state["device"]["connected"] == true);
        assert_eq!(daemon.post("/v1/touch", LONG_TOUCH).0, 200);
        let mut half_head = connect(&daemon);
        half_head.write_all(b"POST /v1/touch HTTP/1.1\r\nHost: local").unwrap();
        let mut half_body = connect(&daemon);
        half_body.write_all(b"POST /v1/touch HTTP/1.1\r\nHost: localhost\r\nContent-Length: 100\r\n\r\n{").unwrap();
        daemon.wait_for(|state| state["device"]["state"] == "running");
        let since = line.mark(|_| {});
        served.ends();
        // Some 30 requests a second.
        line.is_stopped_within(since, 100);
        line.goes_off();
        if goodbye == far {
            drop((half_head, half_body));
            drop(served);
        } else {
            drop(served);
            drop((half_head, half_body));
        }
    }
}

/// Where all places are taken there is still one for a stop.
#[test]
fn a_stop_gets_through_a_crowd() {
    let daemon = Daemon::start(STARTING_PLATE);
    assert_eq!(daemon.post("/v1/touch", LONG_TOUCH).0, 200);
    daemon.wait_for(|state| state["device"]["state"] == "running");
    let mut crowd: Vec<_> = (0..260).map(|_| connect(&daemon)).collect();
    for one in &mut crowd {
        one.write_all(b"GET /v1/state HTTP/1.1\r\nHost: local").unwrap();
    }
    let refused = send_and_listen(&daemon, &post("/v1/touch", LONG_TOUCH));
    assert!(refused.starts_with("HTTP/1.1 503") && refused.to_lowercase().contains("retry-after: 1"), "{refused}");
    let stopped = send_and_listen(&daemon, &post("/v1/stop", ""));
    assert!(stopped.starts_with("HTTP/1.1 200"), "{stopped}");
    drop(crowd);
    daemon.wait_for(|state| state["device"]["state"] != "running" && state["plan"].is_null());
}
