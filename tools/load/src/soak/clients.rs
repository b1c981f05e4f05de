//! Clients of every kind, each in a thread of its own.

use super::tally::{RequestAnswer, Tally};
use super::world::{ServingDaemon, SoakState};
use crate::http::{Answer, Endpoint, Http, PATIENCE};
use crate::live::Live;
use fastrand::Rng;
use serde_json::{Value, json};
use std::io;
use std::path::Path;
use std::time::{Duration, Instant};

/// Between two looks whether there is a daemon.
const LOOK: Duration = Duration::from_millis(20);
/// Longest pause of a client between two touches in ms.
const PAUSE_MS: u64 = 150;
/// How long the outcome of an unanswered touch is asked for.
const ASK: Duration = Duration::from_secs(5);
/// One request in so many is a stop, as many are looks at the state, and as many arm the board by hand.
const STOPS: u64 = 40;
/// Most places that a finger goes by before it is lifted.
const MOST_MOVES: u64 = 6;
/// More than there is: the most that a touch may ask for.
const STRONGEST_G: f64 = 1000.0;
/// How long a drag of which a place was refused may still be shown.
const STILL: Duration = Duration::from_secs(1);
/// The starting plate's screen in pixels.
const SCREEN_PX: [u32; 2] = [1920, 1280];

fn pause_randomly(random: &mut Rng) {
    std::thread::sleep(Duration::from_millis(random.u64(0..PAUSE_MS)));
}

/// In eighths of a pixel, which every reader of numbers gets right to the last bit.
fn choose_random_place_px(random: &mut Rng) -> (f64, f64) {
    let [x, y] = SCREEN_PX.map(|side| f64::from(random.u32(0..side * 8)) / 8.0);
    (x, y)
}

/// The body of a touch of any kind; one in fifty is wrong.
fn make_random_touch_sometimes_out_of_range(random: &mut Rng) -> Value {
    let (x_px, y_px) = choose_random_place_px(random);
    let mut touch = json!({"x_px": x_px, "y_px": y_px, "intensity_g": random.f64()});
    match random.u32(0..50) {
        0 => touch["x_px"] = json!(-1),
        1..10 => touch["effect"] = json!(random.choice(["click", "double_click", "buzz", "swell"])),
        10..14 => touch["trade"] = json!(true),
        14..20 => {
            let (x_px, y_px) = choose_random_place_px(random);
            touch["also"] = json!([{"x_px": x_px, "y_px": y_px}]);
            touch["duration_ms"] = json!(random.u32(20..500));
        }
        20 => {
            // As strong as it can be: at one to four places, or where the masses travel farthest. Short, as a channel may drive 10 % of
            // the time so.
            touch["intensity_g"] = json!(STRONGEST_G);
            touch["duration_ms"] = json!(random.u32(50..200));
            if random.bool() {
                touch["objective"] = json!("reach");
            } else {
                let others = (0..random.usize(0..4)).map(|_| choose_random_place_px(random));
                touch["also"] = others.map(|(x_px, y_px)| json!({"x_px": x_px, "y_px": y_px})).collect();
            }
        }
        _ => touch["duration_ms"] = json!(random.u32(20..1500)),
    }
    touch
}

/// Sends touches, one after the other, over TCP or the socket in the file system.
pub fn run_http_client(state: &SoakState, socket: Option<&Path>, client: usize, mut random: Rng) -> Tally {
    let (mut tally, mut known): (Tally, Option<(ServingDaemon, Http)>) = Default::default();
    while !state.should_clients_end() {
        let Some(serving) = state.current_daemon() else {
            std::thread::sleep(LOOK);
            continue;
        };
        let at = socket.map_or(Endpoint::Tcp(serving.address), |path| Endpoint::Unix(path.to_owned()));
        let mut http = match known.take() {
            Some((known, http)) if known == serving => http,
            _ => Http::new(at.clone()),
        };
        let opened = http.opened;
        match random.u64(0..STOPS) {
            0 => {
                count_non_touch_request_if_answered(&mut tally, http.post("/v1/stop", ""));
                // Rails that come up while nothing is driven, and then a touch that finds them up.
                if random.bool() {
                    count_arming_if_answered(&mut tally, &http.post("/v1/arm", ""));
                }
            }
            1 => count_non_touch_request_if_answered(&mut tally, http.get("/v1/state")),
            2 => count_arming_if_answered(&mut tally, &http.post("/v1/arm", "")),
            _ => {
                tally.sent += 1;
                let name = format!("client{client}.{}", tally.sent);
                let (body, begun) = (make_random_touch_sometimes_out_of_range(&mut random).to_string(), Instant::now());
                match http.send_request("POST", "/v1/touch", Some(&name), &body) {
                    Ok(answer) => {
                        tally.times.add_time(begun.elapsed());
                        tally
                            .count_answer(RequestAnswer::from_status(answer.status, &answer.parse_json_body_or_null()));
                    }
                    Err(error) => poll_outcome_of_unanswered_touch_and_count_told_killed_or_lost(
                        state,
                        (serving, at),
                        &name,
                        &error,
                        &mut tally,
                    ),
                }
            }
        }
        // The first connection to a daemon is not a second one.
        tally.reconnects += http.opened - opened.max(1).min(http.opened);
        known = Some((serving, http));
        pause_randomly(&mut random);
    }
    tally
}

