//! The daemon's interface: a touch drives, a stop stops, mistakes are told, a lost or faulted device is not hidden.

use crate::support;
use era::device::sim::SimKnobs;
use era::scene::STARTING_PLATE;
use serde_json::{Value, json};
use std::time::Duration;
use support::Daemon;
use support::program::run_era_json;
use tungstenite::Message;

#[test]
fn a_touch_drives_both_eras_and_ends_by_itself() {
    let daemon = Daemon::start(STARTING_PLATE);
    let body = json!({"x_px": 960, "y_px": 640, "intensity_g": 0.3, "duration_ms": 600}).to_string();
    let (status, _, plan) = daemon.post("/v1/touch", &body);
    assert_eq!(status, 200, "{plan}");
    assert_eq!(plan["target_mm"], json!([150.0, 100.0]));
    assert_eq!(plan["drives"].as_array().unwrap().len(), 2);
    assert!((plan["predicted"]["target_peak_g"].as_f64().unwrap() - 0.3).abs() < 1e-9);
    assert_eq!(plan["device"]["acknowledged"], true);
    for (drive, achieved) in
        plan["drives"].as_array().unwrap().iter().zip(plan["device"]["achieved"].as_array().unwrap())
    {
        let (asked, got) = (drive["frequency_hz"].as_f64().unwrap(), achieved["frequency_hz"].as_f64().unwrap());
        assert!((got / asked - 1.0).abs() < 20e-6 && achieved["actuator"] == drive["actuator"]);
        assert!(achieved["voltage_v"].as_f64().unwrap() <= drive["voltage_v"].as_f64().unwrap());
    }
    daemon.wait_for(|state| state["device"]["state"] == "running");
    let (_, field) = daemon.get("/v1/field");
    assert_eq!(
        field["peak_g"].as_array().unwrap().len(),
        field["nx"].as_u64().unwrap() as usize * field["ny"].as_u64().unwrap() as usize
    );
    assert!(field["max_g"].as_f64().unwrap() > 0.3);
    daemon.wait_for(|state| state["device"]["state"] == "armed");
}

