//! Whatever is wrong with one finger of a message, the others are driven, and above all those that are lifted are lifted.

use crate::fingers::{Socket, live, next, say};
use crate::line::{CALM, daemon};
use crate::support::Daemon;
use crate::support::described::described;
use serde_json::{Value, json};
use std::time::{Duration, Instant};
use tungstenite::Message;

/// A finger that is wrong, as text, with what its error names: its field, and whether its number can be told.
struct Wrong {
    text: &'static str,
    field: &'static str,
    kind: &'static str,
    has_id: bool,
}

/// All that can be wrong with the second finger of a message; the scene is the example plate of 1920 x 1280 px, or one with a hole.
const WRONG: [Wrong; 27] = {
    const fn wrong(text: &'static str, field: &'static str, kind: &'static str, has_id: bool) -> Wrong {
        Wrong { text, field, kind, has_id }
    }
    [
        // More than 1 % of the side outside the screen, on each side.
        wrong(r#"{"id": 2, "x_px": 1940.0, "y_px": 500}"#, "touches[1].x_px", "out-of-range", true),
        wrong(r#"{"id": 2, "x_px": -19.3, "y_px": 500}"#, "touches[1].x_px", "out-of-range", true),
        wrong(r#"{"id": 2, "x_px": 500, "y_px": 1293}"#, "touches[1].y_px", "out-of-range", true),
        wrong(r#"{"id": 2, "x_px": 500, "y_px": -13}"#, "touches[1].y_px", "out-of-range", true),
        wrong(r#"{"id": 2, "x_px": 1e300, "y_px": 500}"#, "touches[1].x_px", "out-of-range", true),
        // No number, or none that there is.
        wrong(r#"{"id": 2, "x_px": 1e999, "y_px": 500}"#, "touches[1].x_px", "bad-body", true),
        wrong(r#"{"id": 2, "x_px": NaN, "y_px": 500}"#, "touches[1].x_px", "bad-body", true),
        wrong(r#"{"id": 2, "x_px": 500, "y_px": -Infinity}"#, "touches[1].y_px", "bad-body", true),
        wrong(r#"{"id": 2, "x_px": null, "y_px": 500}"#, "touches[1].x_px", "bad-body", true),
        wrong(r#"{"id": 2, "x_px": "500", "y_px": 500}"#, "touches[1].x_px", "bad-body", true),
        wrong(r#"{"id": 2, "x_px": [5], "y_px": 500}"#, "touches[1].x_px[0]", "bad-body", true),
        wrong(r#"{"id": 2, "x_px": true, "y_px": 500}"#, "touches[1].x_px", "bad-body", true),
        // Keys that are missing, unknown or there twice.
        wrong(r#"{"id": 2, "y_px": 500}"#, "touches[1].x_px", "bad-body", true),
        wrong(r#"{"id": 2, "x_px": 500}"#, "touches[1].y_px", "bad-body", true),
        wrong(r#"{"id": 2, "x_px": 500, "y_px": 500, "pressure": 1}"#, "touches[1].pressure", "bad-body", true),
        wrong(r#"{"id": 2, "x_px": 500, "y_px": 500, "x_px": 501}"#, "touches[1].x_px", "bad-body", true),
        // What it should feel like.
        wrong(
            r#"{"id": 2, "x_px": 500, "y_px": 500, "intensity_g": -1}"#,
            "touches[1].intensity_g",
            "out-of-range",
            true,
        ),
        wrong(
            r#"{"id": 2, "x_px": 500, "y_px": 500, "intensity_g": 1001}"#,
            "touches[1].intensity_g",
            "out-of-range",
            true,
        ),
        wrong(r#"{"id": 2, "x_px": 500, "y_px": 500, "intensity_g": "x"}"#, "touches[1].intensity_g", "bad-body", true),
        wrong(r#"{"id": 2, "x_px": 500, "y_px": 500, "effect": "clack"}"#, "touches[1].effect", "bad-body", true),
        wrong(r#"{"id": 2, "x_px": 500, "y_px": 500, "effect": 5}"#, "touches[1].effect", "bad-body", true),
        // Its number.
        wrong(r#"{"id": "b", "x_px": 500, "y_px": 500}"#, "touches[1].id", "bad-body", false),
        wrong(r#"{"id": 1e999, "x_px": 500, "y_px": 500}"#, "touches[1].id", "bad-body", false),
        wrong(r#"{"id": 99999999999999999999, "x_px": 500, "y_px": 500}"#, "touches[1].id", "bad-body", false),
        // No object.
        wrong("null", "touches[1]", "bad-body", false),
        wrong("[2, 500, 500]", "touches[1]", "bad-body", false),
        // The number of the finger before it.
        wrong(r#"{"id": 1, "x_px": 900, "y_px": 500}"#, "touches[1].id", "out-of-range", true),
    ]
};

/// The next message that is an error, or a plan with the fingers that it is for, whichever comes first.
fn next_of(socket: &mut Socket, kind: &str) -> Value {
    let begun = Instant::now();
    loop {
        assert!(begun.elapsed() < Duration::from_secs(30), "no {kind} has come");
        if let Message::Text(text) = socket.read().unwrap() {
            let message: Value = serde_json::from_str(&text).unwrap();
            assert!(described().schema("/components/schemas/LiveOut").is_valid(&message), "{message}");
            if message["type"] == kind && !(kind == "plan" && message["plan"].is_null()) {
                return message;
            }
        }
    }
}

fn ids(plan: &Value) -> Vec<i64> {
    plan["touches"].as_array().unwrap().iter().map(|touch| touch["id"].as_i64().unwrap()).collect()
}

/// Fingers 2 and 3 are down; in one message 3 is lifted, 2 is wrong and 1 is right: 1 is driven alone, and 2, whose place nobody knows, is lifted too.
#[test]
fn one_wrong_finger_takes_nothing_from_the_others() {
    let (daemon, _line) = daemon(CALM);
    let mut socket = live(&daemon, "?send=plan");
    for Wrong { text, field, kind, has_id } in WRONG {
        let two = json!([{"id": 2, "x_px": 400, "y_px": 500}, {"id": 3, "x_px": 1500, "y_px": 900}]);
        say(&mut socket, &json!({"type": "touch", "touches": two, "intensity_g": 0.1}));
        // The one before may be told once more, as drives that are held are renewed.
        while ids(&next(&mut socket, "plan")) != [2, 3] {}
        let message = format!(
            r#"{{"type": "touch", "touches": [{{"id": 1, "x_px": 960, "y_px": 640}}, {text}], "intensity_g": 0.1}}"#
        );
        socket.send(Message::text(message)).unwrap();
        let problem = next_of(&mut socket, "error")["problem"].clone();
        assert_eq!(problem["field"], field, "{text}: {problem}");
        assert_eq!(problem["type"], format!("urn:era:problem:{kind}"), "{text}: {problem}");
        assert_eq!(problem["finger"].is_i64(), has_id, "{text}: {problem}");
        // So may these two.
        while ids(&next_of(&mut socket, "plan")) != [1] {}
        daemon.wait_for(|state| state["touches"].as_array().is_some_and(|touches| touches.len() == 1));
        say(&mut socket, &json!({"type": "touch", "touches": []}));
        // 400 ms after it came down: none of them vibrates.
        daemon.wait_for(|state| state["plan"].is_null() && state["device"]["state"] == "armed");
    }
}

/// An effect of one finger's own that does not go with what the message says of all: that finger is told, and the other one is driven.
#[test]
fn an_effect_that_does_not_go_with_the_message_is_its_fingers_own_mistake() {
    let (daemon, _line) = daemon(CALM);
    let mut socket = live(&daemon, "?send=plan");
    for (effect, field) in [("click", "duration_ms"), ("double_click", "duration_ms")] {
        let finger = json!({"id": 1, "x_px": 960, "y_px": 640});
        let wrong = json!({"id": 2, "x_px": 400, "y_px": 500, "effect": effect});
        let all = json!({"type": "touch", "touches": [finger, wrong], "duration_ms": 9000, "intensity_g": 0.1});
        say(&mut socket, &all);
        let problem = next_of(&mut socket, "error")["problem"].clone();
        assert_eq!((&problem["field"], &problem["finger"]), (&json!(field), &json!(2)), "{effect}: {problem}");
        assert_eq!(ids(&next_of(&mut socket, "plan")), [1], "{effect}");
        say(&mut socket, &json!({"type": "touch", "touches": []}));
        daemon.wait_for(|state| state["plan"].is_null() && state["device"]["state"] == "armed");
    }
    // Where no finger is left the message is refused as one.
    let alone = json!({"id": 2, "x_px": 400, "y_px": 500, "effect": "click"});
    say(&mut socket, &json!({"type": "touch", "touches": [alone], "duration_ms": 9000}));
    assert_eq!(next_of(&mut socket, "error")["problem"]["field"], "duration_ms");
}

/// The only finger moves outside after it was down, or in a cut-out, or its place is no number: its vibration ends.
#[test]
fn a_finger_that_goes_wrong_does_not_vibrate_on() {
    let scene = include_str!("../../../examples/scenes/camera.toml");
    let daemon = Daemon::start(scene);
    let mut socket = live(&daemon, "?send=plan");
    for wrong in [
        r#"{"id": 7, "x_px": 5000, "y_px": 500}"#,
        r#"{"id": 7, "x_px": 960, "y_px": 122}"#,
        r#"{"id": 7, "x_px": 1e999, "y_px": 500}"#,
        r#"{"id": "7", "x_px": 500, "y_px": 500}"#,
    ] {
        let good = json!([{"id": 7, "x_px": 500, "y_px": 500}]);
        say(&mut socket, &json!({"type": "touch", "touches": good, "intensity_g": 0.05}));
        assert_eq!(ids(&next(&mut socket, "plan")), [7], "{wrong}");
        let begun = Instant::now();
        socket
            .send(Message::text(format!(r#"{{"type": "touch", "touches": [{wrong}], "intensity_g": 0.05}}"#)))
            .unwrap();
        next_of(&mut socket, "error");
        daemon.wait_for(|state| state["plan"].is_null() && state["device"]["state"] == "armed");
        // 10 s otherwise.
        assert!(begun.elapsed() < Duration::from_secs(8), "{wrong}: {:?}", begun.elapsed());
        // And again, beside one that stays.
        let two = json!([{"id": 7, "x_px": 500, "y_px": 500}, {"id": 8, "x_px": 1500, "y_px": 900}]);
        say(&mut socket, &json!({"type": "touch", "touches": two, "intensity_g": 0.05}));
        while ids(&next_of(&mut socket, "plan")) != [7, 8] {}
        let message = format!(
            r#"{{"type": "touch", "touches": [{wrong}, {{"id": 8, "x_px": 1500, "y_px": 900}}], "intensity_g": 0.05}}"#
        );
        socket.send(Message::text(message)).unwrap();
        next_of(&mut socket, "error");
        assert_eq!(ids(&next_of(&mut socket, "plan")), [8], "{wrong}");
        say(&mut socket, &json!({"type": "touch", "touches": []}));
        daemon.wait_for(|state| state["plan"].is_null());
    }
}

/// Within 1 % of the side a finger outside the screen counts as at the edge; a touch by POST does not.
#[test]
fn a_finger_just_outside_counts_as_at_the_edge() {
    let (daemon, _line) = daemon(CALM);
    let mut socket = live(&daemon, "?send=plan");
    for ([x_px, y_px], at) in [
        ([1924.5, 500.0], [1920.0, 500.0]),
        ([1939.2, 500.0], [1920.0, 500.0]),
        ([-19.2, 500.0], [0.0, 500.0]),
        ([500.0, 1292.8], [500.0, 1280.0]),
        ([500.0, -12.8], [500.0, 0.0]),
        ([1920.0, 1280.0], [1920.0, 1280.0]),
    ] {
        say(
            &mut socket,
            &json!({"type": "touch", "touches": [{"id": 1, "x_px": x_px, "y_px": y_px}], "intensity_g": 0.1}),
        );
        let plan = next(&mut socket, "plan");
        let touch = &plan["touches"][0];
        assert_eq!([touch["x_px"].as_f64().unwrap(), touch["y_px"].as_f64().unwrap()], at);
        say(&mut socket, &json!({"type": "touch", "touches": []}));
        if [x_px, y_px] != at {
            let (status, _, problem) = daemon.post("/v1/touch", &json!({"x_px": x_px, "y_px": y_px}).to_string());
            assert_eq!((status, &problem["type"]), (400, &json!("urn:era:problem:out-of-range")), "{problem}");
        }
        daemon.wait_for(|state| state["plan"].is_null());
    }
}

/// Of more fingers than are driven at once those that were down stay, wherever in the list they are; each of the others is told.
#[test]
fn an_eleventh_finger_is_refused_alone() {
    let (daemon, _line) = daemon(CALM);
    let mut socket = live(&daemon, "?send=plan");
    let finger = |id: i64| json!({"id": id, "x_px": 100 + 150 * id, "y_px": 600, "intensity_g": 0.02});
    let ten: Vec<Value> = (1..=10).map(finger).collect();
    say(&mut socket, &json!({"type": "touch", "touches": ten}));
    assert_eq!(ids(&next(&mut socket, "plan")).len(), 10);
    let eleven: Vec<Value> = (0..=9).map(finger).chain([finger(11)]).collect();
    say(&mut socket, &json!({"type": "touch", "touches": eleven}));
    let problem = next_of(&mut socket, "error")["problem"].clone();
    assert_eq!(
        (&problem["type"], &problem["finger"]),
        (&json!("urn:era:problem:touch-count"), &json!(11)),
        "{problem}"
    );
    assert_eq!(problem["field"], "touches[10]", "{problem}");
    assert_eq!(ids(&next_of(&mut socket, "plan")), (0..=9).collect::<Vec<i64>>());
}

/// What is wrong with the whole message is told, and the fingers that it leaves out are lifted all the same.
#[test]
fn lifts_of_a_message_that_is_wrong_count() {
    let (daemon, _line) = daemon(CALM);
    let mut socket = live(&daemon, "?send=plan");
    let one = r#"[{"id": 1, "x_px": 960, "y_px": 640}]"#;
    let padding = "x".repeat(17_000);
    for (rest, is_binary) in [
        (r#""intensity_g": "x""#.to_owned(), false),
        (r#""intensity_g": -1"#.to_owned(), false),
        (r#""intensity_g": 1e999"#.to_owned(), false),
        (r#""intensity_g": NaN"#.to_owned(), false),
        (r#""effect": "clack""#.to_owned(), false),
        (r#""effect": "click", "count": 3"#.to_owned(), false),
        (r#""duration_ms": 0"#.to_owned(), false),
        (r#""other": 3"#.to_owned(), false),
        (r#""type": "touch""#.to_owned(), false),
        (format!(r#""padding": "{padding}""#), false),
        (r#""intensity_g": 0.1"#.to_owned(), true),
    ] {
        let two = json!([{"id": 1, "x_px": 960, "y_px": 640}, {"id": 2, "x_px": 400, "y_px": 500}]);
        say(&mut socket, &json!({"type": "touch", "touches": two, "intensity_g": 0.1}));
        while ids(&next_of(&mut socket, "plan")) != [1, 2] {}
        let text = format!(r#"{{"type": "touch", "touches": {one}, {rest}}}"#);
        socket.send(if is_binary { Message::binary(text) } else { Message::text(text) }).unwrap();
        // In any order: the error is no news of what is driven.
        let (mut told, mut left) = (false, false);
        while !(told && left) {
            let Message::Text(text) = socket.read().unwrap() else { continue };
            let message: Value = serde_json::from_str(&text).unwrap();
            told |= message["type"] == "error";
            left |= message["plan"].is_object() && ids(&message) == [1];
        }
        say(&mut socket, &json!({"type": "touch", "touches": []}));
        daemon.wait_for(|state| state["plan"].is_null());
    }
}
