//! Touches that follow each other, on the simulated device in time.

use crate::support;
use era::device::sim::SimPanel;
use era::effects::{EffectRequest, NamedEffect, design_effect};
use era::model::Accuracy;
use era::model::levels::ReducedLevels;
use era::planner::residual::{LIMIT_TOLERANCE, LONGEST_WAIT_S, RailState, ResidualVibration, StartHeadroom};
use era::planner::{Plan, PlanTable, TableOptions, Target};
use era::scene::random::random_scene_text;
use era::scene::{EXAMPLE_BAR, STARTING_PLATE, Scene};
use serde_json::{Value, json};
use std::io::{Read, Write};
use std::time::{Duration, Instant};
use support::Daemon;
use tungstenite::Message;
use turns::{PlannedTurn, SuccessionMode, TurnResult, UnknownFreeMotion, simulate_turns};

mod turns;

/// Most travel in parts of the gap.
const MOST: f64 = (1.0 + LIMIT_TOLERANCE) / 3.0;
/// The travel limit decides everywhere.
const AT_THE_LIMIT_G: f64 = 1e3;

fn table_of(text: &str) -> PlanTable {
    let scene = Scene::parse("succession", text).unwrap();
    let options = TableOptions { step_hz: 4.0, ..TableOptions::default() };
    let levels = ReducedLevels::build(&scene, Accuracy::FAST, options.to_hz).unwrap();
    PlanTable::build(&scene, levels.fine, options).unwrap()
}

fn plan_at(table: &PlanTable, x: f64, y: f64, intensity_g: f64) -> Plan {
    let (x_m, y_m) = (x * table.scene.surface.length_m, y * table.scene.surface.width_m);
    table.plan(&[Target { x_m, y_m, intensity_g: Some(intensity_g) }]).unwrap()
}

fn most(turned: &[TurnResult]) -> f64 {
    turned.iter().flat_map(|turned| &turned.travel).copied().fold(0.0, f64::max)
}

/// Two plans at the limit, 20 ms between them: beyond a third of the gap, or pulled in, if they are sent as they come.
#[test]
fn plans_at_the_limit_stay_within_it_one_after_the_other() {
    let (mut snapped_in, mut weakened) = (0, 0);
    // Both causes: rails that are up, and motion that is left.
    for (number, targets) in [
        (17, [(0.31, 0.62), (0.5, 0.5)]),
        (46, [(0.87, 0.13), (0.5, 0.5)]),
        (283, [(0.31, 0.62), (0.5, 0.5)]),
        (80, [(0.87, 0.13), (0.5, 0.5)]),
    ] {
        let text = random_scene_text(11, number);
        // Without resistors, which come last: they weaken the forces, and these scenes were chosen for what their full forces do.
        let table = table_of(text.split("[electronics]").next().unwrap_or_default());
        let panel = SimPanel::from_plan_table(&table);
        let plans = targets.map(|(x, y)| plan_at(&table, x, y, AT_THE_LIMIT_G));
        let turns: Vec<PlannedTurn<'_>> =
            plans.iter().map(|plan| PlannedTurn { plan, hold_s: 0.6, pause_s: 0.02 }).collect();
        let plainly = simulate_turns(&table, &panel, &turns, SuccessionMode::AtFullForce).unwrap();
        let fitting = simulate_turns(&table, &panel, &turns, SuccessionMode::FittedToHeadroom).unwrap();
        println!(
            "{number}: {:.3} plainly, {:.3} with {:.2?} of the force",
            most(&plainly),
            most(&fitting),
            fitting[1].parts
        );
        assert!(most(&plainly) > 1.0 / 3.0, "scene {number}");
        assert!(most(&fitting) <= MOST, "scene {number}");
        snapped_in += u32::from(most(&plainly) > 0.9);
        weakened += u32::from(fitting[1].parts[0] < 0.9);
        assert!(fitting.iter().all(|turned| turned.room.wait_s <= LONGEST_WAIT_S), "scene {number}");
    }
    assert!(snapped_in >= 1 && weakened >= 3, "{snapped_in} snapped in, {weakened} weaker");
}

