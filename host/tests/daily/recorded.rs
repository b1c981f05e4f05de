//! What is recorded is replayed as it was.

use crate::support::Daemon;
use era::daemon::Recorder;
use era::scene::EXAMPLE_PLATE;
use serde_json::{Value, json};
use std::process::Command;
use tungstenite::Message;

#[test]
fn a_recording_is_replayed_with_the_same_answers() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("day.jsonl");
    {
        let daemon = Daemon::recording(EXAMPLE_PLATE, Recorder::start(&file, "example plate").unwrap());
        for x_px in [300, 900, 1500] {
            let body = json!({"x_px": x_px, "y_px": 600, "intensity_g": 0.1, "duration_ms": 20}).to_string();
            assert_eq!(daemon.post("/v1/touch", &body).0, 200);
        }
        assert_eq!(daemon.post("/v1/touch", r#"{"x_px": 5000, "y_px": 1}"#).0, 400);
        let (mut socket, _) =
            tungstenite::connect(format!("{}/v1/live?send=plan", daemon.url.replace("http", "ws"))).unwrap();
        let tap = json!({"type": "touch", "touches": [{"id": 1, "x_px": 400.0, "y_px": 500.0}], "intensity_g": 0.1});
        socket.send(Message::text(tap.to_string())).unwrap();
        while !matches!(socket.read().unwrap(), Message::Text(_)) {}
        socket.send(Message::text(r#"{"type": "touch", "touches": []}"#)).unwrap();
        drop(socket);
        assert_eq!(daemon.post("/v1/stop", "").0, 200);
    }
    assert!(Recorder::start(&file, "again").is_err(), "a recording is not written over");
    let daemon = Daemon::start(EXAMPLE_PLATE);
    let out = Command::new(env!("CARGO_BIN_EXE_era"))
        .args(["replay", file.to_str().unwrap(), "--url", &daemon.url, "--json"])
        .output()
        .unwrap();
    assert!(out.status.success(), "{}", String::from_utf8_lossy(&out.stderr));
    let told: Value = serde_json::from_slice(&out.stdout).unwrap();
    assert_eq!((&told["requests"], &told["unanswered"]), (&json!(5), &json!(0)), "{told}");
    assert_eq!(told["statuses"], json!({"200": 4, "400": 1}), "{told}");
    assert_eq!((&told["answered_otherwise"], &told["left_out"]), (&json!(0), &json!(0)), "{told}");
    // The same wishes on the same panel are the same drives.
    assert_eq!((&told["drives_compared"], &told["drives_differ_by"]), (&json!(3), &json!(0.0)), "{told}");
    assert!(told["messages"].as_u64() >= Some(1), "{told}");
    std::fs::write(&file, "nonsense").unwrap();
    let out = Command::new(env!("CARGO_BIN_EXE_era"))
        .args(["replay", file.to_str().unwrap(), "--url", &daemon.url])
        .output()
        .unwrap();
    let said = String::from_utf8_lossy(&out.stderr).into_owned();
    assert!(out.status.code() == Some(2) && said.contains("line 1"), "{said}");
}
