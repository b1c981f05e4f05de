//! What is told of an effect that is played is the effect's own: in every field that every client reads the same figures as `era effect`
//! prints, which is a process of its own, whatever limits the effect.

use crate::support;
use era::daemon::Recorder;
use era::scene::{EXAMPLE_BAR, STARTING_PLATE};
use serde_json::{Value, json};
use std::collections::BTreeSet;
use std::path::Path;
use support::Daemon;
use support::program::{build_era_command, run_command};
use tungstenite::Message;

/// All effects, by their names in requests.
const EFFECTS: &[&str] = &["click", "double_click", "buzz", "swell", "pulse_train", "texture"];

/// A scene, a place in px, a peak in g, and what has to limit at least one of the effects there.
struct Case {
    scene: String,
    at_px: [f64; 2],
    intensity_g: f64,
    limit: Option<&'static str>,
}

/// Members of the class of limits that an effect can meet alone; what is left of earlier touches, quiet zones and credit have tests of their own.
fn cases() -> Vec<Case> {
    let case = |scene: &str, at_px, intensity_g, limit| Case { scene: scene.to_owned(), at_px, intensity_g, limit };
    let soft = |stiffness: &str, damping: &str, volts: &str| {
        EXAMPLE_BAR
            .replace("stiffness_n_per_m = 5000.0", &format!("stiffness_n_per_m = {stiffness}"))
            .replace("damping_n_s_per_m = 1.1", &format!("damping_n_s_per_m = {damping}"))
            .replace("max_voltage_v = 2000.0", &format!("max_voltage_v = {volts}"))
    };
    let hungry = STARTING_PLATE
        .replace("electrode_area_mm2 = 1963.5", "electrode_area_mm2 = 30000.0")
        .replace("air_gap_um = 500.0", "air_gap_um = 1000.0");
    vec![
        case(STARTING_PLATE, [960.0, 640.0], 0.05, None),
        case(
            &STARTING_PLATE.replace("max_voltage_v = 2000.0", "max_voltage_v = 600.0"),
            [480.0, 640.0],
            0.5,
            Some("voltage"),
        ),
        // What a press leaves of the gap holds no more.
        case(STARTING_PLATE, [256.0, 1088.0], 3.0, Some("breakdown")),
        case(
            &soft("1500.0", "0.3", "1200.0").replace("stop_um = 170.0", "stop_um = 20.0"),
            [844.0, 80.0],
            5.0,
            Some("travel"),
        ),
        case(&soft("500.0", "1.1", "2000.0"), [600.0, 80.0], 50.0, Some("pull-in")),
        case(&hungry, [480.0, 640.0], 20.0, Some("supply")),
        case(STARTING_PLATE, [400.0, 300.0], 0.2, Some("too-short")),
    ]
}

/// What `era effect` prints, as JSON.
fn oracle(scene: &Path, case: &Case, effect: &str) -> Value {
    let [x, y] = case.at_px;
    let (at, g) = (format!("{x},{y}"), case.intensity_g.to_string());
    let mut command = build_era_command();
    command.args(["effect", "--accuracy", "fast", "--json", "--at", &at, "--intensity-g", &g]);
    let output = run_command(command.args(["--effect", effect, "--scene"]).arg(scene));
    assert!(output.is_success(), "{}", output.error);
    output.parse_json()
}

fn number(value: &Value) -> f64 {
    value.as_f64().unwrap_or_else(|| panic!("{value} is no number"))
}

#[track_caller]
fn close(told: &Value, wanted: &Value, what: &str) {
    let (told, wanted) = (number(told), number(wanted));
    // The board's thousandths and the table's rounding on disk.
    assert!((told - wanted).abs() <= 1e-6 * wanted.abs() + 1e-12, "{what}: {told}, but the effect has {wanted}");
}

/// A plan, as any client is told it, against the effect's own figures: strength, limits, drives, times.
#[track_caller]
fn has_figures_of(plan: &Value, effect: &Value, where_told: &str) {
    close(&plan["predicted"]["target_peak_g"], &effect["predicted"]["peak_g"], where_told);
    close(&plan["targets"][0]["peak_g"], &effect["predicted"]["peak_g"], where_told);
    assert_eq!(plan["limited_by"], effect["limited_by"], "{where_told}");
    assert_eq!(plan["limits"], effect["limits"], "{where_told}");
    for (drive, own) in plan["drives"].as_array().unwrap().iter().zip(effect["drives"].as_array().unwrap()) {
        assert_eq!(drive["actuator"], own["actuator"], "{where_told}");
        for key in ["frequency_hz", "voltage_v", "force_n"] {
            close(&drive[key], &own[key], where_told);
        }
    }
    // The bound is one on the even motion's peak.
    assert!(plan["error_bound"].is_null(), "{where_told}: {}", plan["error_bound"]);
    assert!(plan["predicted"]["mean_elsewhere_g"].is_f64() && plan["predicted"]["contrast_db"].is_f64(), "{plan}");
}