/// What the daemon tells of a plan and a field has the same keys in the command line's JSON, but for what only a daemon knows.
#[test]
fn the_command_line_has_the_daemons_keys() {
    let daemon = Daemon::start(STARTING_PLATE);
    let keys = |value: &Value| value.as_object().unwrap().keys().cloned().collect::<Vec<_>>();
    let ask = |command: &str| run_era_json(&[command, "--at", "150,100", "--accuracy", "fast", "--json"]);
    let (status, _, told) = daemon.post("/v1/touch", r#"{"x_px": 960, "y_px": 640, "duration_ms": 2000}"#);
    assert_eq!(status, 200, "{told}");
    let (_, field) = daemon.get("/v1/field");
    let (plan, map) = (ask("plan"), ask("field"));
    let missing =
        |of: &Value, own: &Value| keys(of).into_iter().filter(|key| own.get(key).is_none()).collect::<Vec<_>>();
    assert_eq!(missing(&told, &plan), ["device", "plan_id"]);
    assert_eq!(missing(&told["times"], &plan["times"]), [""; 0]);
    assert_eq!(missing(&field, &map["field"]), ["plan_id"]);
    for (count, axis) in [("nx", "x_mm"), ("ny", "y_mm")] {
        assert_eq!(map["field"][count].as_u64(), map["field"][axis].as_array().map(|list| list.len() as u64));
    }
}

#[test]
fn stop_stops_whatever_runs() {
    let daemon = Daemon::start(STARTING_PLATE);
    daemon.post("/v1/touch", r#"{"x_px": 100, "y_px": 100, "duration_ms": 9000}"#);
    daemon.wait_for(|state| state["device"]["state"] == "running");
    let (status, _, state) = daemon.post("/v1/stop", "");
    assert_eq!((status, &state["plan"]), (200, &Value::Null));
    // Off at once, safe when the rails are measured to be.
    assert!(state["device"]["state"] == "discharging" || state["device"]["state"] == "safe", "{state}");
    let state = daemon.wait_for(|state| state["device"]["state"] == "safe");
    for rail in state["device"]["supply"]["rail_v"].as_array().unwrap() {
        assert!(rail.as_f64().unwrap() < 60.0, "{state}");
    }
    // What does not drive is not charged, and nothing runs out.
    let supply = &state["device"]["supply"];
    assert_eq!(supply["credit_rule"], "force-squared");
    let (credits, lasts) = (supply["credit_s"].as_array().unwrap(), supply["credit_lasts_s"].as_array().unwrap());
    assert!(lasts.len() == credits.len() && lasts.iter().all(Value::is_null), "{state}");
}

/// A stop ends what was asked for before it, planned or not: touches race with stops at all distances of a plan's time.
#[test]
fn a_stop_also_stops_what_is_still_being_planned() {
    let daemon = Daemon::start(STARTING_PLATE);
    for round in 0..40_u64 {
        std::thread::scope(|threads| {
            let touch =
                threads.spawn(|| daemon.post("/v1/touch", r#"{"x_px": 300, "y_px": 900, "duration_ms": 9000}"#));
            std::thread::sleep(Duration::from_micros(400 * round));
            let (status, _, _) = daemon.post("/v1/stop", "");
            assert_eq!(status, 200);
            let (status, _, answer) = touch.join().unwrap();
            assert!(status == 200 || status == 409 && answer["type"] == "urn:era:problem:stopped", "{status} {answer}");
        });
        // The touch may also have come after the stop; then it was answered and runs.
        let state = daemon.state();
        let runs = state["device"]["state"] == "running";
        assert_eq!(runs, !state["plan"].is_null(), "round {round}: {state}");
        daemon.post("/v1/stop", "");
    }
}

/// The order is certain here: the touch was on its way before the stop, so nothing may run after both.
#[test]
fn an_old_order_is_refused_after_a_stop() {
    let device = era::device::OpenDevice::open(&era::device::Target::Sim, || {
        let table = support::table(STARTING_PLATE);
        let volts = table.scene.actuators.iter().map(|actuator| actuator.max_voltage_v).collect();
        (era::device::sim::SimPanel::from_plan_table(&table), volts)
    });
    let session = era::device::Session::start(device.unwrap(), Default::default(), Default::default()).unwrap();
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build().unwrap();
    runtime.block_on(async {
        let mut seen = session.subscribe_snapshots();
        seen.wait_for(|snapshot| snapshot.connected).await.unwrap();
        let order = |stops| era::device::DriveOrder {
            id: 1,
            asked_at: era::device::AskedAt { stops, interruptions: None },
            start: None,
            content: era::device::DriveContent::Steady {
                drives: Vec::new(),
                hold: Duration::from_secs(1),
                from_zero: false,
            },
        };
        let before = session.stop_count();
        session.begin_drive_arming_if_needed(order(before)).await.unwrap();
        session.stop_and_disarm_board().await.unwrap();
        let refused = session.begin_drive_arming_if_needed(order(before)).await.unwrap_err();
        assert!(matches!(refused, era::device::SessionError::Stopped), "{refused}");
        session.begin_drive_arming_if_needed(order(session.stop_count())).await.unwrap();
    });
}

#[test]
fn a_finished_touch_is_no_plan_any_more() {
    let daemon = Daemon::start(STARTING_PLATE);
    let (status, _, _) = daemon.post("/v1/touch", r#"{"x_px": 300, "y_px": 900, "duration_ms": 150.0}"#);
    assert_eq!(status, 200);
    let state = daemon.wait_for(|state| state["device"]["state"] == "armed");
    assert!(state["plan"].is_null(), "{state}");
}

#[test]
fn each_bad_request_says_what_is_wrong() {
    let daemon = Daemon::start(STARTING_PLATE);
    let bad: &[(&str, &[&str])] = &[
        ("", &["EOF", "The whole body has the form"]),
        ("no json", &["The whole body has the form"]),
        ("[]", &["The whole body has the form"]),
        (r#"{"x_px": 1}"#, &["y_px is missing"]),
        (r#"{"x_px": "1", "y_px": 1}"#, &["x_px is \"1\"", "a number"]),
        (r#"{"x_px": 1, "y_px": 1, "z_px": 1}"#, &["z_px is not a known field", "intensity_g"]),
        (r#"{"x_px": 1921, "y_px": 1}"#, &["x_px is 1921", "0 to 1920"]),
        (r#"{"x_px": 1, "y_px": -0.5}"#, &["y_px is -0.5", "0 to 1280"]),
        (r#"{"x_px": 1, "y_px": 1, "intensity_g": -1}"#, &["intensity_g is -1", "0 to 1000"]),
        (r#"{"x_px": 1, "y_px": 1, "duration_ms": 0}"#, &["duration_ms is 0", "1 to 10000"]),
        (r#"{"x_px": 1, "y_px": 1, "duration_ms": 10001}"#, &["duration_ms is 10001", "1 to 10000"]),
        (r#"{"x_px": 1, "y_px": 1, "duration_ms": "long"}"#, &["long", "duration_ms"]),
    ];
    for (body, wanted) in bad {
        let (status, kind, problem) = daemon.post("/v1/touch", body);
        assert_eq!((status, kind.as_str()), (400, "application/problem+json"), "{body}: {problem}");
        assert_eq!(problem["status"], 400);
        assert!(problem["type"].as_str().unwrap().starts_with("urn:era:problem:") && problem["title"].is_string());
        let detail = problem["detail"].as_str().unwrap();
        for piece in *wanted {
            assert!(detail.contains(piece), "{body:?} gave {detail:?}, which lacks {piece:?}");
        }
    }
    let (_, _, problem) = daemon.post("/v1/touch", r#"{"x_px": 1921, "y_px": 1}"#);
    assert_eq!(
        (&problem["field"], &problem["value"], &problem["allowed"]),
        (&json!("x_px"), &json!(1921.0), &json!("0 to 1920"))
    );
    assert_eq!(daemon.state()["device"]["state"], "safe", "nothing was driven");
}

#[test]
fn other_bad_requests() {
    let daemon = Daemon::start(STARTING_PLATE);
    let (status, problem) = daemon.get("/v1/nothing");
    assert!(status == 404 && problem["detail"].as_str().unwrap().contains("/v1/nothing"));
    let (status, problem) = daemon.get("/v1/touch");
    assert!(status == 405 && problem["detail"].as_str().unwrap().contains("GET"));
    let (status, problem) = daemon.get("/v1/field?x_px=1");
    assert!(status == 400 && problem["detail"].as_str().unwrap().contains("y_px"));
    let (status, problem) = daemon.get("/v1/field?x_px=a&y_px=1");
    assert!(status == 400, "{problem}");
    // All errors have one form, those of the layers below included.
    let (status, kind, problem) = daemon.post("/v1/touch", &" ".repeat(20_000));
    assert_eq!((status, kind.as_str()), (413, "application/problem+json"), "{problem}");
    let (status, problem) = daemon.get("/v1/live");
    assert!((400..500).contains(&status) && problem["type"] == "urn:era:problem:no-websocket", "{problem}");
    // A foreign name may have been pointed at this machine.
    let mut answer =
        Daemon::agent().get(format!("{}/v1/state", daemon.url)).header("Host", "elsewhere.example").call().unwrap();
    let problem: Value = answer.body_mut().read_json().unwrap();
    assert!(answer.status() == 403 && problem["type"] == "urn:era:problem:foreign-host", "{problem}");
    // A page from elsewhere must not move hardware.
    let mut answer = Daemon::agent()
        .post(format!("{}/v1/stop", daemon.url))
        .header("Origin", "http://elsewhere.example")
        .send_empty()
        .unwrap();
    let problem: Value = answer.body_mut().read_json().unwrap();
    assert!(answer.status() == 403 && problem["detail"].as_str().unwrap().contains("elsewhere.example"));
}

/// From the request over the board's queue to the panel: an effect is timed by the board's own clock.
#[test]
fn effects_reach_the_panel() {
    let daemon = Daemon::start(STARTING_PLATE);
    let touch =
        |rest: &str| daemon.post("/v1/touch", &format!(r#"{{"x_px": 900, "y_px": 600, "intensity_g": 0.3{rest}}}"#));
    for (effect, least_ms, most_ms) in
        [("swell", 500.0, 500.0), ("click", 2.0, 250.0), ("double_click", 120.0, 500.0), ("texture", 1000.0, 1000.0)]
    {
        let (status, _, answer) = touch(&format!(r#", "effect": "{effect}""#));
        assert_eq!(status, 200, "{answer}");
        let played = &answer["device"]["effect"];
        assert_eq!(played["name"], effect);
        assert!((least_ms..=most_ms).contains(&played["duration_ms"].as_f64().unwrap()), "{played}");
        assert!(played["start_board_us"].as_u64().unwrap() > 0, "{played}");
        assert!(played["predicted"]["peak_g"].as_f64().unwrap() > 0.2, "{played}");
        for drive in played["drives"].as_array().unwrap() {
            assert!(!drive["segments"].as_array().unwrap().is_empty(), "{played}");
        }
        if effect == "swell" {
            let state = daemon.wait_for(|state| state["telemetry"]["acceleration_peak_g"].as_f64() > Some(0.1));
            assert_eq!(state["device"]["state"], "running");
        }
        daemon.wait_for(|state| state["device"]["state"] == "armed");
    }
    let (status, _, problem) = touch(r#", "effect": "bang""#);
    assert!(status == 400 && problem["detail"].as_str().unwrap().contains("double_click"), "{problem}");
    let (status, _, problem) = touch(r#", "effect": "click", "duration_ms": 100"#);
    assert_eq!((status, &problem["field"]), (400, &json!("duration_ms")));
    let (status, _, problem) = touch(r#", "effect": "texture", "period_ms": 10"#);
    assert_eq!((status, &problem["allowed"]), (400, &json!("25 to 125")), "{problem}");
    let (status, _, problem) = touch(r#", "count": 3"#);
    assert_eq!((status, &problem["field"]), (400, &json!("count")), "{problem}");
    let (status, _, problem) = touch(r#", "intensity_db": 20"#);
    assert_eq!((status, &problem["field"]), (400, &json!("intensity_db")));
    let detail = problem["detail"].as_str().unwrap();
    assert!(detail.contains("intensity_g") && detail.contains("intensity_db"), "{detail}");
}

#[test]
fn levels_above_the_threshold_are_asked_for() {
    let daemon = Daemon::start(STARTING_PLATE);
    let touch = |db: f64| {
        let body = format!(r#"{{"x_px": 900, "y_px": 600, "intensity_db": {db}, "duration_ms": 20}}"#);
        daemon.post("/v1/touch", &body)
    };
    let peak = |db: f64| {
        let (status, _, plan) = touch(db);
        assert_eq!(status, 200, "{plan}");
        plan["predicted"]["target_peak_g"].as_f64().unwrap()
    };
    // 20 dB above 23 to 46 mg, what is felt at 40 to 300 Hz; and everything is proportional while nothing limits it.
    let (weak, strong) = (peak(14.0), peak(20.0));
    assert!((0.2..0.5).contains(&strong), "{strong} g");
    assert!((strong / weak / 10_f64.powf(6.0 / 20.0) - 1.0).abs() < 0.01, "{weak} {strong}");
    let (status, _, problem) = touch(99.0);
    assert_eq!((status, &problem["field"], &problem["allowed"]), (400, &json!("intensity_db"), &json!("-20 to 80")));
}

#[test]
fn the_boards_clock_is_followed() {
    let daemon = Daemon::start(STARTING_PLATE);
    let state = daemon.wait_for(|state| state["device"]["clock"]["samples"].as_u64() >= Some(8));
    let clock = &state["device"]["clock"];
    for key in ["rate_ppm", "half_round_trip_us", "residual_rms_us", "residual_worst_us"] {
        assert!(clock[key].as_f64().is_some_and(f64::is_finite), "{key}: {clock}");
    }
    // Another start of the board is another clock.
    daemon.sim.request_restart();
    daemon.wait_for(|state| state["device"]["restarts"] == 1);
    daemon.wait_for(|state| {
        state["device"]["clock"]["samples"].as_u64().is_some_and(|samples| (1..8).contains(&samples))
    });
}

#[test]
fn field_of_a_touch_without_driving() {
    let daemon = Daemon::start(STARTING_PLATE);
    let (status, field) = daemon.get("/v1/field?x_px=480&y_px=640&intensity_g=0.4");
    assert!(status == 200 && field["max_g"].as_f64().unwrap() >= 0.39);
    assert_eq!(daemon.state()["device"]["state"], "safe");
}

#[test]
fn description_metrics_and_page_are_there() {
    let daemon = Daemon::start(STARTING_PLATE);
    let (_, description) = daemon.get("/openapi.json");
    let paths = description["paths"].as_object().unwrap();
    for path in [
        "/v1/touch",
        "/v1/preview",
        "/v1/requests/{id}",
        "/v1/arm",
        "/v1/stop",
        "/v1/state",
        "/v1/scene",
        "/v1/field",
        "/v1/live",
        "/v1/faults/clear",
        "/metrics",
    ] {
        assert!(paths.contains_key(path), "{path} is described");
    }
    daemon.post("/v1/touch", r#"{"x_px": 1, "y_px": 1}"#);
    daemon.post("/v1/touch", r#"{"x_px": -1, "y_px": 1}"#);
    let metrics = daemon.get_text("/metrics");
    for line in [
        "era_touches_total 1",
        "era_touch_failures_total 1",
        "era_device_connected 1",
        "# TYPE era_plans_total counter",
    ] {
        assert!(metrics.lines().any(|found| found == line), "{line} in {metrics}");
    }
    for path in
        ["/", "/app.js", "/design.js", "/panel.js", "/link.js", "/heat.js", "/readout.js", "/style.css", "/icon.svg"]
    {
        let text = daemon.get_text(path);
        assert!(!text.is_empty() && !text.contains("http://") || path == "/icon.svg" || path == "/panel.js", "{path}");
    }
}

#[test]
fn a_silent_device_is_reported_and_found_again() {
    let daemon = Daemon::start(STARTING_PLATE);
    daemon.sim.set_knobs(SimKnobs { silent: true, ..SimKnobs::default() });
    // It may be only late at first, which is a reason of its own.
    daemon.wait_for(|state| state["device"]["connected"] == false);
    daemon.wait_for(|state| state["device"]["in_doubt"] == false);
    let (status, _, problem) = daemon.post("/v1/touch", r#"{"x_px": 1, "y_px": 1}"#);
    assert!(status == 502 && problem["detail"].as_str().unwrap().contains("not connected"), "{status} {problem}");
    daemon.sim.set_knobs(SimKnobs::default());
    daemon.wait_for(|state| state["device"]["connected"] == true);
    assert_eq!(daemon.post("/v1/touch", r#"{"x_px": 1, "y_px": 1}"#).0, 409, "it was away");
    assert_eq!(daemon.post("/v1/arm", "").0, 200);
    assert_eq!(daemon.post("/v1/touch", r#"{"x_px": 1, "y_px": 1}"#).0, 200);
}

/// The line goes dead while the device drives: it switches itself off, says why, and goes on only after a clear.
#[test]
fn a_dead_line_ends_in_a_fault_that_must_be_cleared() {
    let daemon = Daemon::start(STARTING_PLATE);
    daemon.post("/v1/touch", r#"{"x_px": 900, "y_px": 600, "duration_ms": 10000}"#);
    daemon.wait_for(|state| state["device"]["state"] == "running");
    daemon.sim.set_knobs(SimKnobs { silent: true, ..SimKnobs::default() });
    std::thread::sleep(Duration::from_millis(600));
    daemon.sim.set_knobs(SimKnobs::default());
    let state = daemon.wait_for(|state| state["device"]["state"] == "fault");
    assert_eq!(state["device"]["fault"]["name"], "host-silent");
    let (status, _, problem) = daemon.post("/v1/touch", r#"{"x_px": 1, "y_px": 1}"#);
    assert!(status == 409 && problem["detail"].as_str().unwrap().contains("/v1/faults/clear"), "{status} {problem}");
    let (status, _, state) = daemon.post("/v1/faults/clear", "");
    assert_eq!((status, &state["device"]["fault"]), (200, &Value::Null));
    daemon.wait_for(|state| state["device"]["state"] == "safe");
    assert_eq!(daemon.post("/v1/touch", r#"{"x_px": 1, "y_px": 1}"#).0, 200);
}

#[test]
fn a_restarted_device_is_noticed() {
    let daemon = Daemon::start(STARTING_PLATE);
    daemon.post("/v1/touch", r#"{"x_px": 900, "y_px": 600, "duration_ms": 10000}"#);
    daemon.wait_for(|state| state["device"]["state"] == "running");
    let before = daemon.state()["device"]["boot_id"].clone();
    daemon.sim.request_restart();
    let state = daemon.wait_for(|state| state["device"]["restarts"] == 1 && state["device"]["boot_id"] != before);
    // Whoever has restarted it may have a hand in it: what was live is a fault that a person clears, and a person arms it.
    assert_eq!(
        (&state["device"]["state"], &state["device"]["fault"]["code"]),
        (&json!("fault"), &json!(20)),
        "{state}"
    );
    assert_eq!(daemon.post("/v1/touch", r#"{"x_px": 1, "y_px": 1}"#).0, 409);
    assert_eq!(daemon.post("/v1/arm", "").0, 409);
    assert_eq!(daemon.post("/v1/faults/clear", "").0, 200);
    assert_eq!(daemon.post("/v1/touch", r#"{"x_px": 1, "y_px": 1}"#).0, 409);
    assert_eq!(daemon.post("/v1/arm", "").0, 200);
    assert_eq!(daemon.post("/v1/touch", r#"{"x_px": 1, "y_px": 1}"#).0, 200);
}

#[test]
fn the_live_socket_takes_touches_and_reports_plans() {
    let daemon = Daemon::start(STARTING_PLATE);
    let (mut socket, _) = tungstenite::connect(format!("{}/v1/live", daemon.url.replace("http", "ws"))).unwrap();
    let mut wait_for = |kind: &str, send: Option<Value>| -> Value {
        if let Some(send) = send {
            socket.send(Message::text(send.to_string())).unwrap();
        }
        loop {
            if let Message::Text(text) = socket.read().unwrap() {
                let message: Value = serde_json::from_str(&text).unwrap();
                if message["type"] == kind {
                    return message;
                }
                // Whatever else is wrong would be waited for in vain.
                assert_ne!(message["type"], "error", "waiting for {kind}: {message}");
            }
        }
    };
    assert_eq!(wait_for("scene", None)["actuators"].as_array().unwrap().len(), 2);
    let touches = json!([{"id": 1, "x_px": 400.0, "y_px": 500.0}, {"id": 2, "x_px": 1500.0, "y_px": 700.0}]);
    let plan = wait_for("plan", Some(json!({"type": "touch", "touches": touches, "intensity_g": 0.2})));
    let targets = plan["plan"]["targets"].as_array().unwrap().clone();
    assert!(
        targets.len() == 2 && targets.iter().all(|target| target["peak_g"].as_f64().unwrap() > 0.199),
        "{targets:?}"
    );
    daemon.wait_for(|state| state["device"]["state"] == "running");
    // Each finger may have its own intensity.
    let mut own = touches.clone();
    own[1]["intensity_g"] = json!(0.05);
    let plan = wait_for("plan", Some(json!({"type": "touch", "touches": own, "intensity_g": 0.2})));
    let wanted = |t: usize| plan["plan"]["targets"][t]["wanted_g"].as_f64().unwrap();
    assert_eq!((wanted(0), wanted(1), &plan["touches"][1]["intensity_g"]), (0.2, 0.05, &json!(0.05)));
    // An effect under several fingers ends by itself.
    let buzz = json!({"type": "touch", "touches": touches, "intensity_db": 15.0, "effect": "buzz", "duration_ms": 50});
    let plan = wait_for("plan", Some(buzz));
    assert_eq!((&plan["effect"]["name"], &plan["effect"]["duration_ms"]), (&json!("buzz"), &json!(50.0)));
    daemon.wait_for(|state| state["device"]["state"] == "armed");
    let problem = wait_for("error", Some(json!({"type": "touch", "touches": touches, "effect": "click", "count": 2})));
    assert_eq!(problem["problem"]["field"], "count");
    let problem = wait_for("error", Some(json!({"type": "dance"})));
    assert!(problem["problem"]["detail"].as_str().unwrap().contains("dance"));
    let problem = wait_for("error", Some(json!({"type": "touch", "touches": [{"x_px": -40.0, "y_px": 0.0}]})));
    assert_eq!(problem["problem"]["field"], "touches[0].x_px");
    wait_for("state", Some(json!({"type": "touch", "touches": []})));
    daemon.wait_for(|state| state["device"]["state"] == "armed");
    // A page that goes away has lifted its fingers.
    wait_for("plan", Some(json!({"type": "touch", "touches": [{"x_px": 4.0, "y_px": 9.0}]})));
    drop(socket);
    daemon.wait_for(|state| state["device"]["state"] == "armed");
}
