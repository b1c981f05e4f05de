//! Controls that a page declares: it sends places, and the daemon decides what each finger feels.

use crate::fingers::{Socket, live, next, say};
use crate::line::CALM;
use crate::support::Daemon;
use crate::support::described::described;
use era::planner::STANDARD_GRAVITY;
use era::scene::STARTING_PLATE;
use serde_json::{Value, json};
use std::time::Duration;
use tungstenite::Message;

/// Between two messages of a finger: 60 a second.
const MOVE: Duration = Duration::from_millis(16);

fn declare(socket: &mut Socket, controls: &Value) {
    let message = json!({"type": "controls", "controls": controls});
    assert!(described().schema("/components/schemas/LiveIn").is_valid(&message), "{message}");
    say(socket, &message);
}

/// Fingers by their numbers and places along x.
fn down(socket: &mut Socket, fingers: &[(u32, f64)]) {
    let touches: Vec<Value> = fingers.iter().map(|(id, x)| json!({"id": id, "x_px": x, "y_px": 640})).collect();
    say(socket, &json!({"type": "touch", "touches": touches}));
}

/// The next plan: the effect, and number, place and peak of each finger.
fn next_plan(socket: &mut Socket) -> (Value, Vec<(u64, f64, Option<f64>)>) {
    let plan = next(socket, "plan");
    let of = |finger: &Value| {
        (finger["id"].as_u64().unwrap(), finger["x_px"].as_f64().unwrap(), finger["intensity_g"].as_f64())
    };
    (plan["effect"]["name"].clone(), plan["touches"].as_array().unwrap().iter().map(of).collect())
}

fn next_error(socket: &mut Socket) -> Value {
    loop {
        if let Message::Text(text) = socket.read().unwrap() {
            let message: Value = serde_json::from_str(&text).unwrap();
            if message["type"] == "error" {
                return message["problem"].clone();
            }
        }
    }
}

fn button(x_px: u32, intensity_g: f64) -> Value {
    json!({"kind": "button", "x_px": x_px, "y_px": 600, "width_px": 100, "height_px": 100, "intensity_g": intensity_g})
}

#[test]
fn each_detent_of_a_declared_slider_is_felt() {
    let (daemon, _line) = crate::line::daemon(CALM);
    assert_eq!(daemon.post("/v1/arm", "").0, 200);
    let mut socket = live(&daemon, "?send=plan");
    // Its detents are at 302, 402, ..., 1502.
    let slider = json!({"kind": "slider", "x_px": 300, "y_px": 600, "width_px": 1204, "height_px": 80, "detents": 13,
        "intensity_g": 0.2});
    declare(&mut socket, &json!([slider, button(1700, 0.2)]));
    let (mut x, mut next_detent) = (350.0, 402.0);
    while x < 1650.0 {
        down(&mut socket, &[(1, x)]);
        if x >= next_detent && next_detent <= 1502.0 {
            let (effect, fingers) = next_plan(&mut socket);
            assert_eq!((effect, fingers), (json!("click"), vec![(1, x, Some(0.2))]), "the detent at {next_detent}");
            next_detent += 100.0;
        }
        std::thread::sleep(MOVE);
        x += 20.0;
    }
    assert_eq!(next_detent, 1602.0, "the end was felt");
    // Nothing was felt besides, also not when it is lifted: the button is next.
    down(&mut socket, &[]);
    down(&mut socket, &[(1, 1750.0)]);
    assert_eq!(next_plan(&mut socket).1, [(1, 1750.0, Some(0.2))]);
}

#[test]
fn a_button_is_felt_twice_however_short_it_is_pressed() {
    let (daemon, _line) = crate::line::daemon(CALM);
    let mut socket = live(&daemon, "?send=plan");
    let toggle =
        json!({"kind": "toggle", "x_px": 400, "y_px": 600, "width_px": 100, "height_px": 100, "intensity_g": 0.2});
    declare(&mut socket, &json!([button(200, 0.1), toggle]));
    let mut felt = Vec::new();
    for x in [250.0, 450.0, 450.0] {
        down(&mut socket, &[(1, x)]);
        down(&mut socket, &[]);
        for _ in 0..2 {
            let (effect, fingers) = next_plan(&mut socket);
            assert_eq!((&effect, fingers[0].1), (&json!("click"), x));
            felt.push((fingers[0].2.unwrap() * 1e4).round());
        }
    }
    assert_eq!(felt, [1000.0, 600.0, 2000.0, 1200.0, 1200.0, 720.0], "press and release, on, off, in 1e-4 g");
}

