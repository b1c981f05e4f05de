//! Commands that talk to a running daemon.

use super::args::{Daemon, Touch};
use super::{Failure, Outcome, print_json, print_text};
use serde_json::{Value, json};
use std::fmt::Write;
use std::time::Duration;

/// An emulated board may take some seconds to answer.
const PATIENCE: Duration = Duration::from_secs(30);

pub fn touch(options: &Touch) -> Outcome {
    let mut body = json!({"x_px": options.x_px, "y_px": options.y_px});
    if let Some(map) = body.as_object_mut() {
        map.extend(options.intensity_g.map(|value| ("intensity_g".to_owned(), value.into())));
        map.extend(options.duration_ms.map(|value| ("duration_ms".to_owned(), value.into())));
        map.extend(options.intensity_db.map(|value| ("intensity_db".to_owned(), value.into())));
        map.extend(options.rhythm.count.map(|value| ("count".to_owned(), value.into())));
        map.extend(options.rhythm.period_ms.map(|value| ("period_ms".to_owned(), value.into())));
        map.extend(options.effect.map(|effect| ("effect".to_owned(), json!(effect))));
    }
    let answer = call(&options.daemon, "POST", "/v1/touch", Some(body))?;
    if options.daemon.json {
        return print_json(&answer);
    }
    let mut text = String::new();
    for drive in answer["drives"].as_array().into_iter().flatten() {
        let _ = writeln!(
            text,
            "{:12} {:7.2} Hz  {:7.1} V",
            drive["actuator"].as_str().unwrap_or("?"),
            number(&drive["frequency_hz"]),
            number(&drive["voltage_v"]),
        );
    }
    let predicted = &answer["predicted"];
    let _ = write!(
        text,
        "predicted {:.3} g at the target, contrast {:.1} dB",
        number(&predicted["target_peak_g"]),
        number(&predicted["contrast_db"]),
    );
    if let Some(limit) = answer["limited_by"].as_str() {
        let _ = write!(text, "; limited by {limit}");
    }
    let effect = &answer["device"]["effect"];
    if let Some(name) = effect["name"].as_str() {
        let (length, peak) = (number(&effect["duration_ms"]), number(&effect["predicted"]["peak_g"]));
        let _ = write!(text, "\n{name} of {length:.0} ms, peak {peak:.3} g");
    }
    print_text(&text)
}

pub fn stop(options: &Daemon) -> Outcome {
    let answer = call(options, "POST", "/v1/stop", None)?;
    show_state(options, &answer)
}

pub fn state(options: &Daemon) -> Outcome {
    let answer = call(options, "GET", "/v1/state", None)?;
    show_state(options, &answer)
}

fn show_state(options: &Daemon, answer: &Value) -> Outcome {
    if options.json {
        return print_json(answer);
    }
    let device = &answer["device"];
    let text_of = |value: &Value| value.as_str().unwrap_or("unknown").to_owned();
    let mut text =
        format!("device {} at {}: {}", text_of(&device["kind"]), text_of(&device["port"]), text_of(&device["state"]));
    if device["connected"] == false {
        let _ = write!(text, " (not connected: {})", text_of(&device["problem"]));
    }
    if !device["fault"].is_null() {
        let _ = write!(text, "\nfault {}: {}", device["fault"]["code"], text_of(&device["fault"]["message"]));
    }
    let clock = &device["clock"];
    if !clock.is_null() {
        let _ = write!(
            text,
            "\nclock of the board: {:+.1} ppm, known to {:.0} us rms ({:.0} us at worst)",
            number(&clock["rate_ppm"]),
            number(&clock["residual_rms_us"]),
            number(&clock["residual_worst_us"]),
        );
    }
    for channel in answer["telemetry"]["channels"].as_array().into_iter().flatten() {
        let name = text_of(&channel["actuator"]);
        if channel["active"] == true {
            let _ = write!(
                text,
                "\n  {name:12} {:7.2} Hz  {:7.1} V",
                number(&channel["frequency_hz"]),
                number(&channel["voltage_v"])
            );
        } else {
            let _ = write!(text, "\n  {name:12} off");
        }
    }
    print_text(&text)
}

fn number(value: &Value) -> f64 {
    value.as_f64().unwrap_or(f64::NAN)
}

/// Calls the daemon; a problem it reports becomes the command's error.
fn call(daemon: &Daemon, method: &str, path: &str, body: Option<Value>) -> Result<Value, Failure> {
    let agent: ureq::Agent =
        ureq::Agent::config_builder().http_status_as_error(false).timeout_global(Some(PATIENCE)).build().into();
    let url = format!("{}{path}", daemon.url.trim_end_matches('/'));
    let sent = match (method, body) {
        ("GET", _) => agent.get(&url).call(),
        (_, Some(body)) => agent.post(&url).send_json(body),
        (_, None) => agent.post(&url).send_empty(),
    };
    let mut answer = sent.map_err(|error| {
        Failure::failed(format!("no answer from {url}: {error}. Does the daemon run? `era serve` starts it"))
    })?;
    let status = answer.status();
    let value: Value = answer.body_mut().read_json().map_err(|error| {
        Failure::failed(format!("{url} answered {status}, but not with JSON ({error}): is it an era daemon?"))
    })?;
    if status.is_success() {
        return Ok(value);
    }
    let detail = value["detail"].as_str().unwrap_or("no reason given").to_owned();
    Err(if status.is_client_error() && status.as_u16() == 400 {
        Failure::Usage(detail)
    } else {
        Failure::Failed(detail)
    })
}