/// Waits until the effect before is over, and nothing is left of it: what is driven next is as strong as alone.
fn rest(daemon: &Daemon) {
    daemon.post("/v1/stop", "");
    daemon.wait_for(|state| state["device"]["state"] == "safe");
    std::thread::sleep(std::time::Duration::from_millis(700));
}

#[test]
fn every_client_is_told_the_effects_own_figures() {
    let mut seen = BTreeSet::new();
    for (c, case) in cases().iter().enumerate() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("scene.toml");
        std::fs::write(&file, &case.scene).unwrap();
        let recording = folder.path().join("day.jsonl");
        let mut ids = Vec::new();
        {
            let daemon = Daemon::recording(&case.scene, Recorder::start(&recording, "a scene").unwrap());
            let (mut socket, _) =
                tungstenite::connect(format!("{}/v1/live?send=plan", daemon.url.replace("http", "ws"))).unwrap();
            let mut next_plan = || loop {
                if let Message::Text(text) = socket.read().unwrap() {
                    let message: Value = serde_json::from_str(&text).unwrap();
                    if message["plan"].is_object() {
                        return message;
                    }
                }
            };
            for effect in EFFECTS {
                let own = oracle(&file, case, effect);
                let [x_px, y_px] = case.at_px;
                let body = json!({"x_px": x_px, "y_px": y_px, "intensity_g": case.intensity_g, "effect": effect});
                let (status, _, answer) = daemon.post("/v1/touch", &body.to_string());
                assert_eq!(status, 200, "{answer}");
                let state = daemon.state();
                let live = next_plan();
                let request = daemon.get(&format!("/v1/requests/{}", answer["plan_id"])).1;
                let at = format!("case {c}, {effect}");
                has_figures_of(&answer, &own, &format!("{at}, POST /v1/touch"));
                has_figures_of(&live["plan"], &own, &format!("{at}, live socket"));
                has_figures_of(&request["answer"], &own, &format!("{at}, GET /v1/requests"));
                if state["plan"].is_object() {
                    has_figures_of(&state["plan"], &own, &format!("{at}, GET /v1/state"));
                    // Its map is as strong at the target as the effect is, to the step of its grid.
                    let field = daemon.get("/v1/field").1;
                    if field["plan_id"] == answer["plan_id"] {
                        let most = number(&field["max_g"]);
                        assert!(most >= 0.8 * number(&own["predicted"]["peak_g"]), "{at}: {most} g at most on the map");
                    }
                }
                // A click's contrast and sound are in every answer.
                if !own["windows"].as_array().unwrap().is_empty() {
                    for key in ["contrast_db", "sound_db"] {
                        close(&answer["device"]["effect"]["predicted"][key], &own["predicted"][key], &at);
                        close(&live["effect"]["predicted"][key], &own["predicted"][key], &at);
                    }
                }
                // Residual vibration by its new and, for one version, its old name.
                for predicted in
                    [&own["predicted"], &answer["device"]["effect"]["predicted"], &live["effect"]["predicted"]]
                {
                    assert!(predicted["residual"].is_f64(), "{predicted}");
                    assert_eq!(predicted["residual"], predicted["left"], "{predicted}");
                }
                let limits = answer["limits"].as_array().unwrap();
                seen.extend(limits.iter().map(|limit| limit["code"].as_str().unwrap().to_owned()));
                let here: Vec<&str> = limits.iter().map(|limit| limit["code"].as_str().unwrap()).collect();
                println!(
                    "{at}: {:.4} g of {} g, {here:?}",
                    number(&answer["predicted"]["target_peak_g"]),
                    case.intensity_g
                );
                ids.push((answer["plan_id"].clone(), own));
                rest(&daemon);
            }
        }
        let lines = std::fs::read_to_string(&recording).unwrap();
        let lines: Vec<Value> = lines.lines().map(|line| serde_json::from_str(line).unwrap()).collect();
        for (id, own) in ids {
            let outcome = lines.iter().find(|line| line["kind"] == "outcome" && line["id"] == id).unwrap();
            close(&outcome["predicted"]["target_peak_g"], &own["predicted"]["peak_g"], "recording");
            assert_eq!((&outcome["limited_by"], &outcome["limits"]), (&own["limited_by"], &own["limits"]), "recording");
        }
        if let Some(limit) = case.limit {
            assert!(seen.contains(limit), "case {c} is to be limited by {limit}, and so far were seen {seen:?}");
        }
    }
}

