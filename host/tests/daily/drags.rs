//! Fingers that stay down for longer than the board drives without a rest, or than its credit lasts.

use crate::fingers::{live, say};
use crate::support::Daemon;
use crate::support::timed_board::TimedBoard;
use era::device::session::policy::SessionPolicy;
use era::scene::STARTING_PLATE;
use era_shared::protocol::{ChannelDrive, Reply, Request};
use serde_json::{Value, json};
use std::net::TcpStream;
use std::time::{Duration, Instant};
use tungstenite::stream::MaybeTlsStream;
use tungstenite::{Message, WebSocket};

/// Longer than the board's longest burst.
const LONG: Duration = Duration::from_secs(13);
/// A finger's moves: 30 a second.
const MOVE: Duration = Duration::from_millis(33);

fn finger(x_px: f64) -> Value {
    json!({"type": "touch", "touches": [{"id": 1, "x_px": x_px, "y_px": 640.0}], "intensity_g": 0.3})
}

fn set_read_timeout(socket: &WebSocket<MaybeTlsStream<TcpStream>>, timeout: Duration) {
    if let MaybeTlsStream::Plain(stream) = socket.get_ref() {
        stream.set_read_timeout(Some(timeout)).unwrap();
    }
}

/// What has come on a socket until now.
fn read_all(socket: &mut WebSocket<MaybeTlsStream<TcpStream>>) -> Vec<Value> {
    let mut all = Vec::new();
    set_read_timeout(socket, Duration::from_millis(1));
    while let Ok(message) = socket.read() {
        if let Message::Text(text) = message {
            all.push(serde_json::from_str(&text).unwrap());
        }
    }
    all
}

fn rests(message: &Value) -> bool {
    message["plan"]["thinned"] == json!({"part": 0.0, "reason": "burst"})
}

/// Moves a finger, or not, for longer than a burst; what the daemon said meanwhile.
fn drag(daemon: &Daemon, moves: bool) -> Vec<Value> {
    let mut socket = live(daemon, "?send=plan");
    let (begun, mut said) = (Instant::now(), Vec::new());
    say(&mut socket, &finger(960.0));
    while begun.elapsed() < LONG {
        std::thread::sleep(MOVE);
        if moves {
            say(&mut socket, &finger(960.0 + 300.0 * begun.elapsed().as_secs_f64().sin()));
        }
        said.extend(read_all(&mut socket));
    }
    let state = daemon.wait_for(|state| state["device"]["state"] == "running");
    assert!(state["plan"]["thinned"].is_null() && state["touches"][0]["id"] == 1, "{state}");
    say(&mut socket, &json!({"type": "touch", "touches": []}));
    daemon.wait_for(|state| state["device"]["state"] != "running" && state["plan"].is_null());
    said
}

#[test]
fn a_long_drag_is_interrupted_by_a_rest_and_not_by_the_board() {
    let daemon = Daemon::start(STARTING_PLATE);
    let said = drag(&daemon, true);
    let error = said.iter().find(|message| message["type"] != "plan");
    assert!(error.is_none(), "{error:?}");
    assert_eq!(said.iter().filter(|message| rests(message)).count(), 1, "one rest in 13 s");
}

#[test]
fn a_finger_that_rests_is_felt_for_as_long_as_it_is_down() {
    let daemon = Daemon::start(STARTING_PLATE);
    let said = drag(&daemon, false);
    let kinds: Vec<bool> = said.iter().map(rests).collect();
    assert_eq!(kinds, [false, true, false], "{said:?}");
}

