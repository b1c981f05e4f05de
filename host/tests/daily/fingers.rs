//! Fingers on a page: taps are felt, effects begin once.

use crate::line::{CALM, Ear};
use crate::support::Daemon;
use crate::support::described::described;
use era::device::timing::REAL_TIME;
use era::scene::STARTING_PLATE;
use era_shared::protocol::Request;
use serde_json::{Value, json};
use std::net::TcpStream;
use std::time::{Duration, Instant};
use tungstenite::stream::MaybeTlsStream;
use tungstenite::{Message, WebSocket};

pub type Socket = WebSocket<MaybeTlsStream<TcpStream>>;

pub fn live(daemon: &Daemon, query: &str) -> Socket {
    let (socket, _) = tungstenite::connect(format!("{}/v1/live{query}", daemon.url.replace("http", "ws"))).unwrap();
    if let MaybeTlsStream::Plain(stream) = socket.get_ref() {
        stream.set_read_timeout(Some(Duration::from_secs(30))).unwrap();
    }
    socket
}

pub fn say(socket: &mut Socket, message: &Value) {
    socket.send(Message::text(message.to_string())).unwrap();
}

fn touch(touches: &Value) -> Value {
    json!({"type": "touch", "touches": touches, "intensity_g": 0.1})
}

/// The next message of a kind; an error is none, nor is that a plan is over.
pub fn next(socket: &mut Socket, kind: &str) -> Value {
    let begun = Instant::now();
    loop {
        // Questions for a sign of life end a wait for nothing.
        assert!(begun.elapsed() < Duration::from_secs(30), "no {kind} has come");
        if let Message::Text(text) = socket.read().unwrap() {
            let message: Value = serde_json::from_str(&text).unwrap();
            assert_ne!(message["type"], "error", "{message}");
            if message["type"] == kind && !(kind == "plan" && message["plan"].is_null()) {
                return message;
            }
        }
    }
}

#[test]
fn every_tap_vibrates() {
    let (daemon, _line) = crate::line::daemon(CALM);
    let mut socket = live(&daemon, "?send=plan");
    for i in 0..20 {
        say(&mut socket, &touch(&json!([{"id": 1, "x_px": 100 + 80 * i, "y_px": 500.0}])));
        say(&mut socket, &touch(&json!([])));
    }
    for i in 0..20 {
        let plan = next(&mut socket, "plan");
        assert_eq!(plan["touches"][0]["x_px"], f64::from(100 + 80 * i), "tap {i}: {}", plan["touches"]);
        assert!(plan.get("field").is_none(), "nobody asked for the field");
    }
    // The last one is driven for its least time, and then it is lifted.
    daemon.wait_for(|state| state["device"]["state"] == "armed" && state["plan"].is_null());
}

/// However short a finger was down: the board is not told of its end before a tap's least time is over.
#[test]
fn a_tap_vibrates_for_its_least_time() {
    let (daemon, line) = crate::line::daemon(REAL_TIME);
    let mut socket = live(&daemon, "?send=plan");
    say(&mut socket, &touch(&json!([{"id": 1, "x_px": 900, "y_px": 500.0}])));
    say(&mut socket, &touch(&json!([])));
    next(&mut socket, "plan");
    let drives = |ear: &Ear, is_on: bool| {
        let mut asked = ear.asked.iter().zip(&ear.at);
        asked
            .find(|(request, _)| matches!(request, Request::SetDrives { drives } if drives.is_empty() != is_on))
            .map(|it| *it.1)
    };
    let ear = line.wait_for(|ear| drives(ear, false).is_some());
    let took = drives(&ear, false).unwrap() - drives(&ear, true).unwrap();
    assert!(took >= Duration::from_millis(400), "{took:?}");
}

/// When the line took what drives.
fn driven_at(ear: &Ear) -> Vec<Instant> {
    let drives = |request: &Request| matches!(request, Request::SetDrives { drives } if !drives.is_empty());
    ear.asked.iter().zip(&ear.at).filter(|(request, _)| drives(request)).map(|(_, at)| *at).collect()
}

