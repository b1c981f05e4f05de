//! Numbers as clients write them: whole ones with a point or an exponent, and strict ones in paths and queries.

use crate::fingers::live;
use crate::support::Daemon;
use crate::support::described::described;
use era::scene::STARTING_PLATE;
use serde_json::{Value, json};
use tungstenite::Message;

/// Ways to write whole numbers, and what they are.
const WHOLE: [(&str, f64); 12] = [
    ("3", 3.0),
    ("3.0", 3.0),
    ("3.000", 3.0),
    ("1e1", 10.0),
    ("1E1", 10.0),
    ("1e+1", 10.0),
    ("1.0e1", 10.0),
    ("0.3e1", 3.0),
    ("30e-1", 3.0),
    ("300.0e-2", 3.0),
    ("5e0", 5.0),
    ("100", 100.0),
];
/// What is none, or is none that a count may be.
const NOT: [&str; 10] = ["3.5", "1e-1", "-1", "-1.0", "0.5", "1e10", "4294967299.0", "1e300", "\"3\"", "true"];

/// The description's own word for what an integer is, by a validator of JSON Schema, is the daemon's.
#[test]
fn a_whole_number_may_be_written_with_a_point() {
    let daemon = Daemon::start(STARTING_PLATE);
    let asked = described().schema("/paths/~1v1~1touch/post/requestBody/content/application~1json/schema");
    let body = |count: &str| {
        let rest = r#""x_px": 900, "y_px": 600, "intensity_g": 0.1, "effect": "pulse_train", "period_ms": 10"#;
        format!(r#"{{{rest}, "count": {count}}}"#)
    };
    for (text, value) in WHOLE {
        assert!(asked.is_valid(&serde_json::from_str(&body(text)).unwrap()), "{text}");
        // Whatever the board says to it, it has been read.
        let (status, _, answer) = daemon.post("/v1/touch", &body(text));
        assert!(![400, 422].contains(&status), "{text}: {answer}");
        // What was read is told where it does not belong.
        let lonely = format!(r#"{{"x_px": 900, "y_px": 600, "count": {text}}}"#);
        let (status, _, problem) = daemon.post("/v1/touch", &lonely);
        let told = (problem["field"].as_str(), problem["value"].as_f64());
        assert!(status == 400 && told == (Some("count"), Some(value)), "{text}: {problem}");
    }
    for text in NOT {
        assert!(!asked.is_valid(&serde_json::from_str(&body(text)).unwrap()), "{text}");
        let (status, _, problem) = daemon.post("/v1/touch", &body(text));
        assert_eq!((status, &problem["field"]), (400, &json!("count")), "{text}: {problem}");
    }
    let (status, _, problem) = daemon.post("/v1/touch", &body("3.5"));
    assert!(status == 400 && problem["value"] == json!(3.5), "{problem}");
    assert!(problem["allowed"].as_str().unwrap().contains("whole number"), "{problem}");
    let (status, _, problem) = daemon.post("/v1/touch", &body("1e999"));
    assert_eq!((status, &problem["field"]), (400, &json!("count")), "{problem}");
    assert_ne!(daemon.post("/v1/touch", &body("null")).0, 400);
}

/// The same in effect files, whose numbers have their ranges in the description.
#[test]
fn whole_numbers_of_effect_files_may_be_written_with_a_point() {
    let daemon = Daemon::start(STARTING_PLATE);
    let asked = described().schema("/paths/~1v1~1effects/post/requestBody/content/application~1json/schema");
    let body = |version: &str, event: &str| {
        let place = r#""x_px": 900, "y_px": 600, "intensity_g": 0.1"#;
        format!(r#"{{{place}, "effect": {{"version": {version}, "events": [{{"primitive": "tick"{event}}}]}}}}"#)
    };
    let check = |version: &str, event: &str, is_good: bool| {
        let text = body(version, event);
        assert_eq!(asked.is_valid(&serde_json::from_str(&text).unwrap()), is_good, "{text}");
        let (status, _, answer) = daemon.post("/v1/effects", &text);
        assert_eq!(![400, 422].contains(&status), is_good, "{text}: {answer}");
    };
    for version in ["1", "1.0", "1e0", "10e-1"] {
        check(version, "", true);
    }
    for version in ["0", "2", "2.0", "1.5", "-1"] {
        check(version, "", false);
    }
    for (count, is_good) in [("2", true), ("2.0", true), ("0.2e1", true), ("0", false), ("1001", false), ("2.5", false)]
    {
        check("1", &format!(r#", "repeat": {{"count": {count}, "period_ms": 60}}"#), is_good);
    }
    for (field, least, most) in [
        ("time_ms", 0.0, 30_000.0),
        ("pause_ms", 0.0, 30_000.0),
        ("intensity", 0.0, 1.0),
        ("sharpness", 0.0, 1.0),
        ("dx_mm", -2000.0, 2000.0),
        ("dy_mm", -2000.0, 2000.0),
    ] {
        for value in [least - 0.5, most + 0.5] {
            check("1", &format!(r#", "{field}": {value:?}"#), false);
        }
    }
}

/// Numbers of fingers and of pulses on the live socket: a finger beside the screen is told by its number.
#[test]
fn fingers_are_numbered_by_any_whole_number() {
    let daemon = Daemon::start(STARTING_PLATE);
    let mut socket = live(&daemon, "?send=");
    let mut told = |message: String| loop {
        let message = Message::text(message.clone());
        socket.send(message).unwrap();
        while let Ok(answer) = socket.read() {
            if let Message::Text(text) = answer {
                return serde_json::from_str::<Value>(&text).unwrap()["problem"].clone();
            }
        }
    };
    let finger = |id: &str, more: &str| {
        format!(r#"{{"type": "touch", "touches": [{{"id": {id}, "x_px": -900, "y_px": 600}}]{more}}}"#)
    };
    for (text, value) in [
        ("7", 7),
        ("7.0", 7),
        ("1e1", 10),
        ("-3.0", -3),
        ("-3e0", -3),
        ("-0.0", 0),
        ("9007199254740992.0", 1_i64 << 53),
        ("9223372036854775807", i64::MAX),
    ] {
        let problem = told(finger(text, ""));
        assert_eq!((&problem["finger"], &problem["field"]), (&json!(value), &json!("touches[0].x_px")), "{problem}");
    }
    for text in ["7.5", "1e-1", "\"7\"", "1e30", "9007199254740994.0", "9223372036854775808", "true"] {
        let problem = told(finger(text, ""));
        assert_eq!(problem["field"], json!("touches[0].id"), "{text}: {problem}");
    }
    for (count, field) in
        [("3", "touches[0].x_px"), ("3.0", "touches[0].x_px"), ("1e1", "touches[0].x_px"), ("3.5", "count")]
    {
        let more = format!(r#", "effect": "pulse_train", "count": {count}"#);
        // Of a count that is wrong nothing else is.
        let x_px = if field == "count" { "900" } else { "-900" };
        let problem = told(finger("1", &more).replace("-900", x_px));
        assert_eq!(problem["field"], json!(field), "{count}: {problem}");
    }
}

/// JSON's own numbers (RFC 8259, 6), and no others, whatever else is asked for.
#[test]
fn numbers_of_queries_are_those_of_json() {
    let daemon = Daemon::start(STARTING_PLATE);
    for text in ["0", "0.5", "5e-1", "1000", "1E2", "-0", "1e%2B1"] {
        for rest in ["", "&x_px=900&y_px=600"] {
            let (status, field) = daemon.get(&format!("/v1/field?intensity_g={text}{rest}"));
            assert_eq!(status, 200, "{text}{rest}: {field}");
        }
    }
    for text in ["-1.5", "1000.5", "-1e-9", "1e308"] {
        for rest in ["", "&x_px=900&y_px=600"] {
            let (status, problem) = daemon.get(&format!("/v1/field?intensity_g={text}{rest}"));
            assert_eq!((status, &problem["field"]), (400, &json!("intensity_g")), "{text}{rest}: {problem}");
            assert_eq!(problem["allowed"], json!("0 to 1000"), "{problem}");
        }
    }
    let none = [
        "",
        "nan",
        "NaN",
        "inf",
        "-inf",
        "infinity",
        "%2B1",
        "+1",
        "%201",
        "1%20",
        "1.",
        ".5",
        "01",
        "1_0",
        "0x10",
        "1e",
        "1,5",
        "1e999",
        "-",
        "--1",
        "true",
        "null",
        "%22one%22",
        "%D9%A1",
    ];
    for text in none {
        for name in ["x_px", "y_px", "intensity_g"] {
            let others: String = ["x_px", "y_px", "intensity_g"]
                .iter()
                .filter(|other| **other != name)
                .map(|other| format!("&{other}=1"))
                .collect();
            let (status, problem) = daemon.get(&format!("/v1/field?{name}={text}{others}"));
            assert_eq!((status, &problem["field"]), (400, &json!(name)), "{name}={text}: {problem}");
        }
    }
    for (query, field) in [("x_px=-1&y_px=1", "x_px"), ("x_px=1&y_px=1281", "y_px"), ("x_px=1e9&y_px=1", "x_px")] {
        let (status, problem) = daemon.get(&format!("/v1/field?{query}"));
        assert_eq!((status, &problem["field"]), (400, &json!(field)), "{query}: {problem}");
    }
}

#[test]
fn a_request_has_one_number() {
    let daemon = Daemon::start(STARTING_PLATE);
    for _ in 0..3 {
        daemon.post("/v1/touch", r#"{"x_px": 900, "y_px": 600, "duration_ms": 20}"#);
    }
    for same in ["3", "%33"] {
        let (status, told) = daemon.get(&format!("/v1/requests/{same}"));
        assert_eq!((status, &told["id"]), (200, &json!(3)), "{same}");
    }
    for other in
        ["+3", "%2B3", "03", "003", "3.0", "3e0", "-3", "%203", "3%20", "0x3", "%D9%A3", "18446744073709551619"]
    {
        let (status, problem) = daemon.get(&format!("/v1/requests/{other}"));
        assert_eq!(status, 404, "{other}: {problem}");
    }
}
