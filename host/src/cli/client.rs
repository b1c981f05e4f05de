//! Commands that talk to a running daemon.

use super::args::{DaemonOptions, Touch};
use super::token::read_token_from_file_or_else_environment;
use super::wishes::{AdditionalTarget, QuietZoneOption};
use super::{CommandResult, Failure, print_json, print_text_after_queued_log};
use crate::certificate;
use crate::connection::{DaemonRoute, HostPort, client_config, describe_redirect};
use crate::daemon::{OtherTarget, QuietZone, TouchRequest};
use crate::doctor::reach::RequestTrouble;
use crate::effects::NamedEffect;
use crate::planner::Weigh;
use serde_json::{Value, json};
use std::fmt::Write;
use std::path::Path;
use std::time::Duration;

/// An emulated board may take some seconds to answer.
const PATIENCE: Duration = Duration::from_secs(30);

pub fn send_touch_to_daemon_and_print_answer(options: &Touch) -> CommandResult {
    let answer =
        request_body_failing_on_error_status(&options.daemon, "POST", "/v1/touch", Some(make_touch_body(options)))?;
    if options.daemon.json {
        return print_json(&answer);
    }
    print_text_after_queued_log(&format_touch_answer(&answer))
}

/// The request; what was not given is left out, so that the daemon's defaults hold.
fn make_touch_body(options: &Touch) -> Value {
    let wishes = &options.wishes;
    let request = TouchRequest {
        x_px: options.x_px,
        y_px: options.y_px,
        intensity_g: options.intensity_g,
        intensity_db: options.intensity_db,
        duration_ms: options.duration_ms,
        effect: options.effect,
        count: options.rhythm.count,
        period_ms: options.rhythm.period_ms,
        crisp_ms: options.crispness.crisp_ms,
        prefer: options.crispness.prefer,
        from_ms: wishes.window.map(|window| window.from_ms),
        to_ms: wishes.window.map(|window| window.to_ms),
        also: (!wishes.also.is_empty()).then(|| {
            let target = |also: &AdditionalTarget| OtherTarget {
                x_px: also.at.x,
                y_px: also.at.y,
                intensity_g: also.intensity_g,
                from_ms: also.window.map(|window| window.from_ms),
                to_ms: also.window.map(|window| window.to_ms),
            };
            wishes.also.iter().map(target).collect()
        }),
        quiet: (!wishes.quiet.is_empty()).then(|| {
            let zone = |zone: &QuietZoneOption| QuietZone {
                x_px: zone.at.x,
                y_px: zone.at.y,
                radius_mm: zone.radius_mm,
                at_most_g: zone.at_most_g,
            };
            wishes.quiet.iter().map(zone).collect()
        }),
        objective: Some(wishes.objective),
        grouping: Some(wishes.grouping),
        weigh: Some(wishes.weigh).filter(|weigh| *weigh != Weigh::default()),
        trade: options.trade.then_some(true),
    };
    let mut body = json!(request);
    let leave_out_nulls = |value: &mut Value| {
        if let Some(map) = value.as_object_mut() {
            map.retain(|_, value| !value.is_null());
        }
    };
    body["also"].as_array_mut().into_iter().flatten().for_each(leave_out_nulls);
    leave_out_nulls(&mut body);
    body
}

