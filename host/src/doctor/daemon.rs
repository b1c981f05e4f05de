//! What a running daemon says of itself and its device.

use super::facts::{BoardReport, Clock, Daemon, Fault, Supply};
use super::reach::RequestTrouble;
use crate::connection::describe_redirect;
use serde_json::Value;
use std::net::{IpAddr, Ipv4Addr, Ipv6Addr, SocketAddr};
use std::time::Duration;

/// Longest wait for an answer.
pub const ANSWER: Duration = Duration::from_secs(5);
/// What is asked for.
const STATE: &str = "/v1/state";

/// Where a daemon that listens at `address` is reached from this machine.
#[must_use]
pub fn replace_unspecified_by_loopback(address: SocketAddr) -> SocketAddr {
    let ip = match address.ip() {
        IpAddr::V4(ip) if ip.is_unspecified() => Ipv4Addr::LOCALHOST.into(),
        IpAddr::V6(ip) if ip.is_unspecified() => Ipv6Addr::LOCALHOST.into(),
        ip => ip,
    };
    SocketAddr::new(ip, address.port())
}

/// How a daemon is asked.
#[derive(Clone, Copy, Debug, Default)]
pub struct DaemonRequestRoute {
    /// Whether a certificate of the user's is trusted.
    pub has_ca: bool,
    /// Whether a proxy was named.
    pub has_proxy: bool,
}

/// Asks whoever listens at `url`, over `agent`, which takes no status for an error and follows no redirect; `bearer` is what the header
/// `Authorization` says.
#[must_use]
pub fn ask_daemon(url: &str, agent: &ureq::Agent, bearer: Option<&str>, way: DaemonRequestRoute) -> Daemon {
    let mut request = agent.get(format!("{url}{STATE}"));
    if let Some(bearer) = bearer {
        request = request.header("Authorization", bearer);
    }
    let mut answer = match request.call() {
        Ok(answer) => answer,
        Err(error) => {
            let trouble = RequestTrouble::find_trouble_probing_address_for_tls(&error, url, way.has_proxy);
            return match (trouble.describe_with_advice(url, way.has_ca), &error) {
                (Some((found, advice)), _) => Daemon::Hidden { found, advice },
                (
                    None,
                    ureq::Error::ConnectionFailed
                    | ureq::Error::HostNotFound
                    | ureq::Error::Timeout(ureq::Timeout::Connect),
                ) => Daemon::Absent,
                (None, ureq::Error::Io(error)) if means_refused_unreachable_or_unknown_host(error) => Daemon::Absent,
                (None, error) => Daemon::OtherProgram(error.to_string()),
            };
        }
    };
    let status = answer.status();
    if status.is_redirection() {
        let location = answer.headers().get("location").map(|value| String::from_utf8_lossy(value.as_bytes()));
        let (found, advice) = describe_redirect(url, STATE, status.as_u16(), location.as_deref());
        return Daemon::Hidden { found, advice };
    }
    let Ok(state) = answer.body_mut().read_json::<Value>() else {
        return Daemon::OtherProgram(format!("the status of its answer is {status}, and the answer is not JSON"));
    };
    if matches!(status.as_u16(), 401 | 403) {
        return Daemon::Guarded(parse_string(&state["detail"]).unwrap_or_else(|| status.to_string()));
    }
    if !status.is_success() {
        return Daemon::OtherProgram(format!("the status of its answer is {status}"));
    }
    parse_daemon_state_or_other_program(&state)
}

/// Whether nobody took the connection.
fn means_refused_unreachable_or_unknown_host(error: &std::io::Error) -> bool {
    use std::io::ErrorKind;
    // Not found: a name without an address.
    matches!(
        error.kind(),
        ErrorKind::ConnectionRefused | ErrorKind::HostUnreachable | ErrorKind::NetworkUnreachable | ErrorKind::NotFound
    )
}

/// Reads the answer to `GET /v1/state`.
#[must_use]
pub fn parse_daemon_state_or_other_program(state: &Value) -> Daemon {
    let (device, daemon) = (&state["device"], &state["daemon"]);
    let (Some(version), Some(kind), Some(port)) =
        (parse_string(&daemon["version"]), parse_string(&device["kind"]), parse_string(&device["port"]))
    else {
        return Daemon::OtherProgram("its answer is JSON, but is not the state of a daemon".into());
    };
    let problem = (device["connected"] == false)
        .then(|| parse_string(&device["problem"]).unwrap_or_else(|| "the daemon gave no reason".into()));
    let heard = parse_string(&device["firmware"]).map(|firmware| Box::new(parse_board_report(firmware, state)));
    Daemon::Runs { version, port, kind, problem, heard }
}

fn parse_board_report(firmware: String, state: &Value) -> BoardReport {
    let (device, link) = (&state["device"], &state["link"]);
    let (supply, clock) = (&device["supply"], &device["clock"]);
    let number = |value: &Value| value.as_f64().unwrap_or(f64::NAN);
    BoardReport {
        firmware,
        protocol: device["protocol"].as_u64().and_then(|version| version.try_into().ok()),
        state: parse_string(&device["state"]),
        fault: device["fault"]["code"].as_u64().map(|code| Fault {
            code,
            name: parse_string(&device["fault"]["name"]).unwrap_or_default(),
            advice: parse_string(&device["fault"]["message"]).unwrap_or_default(),
        }),
        failure: parse_string(&device["failure"]),
        waits_to_be_armed: device["waits_to_be_armed"] == true,
        was_watchdog: device["reset_cause"] == "Watchdog",
        supply: supply.is_object().then(|| Supply {
            rail_v: supply["rail_v"].as_array().into_iter().flatten().map(number).collect(),
            interlock_closed: supply["interlock_closed"] == true,
            stop_released: supply["stop_released"] == true,
            earth_bonded: supply["earth_bonded"] == true,
        }),
        clock: clock.is_object().then(|| Clock {
            rate_ppm: clock["rate_ppm"].as_f64(),
            half_round_trip_s: number(&clock["half_round_trip_us"]) * 1e-6,
            worst_s: number(&clock["residual_worst_us"]) * 1e-6,
        }),
        frames: (link["frames_sent"].as_u64().unwrap_or(0), link["repeats"].as_u64().unwrap_or(0)),
    }
}

fn parse_string(value: &Value) -> Option<String> {
    value.as_str().map(str::to_owned)
}