/// What is left of earlier touches, a quiet zone and several targets: the effect that is played has these figures, as the answer's own fields do.
#[test]
fn weaker_effects_are_reported_as_weak_as_they_are() {
    let daemon = Daemon::start(EXAMPLE_BAR);
    for effect in EFFECTS {
        rest(&daemon);
        let strong = r#"{"x_px": 300, "y_px": 80, "intensity_g": 30, "duration_ms": 9000}"#;
        assert_eq!(daemon.post("/v1/touch", strong).0, 200);
        std::thread::sleep(std::time::Duration::from_millis(600));
        let body = json!({"x_px": 1500, "y_px": 80, "intensity_g": 30, "effect": effect}).to_string();
        let (status, _, answer) = daemon.post("/v1/touch", &body);
        assert_eq!(status, 200, "{answer}");
        println!("{effect} after a strong touch: {} {}", answer["predicted"]["target_peak_g"], answer["limits"]);
        assert!(
            answer["limits"].as_array().unwrap().iter().any(|limit| limit["code"] == "still-moving"),
            "{effect}: {answer}"
        );
        has_figures_of(&answer, &answer["device"]["effect"], effect);
        assert!(number(&answer["targets"][0]["wanted_g"]) > 29.0, "{answer}");
    }
    let daemon = Daemon::start(STARTING_PLATE);
    for effect in EFFECTS {
        let quiet = json!([{"x_px": 520, "y_px": 640, "radius_mm": 5, "at_most_g": 0.02}]);
        let also = json!([{"x_px": 1500, "y_px": 640}]);
        for (key, value) in [("quiet", quiet), ("also", also)] {
            rest(&daemon);
            let mut body = json!({"x_px": 480, "y_px": 640, "intensity_g": 0.5, "effect": effect});
            body[key] = value;
            let (status, _, answer) = daemon.post("/v1/touch", &body.to_string());
            assert_eq!(status, 200, "{answer}");
            has_figures_of(&answer, &answer["device"]["effect"], &format!("{effect}, {key}"));
            let targets = answer["targets"].as_array().unwrap();
            assert!(targets.iter().all(|target| number(&target["peak_g"]) > 0.0), "{answer}");
        }
    }
}

/// What the windows of a click do when no finger is there: of a finger that weighs nothing what they do with it, and of a heavy one, whose click is designed
/// for the panel with it, something else. A scene without a finger has no such figures.
#[test]
fn a_click_is_reported_with_and_without_the_finger() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("scene.toml");
    let case = Case { scene: String::new(), at_px: [960.0, 640.0], intensity_g: 0.3, limit: None };
    let click = |finger: &str| {
        std::fs::write(&path, STARTING_PLATE.to_owned() + finger).unwrap();
        oracle(&path, &case, "click")
    };
    assert!(click("")["without_finger"].is_null());
    let light = click("\n[finger]\nmass_g = 1e-6\ndamping_n_s_per_m = 0.0\nstiffness_n_per_m = 0.0\n");
    // Times are those of samples, 1/16 ms apart.
    for (key, by) in [("peak_g", 1e-3), ("peak_at_ms", 0.07), ("quiet_ms", 0.07)] {
        let (with, without) = (number(&light["predicted"][key]), number(&light["without_finger"][key]));
        assert!((with - without).abs() < by, "{key}: {with} with, {without} without");
    }
    assert_eq!(light["without_finger"]["crisp"], light["predicted"]["crisp"]);
    // The daemon's click, designed without the finger, is nearly the same with a finger that weighs nothing.
    for key in ["peak_g", "peak_at_ms"] {
        let (own, daemon) = (number(&light["without_finger"][key]), number(&light["played_by_daemon"][key]));
        assert!((own / daemon - 1.0).abs() < 0.02, "{key}: {own}, by the daemon {daemon}");
    }
    let heavy = click("\n[finger]\nmass_g = 20.0\ndamping_n_s_per_m = 2.0\nstiffness_n_per_m = 800.0\n");
    let (with, without) = (number(&heavy["predicted"]["peak_g"]), number(&heavy["without_finger"]["peak_g"]));
    assert!((with - without).abs() > 0.05 * with, "{with} with, {without} without");
    // The daemon's click is designed without the finger: with the finger it is neither what it is without, nor the click that is designed for it.
    let (bare, daemon) = (number(&click("")["predicted"]["peak_g"]), number(&heavy["played_by_daemon"]["peak_g"]));
    assert!((daemon - bare).abs() > 0.02 * bare && (daemon - with).abs() > 0.02 * with, "{daemon}, {bare}, {with}");
}