/// Random panels, places, lengths and pauses: `ERA_PANELS=90 cargo test -p era-host --test panels succession::random -- --nocapture` tries
/// many more.
#[test]
fn random_successions_stay_within_the_limit() {
    let panels = std::env::var("ERA_PANELS").ok().and_then(|count| count.parse().ok()).unwrap_or(4_u64);
    let (mut followed, mut furthest) = (0, 0.0_f64);
    for number in 0..panels {
        let table = table_of(&random_scene_text(23, number));
        let panel = SimPanel::from_plan_table(&table);
        for start in 0..3_u32 {
            let at = |i: u32, step: f64| (0.5 + step * f64::from(7 * start + i + 1)).fract();
            let request = |i: u32| {
                let (x_m, y_m) = (
                    at(i, 0.754_877_666) * table.scene.surface.length_m,
                    at(i, 0.569_840_291) * table.scene.surface.width_m,
                );
                table.plan(&[Target { x_m, y_m, intensity_g: Some(AT_THE_LIMIT_G) }])
            };
            // A place in a cut-out, or one that nothing moves, has no plan.
            let plans: Vec<Plan> = (0..4).filter_map(|i| request(i).ok()).collect();
            let turn = |(plan, i): (_, u32)| PlannedTurn {
                plan,
                hold_s: [0.016, 0.1, 0.4, 0.7][(start + i) as usize % 4],
                pause_s: [0.0, 0.02, 0.005, 0.1][(2 * start + 3 * i) as usize % 4],
            };
            let turns: Vec<PlannedTurn<'_>> = plans.iter().zip(0..).map(turn).collect();
            let turned = match simulate_turns(&table, &panel, &turns, SuccessionMode::FittedToHeadroom) {
                Ok(turned) => turned,
                Err(UnknownFreeMotion) => continue,
            };
            let after = turned.iter().flat_map(|turned| &turned.travel_after).copied().fold(0.0, f64::max);
            assert!(most(&turned).max(after) <= MOST, "panel {number}, start {start}: {:.3}", most(&turned).max(after));
            followed += 1;
            furthest = furthest.max(most(&turned));
        }
    }
    println!("{followed} successions on {panels} panels, {furthest:.3} of the gap at most");
    assert!(followed > 0 && furthest > 0.5 / 3.0, "{followed} {furthest}");
}

/// A finger that is drawn over a panel, as strong as it goes, a new plan every frame of a page.
#[test]
fn a_drawn_finger_stays_within_the_limit() {
    for number in [46, 80] {
        let table = table_of(&random_scene_text(11, number));
        let plans: Vec<Plan> =
            (0..40).map(|i| plan_at(&table, 0.2 + 0.015 * f64::from(i), 0.4, AT_THE_LIMIT_G)).collect();
        let turns: Vec<PlannedTurn<'_>> =
            plans.iter().map(|plan| PlannedTurn { plan, hold_s: 0.016, pause_s: 0.0 }).collect();
        let fitting =
            simulate_turns(&table, &SimPanel::from_plan_table(&table), &turns, SuccessionMode::FittedToHeadroom)
                .unwrap();
        let plainly =
            simulate_turns(&table, &SimPanel::from_plan_table(&table), &turns, SuccessionMode::AtFullForce).unwrap();
        println!("{number}: {:.3} plainly, {:.3}", most(&plainly), most(&fitting));
        assert!(most(&fitting) <= MOST, "scene {number}");
        // It is felt all the same: 0.28 and more of what the limit allows.
        assert!(most(&fitting) > 0.28 / 3.0, "scene {number}");
    }
}

/// The same on the example panels at usual strengths, then taps in quick succession, then clicks: nothing waits or is weaker.
#[test]
fn ordinary_touches_are_neither_late_nor_weaker() {
    for (text, intensity_g) in [(EXAMPLE_BAR, 0.3), (STARTING_PLATE, 0.2), (EXAMPLE_BAR, 0.6)] {
        let table = table_of(text);
        let mut residual = ResidualVibration::new(table.decay_rate_and_travel_of_each_pole());
        let (mut now_s, mut board, mut took) = (0.0, RailState::Down, Vec::new());
        for i in 0..300_u32 {
            let along = f64::from(i) / 300.0;
            let plan = plan_at(&table, 0.05 + 0.9 * along, 0.5 + 0.4 * (9.0 * along).sin(), intensity_g);
            let begun = Instant::now();
            let motion = table.predict_travel_and_free_motion_of_plan_if_poles_known(&plan).unwrap();
            took.push(begun.elapsed().as_secs_f64() * 1e6);
            let drives = Some(plan.drives.as_slice());
            let room = residual.find_wait_and_force_fraction_within_travel_limits(&motion, drives, now_s, board);
            assert_eq!(room, StartHeadroom::ALL, "touch {i} of {intensity_g} g");
            let is_tap = i >= 200;
            residual.record_drives_that_begin_in_place_of_others(
                u64::from(i),
                &motion,
                drives,
                board,
                now_s,
                now_s + if is_tap { 0.05 } else { 1.0 },
            );
            board = if is_tap { RailState::Up } else { RailState::Driving };
            now_s += if is_tap { 0.1 } else { 0.016 };
        }
        took.sort_by(f64::total_cmp);
        println!(
            "{} poles, {:.0} us for a motion (median)",
            table.decay_rate_and_travel_of_each_pole().len(),
            took[took.len() / 2]
        );
        for i in 0..20_u32 {
            let plan = plan_at(&table, 0.1 + 0.04 * f64::from(i), 0.3, intensity_g);
            let design = design_effect(
                &table,
                table.panel_poles().unwrap(),
                &plan,
                EffectRequest::with_defaults(NamedEffect::Click),
            )
            .unwrap();
            let motion = design.predict_travel_and_free_motion_left_by_effect_if_poles_known(&table).unwrap();
            let room = residual.find_wait_and_force_fraction_within_travel_limits(&motion, None, now_s, RailState::Up);
            assert_eq!(room, StartHeadroom::ALL, "click {i} of {intensity_g} g");
            residual.record_drives_that_begin_in_place_of_others(
                1000 + u64::from(i),
                &motion,
                None,
                RailState::Up,
                now_s,
                now_s + 0.03,
            );
            now_s += 0.15;
        }
    }
}

