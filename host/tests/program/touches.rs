//! Touches of several targets over HTTP: their options, what cannot be had, and their times.

use crate::support;
use clap::ValueEnum;
use era::planner::Objective;
use era::scene::STARTING_PLATE;
use serde_json::{Value, json};
use std::time::Duration;
use support::Daemon;

/// Two targets, a quiet zone, another objective, in one request; what cannot be had is said, and what can with it.
#[test]
fn several_targets_quiet_zones_and_options_are_taken() {
    let daemon = Daemon::start(STARTING_PLATE);
    let touch = |rest: &str| {
        daemon
            .post("/v1/touch", &format!(r#"{{"x_px": 480, "y_px": 640, "intensity_g": 0.2, "duration_ms": 50{rest}}}"#))
    };
    let (status, _, plan) =
        touch(r#", "also": [{"x_px": 1500, "y_px": 700, "intensity_g": 0.1}, {"x_px": 900, "y_px": 300}]"#);
    assert_eq!(status, 200, "{plan}");
    let wanted: Vec<_> = plan["targets"].as_array().unwrap().iter().map(|t| t["wanted_g"].as_f64().unwrap()).collect();
    assert_eq!(wanted, [0.2, 0.1, 0.2]);
    assert!(plan["limited_by"].is_null() && plan.get("trade").is_none(), "{plan}");

    let hard = r#", "also": [{"x_px": 1500, "y_px": 700, "intensity_g": 50}]"#;
    let (_, _, plan) = touch(hard);
    assert!(plan["limited_by"].is_string() && plan.get("trade").is_none(), "{plan}");
    let (_, _, plan) = touch(&format!(r#"{hard}, "trade": true"#));
    let curve = &plan["trade"]["targets"][0];
    assert_eq!((&curve["target"], curve["points"].as_array().unwrap().len()), (&json!(0), 11), "{plan}");
    assert_eq!(curve["points"][0]["peaks_g"].as_array().unwrap().len(), 2);

    let spared = r#", "quiet": [{"x_px": 960, "y_px": 640, "radius_mm": 10, "at_most_g": 0.02}]"#;
    let (status, _, quiet) = touch(spared);
    assert_eq!(status, 200, "{quiet}");
    assert!(quiet["targets"][0]["peak_g"].as_f64().unwrap() < 0.2 || quiet["limited_by"].is_null(), "{quiet}");
    let times = &quiet["times"];
    assert!(times["reaches_90_ms"].as_f64() > Some(1.0) && times["decays_to_10_ms"].as_f64() > Some(1.0), "{quiet}");
    let (_, _, power) = touch(r#", "objective": "power""#);
    assert_eq!(
        (&power["objective"], power["predicted"]["target_peak_g"].as_f64() > Some(0.19)),
        (&json!("power"), true)
    );
    let (status, ..) = touch(r#", "weigh": "felt""#);
    let (refused, _, problem) = touch(r#", "weigh": "loud""#);
    assert!(
        (status, refused) == (200, 400) && problem["detail"].as_str().is_some_and(|d| d.contains("felt")),
        "{problem}"
    );
    let (_, _, shared) = touch(r#", "grouping": "shared""#);
    assert_eq!(shared["grouping"], "shared");
    assert_eq!(shared["drives"][0]["frequency_hz"], shared["drives"][1]["frequency_hz"]);
    for (drive, achieved) in
        shared["drives"].as_array().unwrap().iter().zip(shared["device"]["achieved"].as_array().unwrap())
    {
        let apart = drive["phase_rad"].as_f64().unwrap() - achieved["phase_rad"].as_f64().unwrap();
        assert!((0.5 * apart).sin().abs() < 0.01, "{shared}");
    }

    for (rest, field, value) in [
        (r#", "also": [{"x_px": 1, "y_px": 1}, {"x_px": 1921, "y_px": 1}]"#, "also[1].x_px", json!(1921.0)),
        (r#", "also": [{"x_px": 1, "y_px": 1, "intensity_g": -1}]"#, "also[0].intensity_g", json!(-1.0)),
        (r#", "also": [{"x_px": 1, "y_px": 1, "from_ms": 5, "to_ms": 4}]"#, "also[0].to_ms", json!(4.0)),
        (r#", "from_ms": 60"#, "to_ms", json!(50.0)),
        (r#", "to_ms": 10001"#, "to_ms", json!(10001.0)),
        (r#", "quiet": [{"x_px": 1, "y_px": -1, "radius_mm": 1, "at_most_g": 1}]"#, "quiet[0].y_px", json!(-1.0)),
        (
            r#", "quiet": [{"x_px": 1, "y_px": 1, "radius_mm": 101, "at_most_g": 1}]"#,
            "quiet[0].radius_mm",
            json!(101.0),
        ),
        (r#", "also": [{"x_px": 1, "y_px": 1, "intensity_g": "much"}]"#, "also[0].intensity_g", json!("much")),
        (r#", "quiet": [{"x_px": 1, "y_px": 1, "radius_mm": 1, "at_most_g": -1}]"#, "quiet[0].at_most_g", json!(-1.0)),
        (r#", "also": [{"x_px": 1, "y_px": 1}], "grouping": "shared""#, "grouping", json!("shared")),
        (r#", "also": [{"x_px": 1, "y_px": 1}], "objective": "reach""#, "objective", json!("reach")),
    ] {
        let (status, _, problem) = touch(rest);
        assert_eq!((status, &problem["field"], &problem["value"]), (400, &json!(field), &value), "{problem}");
        assert!(problem["allowed"].is_string() && problem["detail"].as_str().unwrap().contains(field), "{problem}");
    }
    for (rest, field, value, allowed) in [
        (r#", "objective": "loud""#, "objective", "loud", "one of contrast, reach, power"),
        (r#", "grouping": "mixed""#, "grouping", "mixed", "distinct or shared"),
    ] {
        let (status, _, problem) = touch(rest);
        let named = (&problem["field"], &problem["value"], &problem["allowed"]);
        assert_eq!((status, named), (400, (&json!(field), &json!(value), &json!(allowed))), "{problem}");
    }
    let body = r#"{"x_px": 1, "y_px": 1, "effect": "click", "to_ms": 50}"#;
    let (status, _, problem) = daemon.post("/v1/touch", body);
    assert_eq!((status, &problem["field"]), (400, &json!("to_ms")), "{problem}");
}

/// Commands, requests, their description and what a wrong request is told know the same objectives.
#[test]
fn every_objective_is_reported() {
    let daemon = Daemon::start(STARTING_PLATE);
    let names: Vec<String> = Objective::ALL.iter().map(|objective| objective.name().to_owned()).collect();
    let of_commands: Vec<String> = Objective::value_variants()
        .iter()
        .filter_map(|objective| Some(objective.to_possible_value()?.get_name().to_owned()))
        .collect();
    let of_requests: Vec<Value> = Objective::ALL.iter().map(|objective| json!(objective)).collect();
    assert_eq!((&names, json!(names)), (&of_commands, json!(of_requests)));
    let described = daemon.get("/openapi.json").1;
    assert_eq!(described["components"]["schemas"]["Objective"]["enum"], json!(names));
    let (_, _, wrong) = daemon.post("/v1/touch", r#"{"x_px": "left"}"#);
    let told: Vec<String> = names.iter().map(|name| format!("\"{name}\"")).collect();
    assert!(wrong["detail"].as_str().unwrap().contains(&told.join(" | ")), "{wrong}");
}

/// Stretches are driven one after the other; a stop or a newer touch ends those that are left.
#[test]
fn time_windows_are_driven_in_turn() {
    let daemon = Daemon::start(STARTING_PLATE);
    let body = |first_ms: u32, second_ms: u32, end_ms: u32| {
        json!({
            "x_px": 480, "y_px": 640, "intensity_g": 0.2, "from_ms": 0, "to_ms": first_ms,
            "also": [{"x_px": 1500, "y_px": 700, "intensity_g": 0.1, "from_ms": second_ms, "to_ms": end_ms}],
        })
        .to_string()
    };
    let target = |state: &Value| state["plan"]["target_mm"][0].as_f64();
    let (status, _, answer) = daemon.post("/v1/touch", &body(400, 800, 1600));
    assert_eq!((status, &answer["device"]["acknowledged"]), (200, &json!(true)), "{answer}");
    let stretches = answer["stretches"].as_array().unwrap();
    let times: Vec<_> = stretches.iter().map(|s| (s["from_ms"].as_f64(), s["to_ms"].as_f64(), &s["targets"])).collect();
    let time = |from: f64, to: f64| (Some(from), Some(to));
    assert_eq!(
        times.iter().map(|t| (t.0, t.1)).collect::<Vec<_>>(),
        [time(0.0, 400.0), time(400.0, 800.0), time(800.0, 1600.0)]
    );
    assert!(stretches[1]["plan"].is_null() && stretches[0]["plan"]["drives"] == answer["drives"], "{answer}");
    daemon.wait_for(|state| target(state) == Some(75.0) && state["device"]["state"] == "running");
    daemon.wait_for(|state| state["plan"].is_null() && state["device"]["state"] == "armed");
    daemon.wait_for(|state| target(state) > Some(200.0) && state["device"]["state"] == "running");
    daemon.wait_for(|state| state["plan"].is_null() && state["device"]["state"] == "armed");

    // What is left goes with a stop, and with a newer touch.
    daemon.post("/v1/touch", &body(100, 600, 900));
    daemon.post("/v1/stop", "");
    daemon.wait_for(|state| state["device"]["state"] == "safe");
    daemon.post("/v1/touch", &body(100, 600, 900));
    let newer = r#"{"x_px": 900, "y_px": 600, "duration_ms": 1500}"#;
    let (_, _, newer) = daemon.post("/v1/touch", newer);
    std::thread::sleep(Duration::from_millis(1000));
    let state = daemon.state();
    assert_eq!((&state["plan_id"], &state["device"]["state"]), (&newer["plan_id"], &json!("running")), "{state}");
    // One that begins later ends what is driven, and is driven at its time.
    let later = r#"{"x_px": 300, "y_px": 600, "from_ms": 300, "to_ms": 600}"#;
    let (status, _, answer) = daemon.post("/v1/touch", later);
    assert_eq!((status, &answer["device"]["acknowledged"]), (200, &json!(false)), "{answer}");
    daemon.wait_for(|state| state["plan_id"] == answer["plan_id"] && state["device"]["state"] == "running");
    daemon.wait_for(|state| state["plan"].is_null() && state["device"]["state"] == "armed");
}