/// What is driven, and what it should do; of an effect its own drives, which are not those of the steady plan.
fn format_touch_answer(answer: &Value) -> String {
    let mut text = String::new();
    let effect = &answer["device"]["effect"];
    let drives = if effect.is_object() { &effect["drives"] } else { &answer["drives"] };
    write_drives(&mut text, drives);
    let predicted = &answer["predicted"];
    let text_of = |value: &Value| value.as_str().map(str::to_owned);
    match text_of(&effect["name"]) {
        Some(name) => {
            let played = &effect["predicted"];
            let windows = effect["windows"].as_array().map_or(0, Vec::len);
            let _ = write!(
                text,
                "{name} of {:.0} ms, peak {:.3} g",
                read_number_or_nan(&effect["duration_ms"]),
                read_number_or_nan(&played["peak_g"]),
            );
            let _ = match windows {
                0 => write!(
                    text,
                    " ({:.3} to {:.3} g, depending on the phases of the drives)",
                    read_number_or_nan(&played["peak_least_g"]),
                    read_number_or_nan(&played["peak_most_g"]),
                ),
                _ => write!(
                    text,
                    " in the felt band (up to 500 Hz; an accelerometer shows {:.3} g below 1 kHz); {windows} \
                     electrode windows",
                    read_number_or_nan(&played["peak_most_g"]),
                ),
            };
            if name == NamedEffect::DoubleClick.name() && windows > 0 {
                let weaker_g = read_number_or_nan(&played["peak_least_g"]);
                let _ = write!(text, "; peak of the weaker one of the two clicks: {weaker_g:.3} g");
            }
            if let Some(limit) = text_of(&effect["limited_by"]) {
                let _ = write!(text, "; limited by {limit}");
            }
        }
        None => {
            let _ = write!(
                text,
                "predicted {:.3} g at the target, contrast {:.1} dB",
                read_number_or_nan(&predicted["target_peak_g"]),
                read_number_or_nan(&predicted["contrast_db"]),
            );
            if let Some(limit) = text_of(&answer["limited_by"]) {
                let _ = write!(text, "; limited by {limit}");
            }
        }
    }
    let targets = answer["targets"].as_array().map(Vec::as_slice).unwrap_or_default();
    for target in targets.iter().filter(|_| targets.len() > 1) {
        let of = |name: &str| read_number_or_nan(&target[name]);
        let (x, y, peak, wanted) = (of("x_mm"), of("y_mm"), of("peak_g"), of("wanted_g"));
        let _ = write!(text, "\n  target at {x:.1} mm, {y:.1} mm: {peak:.3} g ({wanted:.3} g requested)");
    }
    for stretch in answer["stretches"].as_array().into_iter().flatten() {
        let _ = write!(
            text,
            "\n{:.0} to {:.0} ms:",
            read_number_or_nan(&stretch["from_ms"]),
            read_number_or_nan(&stretch["to_ms"])
        );
        match stretch["plan"]["targets"].as_array() {
            None => text.push_str(" no drives"),
            Some(targets) => {
                let peaks: Vec<String> =
                    targets.iter().map(|t| format!("{:.3} g", read_number_or_nan(&t["peak_g"]))).collect();
                let _ = write!(text, " {}", peaks.join(", "));
            }
        }
    }
    if !answer["trade"].is_null() {
        text.push_str("\nthe requested peaks and quiet zones conflict; --json prints alternatives in the key `trade`");
    }
    text
}

fn write_drives(text: &mut String, drives: &Value) {
    for drive in drives.as_array().into_iter().flatten() {
        let _ = writeln!(
            text,
            "{:12} {:7.2} Hz  {:7.1} V",
            drive["actuator"].as_str().unwrap_or("?"),
            read_number_or_nan(&drive["frequency_hz"]),
            read_number_or_nan(&drive["voltage_v"]),
        );
    }
}

pub fn send_stop_to_daemon_and_print_state(options: &DaemonOptions) -> CommandResult {
    let answer = request_body_failing_on_error_status(options, "POST", "/v1/stop", None)?;
    print_state(options, &answer)
}

pub fn clear_faults_through_daemon_and_print_state(options: &DaemonOptions) -> CommandResult {
    let answer = request_body_failing_on_error_status(options, "POST", "/v1/faults/clear", None)?;
    print_state(options, &answer)
}

pub fn arm_device_through_daemon_and_print_state(options: &DaemonOptions) -> CommandResult {
    let answer = request_body_failing_on_error_status(options, "POST", "/v1/arm", None)?;
    print_state(options, &answer)
}

pub fn show_device_state(options: &DaemonOptions) -> CommandResult {
    let answer = request_body_failing_on_error_status(options, "GET", "/v1/state", None)?;
    print_state(options, &answer)
}

fn print_state(options: &DaemonOptions, answer: &Value) -> CommandResult {
    if options.json {
        return print_json(answer);
    }
    print_text_after_queued_log(&format_state(answer))
}