/// A daemon on a scene.
struct Served {
    daemon: Daemon,
    width_px: f64,
    height_px: f64,
}

impl Served {
    fn start(text: &str) -> Self {
        let daemon = Daemon::start(text);
        let (_, scene) = daemon.get("/v1/scene");
        let [width_px, height_px] = ["width_px", "height_px"].map(|key| scene["screen"][key].as_f64().unwrap());
        Self { daemon, width_px, height_px }
    }

    /// A touch at parts of the screen. A machine that is too busy to say a word to the board within its dead-man time loses it, which is
    /// the board's duty and is not what these tests are about: the fault is cleared, and the touch made again.
    fn touch(&self, x: f64, y: f64, intensity_g: f64, hold_ms: u32) -> (u16, Value) {
        let (x_px, y_px) = (x * self.width_px, y * self.height_px);
        let body = json!({"x_px": x_px, "y_px": y_px, "intensity_g": intensity_g, "duration_ms": hold_ms}).to_string();
        let touch = || self.daemon.post("/v1/touch", &body);
        let was_lost = |answer: &Value| answer["detail"].as_str().is_some_and(|why| why.contains("(host-silent)"));
        let (mut status, _, mut answer) = touch();
        for _ in 0..3 {
            if was_lost(&answer) {
                self.daemon.post("/v1/faults/clear", "");
                (status, _, answer) = touch();
            }
        }
        (status, answer)
    }
}

fn is_still_moving(plan: &Value) -> bool {
    plan["limits"].as_array().unwrap().iter().any(|limit| limit["code"] == "still-moving")
}

/// Over HTTP: the second of two strong touches is weaker at first and says so, and grows to its whole strength while it is held; of
/// two that come together the newer one is driven in the end, and a stop ends it.
#[test]
fn a_touch_that_does_not_fit_is_weaker_at_first() {
    // Without a press: with its stops this scene's plans have room for each other.
    let served = Served::start(&(random_scene_text(11, 68) + "\n[press]\nforce_n = 0.0\n"));
    let touch = |x: f64, y: f64| {
        let (status, answer) = served.touch(x, y, AT_THE_LIMIT_G, 9000);
        assert_eq!(status, 200, "{answer}");
        answer
    };
    let whole = touch(0.31, 0.62);
    assert!(!is_still_moving(&whole) && whole["device"]["delayed_ms"].is_null(), "nothing moved before: {whole}");
    assert_eq!(served.daemon.post("/v1/stop", "").0, 200);
    std::thread::sleep(Duration::from_millis(1500));
    touch(0.87, 0.13);
    // Long enough to be steady.
    std::thread::sleep(Duration::from_millis(600));
    let weaker = touch(0.31, 0.62);
    let peak_g = |answer: &Value| answer["predicted"]["target_peak_g"].as_f64().unwrap();
    assert!(is_still_moving(&weaker) && peak_g(&weaker) < 0.9 * peak_g(&whole), "{weaker}");
    assert!(weaker["limited_by"].as_str().unwrap().contains("motion that remains from earlier touches"), "{weaker}");
    let grown = served.daemon.wait_for(|state| state["plan"].is_object() && !is_still_moving(&state["plan"]));
    assert_eq!(grown["plan_id"], weaker["plan_id"]);
    assert!((peak_g(&grown["plan"]) / peak_g(&whole) - 1.0).abs() < 1e-6, "{grown}");
    assert_eq!(grown["device"]["state"], "running");
    let together: Vec<(u16, Value)> = std::thread::scope(|threads| {
        let touches = [(0.87, 0.13), (0.5, 0.5)].map(|(x, y)| {
            let served = &served;
            threads.spawn(move || served.touch(x, y, AT_THE_LIMIT_G, 9000))
        });
        touches.into_iter().map(|touch| touch.join().unwrap()).collect()
    });
    let driven = together.iter().filter_map(|(status, answer)| match status {
        200 => answer["plan_id"].as_u64(),
        _ => {
            assert_eq!((*status, &answer["type"]), (409, &json!("urn:era:problem:superseded")), "{answer}");
            None
        }
    });
    assert_eq!(served.daemon.state()["plan_id"].as_u64(), driven.max());
    assert_eq!(served.daemon.post("/v1/stop", "").0, 200);
    // What would have grown does not begin again.
    std::thread::sleep(Duration::from_millis(300));
    assert_eq!(served.daemon.state()["plan"], Value::Null);
}