/// Taps that come faster than they can be felt, of one finger and of one beside another that stays: each has the panel to itself for a
/// while.
#[test]
fn taps_that_follow_each_other_are_all_felt() {
    for stays in [json!([]), json!([{"id": 7, "x_px": 100, "y_px": 900.0}])] {
        let (daemon, line) = crate::line::daemon(CALM);
        let mut socket = live(&daemon, "?send=plan");
        let mut with = stays.as_array().unwrap().clone();
        if !with.is_empty() {
            say(&mut socket, &touch(&stays));
            next(&mut socket, "plan");
        }
        let before = driven_at(&line.ear()).len();
        for i in 0..5 {
            with.push(json!({"id": 1, "x_px": f64::from(300 + 200 * i), "y_px": 500.0}));
            say(&mut socket, &touch(&json!(with)));
            with.pop();
            say(&mut socket, &touch(&stays));
        }
        for i in 0..5 {
            while next(&mut socket, "plan")["touches"].as_array().unwrap().last().unwrap()["x_px"]
                != f64::from(300 + 200 * i)
            {}
        }
        let at = driven_at(&line.wait_for(|ear| driven_at(ear).len() >= before + 5));
        let apart: Vec<_> = at[before..].windows(2).map(|pair| pair[1] - pair[0]).collect();
        assert!(apart.iter().all(|apart| *apart >= Duration::from_millis(40)), "{apart:?}");
    }
}

#[test]
fn an_effect_begins_once_however_its_finger_moves() {
    let daemon = Daemon::start(STARTING_PLATE);
    let mut socket = live(&daemon, "?send=plan");
    let at = |id: u32, x_px: f64| json!({"id": id, "x_px": x_px, "y_px": 500.0, "effect": "click"});
    say(&mut socket, &touch(&json!([at(1, 400.0)])));
    let first = next(&mut socket, "plan");
    assert_eq!(first["effect"]["name"], "click");
    for i in 1..10 {
        say(&mut socket, &touch(&json!([at(1, 400.0 + f64::from(i))])));
        std::thread::sleep(Duration::from_millis(5));
    }
    // A second finger is a second click, of which the next plan tells.
    say(&mut socket, &touch(&json!([at(1, 410.0), at(2, 1500.0)])));
    let second = next(&mut socket, "plan");
    assert_eq!(second["touches"].as_array().unwrap().len(), 2, "{}", second["touches"]);
    // So is the same one when it comes again while the first stays, ...
    say(&mut socket, &touch(&json!([at(1, 410.0)])));
    std::thread::sleep(Duration::from_millis(300));
    say(&mut socket, &touch(&json!([at(1, 410.0), at(2, 1400.0)])));
    let again = next(&mut socket, "plan");
    assert_eq!(again["touches"][1]["x_px"], 1400.0, "{}", again["touches"]);
    // ... and the first one after it was lifted.
    say(&mut socket, &touch(&json!([])));
    say(&mut socket, &touch(&json!([at(1, 700.0)])));
    let third = next(&mut socket, "plan");
    assert_eq!(third["touches"][0]["x_px"], 700.0, "{}", third["touches"]);
}

#[test]
fn the_finger_that_is_wrong_is_named() {
    let daemon = Daemon::start(STARTING_PLATE);
    let mut socket = live(&daemon, "?send=");
    say(&mut socket, &touch(&json!([{"id": 1, "x_px": 10, "y_px": 10}, {"id": 2, "x_px": 5000, "y_px": 10}])));
    // Questions for a sign of life may come before it.
    let text = loop {
        if let Message::Text(text) = socket.read().unwrap() {
            break text;
        }
    };
    let message: Value = serde_json::from_str(&text).unwrap();
    let problem = &message["problem"];
    assert_eq!((&problem["field"], &problem["value"]), (&json!("touches[1].x_px"), &json!(5000.0)), "{message}");
    assert_eq!(problem["finger"], 2, "{message}");
    let detail = problem["detail"].as_str().unwrap();
    assert!(detail.starts_with("finger 2: touches[1].x_px is 5000"), "{message}");
}