/// The device, its fault, its clock and its channels.
fn format_state(answer: &Value) -> String {
    let device = &answer["device"];
    let text_of = |value: &Value| value.as_str().unwrap_or("unknown").to_owned();
    let mut text =
        format!("device {} at {}: {}", text_of(&device["kind"]), text_of(&device["port"]), text_of(&device["state"]));
    if device["connected"] == false {
        let _ = write!(text, " (not connected: {})", text_of(&device["problem"]));
    }
    if !device["fault"].is_null() {
        let fault = &device["fault"];
        let _ = write!(
            text,
            "\nfault {} ({}): {} `era clear` clears the fault",
            fault["code"],
            text_of(&fault["name"]),
            text_of(&fault["message"])
        );
    }
    if device["waits_to_be_armed"] == true {
        text.push_str("\nthe device had an outage, and nothing is driven until `era arm` arms the device");
    }
    let clock = &device["clock"];
    if !clock.is_null() {
        let _ = write!(
            text,
            "\nclock of the board: {:+.1} ppm relative to the clock of the daemon's computer; error of the \
             predicted board time {:.0} us rms, {:.0} us at most",
            read_number_or_nan(&clock["rate_ppm"]),
            read_number_or_nan(&clock["residual_rms_us"]),
            read_number_or_nan(&clock["residual_worst_us"]),
        );
    }
    for (i, channel) in (1..).zip(answer["telemetry"]["channels"].as_array().into_iter().flatten()) {
        // A board may have more channels than the scene has actuators.
        let name = channel["actuator"].as_str().map_or_else(|| format!("(channel {i})"), str::to_owned);
        if channel["active"] == true {
            let _ = write!(
                text,
                "\n  {name:12} {:7.2} Hz  {:7.1} V",
                read_number_or_nan(&channel["frequency_hz"]),
                read_number_or_nan(&channel["voltage_v"])
            );
        } else {
            let _ = write!(text, "\n  {name:12} off");
            if channel["actuator"].is_null() {
                text.push_str("; the scene has no actuator for this channel");
            }
        }
    }
    text
}

fn read_number_or_nan(value: &Value) -> f64 {
    value.as_f64().unwrap_or(f64::NAN)
}

/// How a command asks its daemon.
pub struct DaemonContact {
    /// Over which connections.
    pub way: DaemonRoute,
    /// Value of the header `Authorization`, if there is a token.
    pub bearer: Option<String>,
}

impl DaemonContact {
    /// As the options say.
    ///
    /// # Errors
    /// A file that cannot be used, or a token that would go through a proxy for everybody there to read.
    pub fn from_options_refusing_token_over_proxy_without_tls(daemon: &DaemonOptions) -> Result<Self, Failure> {
        let token = read_token_from_file_or_else_environment(daemon.token_file.as_deref())?;
        Self::new(&daemon.url, daemon.ca.as_deref(), daemon.proxy.as_ref(), token)
    }

    /// The same for who finds its token elsewhere.
    ///
    /// # Errors
    /// As [`Self::from_options_refusing_token_over_proxy_without_tls`].
    pub fn new(url: &str, ca: Option<&Path>, proxy: Option<&HostPort>, token: Option<String>) -> Result<Self, Failure> {
        if proxy.is_some() && token.is_some() && !url.starts_with("https://") {
            return Err(Failure::Usage(format!(
                "with --proxy, a token is sent only over TLS, because the proxy can read what is sent without TLS: use \
                 an https:// address in place of {url}, or omit --proxy"
            )));
        }
        let given = ca.map_or_else(
            || Ok(Vec::new()),
            |path| {
                certificate::read_certificates(path)
                    .map_err(|error| Failure::Usage(format!("{}: {error}", path.display())))
            },
        )?;
        let tls = client_config(given).map_err(Failure::Usage)?;
        Ok(Self {
            way: DaemonRoute { tls, proxy: proxy.cloned() },
            bearer: token.map(|token| format!("Bearer {token}")),
        })
    }
}

fn add_bearer_token<B>(request: ureq::RequestBuilder<B>, header_value: Option<String>) -> ureq::RequestBuilder<B> {
    match header_value {
        Some(header_value) => request.header("Authorization", header_value),
        None => request,
    }
}

/// What the daemon answers.
#[derive(Clone, Debug)]
pub struct DaemonAnswer {
    /// HTTP status.
    pub status: u16,
    /// Its JSON.
    pub body: Value,
}

