//! Time from `POST /v1/touch` to the last byte of the drive's frame at the simulated device.

mod first;

use super::args::Latency;
use super::panel::load_or_compute_plan_table;
use super::serve::open_device;
use super::{CommandResult, Failure, print_json, print_text_after_queued_log};
use crate::daemon::{App, BackgroundDaemon};
use crate::device::Target;
use crate::verify::spread_points;
use serde_json::json;
use std::time::{Duration, Instant};

/// Refused touches that are told and left out; more of them are a failure.
const MOST_REFUSED: usize = 10;
/// Touches that are not counted, while caches and connections warm up.
const WARM_UP: u32 = 20;

pub fn measure_touch_latency_on_simulated_device(options: &Latency) -> CommandResult {
    let (scene, text) = options.panel.load_scene_and_text()?;
    let table = load_or_compute_plan_table(&options.panel, options.keep, &scene)?;
    let device = open_device(&Target::Sim, &table)?;
    let sim = device.sim_control_if_simulated().ok_or_else(|| {
        Failure::runtime_error(
            "the device that `era latency` opened is not the simulated device: please report this message",
        )
    })?;
    let app = App::new(table, device, text).map_err(Failure::runtime_error)?;
    let daemon = BackgroundDaemon::start(app).map_err(Failure::runtime_error)?;
    let base = format!("http://{}", daemon.address());
    let agent: ureq::Agent = ureq::Agent::config_builder()
        .http_status_as_error(false)
        .timeout_global(Some(Duration::from_secs(10)))
        // Its own daemon is asked, whatever proxy the environment names.
        .proxy(None)
        .max_redirects(0)
        .build()
        .into();
    await_device(&agent, &base)?;
    if let Some(clicks) = options.first_clicks {
        return first::measure_first_click_latency_armed_and_unarmed(options, clicks, &scene, &agent, &base);
    }

    let screen = scene.screen;
    let mut points = spread_points(WARM_UP + options.touches, f64::from(screen.width_px), f64::from(screen.height_px));
    points.retain(|(x_px, y_px)| scene.surface_point_at_px(*x_px, *y_px).is_ok());
    let mut to_device = Vec::new();
    let mut to_answer = Vec::new();
    let (mut refused, mut delayed, mut longest_ms) = (Vec::new(), 0_u32, 0.0_f64);
    for (i, (x_px, y_px)) in (0_u32..).zip(points) {
        let started = Instant::now();
        let mut body = json!({"x_px": x_px, "y_px": y_px, "duration_ms": 1000});
        if let Some(intensity_g) = options.intensity_g {
            body["intensity_g"] = intensity_g.into();
        }
        let mut answer = agent.post(format!("{base}/v1/touch")).send_json(body).map_err(Failure::runtime_error)?;
        let answered = started.elapsed();
        if !answer.status().is_success() {
            // Nothing was driven that could be timed. A few are told; more are no measurement.
            let problem: serde_json::Value = answer.body_mut().read_json().unwrap_or_default();
            refused.push(problem["detail"].as_str().unwrap_or("the daemon gave no reason").to_owned());
            if refused.len() > MOST_REFUSED {
                return Err(Failure::runtime_error(format!(
                    "{} of {} touches were refused; the last refusal: {}",
                    refused.len(),
                    i + 1,
                    refused.last().map_or("", String::as_str)
                )));
            }
            continue;
        }
        let answer: serde_json::Value = answer.body_mut().read_json().map_err(Failure::runtime_error)?;
        if let Some(ms) = answer["device"]["delayed_ms"].as_f64().filter(|_| i >= WARM_UP) {
            delayed += 1;
            longest_ms = longest_ms.max(ms);
        }
        let arrived =
            sim.last_drives_received_at().ok_or_else(|| Failure::runtime_error("the device received no drive"))?;
        if i >= WARM_UP {
            to_device.push(arrived.saturating_duration_since(started));
            to_answer.push(answered);
        }
    }
    let (device, answer) = (LatencyFigures::from_durations(to_device), LatencyFigures::from_durations(to_answer));
    if options.json {
        return print_json(&json!({
            "touches": options.touches, "to_device_ms": device.to_json(), "to_answer_ms": answer.to_json(),
            "refused": refused, "delayed": delayed, "delayed_ms_longest": longest_ms,
        }));
    }
    print_text_after_queued_log(&format!(
        "{} touches on {}; the daemon and the simulated device run in one process, and each time in the table \
         includes the planning\n\
         time from POST /v1/touch           median      p99      max\n\
         until the device has all drives  {device}\n\
         until the answer                 {answer}\n\
         touches that waited until earlier vibration had decayed: {delayed} (longest wait: {longest_ms:.1} ms); refused touches: {}",
        options.touches,
        scene.name,
        refused.len()
    ))
}

fn await_device(agent: &ureq::Agent, base: &str) -> CommandResult {
    await_device_state(agent, base, "answer", |device| device["connected"] == true)
}

/// Waits until the simulated device is as wanted, by the state that the daemon tells.
fn await_device_state(
    agent: &ureq::Agent,
    base: &str,
    what: &str,
    is_state_reached: impl Fn(&serde_json::Value) -> bool,
) -> CommandResult {
    let deadline = Instant::now() + Duration::from_secs(10);
    while Instant::now() < deadline {
        let state: serde_json::Value = agent
            .get(format!("{base}/v1/state"))
            .call()
            .map_err(Failure::runtime_error)?
            .body_mut()
            .read_json()
            .map_err(Failure::runtime_error)?;
        if is_state_reached(&state["device"]) {
            return Ok(());
        }
        std::thread::sleep(Duration::from_millis(10));
    }
    Err(Failure::runtime_error(format!("within 10 s, the simulated device did not {what}")))
}

struct LatencyFigures {
    median_ms: f64,
    p99_ms: f64,
    max_ms: f64,
}

impl LatencyFigures {
    fn from_durations(mut times: Vec<Duration>) -> Self {
        times.sort_unstable();
        let at = |percent: usize| {
            let index = (times.len() * percent / 100).min(times.len().saturating_sub(1));
            times.get(index).map_or(f64::NAN, |time| time.as_secs_f64() * 1e3)
        };
        Self { median_ms: at(50), p99_ms: at(99), max_ms: at(100) }
    }

    fn to_json(&self) -> serde_json::Value {
        json!({"median": self.median_ms, "p99": self.p99_ms, "max": self.max_ms})
    }
}

impl std::fmt::Display for LatencyFigures {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{:6.2} ms {:6.2} ms {:6.2} ms", self.median_ms, self.p99_ms, self.max_ms)
    }
}
