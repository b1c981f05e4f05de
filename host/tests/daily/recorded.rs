//! What is recorded is replayed as it was.

use crate::fingers::{live, next, say};
use crate::line::{CALM, daemon, plate};
use crate::secrets::write_secret;
use crate::support::Daemon;
use crate::support::program::{build_era_command, run_command, run_era, run_era_json};
use crate::support::served::Served;
use era::daemon::{Access, BackgroundDaemon, Limits, Recorder, listener};
use era::device::sim::SimKnobs;
use era::scene::STARTING_PLATE;
use serde_json::{Value, json};
use std::sync::Arc;
use std::time::Duration;

#[test]
fn a_recording_is_replayed_with_the_same_answers() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("day.jsonl");
    {
        let (mut app, line) = plate(CALM);
        app.record = Some(Recorder::start(&file, "example plate").unwrap());
        let background = BackgroundDaemon::start(app).unwrap();
        let daemon =
            Daemon { url: format!("http://{}", background.address()), sim: line.sim(), background: Some(background) };
        daemon.wait_for(|state| state["device"]["connected"] == true);
        for x_px in [300, 900, 1500] {
            let body = json!({"x_px": x_px, "y_px": 600, "intensity_g": 0.1, "duration_ms": 20}).to_string();
            assert_eq!(daemon.post("/v1/touch", &body).0, 200);
            // The replay sends them at the same times: a stall of the computer must be shorter than this, or a touch replaces the
            // touch before it.
            std::thread::sleep(Duration::from_secs(2));
        }
        assert_eq!(daemon.post("/v1/touch", r#"{"x_px": 5000, "y_px": 1}"#).0, 400);
        let ticks = json!({"x_px": 960, "y_px": 640, "intensity_g": 0.1, "effect": {"version": 1, "events": [
            {"primitive": "tick", "repeat": {"count": 2, "period_ms": 100}}]}});
        assert_eq!(daemon.post("/v1/effects", &ticks.to_string()).0, 200);
        std::thread::sleep(Duration::from_secs(2));
        assert_eq!(daemon.post("/v1/effects", r#"{"x_px": 960, "y_px": 640}"#).0, 400);
        let mut socket = live(&daemon, "?send=plan");
        let tap = json!({"type": "touch", "touches": [{"id": 1, "x_px": 400.0, "y_px": 500.0}], "intensity_g": 0.1});
        say(&mut socket, &tap);
        next(&mut socket, "plan");
        say(&mut socket, &json!({"type": "touch", "touches": []}));
        drop(socket);
        assert_eq!(daemon.post("/v1/stop", "").0, 200);
    }
    assert!(Recorder::start(&file, "again").is_err(), "a recording is not written over");
    let (daemon, _line) = daemon(CALM);
    let told = run_era_json(&["replay", file.to_str().unwrap(), "--url", &daemon.url, "--json"]);
    assert_eq!((&told["requests"], &told["unanswered"]), (&json!(7), &json!(0)), "{told}");
    assert_eq!(told["statuses"], json!({"200": 5, "400": 2}), "{told}");
    assert_eq!((&told["answered_otherwise"], &told["left_out"]), (&json!(0), &json!(0)), "{told}");
    // The same wishes on the same panel are the same drives.
    assert_eq!((&told["drives_compared"], &told["drives_differ_by"]), (&json!(3), &json!(0.0)), "{told}");
    assert!(told["messages"].as_u64() >= Some(1), "{told}");
    // What is answered otherwise is named: the first touch had, it says here, been superseded. It is replayed alone, so that no
    // other touch can replace it.
    let text = std::fs::read_to_string(&file).unwrap();
    let first_touch_lines = text.lines().take_while(|line| !line.contains("\"x_px\":900"));
    let lines = first_touch_lines.map(|line| {
        let mut line: Value = serde_json::from_str(line).unwrap();
        if line["kind"] == "outcome" && line["id"] == 1 {
            let problem = json!({"type": "urn:era:problem:superseded"});
            line = json!({"at_ms": line["at_ms"], "kind": "outcome", "id": 1, "status": 409, "problem": problem});
        }
        line.to_string() + "\n"
    });
    std::fs::write(&file, lines.collect::<String>()).unwrap();
    let replay =
        |more: &[&str]| run_era(&[&["replay", file.to_str().unwrap(), "--url", &daemon.url], more].concat()).out;
    let said = replay(&[]);
    let line = said
        .lines()
        .find(|line| line.contains("409 superseded in the recording, 200 now"))
        .unwrap_or_else(|| panic!("{said}"));
    assert!(
        said.contains("whose answer differs from the recorded answer: 1") && line.contains("\"x_px\":300"),
        "{said}"
    );
    let told: Value = serde_json::from_str(&replay(&["--json"])).unwrap();
    let otherwise = &told["otherwise"][0];
    assert_eq!((&otherwise["id"], &otherwise["body"]["x_px"]), (&json!(1), &json!(300)), "{told}");
    assert_eq!(otherwise["then"], json!({"status": 409, "type": "superseded"}), "{told}");
    assert_eq!(otherwise["now"], json!({"status": 200, "type": null}), "{told}");
    std::fs::write(&file, "nonsense").unwrap();
    let out = run_era(&["replay", file.to_str().unwrap(), "--url", &daemon.url]);
    let said = &out.error;
    assert!(out.code == Some(2) && said.contains("line 1"), "{said}");
}

/// What was measured stands beside what was driven: the sensor's peak and the rails while the board is on, and every change of its
/// state.
#[test]
fn what_the_board_measures_is_recorded() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("day.jsonl");
    {
        let daemon = Daemon::recording(STARTING_PLATE, Recorder::start(&file, "example plate").unwrap());
        let touch = r#"{"x_px": 900, "y_px": 600, "intensity_g": 0.1, "duration_ms": 600}"#;
        daemon.wait_for(|state| state["device"]["state"] == "safe");
        assert_eq!(daemon.post("/v1/arm", "").0, 200);
        assert_eq!(daemon.post("/v1/touch", touch).0, 200);
        daemon.wait_for(|state| state["device"]["state"] == "armed");
        daemon.sim.set_knobs(SimKnobs { silent: true, ..SimKnobs::default() });
        daemon.wait_for(|state| state["device"]["connected"] == false && state["device"]["in_doubt"] == false);
        assert_ne!(daemon.post("/v1/faults/clear", "").0, 200);
    }
    let text = std::fs::read_to_string(&file).unwrap();
    let lines: Vec<Value> = text.lines().map(|line| serde_json::from_str(line).unwrap()).collect();
    let measured: Vec<&Value> = lines.iter().filter(|line| line["kind"] == "measured").collect();
    // What was asked by hand has its outcome, too.
    let only = |kind: &str| lines.iter().filter(|line| line["kind"] == kind).collect::<Vec<_>>();
    assert!(only("armed").len() == 1 && only("armed")[0]["problem"].is_null(), "{lines:?}");
    assert_eq!(only("cleared")[0]["problem"]["type"], "urn:era:problem:device-lost");
    let running: Vec<&&Value> = measured.iter().filter(|line| line["state"] == "running").collect();
    let peak = |line: &Value| line["telemetry"]["acceleration_peak_g"].as_f64().unwrap_or(0.0);
    let highest_v =
        |line: &Value| line["rail_v"][0].as_f64().unwrap_or(0.0).max(line["rail_v"][1].as_f64().unwrap_or(0.0));
    assert!(running.iter().any(|line| peak(line) > 0.001 && highest_v(line) > 60.0), "{measured:?}");
    assert!(running.iter().any(|line| line["telemetry"]["channels"][0]["frequency_hz"].is_f64()), "{running:?}");
    let states: Vec<&Value> = measured.iter().map(|line| &line["state"]).collect();
    let first = |name: &str| states.iter().position(|state| *state == name);
    assert!(first("safe").is_some() && first("safe") < first("running"), "{states:?}");
    assert!(first("running") < states.iter().rposition(|state| *state == "armed"), "{states:?}");
    // Of a board that is away nothing is measured.
    let away = measured.last().unwrap();
    assert!(away["connected"] == false && away["rail_v"].is_null() && away["telemetry"].is_null(), "{away}");
    // Ten times a second at most, but for changes.
    assert!(measured.len() < 60, "{}", measured.len());
}

/// What pages' fingers did is replayed with the same certificate and token as everything else, and comes through as it was.
#[test]
fn fingers_are_replayed_over_tls_with_a_token() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    let file = path("day.jsonl");
    {
        let daemon = Daemon::recording(STARTING_PLATE, Recorder::start(&file, "example plate").unwrap());
        let mut socket = live(&daemon, "?send=plan");
        let edge = json!({"kind": "edge", "x_px": 900, "y_px": 100, "width_px": 50, "height_px": 50});
        say(&mut socket, &json!({"type": "controls", "controls": [edge]}));
        for x_px in [400.0, 450.0] {
            let tap = json!({"type": "touch", "touches": [{"id": 1, "x_px": x_px, "y_px": 500.0}], "intensity_g": 0.1});
            say(&mut socket, &tap);
            next(&mut socket, "plan");
        }
        say(&mut socket, &json!({"type": "touch", "touches": []}));
        socket.close(None).unwrap();
        while socket.read().is_ok() {}
    }
    let secret = "T".repeat(32);
    let access = Access { tokens: Access::parse_tokens(&format!("touch {secret}")).unwrap(), ..Access::default() };
    let mut app = Daemon::app(STARTING_PLATE, access);
    app.record = Some(Recorder::start(&path("again.jsonl"), "example plate").unwrap());
    let tls = listener::find_or_make_certificate(&path("tls"), &[]).unwrap();
    let (served, url) = Served::at_a_port(&Arc::new(app), Some(&tls));
    write_secret(&path("token"), &secret);
    let replay = |more: &[&str], variable: Option<&str>| {
        let mut command = build_era_command();
        command.args(["replay", file.to_str().unwrap(), "--url", &url, "--json"]).args(more);
        let out = run_command(command.envs(variable.map(|token| ("ERA_TOKEN", token))));
        let told: Value = serde_json::from_str(&out.out).unwrap_or_default();
        (out.code.unwrap(), told["messages"].clone(), out.error)
    };
    let (certificate, token) = (tls.certificate.to_str().unwrap(), path("token"));
    let (ca, of_file) = (["--ca", certificate], ["--ca", certificate, "--token-file", token.to_str().unwrap()]);
    for (more, variable) in [(&of_file[..], None), (&ca, Some(secret.as_str()))] {
        let (code, messages, said) = replay(more, variable);
        assert!(code == 0 && messages == 4, "{code} {messages} {said}");
    }
    for (more, variable, piece) in [
        (&of_file[2..], None, "is not trusted"),
        (&ca, None, "the request has no token"),
        (&ca, Some("X"), "this token is not in the daemon's token file"),
    ] {
        let (code, _, said) = replay(more, variable);
        assert!(code == 1 && said.contains(piece), "{code} {said}");
    }
    drop(served);
    let said = |file: &str| -> Vec<Value> {
        let text = std::fs::read_to_string(path(file)).unwrap();
        let lines = text.lines().map(|line| serde_json::from_str::<Value>(line).unwrap());
        lines.filter(|line| line["kind"] == "fingers").map(|line| line["message"].clone()).collect()
    };
    let (then, now) = (said("day.jsonl"), said("again.jsonl"));
    assert_eq!(now, [then.clone(), then].concat());
}

/// A page that rests longer than the daemon waits for a word of it speaks again, and what comes after it is asked; what a page is refused is
/// told.
#[test]
fn a_page_that_rests_is_replayed_to_the_end() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("rests.jsonl");
    let finger =
        |x_px: f64| json!({"type": "touch", "touches": [{"id": 1, "x_px": x_px, "y_px": 500.0}], "intensity_g": 0.1});
    let mut lines = vec![json!({"at_ms": 0.0, "kind": "begin", "format": 1, "scene": "example plate"})];
    for (at_ms, message) in [(10.0, finger(400.0)), (100.0, finger(1e6)), (900.0, finger(500.0))] {
        lines.push(json!({"at_ms": at_ms, "kind": "fingers", "socket": 1, "message": message}));
    }
    lines.push(json!({"at_ms": 1000.0, "kind": "stop", "socket": 1}));
    let text: String = lines.iter().map(|line| format!("{line}\n")).collect();
    std::fs::write(&file, text).unwrap();
    // Where nobody is asked for a sign of life, the socket is closed in the rest; where somebody is, it is answered.
    for ping_ms in [30, 3_600_000] {
        // Nothing here is about a board that is late.
        let (mut app, _line) = plate(CALM);
        let ms = Duration::from_millis;
        app.limits = Limits { silence: ms(200), ping: ms(ping_ms), ..Limits::default() };
        let app = Arc::new(app);
        let (served, url) = Served::at_a_port(&app, None);
        let mut device = app.driver.subscribe_device_snapshots();
        served.runtime.block_on(async { device.wait_for(|snapshot| snapshot.connected).await.map(drop) }).unwrap();
        let out = run_era(&["replay", file.to_str().unwrap(), "--url", &url, "--json"]);
        let told: Value = serde_json::from_str(&out.out).unwrap_or_default();
        let said = &out.error;
        assert!(out.is_success() && told["messages"] == 3 && told["messages_lost"] == 0, "{told} {said}");
        assert_eq!(told["messages_refused"], json!({"out-of-range": 1}), "{told}");
        assert_eq!(app.driver.stop_count(), 1, "{told}");
        drop(served);
    }
}

/// A service is started again and again with the same configuration.
#[test]
fn each_start_has_a_file_of_its_own_in_a_folder() {
    let folder = tempfile::tempdir().unwrap();
    let records = format!("{}/records/", folder.path().display());
    for started in 1..=3 {
        drop(Recorder::start(records.as_ref(), "desk").unwrap());
        assert_eq!(std::fs::read_dir(&records).unwrap().count(), started);
    }
    for file in std::fs::read_dir(&records).unwrap() {
        let path = file.unwrap().path();
        let name = path.file_name().unwrap().to_str().unwrap().to_owned();
        assert!(name.starts_with("20") && name.contains('T') && !name.contains(':'), "{name}");
        assert!(path.extension().is_some_and(|it| it == "jsonl"), "{name}");
        assert!(std::fs::read_to_string(path).unwrap().contains("\"begin\""), "{name}");
    }
    // A folder that is there needs no slash.
    drop(Recorder::start(folder.path(), "desk").unwrap());
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 2);
}