/// The board is off, so that the press waits for its self-test and for its rails, and the finger is lifted before that: the release comes after it.
#[test]
fn the_first_press_after_a_rest_is_felt() {
    let mut told = Vec::new();
    // Other programs may hold the computer up.
    for _ in 0..4 {
        let daemon = Daemon::start(STARTING_PLATE);
        let mut socket = live(&daemon, "?send=plan");
        declare(&mut socket, &json!([button(200, 0.2)]));
        down(&mut socket, &[(1, 250.0)]);
        std::thread::sleep(Duration::from_millis(30));
        down(&mut socket, &[]);
        let clicks = [next(&mut socket, "plan"), next(&mut socket, "plan")];
        std::thread::sleep(Duration::from_millis(300));
        told = clicks
            .iter()
            .map(|click| {
                let measured = daemon.sim.peak_of_touch_if_kept(click["plan_id"].as_u64().unwrap());
                let measured_g = measured.map_or(0.0, |peak| peak.peak_m_per_s2 / STANDARD_GRAVITY);
                (measured_g, click["effect"]["predicted"]["peak_least_g"].as_f64().unwrap())
            })
            .collect();
        if told.iter().all(|(measured_g, least_g)| *measured_g > 0.7 * least_g) {
            return;
        }
    }
    panic!("measured and predicted peaks of press and release in g: {told:.3?}");
}

#[test]
fn a_texture_ends_when_nothing_is_said() {
    let (daemon, _line) = crate::line::daemon(CALM);
    let mut socket = live(&daemon, "?send=plan");
    let texture = json!({"kind": "texture", "x_px": 200, "y_px": 600, "width_px": 1500, "height_px": 100, "intensity_g": 0.2,
        "speed_px_s": 200});
    declare(&mut socket, &json!([texture]));
    for times in 0..2 {
        down(&mut socket, &[(1, 300.0)]);
        let mut x = 300.0;
        loop {
            x += 8.0;
            assert!(x < 1600.0, "nothing was felt");
            down(&mut socket, &[(1, x)]);
            std::thread::sleep(MOVE);
            if daemon.state()["plan"].is_object() {
                break;
            }
        }
        let (effect, fingers) = next_plan(&mut socket);
        let peak_g = fingers[0].2.unwrap();
        assert!(effect.is_null() && peak_g > 0.0 && peak_g <= 0.2, "{peak_g}");
        // The finger stays down, and its page says nothing more.
        daemon.wait_for(|state| state["plan"].is_null() && state["device"]["state"] != "running");
        if times == 0 {
            while next_plan_or_end(&mut socket).is_some() {}
        }
    }
}

/// Whether the next message is about a plan that is driven, and not about its end.
fn next_plan_or_end(socket: &mut Socket) -> Option<Value> {
    loop {
        if let Message::Text(text) = socket.read().unwrap() {
            let message: Value = serde_json::from_str(&text).unwrap();
            assert_eq!(message["type"], "plan", "{message}");
            return Some(message).filter(|message| message["plan"].is_object());
        }
    }
}

/// A finger outside vibrates as without controls, and goes on after the click of another one.
#[test]
fn a_finger_outside_of_the_controls_is_driven_as_without_them() {
    let (daemon, _line) = crate::line::daemon(CALM);
    let mut socket = live(&daemon, "?send=plan");
    declare(&mut socket, &json!([button(200, 0.2)]));
    down(&mut socket, &[(1, 900.0)]);
    assert_eq!(next_plan(&mut socket), (json!(null), vec![(1, 900.0, None)]));
    down(&mut socket, &[(1, 900.0), (2, 250.0)]);
    assert_eq!(next_plan(&mut socket), (json!("click"), vec![(2, 250.0, Some(0.2))]));
    assert_eq!(next_plan(&mut socket), (json!(null), vec![(1, 900.0, None)]));
    // One that asks for something itself is on no control.
    let own = json!([{"id": 3, "x_px": 250, "y_px": 640, "effect": "buzz"}]);
    say(&mut socket, &json!({"type": "touch", "touches": own, "intensity_g": 0.1}));
    // The other two were lifted, one of them from its button.
    let (effect, fingers) = next_plan(&mut socket);
    assert!(effect == "buzz" || effect == "click" && next_plan(&mut socket).0 == "buzz", "{effect} {fingers:?}");
}