fn count_non_touch_request_if_answered(tally: &mut Tally, answer: io::Result<Answer>) {
    tally.others += u64::from(answer.is_ok());
}

/// An answer to `POST /v1/arm`. One that did not come is no loss: arming again does no harm.
fn count_arming_if_answered(tally: &mut Tally, answer: &io::Result<Answer>) {
    if let Ok(answer) = answer {
        tally.count_answer_to_arm_request_by_kind(&RequestAnswer::from_status(
            answer.status,
            &answer.parse_json_body_or_null(),
        ));
    }
}

/// Asks what became of a touch that was not answered, in the way in which it was sent: names are their clients' own.
fn poll_outcome_of_unanswered_touch_and_count_told_killed_or_lost(
    state: &SoakState,
    (serving, at): (ServingDaemon, Endpoint),
    name: &str,
    error: &io::Error,
    tally: &mut Tally,
) {
    let begun = Instant::now();
    let mut http = Http::new(at);
    let mut last = String::from("nothing");
    while begun.elapsed() < ASK {
        if !state.is_current_daemon(serving) {
            tally.killed += 1;
            return;
        }
        match http.get(&format!("/v1/requests/{name}")) {
            Ok(answer) => {
                let told = answer.parse_json_body_or_null();
                if answer.status == 200 && told["state"] != "waiting" {
                    tally.told += 1;
                    return;
                }
                last = String::from_utf8_lossy(&answer.body).chars().take(200).collect();
            }
            Err(error) => last = error.to_string(),
        }
        std::thread::sleep(LOOK);
    }
    tally.record_and_print_lost_touch(format!(
        "{name}: {error} ({:?}); the answer about its outcome: {last}",
        error.kind()
    ));
}

/// Taps and drags on the live socket, one after the other: the last place of each must be driven and shown, or refused.
pub fn run_live_client(state: &SoakState, client: usize, mut random: Rng) -> Tally {
    let (mut tally, mut known): (Tally, Option<(ServingDaemon, Live)>) = Default::default();
    let mut seen = 0;
    while !state.should_clients_end() {
        let Some(serving) = state.current_daemon() else {
            std::thread::sleep(LOOK);
            continue;
        };
        let mut live = match known.take() {
            Some((known, live)) if known == serving => live,
            _ => match Live::open(serving.address, "plan") {
                Ok(live) => {
                    tally.reconnects += u64::from(seen == serving.generation);
                    seen = serving.generation;
                    live
                }
                Err(_) => {
                    std::thread::sleep(LOOK);
                    continue;
                }
            },
        };
        tally.sent += 1;
        let begun = Instant::now();
        match perform_random_gesture_and_await_plan_or_refusal(&mut live, client, &mut random) {
            Ok(answer) => {
                // A drag of which a place was refused is waited for.
                if answer.was_touch_driven() {
                    tally.live_times.add_time(begun.elapsed());
                }
                tally.count_answer(answer);
                known = Some((serving, live));
            }
            Err(error) => {
                // What has been said of a kill is said before it.
                if state.is_current_daemon(serving) {
                    tally.record_and_print_lost_touch(format!("live{client}.{}: {error}", tally.sent));
                } else {
                    tally.killed += 1;
                }
            }
        }
        pause_randomly(&mut random);
    }
    tally
}

/// Puts a finger down, moves it, and lifts it.
fn perform_random_gesture_and_await_plan_or_refusal(
    live: &mut Live,
    client: usize,
    random: &mut Rng,
) -> Result<RequestAnswer, String> {
    let (moves, intensity_g) = (random.u64(0..MOST_MOVES), random.f64());
    let (mut x_px, mut y_px) = choose_random_place_px(random);
    for step in 0..=moves {
        if step > 0 {
            std::thread::sleep(Duration::from_millis(random.u64(2..20)));
            (x_px, y_px) = choose_random_place_px(random);
        }
        let finger = json!({"id": client, "x_px": x_px, "y_px": y_px, "intensity_g": intensity_g});
        live.send(&json!({"type": "touch", "touches": [finger]}))?;
    }
    live.send(&json!({"type": "touch", "touches": []}))?;
    let mut refused = None;
    let mut others = 0_u64;
    let (mut begun, mut patience) = (Instant::now(), PATIENCE);
    while begun.elapsed() < patience {
        let message = match live.read() {
            Ok(message) => message,
            // Whether it was the last place or one before that was refused is not said.
            Err(error) => return refused.ok_or(error),
        };
        if message["type"] == "plan" && message["touches"][0]["x_px"] == json!(x_px) {
            return Ok(RequestAnswer::make_shown_answer_for_plan_on_live_socket());
        }
        others += u64::from(message["type"] == "plan");
        if message["type"] == "error" {
            let problem = &message["problem"];
            let status = problem["status"].as_u64().and_then(|status| u16::try_from(status).ok());
            refused = Some(RequestAnswer::from_status(status.unwrap_or(0), problem));
            if moves == 0 {
                break;
            }
            (begun, patience) = (Instant::now(), STILL);
        }
    }
    refused.ok_or_else(|| {
        format!(
            "neither plan nor error within {} s of {moves} moves, but {others} plans for other clients",
            PATIENCE.as_secs()
        )
    })
}