/// What a touch leaves in the panel is there whoever has asked for it, also if its sender has hung up before it was driven: the touch that follows
/// has as much room as after one whose sender listens.
#[test]
fn a_touch_whose_sender_has_gone_is_counted() {
    let served = Served::start(&(random_scene_text(11, 68) + "\n[press]\nforce_n = 0.0\n"));
    let body = json!({
        "x_px": 0.87 * served.width_px, "y_px": 0.13 * served.height_px, "intensity_g": AT_THE_LIMIT_G, "duration_ms": 9000,
    });
    let (body, address) = (body.to_string(), served.daemon.url.trim_start_matches("http://"));
    let length = body.len();
    let room = |listens: bool| {
        let mut stream = std::net::TcpStream::connect(address).unwrap();
        let head = format!("POST /v1/touch HTTP/1.1\r\nHost: localhost\r\nContent-Length: {length}");
        write!(stream, "{head}\r\nConnection: close\r\n\r\n{body}").unwrap();
        if listens {
            let mut answer = String::new();
            stream.read_to_string(&mut answer).unwrap();
            assert!(answer.starts_with("HTTP/1.1 200"), "{answer}");
        } else {
            stream.shutdown(std::net::Shutdown::Both).unwrap();
        }
        served.daemon.wait_for(|state| state["plan"].is_object() && state["device"]["state"] == "running");
        // Long enough to be steady.
        std::thread::sleep(Duration::from_millis(600));
        let (status, second) = served.touch(0.31, 0.62, AT_THE_LIMIT_G, 9000);
        assert!(status == 200 && is_still_moving(&second), "{second}");
        assert_eq!(served.daemon.post("/v1/stop", "").0, 200);
        std::thread::sleep(Duration::from_millis(1500));
        second["predicted"]["target_peak_g"].as_f64().unwrap()
    };
    let (heard_g, unheard_g) = (room(true), room(false));
    // Where nothing is counted it has 3 g.
    assert!((unheard_g - heard_g).abs() < 0.1, "{unheard_g} g, and {heard_g} g after one that listens");
}

/// Usual touches go the same way as ever.
#[test]
fn a_second_ordinary_touch_is_neither_late_nor_weaker() {
    let served = Served::start(STARTING_PLATE);
    for i in 0..6_u32 {
        let (status, answer) = served.touch(0.2 + 0.1 * f64::from(i), 0.4, 0.3, 300);
        assert!(status == 200 && answer["device"]["delayed_ms"].is_null(), "{answer}");
        assert!(!is_still_moving(&answer), "{answer}");
        std::thread::sleep(Duration::from_millis(30 * u64::from(i)));
    }
}

/// On a page: a finger that is lifted while its touch is weaker than it will be is not driven afterwards.
#[test]
fn a_lifted_finger_does_not_grow() {
    let served = Served::start(&random_scene_text(11, 68));
    let url = served.daemon.url.replace("http", "ws");
    let (mut socket, _) = tungstenite::connect(format!("{url}/v1/live")).unwrap();
    let mut say = |fingers: Option<(f64, f64)>| {
        let at = |(x, y)| json!([{"id": 1, "x_px": x * served.width_px, "y_px": y * served.height_px}]);
        let touches = fingers.map_or(json!([]), at);
        let message = json!({"type": "touch", "touches": touches, "intensity_g": AT_THE_LIMIT_G});
        socket.send(Message::text(message.to_string())).unwrap();
    };
    say(Some((0.87, 0.13)));
    let first = served.daemon.wait_for(|state| state["plan_id"].is_number())["plan_id"].clone();
    std::thread::sleep(Duration::from_millis(600));
    say(Some((0.31, 0.62)));
    served.daemon.wait_for(|state| state["plan_id"].as_u64() > first.as_u64());
    say(None);
    std::thread::sleep(Duration::from_millis(900));
    let state = served.daemon.state();
    assert!(state["plan"].is_null() && state["device"]["state"] != "running", "{state}");
    drop(socket);
    let (status, answer) = served.touch(0.5, 0.5, 0.1, 100);
    assert!(status == 200 && answer["plan_id"].as_u64() > first.as_u64(), "{answer}");
}