/// It is lifted after it has pressed the button that stops everything: that drives nothing.
#[test]
fn a_button_that_was_pressed_before_a_stop_is_not_felt_after_it() {
    let (daemon, _line) = crate::line::daemon(CALM);
    let mut socket = live(&daemon, "?send=plan");
    declare(&mut socket, &json!([button(200, 0.2), button(400, 0.1)]));
    down(&mut socket, &[(1, 250.0)]);
    assert_eq!(next_plan(&mut socket).1, [(1, 250.0, Some(0.2))]);
    say(&mut socket, &json!({"type": "stop"}));
    down(&mut socket, &[]);
    daemon.wait_for(|state| state["device"]["state"] == "safe");
    // Longer than a click has for itself: a release that waits would be driven.
    std::thread::sleep(Duration::from_millis(150));
    down(&mut socket, &[(1, 450.0)]);
    assert_eq!(next_plan(&mut socket).1, [(1, 450.0, Some(0.1))]);
    // Neither driven nor overtaken by the second press: there was none.
    let metrics = daemon.get_text("/metrics");
    for count in ["era_touches_total 2", "era_touch_failures_total 0"] {
        assert!(metrics.lines().any(|line| line == count), "no {count:?} in {metrics}");
    }
}

#[test]
fn a_wrong_control_is_named_and_the_former_ones_stay() {
    let (daemon, _line) = crate::line::daemon(CALM);
    let mut socket = live(&daemon, "?send=plan");
    declare(&mut socket, &json!([button(200, 0.2)]));
    let slider = |more: &Value| {
        let mut slider =
            json!({"kind": "slider", "x_px": 300, "y_px": 600, "width_px": 100, "height_px": 80, "detents": 5});
        slider.as_object_mut().unwrap().extend(more.as_object().unwrap().clone());
        json!({"type": "controls", "controls": [button(400, 0.2), slider]})
    };
    for (message, field, kind) in [
        (slider(&json!({"detents": 201})), "controls[1].detents", "out-of-range"),
        (slider(&json!({"detents": 2.5})), "controls[1].detents", "bad-body"),
        (slider(&json!({"x_px": 1921})), "controls[1].x_px", "out-of-range"),
        (slider(&json!({"width_px": "wide"})), "controls[1].width_px", "bad-body"),
        (slider(&json!({"on": true})), "controls[1].on", "bad-body"),
        (slider(&json!({"kind": "knob"})), "controls[1].kind", "bad-body"),
        (slider(&json!({"colour": 1})), "controls[1].colour", "bad-body"),
        (json!({"type": "controls", "controls": [[1, 2]]}), "controls[0]", "bad-body"),
        (json!({"type": "controls", "controls": vec![button(400, 0.2); 65]}), "controls", "out-of-range"),
        (json!({"type": "controls"}), "controls", "bad-body"),
        (json!({"type": "controls", "controls": [], "touches": []}), "touches", "bad-body"),
        (json!({"type": "controls", "controls": [], "effect": "click"}), "effect", "bad-body"),
        (json!({"type": "touch", "touches": [], "controls": []}), "controls", "bad-body"),
    ] {
        say(&mut socket, &message);
        let problem = next_error(&mut socket);
        assert_eq!(
            (&problem["field"], &problem["type"]),
            (&json!(field), &json!(format!("urn:era:problem:{kind}"))),
            "{problem}"
        );
        assert!(problem["detail"].as_str().unwrap().contains(field), "{problem}");
    }
    say(&mut socket, &slider(&json!({"x_px": "NaN"})));
    assert_eq!(next_error(&mut socket)["field"], "controls[1].x_px");
    socket
        .send(Message::text(slider(&json!({"x_px": 1})).to_string().replace("\"x_px\":1,", "\"x_px\":NaN,")))
        .unwrap();
    assert_eq!(next_error(&mut socket)["field"], "controls[1].x_px");
    // The first list still holds, until an empty one comes.
    down(&mut socket, &[(1, 250.0)]);
    assert_eq!(next_plan(&mut socket).1, [(1, 250.0, Some(0.2))]);
    down(&mut socket, &[]);
    assert_eq!(next_plan(&mut socket).0, "click");
    declare(&mut socket, &json!([]));
    down(&mut socket, &[(1, 250.0)]);
    assert_eq!(next_plan(&mut socket), (json!(null), vec![(1, 250.0, None)]));
}

/// They belong to one socket.
#[test]
fn another_page_has_no_controls() {
    let (daemon, _line) = crate::line::daemon(CALM);
    let (mut with, mut without) = (live(&daemon, "?send=plan"), live(&daemon, "?send=plan"));
    declare(&mut with, &json!([button(200, 0.2)]));
    down(&mut with, &[(1, 250.0)]);
    assert_eq!(next_plan(&mut with).0, "click");
    assert_eq!(next_plan(&mut without).0, "click");
    down(&mut without, &[(1, 250.0)]);
    assert_eq!(next_plan(&mut without), (json!(null), vec![(1, 250.0, None)]));
}
