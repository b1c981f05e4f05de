//! First clicks of an idle board: how long until one begins, with its rails down and after it was armed ahead.

use super::{LatencyFigures, await_device_state};
use crate::cli::args::Latency;
use crate::cli::{CommandResult, Failure, print_json, print_text_after_queued_log};
use crate::scene::Scene;
use crate::verify::spread_points;
use serde_json::{Value, json};
use std::time::{Duration, Instant};

/// Voltage in V below which rails count as down: what a stop waits for.
const DOWN_V: f64 = 60.0;
/// From the answer to `POST /v1/arm` to the click: a hand that comes near, and rails that rise within 100 ms meanwhile.
const AHEAD: Duration = Duration::from_millis(200);

/// Times `clicks` of them in both ways, by turns, so that a busy moment of the machine meets both.
pub fn measure_first_click_latency_armed_and_unarmed(
    options: &Latency,
    clicks: u32,
    scene: &Scene,
    agent: &ureq::Agent,
    base: &str,
) -> CommandResult {
    let mut points = spread_points(clicks, f64::from(scene.screen.width_px), f64::from(scene.screen.height_px));
    points.retain(|(x_px, y_px)| scene.surface_point_at_px(*x_px, *y_px).is_ok());
    let Some(first) = points.first().copied() else {
        return Err(Failure::runtime_error(format!(
            "the program chose {clicks} points of the screen for the clicks, but none of these points is on the \
            surface: use a larger --first-clicks to get more points"
        )));
    };
    let (mut armed, mut unarmed) = (Vec::new(), Vec::new());
    // The first round is not counted, while caches and connections warm up.
    for (round, (x_px, y_px)) in std::iter::once(first).chain(points).enumerate() {
        for (arms, times) in [(true, &mut armed), (false, &mut unarmed)] {
            post_json_or_fail(agent, &format!("{base}/v1/stop"), &Value::Null)?;
            await_device_state(agent, base, "reach the state `safe` with discharged rails", |device| {
                let rails = device["supply"]["rail_v"].as_array();
                device["state"] == "safe"
                    && rails.is_some_and(|rails| rails.iter().all(|rail| rail.as_f64().is_some_and(|v| v < DOWN_V)))
            })?;
            if arms {
                post_json_or_fail(agent, &format!("{base}/v1/arm"), &Value::Null)?;
                std::thread::sleep(AHEAD);
            }
            let mut click = json!({"x_px": x_px, "y_px": y_px, "effect": "click"});
            if let Some(intensity_g) = options.intensity_g {
                click["intensity_g"] = intensity_g.into();
            }
            let begun = Instant::now();
            let answer = post_json_or_fail(agent, &format!("{base}/v1/touch"), &click)?;
            // The answer comes before the rails have risen.
            let starts_in_ms = answer["device"]["effect"]["starts_in_ms"].as_f64().unwrap_or(0.0);
            if round > 0 {
                times.push(begun.elapsed() + Duration::try_from_secs_f64(starts_in_ms / 1e3).unwrap_or_default());
            }
        }
    }
    let (counted, armed, unarmed) =
        (armed.len(), LatencyFigures::from_durations(armed), LatencyFigures::from_durations(unarmed));
    if options.json {
        return print_json(&json!({
            "first_clicks": counted, "armed_ms": armed.to_json(), "rails_down_ms": unarmed.to_json(),
        }));
    }
    print_text_after_queued_log(&format!(
        "Time from POST /v1/touch until the click starts, for the scene {}; this time includes the planning of the \
        click. Each row is for {counted} clicks. The \
         board was idle before every click. The daemon and the simulated device ran in one process.\n\
         before the click                   median      p99      max\n\
         rails charged by POST /v1/arm   {armed}\n\
         rails discharged                {unarmed}",
        scene.name
    ))
}

fn post_json_or_fail(agent: &ureq::Agent, url: &str, body: &Value) -> Result<Value, Failure> {
    let request = agent.post(url);
    let answer = if body.is_null() { request.send_empty() } else { request.send_json(body) };
    let mut answer = answer.map_err(Failure::runtime_error)?;
    let told: Value = answer.body_mut().read_json().unwrap_or_default();
    if answer.status().is_success() {
        return Ok(told);
    }
    let detail = told["detail"].as_str().unwrap_or("the daemon gave no reason");
    Err(Failure::runtime_error(format!("the request to {url} was refused with {}: {detail}", answer.status())))
}