/// Asks the daemon.
///
/// # Errors
/// That there was no answer, or none of a daemon's.
pub fn request_json_answer_of_any_status_but_redirect(
    daemon: &DaemonOptions,
    method: &str,
    path: &str,
    body: Option<Value>,
) -> Result<DaemonAnswer, Failure> {
    let DaemonContact { way, bearer } = DaemonContact::from_options_refusing_token_over_proxy_without_tls(daemon)?;
    let agent = way.make_agent(PATIENCE);
    let url = format!("{}{path}", daemon.url);
    let sent = match (method, body) {
        ("GET", _) => add_bearer_token(agent.get(&url), bearer).call(),
        (_, Some(body)) => add_bearer_token(agent.post(&url), bearer).send_json(body),
        (_, None) => add_bearer_token(agent.post(&url), bearer).send_empty(),
    };
    let mut answer = sent.map_err(|error| {
        match RequestTrouble::find_trouble_probing_address_for_tls(&error, &daemon.url, daemon.proxy.is_some())
            .describe_with_advice(&daemon.url, daemon.ca.is_some())
        {
            Some((found, advice)) => Failure::runtime_error(format!("{found}: {advice}")),
            None => Failure::runtime_error(format!(
                "no answer from {url}: {error}. Check that the daemon runs; `era serve` starts the daemon"
            )),
        }
    })?;
    let status = answer.status();
    if status.is_redirection() {
        let location = answer.headers().get("location").map(|value| String::from_utf8_lossy(value.as_bytes()));
        let (found, advice) = describe_redirect(&daemon.url, path, status.as_u16(), location.as_deref());
        return Err(Failure::runtime_error(format!("{found}: {advice}")));
    }
    let body: Value = answer.body_mut().read_json().map_err(|error| {
        Failure::runtime_error(format!(
            "{url} answered with the status {status}, but the answer is not JSON ({error}): check that this \
             is the address of an era daemon"
        ))
    })?;
    Ok(DaemonAnswer { status: status.as_u16(), body })
}

/// Calls the daemon; a problem it reports becomes the command's error.
///
/// # Errors
/// As [`request_json_answer_of_any_status_but_redirect`], and the problem.
pub fn request_body_failing_on_error_status(
    daemon: &DaemonOptions,
    method: &str,
    path: &str,
    body: Option<Value>,
) -> Result<Value, Failure> {
    let DaemonAnswer { status, body } = request_json_answer_of_any_status_but_redirect(daemon, method, path, body)?;
    if (200..300).contains(&status) {
        return Ok(body);
    }
    let no_reason = || format!("the daemon answered with the status {status} and gave no reason");
    let mut detail = body["detail"].as_str().map_or_else(no_reason, str::to_owned);
    if status == 401 {
        detail.push_str(" (use --token-file FILE, or the environment variable ERA_TOKEN)");
    }
    Err(if status == 400 { Failure::Usage(detail) } else { Failure::Failed(detail) })
}

#[cfg(test)]
mod tests {
    use super::super::command::{Arguments, Command};
    use super::super::values::{hide_secret_parts, parse_daemon_url_adding_http_if_no_scheme};
    use super::*;
    use clap::Parser;

    #[test]
    fn an_address_may_leave_the_scheme_out() {
        for text in ["127.0.0.1:7878", "http://127.0.0.1:7878", "HTTP://127.0.0.1:7878/"] {
            assert_eq!(parse_daemon_url_adding_http_if_no_scheme(text).as_deref(), Ok("http://127.0.0.1:7878"));
        }
        assert_eq!(
            parse_daemon_url_adding_http_if_no_scheme("https://panel:7878/").as_deref(),
            Ok("https://panel:7878")
        );
        assert!(
            parse_daemon_url_adding_http_if_no_scheme("ftp://panel")
                .unwrap_err()
                .contains("must begin with http:// or https://")
        );
        assert!(parse_daemon_url_adding_http_if_no_scheme("http://").unwrap_err().contains("HOST:PORT"));
        // As copied from a browser, or with a password: a stop would go elsewhere, and what is secret is not repeated.
        for text in
            ["http://panel:7878/#token=secret", "http://panel:7878/?token=secret", "http://me:secret@panel:7878"]
        {
            let told =
                format!("{} {}", parse_daemon_url_adding_http_if_no_scheme(text).unwrap_err(), hide_secret_parts(text));
            assert!(told.contains("HOST:PORT") && told.contains("panel:7878") && !told.contains("secret"), "{told}");
        }
    }