#[test]
fn a_finger_in_a_cutout_is_named() {
    let daemon = Daemon::start(include_str!("../../../examples/scenes/camera.toml"));
    let mut socket = live(&daemon, "?send=");
    say(&mut socket, &touch(&json!([{"id": 7, "x_px": 10, "y_px": 10}, {"id": 9, "x_px": 960, "y_px": 122}])));
    let text = loop {
        if let Message::Text(text) = socket.read().unwrap() {
            break text;
        }
    };
    let message: Value = serde_json::from_str(&text).unwrap();
    let problem = &message["problem"];
    assert_eq!(problem["type"], "urn:era:problem:in-cutout", "{message}");
    assert_eq!((&problem["finger"], &problem["field"]), (&json!(9), &json!("touches[1]")), "{message}");
    assert!(problem["detail"].as_str().unwrap().starts_with("finger 9: touches[1]: "), "{message}");
}

/// Lifted and back while another finger's click is on its way: it clicks anew.
#[test]
fn a_finger_that_comes_again_at_once_plays_its_effect_again() {
    let daemon = Daemon::start(STARTING_PLATE);
    let mut socket = live(&daemon, "?send=plan");
    let at = |id: u32, x_px: f64| json!({"id": id, "x_px": x_px, "y_px": 500.0, "effect": "click"});
    say(&mut socket, &touch(&json!([at(1, 400.0), at(2, 1500.0)])));
    next(&mut socket, "plan");
    for i in 0..5 {
        // The third finger's click takes some ms; the second one goes and comes meanwhile.
        let (x_px, third) = (1400.0 + f64::from(i), at(10 + i, 900.0));
        say(&mut socket, &touch(&json!([at(1, 400.0), at(2, 1500.0), third])));
        say(&mut socket, &touch(&json!([at(1, 400.0), third])));
        say(&mut socket, &touch(&json!([at(1, 400.0), at(2, x_px), third])));
        loop {
            let plan = next(&mut socket, "plan");
            if plan["touches"][1]["x_px"] == x_px {
                break;
            }
        }
    }
}

