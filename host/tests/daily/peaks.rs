//! What is measured of a touch is its own peak, however seldom and by however many it is read.

use crate::fingers::live;
use crate::support::Daemon;
use era::daemon::Recorder;
use era::scene::STARTING_PLATE;
use serde_json::{Value, json};
use std::time::Duration;
use tungstenite::Message;

/// How far a single click may be from its prediction, which is the mean over how the drives' cycles fall: what the prediction says itself of some
/// ways to fall, and what the simulated board was seen to add to that (16 %), twice. Readers that missed the peak were off by 2 to 4 times.
fn range(answer: &Value) -> std::ops::Range<f64> {
    let predicted = &answer["device"]["effect"]["predicted"];
    0.7 * predicted["peak_least_g"].as_f64().unwrap()..1.3 * predicted["peak_most_g"].as_f64().unwrap()
}

/// What the sensor has shown under a touch, in g.
pub fn find_touch_peak_g(telemetry: &Value, plan_id: &Value) -> Option<f64> {
    let mut peaks = telemetry["touch_peaks"].as_array()?.iter();
    peaks.find(|peak| peak["plan_id"] == *plan_id)?["peak_g"].as_f64()
}

fn peak_of(telemetry: &Value, plan_id: &Value) -> f64 {
    find_touch_peak_g(telemetry, plan_id).unwrap_or_else(|| panic!("{plan_id} in {telemetry}"))
}

fn metric(daemon: &Daemon) -> f64 {
    let text = daemon.get_text("/metrics");
    let line =
        text.lines().find(|line| line.starts_with("era_acceleration_peak_g ")).unwrap_or_else(|| panic!("{text}"));
    line.split(' ').nth(1).unwrap().parse().unwrap()
}

/// Clicks of some ms at three strengths and places, read a second after they are over: by two readers of the state, one after the other, by the
/// metrics, by a live socket that reads nothing meanwhile, by its outcome and by the recording. All have the same peak, which is near the predicted one.
#[test]
fn every_client_has_the_peak_of_its_own_touch() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("day.jsonl");
    let mut touched = Vec::new();
    {
        let daemon = Daemon::recording(STARTING_PLATE, Recorder::start(&file, "example plate").unwrap());
        let mut socket = live(&daemon, "?send=state");
        for (x_px, y_px, intensity_g) in [(512, 640, 0.3), (960, 384, 0.4), (1600, 64, 0.1), (512, 640, 0.15)] {
            assert_eq!(daemon.post("/v1/arm", "").0, 200);
            let body = json!({"x_px": x_px, "y_px": y_px, "intensity_g": intensity_g, "effect": "click"}).to_string();
            let (status, _, answer) = daemon.post("/v1/touch", &body);
            assert_eq!(status, 200, "{answer}");
            std::thread::sleep(Duration::from_millis(1200));
            let [first, second] = [daemon.state(), daemon.state()];
            let peak = peak_of(&first["telemetry"], &answer["plan_id"]);
            assert!(
                range(&answer).contains(&peak),
                "{peak} g of {intensity_g} g, {}",
                answer["device"]["effect"]["predicted"]
            );
            println!("{x_px},{y_px}: predicted {}, measured {peak}", answer["predicted"]["target_peak_g"]);
            // Nobody's reading clears another's.
            for telemetry in [&first["telemetry"], &second["telemetry"]] {
                assert_eq!(telemetry["acceleration_peak_g"].as_f64(), Some(peak), "{telemetry}");
                assert_eq!(peak_of(telemetry, &answer["plan_id"]), peak);
            }
            assert_eq!(metric(&daemon), peak);
            // What the sensor shows now is another matter: the click is over.
            assert!(second["telemetry"]["acceleration_recent_g"].as_f64() < Some(0.3 * peak), "{second}");
            touched.push((answer["plan_id"].clone(), peak));
        }
        // A reader that comes late, and touches that follow each other: each has its own.
        for (plan_id, peak) in &touched {
            let told = daemon.get(&format!("/v1/requests/{plan_id}")).1;
            assert_eq!(told["acceleration_peak_g"].as_f64(), Some(*peak), "{told}");
            loop {
                let Message::Text(text) = socket.read().unwrap() else { continue };
                let state: Value = serde_json::from_str(&text).unwrap();
                let all = state["telemetry"]["touch_peaks"].as_array().cloned().unwrap_or_default();
                if all.iter().any(|own| own["plan_id"] == *plan_id && own["peak_g"].as_f64() == Some(*peak)) {
                    break;
                }
            }
        }
    }
    let text = std::fs::read_to_string(&file).unwrap();
    let lines: Vec<Value> = text.lines().map(|line| serde_json::from_str(line).unwrap()).collect();
    for (plan_id, peak) in touched {
        let is_own = |own: &Value| own["plan_id"] == plan_id && own["peak_g"].as_f64() == Some(peak);
        let has = |line: &Value| line["telemetry"]["touch_peaks"].as_array().is_some_and(|all| all.iter().any(is_own));
        assert!(
            lines.iter().any(|line| line["kind"] == "measured" && has(line)),
            "{plan_id} is not recorded with {peak} g"
        );
    }
}

/// A weak click after a strong one elsewhere, as soon as that is over: each has its own peak, and a touch that is refused takes nobody's.
#[test]
fn a_weak_touch_does_not_have_the_peak_of_the_strong_one_before() {
    let daemon = Daemon::start(STARTING_PLATE);
    let click = |x_px: i32, intensity_g: f64| {
        let body = json!({"x_px": x_px, "y_px": 640, "intensity_g": intensity_g, "effect": "click"}).to_string();
        let (status, _, answer) = daemon.post("/v1/touch", &body);
        assert_eq!(status, 200, "{answer}");
        answer
    };
    let strong = click(512, 0.3);
    std::thread::sleep(Duration::from_millis(700));
    let weak = click(1400, 0.03);
    std::thread::sleep(Duration::from_millis(700));
    assert_eq!(daemon.post("/v1/touch", r#"{"x_px": 5000, "y_px": 640}"#).0, 400);
    let state = daemon.state();
    for answer in [&strong, &weak] {
        let peak = peak_of(&state["telemetry"], &answer["plan_id"]);
        assert!(range(answer).contains(&peak), "{peak} g, {}", answer["device"]["effect"]["predicted"]);
    }
    assert_eq!(state["telemetry"]["acceleration_peak_g"], state["telemetry"]["touch_peaks"][0]["peak_g"], "{state}");
    assert_eq!(state["telemetry"]["touch_peaks"][0]["plan_id"], weak["plan_id"]);
}