    #[test]
    fn a_touch_asks_for_what_was_given_and_nothing_else() {
        let body = |rest: &str| {
            let arguments = format!("era touch 960 640 {rest}");
            match Arguments::parse_from(arguments.split_whitespace()).command {
                Some(Command::Touch(touch)) => make_touch_body(&touch),
                other => panic!("{other:?}"),
            }
        };
        let plain = json!({"x_px": 960.0, "y_px": 640.0, "objective": "contrast", "grouping": "distinct"});
        assert_eq!(body(""), plain);
        let many = body("--also 10,20:0.2:100-300 --also 5,6 --quiet 100,200:15:0.02 --grouping shared --trade");
        let also = json!([
            {"x_px": 10.0, "y_px": 20.0, "intensity_g": 0.2, "from_ms": 100.0, "to_ms": 300.0},
            {"x_px": 5.0, "y_px": 6.0},
        ]);
        assert_eq!(many["also"], also);
        let quiet = json!([{"x_px": 100.0, "y_px": 200.0, "radius_mm": 15.0, "at_most_g": 0.02}]);
        assert_eq!(body("--weigh felt")["weigh"], "felt");
        assert_eq!((&many["quiet"], &many["grouping"], &many["trade"]), (&quiet, &json!("shared"), &json!(true)));
    }

    #[test]
    fn channels_without_an_actuator_and_faults_are_reported() {
        let channel = |name: Option<&str>| json!({"actuator": name, "active": false});
        let fault = json!({"code": 0, "name": "host-silent", "message": "Check the cable."});
        let state = json!({
            "device": {
                "kind": "emulated", "port": "/dev/pts/1", "state": "fault", "fault": fault, "waits_to_be_armed": true,
            },
            "telemetry": {"channels": [channel(Some("left")), channel(None)]},
        });
        let text = format_state(&state);
        assert!(text.contains("\n  left         off\n  (channel 2)  off; the scene has no actuator"), "{text}");
        assert!(text.contains("fault 0 (host-silent): Check the cable. `era clear` clears the fault\n"), "{text}");
        assert!(text.contains("\nthe device had an outage, and nothing is driven until `era arm`"), "{text}");
    }

    #[test]
    fn of_a_board_that_is_gone_nothing_is_reported_as_if_it_were_there() {
        let device =
            json!({"kind": "serial", "port": "/dev/ttyACM0", "state": null, "connected": false, "problem": "silent"});
        let text = format_state(&json!({"device": device, "telemetry": null}));
        assert_eq!(text, "device serial at /dev/ttyACM0: unknown (not connected: silent)");
    }

    #[test]
    fn an_effect_is_reported_with_its_own_drives() {
        let drive = |volts: f64| json!([{"actuator": "left", "frequency_hz": 268.0, "voltage_v": volts}]);
        let mut answer = json!({
            "drives": drive(911.9), "predicted": {"target_peak_g": 0.5, "contrast_db": 2.5}, "device": {},
        });
        assert!(format_touch_answer(&answer).contains("911.9 V\npredicted 0.500 g"));
        let predicted = json!({"peak_g": 0.45, "peak_least_g": 0.4, "peak_most_g": 0.5});
        answer["device"]["effect"] = json!({
            "name": "click", "duration_ms": 30.0, "drives": drive(1600.0), "predicted": predicted,
            "limited_by": "voltage of left",
        });
        let text = format_touch_answer(&answer);
        assert!(text.contains("1600.0 V\nclick of 30 ms, peak 0.450 g") && !text.contains("911.9"), "{text}");
        assert!(text.ends_with("limited by voltage of left"), "{text}");
        answer["device"]["effect"]["name"] = json!("double_click");
        answer["device"]["effect"]["windows"] = json!([{}, {}]);
        assert!(format_touch_answer(&answer).contains("; peak of the weaker one of the two clicks: 0.400 g; limited"));
    }
}
