//! How long touches take: `era latency`, which touches that are held back or refused do not end, and what keeps the link from them.

use crate::support::Daemon;
use crate::support::program::{run_era, run_era_json};
use era::scene::STARTING_PLATE;
use serde_json::{Value, json};
use std::time::Instant;

/// Waits for what is left of touches before are counted and told apart, as they are no latency, and refused touches end nothing. Weak touches
/// wait for nothing, and strong ones that follow each other all over the panel do.
#[test]
fn the_latency_of_weak_touches_is_measured() {
    let told = |touches: &str, intensity_g: &str| -> Value {
        run_era_json(&[
            "latency",
            "--touches",
            touches,
            "--intensity-g",
            intensity_g,
            "--accuracy",
            "fast",
            "--no-cache",
            "--json",
        ])
    };
    let (weak, strong) = (told("40", "0.1"), told("200", "1.3"));
    assert_eq!((&weak["refused"], &weak["delayed"], &weak["delayed_ms_longest"]), (&json!([]), &json!(0), &json!(0.0)));
    assert!(strong["delayed"].as_u64() > Some(0), "{strong}");
    let ms = |told: &Value, path: &str| told.pointer(path).and_then(Value::as_f64).unwrap();
    for told in [&weak, &strong] {
        // The frame leaves before the answer comes, and no touch waits longer for its frame than the longest.
        assert!(ms(told, "/to_device_ms/median") <= ms(told, "/to_answer_ms/median"), "{told}");
        assert!(ms(told, "/to_device_ms/median") <= ms(told, "/to_device_ms/max"), "{told}");
        assert!(ms(told, "/to_device_ms/median") > 0.0, "{told}");
    }
    let longest = ms(&strong, "/to_device_ms/max");
    assert!(longest >= ms(&strong, "/delayed_ms_longest"), "what is waited for is in its touch's time: {strong}");
}

/// Without a touch there is no median, and with the warm-up the largest number of 32 bits is no number any more.
#[test]
fn the_number_of_touches_has_a_range() {
    for touches in ["0", "1000001", "4294967295"] {
        let out = run_era(&["latency", "--touches", touches]);
        let error = &out.error;
        assert_eq!(out.code, Some(2), "{error}");
        assert!(error.contains("--touches") && error.contains("1..=1000000"), "{error}");
    }
}

/// First clicks are timed in both ways, and none is lost on the way: with the rails down, and after the board was armed.
#[test]
fn first_clicks_are_timed_armed_and_not() {
    let told = run_era_json(&["latency", "--first-clicks", "3", "--accuracy", "fast", "--no-cache", "--json"]);
    let ms = |path: &str| told.pointer(path).and_then(Value::as_f64).unwrap();
    assert_eq!(told["first_clicks"], 3);
    for way in ["armed_ms", "rails_down_ms"] {
        let [median, most] = ["median", "max"].map(|figure| ms(&format!("/{way}/{figure}")));
        assert!(0.0 < median && median <= most, "{told}");
    }
}

/// A look at the board's state is four requests, which the next touch would have to wait for: touches that follow each other quickly have
/// one now and then, and not one each.
#[test]
fn touches_that_follow_each_other_are_not_held_up_by_looks() {
    const TOUCHES: u32 = 60;
    /// Less than from one look for a drive to the next, between two signs of life and two samples of the clock after connecting.
    const LOOK_MS: u32 = 15;
    const OTHERS_MS: u32 = 15;
    let daemon = Daemon::start(STARTING_PLATE);
    let touch = |k: u32| json!({"x_px": 300 + k, "y_px": 640, "intensity_g": 0.1, "duration_ms": 500}).to_string();
    assert_eq!(daemon.post("/v1/touch", &touch(0)).0, 200);
    // Repeats are the busy machine's.
    let asked = |state: &Value| {
        let count = |name: &str| state["link"][name].as_u64().unwrap();
        count("frames_sent") - count("repeats")
    };
    // What is told is as old as the last look: after the next one all that arming took is in it.
    let armed = asked(&daemon.state());
    let (before, begun) = (asked(&daemon.wait_for(|state| asked(state) > armed)), Instant::now());
    for k in 1..=TOUCHES {
        assert_eq!(daemon.post("/v1/touch", &touch(k)).0, 200);
    }
    let after = asked(&daemon.wait_for(|state| asked(state) >= before + u64::from(TOUCHES)));
    let ms = u32::try_from(begun.elapsed().as_millis()).unwrap();
    // Before the first count and after the last there may be a look each; whatever else is asked, once more than there was time for.
    let most = TOUCHES + 4 * (ms / LOOK_MS + 2) + ms / OTHERS_MS + 2;
    assert!(after - before <= u64::from(most), "{} requests for {TOUCHES} touches in {ms} ms", after - before);
}