#[test]
fn a_socket_reports_only_what_it_is_asked_for() {
    let daemon = Daemon::start(STARTING_PLATE);
    let error = tungstenite::connect(format!("{}/v1/live?send=map", daemon.url.replace("http", "ws"))).unwrap_err();
    let tungstenite::Error::Http(answer) = error else { panic!("{error}") };
    let problem: Value = serde_json::from_slice(answer.body().as_ref().unwrap()).unwrap();
    assert_eq!((answer.status().as_u16(), &problem["field"]), (400, &json!("send")), "{problem}");
    // Maps go to those who name them; the rest to everybody who names nothing.
    let sockets =
        [("", ["scene", "state", "plan"], false), ("?send=scene,state,field", ["scene", "state", "plan"], true)];
    let open = sockets.map(|(query, kinds, has_map)| (live(&daemon, query), kinds, has_map));
    daemon.post("/v1/touch", r#"{"x_px": 300, "y_px": 900, "duration_ms": 9000}"#);
    // One that comes later is told of the plan at once, and as the others are.
    let late = sockets.map(|(query, kinds, has_map)| (live(&daemon, query), kinds, has_map));
    for (mut socket, kinds, has_map) in open.into_iter().chain(late) {
        let socket = &mut socket;
        let told = kinds.map(|kind| next(socket, kind));
        assert_eq!(told[2]["field"]["peak_g"].is_array(), has_map);
        assert_eq!(told[2].get("field").is_some(), has_map);
        assert!(told[2]["plan"]["drives"].is_array());
        // What it says wrong it is told in any case.
        say(socket, &json!({"type": "dance"}));
        while !matches!(socket.read().unwrap(), Message::Text(text) if text.contains("\"type\":\"error\"")) {}
    }
}

/// A page that stops and touches again at once, in one write: the touch comes after the stop, is driven, and stays shown.
#[test]
fn a_touch_right_after_a_stop_is_driven() {
    let daemon = Daemon::start(STARTING_PLATE);
    let mut socket = live(&daemon, "?send=plan");
    for i in 0..20 {
        let x_px = f64::from(200 + 20 * i);
        socket.write(Message::text(json!({"type": "stop"}).to_string())).unwrap();
        socket.write(Message::text(touch(&json!([{"id": 1, "x_px": x_px, "y_px": 500.0}])).to_string())).unwrap();
        socket.flush().unwrap();
        while next(&mut socket, "plan")["touches"][0]["x_px"] != x_px {}
        daemon.wait_for(|state| state["device"]["state"] == "running");
        assert_eq!(daemon.state()["touches"][0]["x_px"], x_px);
        say(&mut socket, &touch(&json!([])));
    }
}

/// Who is told of plans alone is told of their ends, too: by themselves, by a stop, by a finger that is lifted.
#[test]
fn a_page_is_told_that_a_plan_is_over() {
    let daemon = Daemon::start(STARTING_PLATE);
    let mut socket = live(&daemon, "?send=plan");
    let mut other = live(&daemon, "?send=");
    let begun = Instant::now();
    let mut told = || loop {
        // Questions for a sign of life end a wait for nothing.
        assert!(begun.elapsed() < Duration::from_secs(30), "not told");
        if let Message::Text(text) = socket.read().unwrap() {
            let message: Value = serde_json::from_str(&text).unwrap();
            assert_eq!(message["type"], "plan", "{message}");
            assert!(described().schema("/components/schemas/LiveOut").is_valid(&message), "{message}");
            break (message["plan"].is_object(), message["touches"].as_array().unwrap().len());
        }
    };
    daemon.post("/v1/touch", r#"{"x_px": 300, "y_px": 900, "duration_ms": 100}"#);
    assert_eq!((told(), told()), ((true, 1), (false, 0)));
    daemon.post("/v1/touch", r#"{"x_px": 300, "y_px": 900, "duration_ms": 9000}"#);
    assert_eq!(told(), (true, 1));
    daemon.post("/v1/stop", "");
    assert_eq!(told(), (false, 0));
    say(&mut other, &touch(&json!([{"id": 1, "x_px": 900, "y_px": 500.0}])));
    assert_eq!(told(), (true, 1));
    say(&mut other, &touch(&json!([])));
    assert_eq!(told(), (false, 0));
}

/// What is told to be wrong next.
fn next_error(socket: &mut Socket) -> Value {
    loop {
        if let Message::Text(text) = socket.read().unwrap() {
            let message: Value = serde_json::from_str(&text).unwrap();
            if message["type"] == "error" {
                return message;
            }
        }
    }
}

/// Whatever a page says that cannot be done is answered, and it can go on.
#[test]
fn what_a_page_cannot_say_is_answered() {
    let daemon = Daemon::start(STARTING_PLATE);
    let mut socket = live(&daemon, "?send=plan");
    let twice = json!([{"id": 3, "x_px": 400, "y_px": 500}, {"id": 4, "x_px": 1, "y_px": 1}, {"id": 3, "x_px": 900, "y_px": 500}]);
    let long = json!({"type": "touch", "touches": [], "padding": "x".repeat(17_000)}).to_string();
    let wrong = [
        (Message::binary(r#"{"type": "stop"}"#), "binary"),
        (Message::text(long), "may have at most 16384"),
        (Message::text(touch(&twice).to_string()), "touches[2].id is 3"),
    ];
    for (message, wanted) in wrong {
        socket.send(message).unwrap();
        let told = next_error(&mut socket);
        assert!(told["problem"]["detail"].as_str().is_some_and(|detail| detail.contains(wanted)), "{told}");
    }
    say(&mut socket, &touch(&json!([{"id": 3, "x_px": 400, "y_px": 500}])));
    next(&mut socket, "plan");
}

/// What cannot be used but says that it is a stop is one: what else is wrong with it is told besides.
#[test]
fn a_stop_that_says_too_much_is_one() {
    let daemon = Daemon::start(STARTING_PLATE);
    let mut socket = live(&daemon, "?send=plan");
    let padding = "x".repeat(17_000);
    for message in [
        Message::text(r#"{"type": "stop", "reason": "x"}"#),
        Message::text(r#"{"type": "stop", "touches": [1]}"#),
        Message::text(r#"{"intensity_g": 1e400, "type": "stop"}"#),
        Message::text(format!(r#"{{"type": "stop", "padding": "{padding}"}}"#)),
        Message::binary(r#"{"type": "stop"}"#),
    ] {
        let (status, _, plan) = daemon.post("/v1/touch", r#"{"x_px": 300, "y_px": 900, "duration_ms": 9000}"#);
        assert_eq!(status, 200, "{plan}");
        socket.send(message).unwrap();
        let told = next_error(&mut socket);
        assert_eq!(told["problem"]["type"], "urn:era:problem:bad-body", "{told}");
        daemon.wait_for(|state| state["plan"].is_null() && state["device"]["state"] == "safe");
    }
}