/// A finger that rests and is to feel nothing is one plan for as long as it is down, whose end nothing but its lift brings.
#[test]
fn a_finger_that_rests_and_feels_nothing_is_one_plan() {
    let daemon = Daemon::start(STARTING_PLATE);
    let mut socket = live(&daemon, "?send=plan");
    let (begun, mut said) = (Instant::now(), Vec::new());
    say(&mut socket, &json!({"type": "touch", "touches": [{"id": 1, "x_px": 960.0, "y_px": 640.0}], "intensity_g": 0}));
    while begun.elapsed() < LONG {
        std::thread::sleep(MOVE);
        said.extend(read_all(&mut socket));
    }
    let state = daemon.wait_for(|state| state["plan"].is_object());
    assert_eq!(state["touches"][0]["id"], 1, "{state}");
    assert_eq!(said.len(), 1, "{said:?}");
    assert_ne!(state["device"]["state"], "running", "the board drives nothing");
    say(&mut socket, &json!({"type": "touch", "touches": []}));
    daemon.wait_for(|state| state["plan"].is_null());
}

/// Uses up what both channels have, but for so much.
fn spend(board: &TimedBoard, leave_ms: u32) {
    // Its time is the test's alone meanwhile, however busy the computer is; it has seen that its rails are down.
    board.lock().slower = u64::MAX;
    board.lock().pass(10_000);
    let mut client = board.client();
    let mut ask = |request: &Request| client.request(request).unwrap();
    let drive = |channel| ChannelDrive {
        channel,
        frequency_millihertz: 150_000,
        pulse_width_ppm: 900_000,
        phase_microturns: 0,
        voltage_millivolts: 2_000_000,
    };
    let drives: heapless::Vec<_, { era_shared::MAX_CHANNELS }> = [drive(0), drive(1)].into_iter().collect();
    ask(&Request::Hello { host_min: 1, host_current: 3 });
    ask(&Request::ArmWith { deadman_ms: None, burst_ms: Some(10_000) });
    board.lock().pass(100_000);
    'spent: loop {
        ask(&Request::SetDrives { drives: drives.clone() });
        for _ in 0..95 {
            board.lock().pass(100_000);
            let Reply::Credit(credit) = ask(&Request::Credit) else { panic!("no credit") };
            if credit.channels.iter().all(|channel| channel.left_ms <= leave_ms) {
                break 'spent;
            }
        }
        ask(&Request::SetDrives { drives: heapless::Vec::new() });
        board.lock().pass(150_000);
        ask(&Request::KeepAlive);
    }
    ask(&Request::Disarm);
    board.lock().pass(100_000);
    board.lock().slower = 1;
}

#[test]
fn a_strong_drag_on_little_credit_is_thinned_out_and_never_ends() {
    let board = TimedBoard::new();
    spend(&board, 3000);
    let daemon = Daemon::at(STARTING_PLATE, &board.behind_a_terminal(), SessionPolicy::default());
    daemon.wait_for(|state| state["device"]["supply"]["credit_s"][0].as_f64().is_some());
    // Twice as long as the credit would last.
    let begun = Instant::now();
    let mut least = f64::INFINITY;
    while begun.elapsed() < Duration::from_secs(8) {
        let body = json!({"x_px": 960, "y_px": 640, "intensity_g": 1000, "duration_ms": 2000}).to_string();
        let (status, _, answer) = daemon.post("/v1/touch", &body);
        assert_eq!(status, 200, "{answer}");
        let (part, reason) = (answer["thinned"]["part"].as_f64(), &answer["thinned"]["reason"]);
        assert!(part > Some(0.2) && part < Some(0.95) && reason == "credit", "{}", answer["thinned"]);
        // Of what limits the plan itself it says the same as ever.
        assert!(!answer["limits"].to_string().contains("still-moving"), "{}", answer["limits"]);
        least = part.map_or(least, |part| least.min(part));
        std::thread::sleep(Duration::from_millis(200));
        let state = daemon.state();
        assert_eq!(state["device"]["state"], "running", "{state}");
        let left = state["device"]["supply"]["credit_s"].as_array().unwrap();
        assert!(left.iter().all(|left| left.as_f64() > Some(0.5)), "{left:?}");
    }
    println!("thinned to {least}");
}
