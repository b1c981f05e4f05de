//! What a board says when it is asked. Every question is one that changes nothing on it.

use super::facts::{BoardReport, Clock, PortAnswer, Supply};
use crate::device::port::{PortError, SerialPort, run_port_calls_in_thread_abandoned_after_limit};
use crate::device::target::describe_link_error_and_name_programs_on_port;
use crate::device::timing::REAL_TIME;
use crate::device::{Client, ClockSync, DeviceIdentity, LinkError};
use era_shared::protocol::{CURRENT_VERSION, DetailsReply, MIN_VERSION, Reply, Request, ResetCause};
use era_shared::safety::SafetyState;
use std::time::{Duration, Instant};

/// How often the board's clock is read, and how long between two readings.
const CLOCK_READINGS: u32 = 16;
const CLOCK_EVERY: Duration = Duration::from_millis(40);
/// Longest time for all questions, which take about 1 s: a call on the port may not return.
const ASK_LIMIT: Duration = Duration::from_secs(15);

/// Opens a port and asks who is there. The port must be a board's by its USB identity or named by the user, and nobody
/// else may have it open.
#[must_use]
pub fn ask_board(path: &str) -> PortAnswer {
    let transport = match SerialPort::open(path) {
        Ok(transport) => transport,
        Err(error) => return classify_open_error(&error),
    };
    let asked = run_port_calls_in_thread_abandoned_after_limit(path, ASK_LIMIT, move |step| {
        step.name_and_run_call("read or write", || {
            read_board_report_with_supply_and_clock_if_idle(&mut Client::with_retry_policy(
                Box::new(transport),
                REAL_TIME.retry_policy,
            ))
        })
    });
    match asked {
        Ok(Ok(heard)) => PortAnswer::Answered(heard),
        Ok(Err(error @ LinkError::Version { .. })) => PortAnswer::Version(error.to_string()),
        Ok(Err(error)) => PortAnswer::Silent(describe_link_error_and_name_programs_on_port(path, &error)),
        Err(error) => PortAnswer::Failed(error.to_string()),
    }
}

fn classify_open_error(error: &PortError) -> PortAnswer {
    match error {
        PortError::Missing { .. } | PortError::NotConnected { .. } => PortAnswer::Missing,
        PortError::Denied { .. } => PortAnswer::Denied,
        PortError::Busy { .. } => PortAnswer::Busy,
        PortError::Late { .. } | PortError::NoPort { .. } | PortError::Failed { .. } => {
            PortAnswer::Failed(error.to_string())
        }
    }
}

/// Asks everything that there is to know.
///
/// # Errors
/// [`LinkError`] if the board does not say who it is, or falls silent.
pub fn read_board_report_with_supply_and_clock_if_idle(client: &mut Client) -> Result<BoardReport, LinkError> {
    let hello = Request::Hello { host_min: MIN_VERSION, host_current: CURRENT_VERSION };
    let reply = client.request(&hello)?;
    let identity = DeviceIdentity::from_reply_if_hello(reply).ok_or_else(|| unexpected_reply_error("hello"))?;
    let mut heard = BoardReport {
        firmware: identity.firmware_version_and_commit_text(),
        protocol: Some(client.protocol_version()),
        failure: Some(identity.failure).filter(|failure| !failure.is_empty()),
        was_watchdog: identity.reset_cause == ResetCause::Watchdog,
        ..BoardReport::default()
    };
    let Reply::Status(status) = client.request(&Request::Status)? else { return Err(unexpected_reply_error("status")) };
    heard.state = Some(status.state.name().into());
    heard.fault = status.fault.map(|fault| fault.code.into());
    // A board that is armed hears its host in every question: its dead-man timer is not to be held up by ours.
    let is_idle =
        matches!(status.state, SafetyState::Boot | SafetyState::Safe | SafetyState::Fault | SafetyState::Discharging);
    if is_idle && client.protocol_version() >= Request::Details.introduced_in_version() {
        let Reply::Details(details) = client.request(&Request::Details)? else {
            return Err(unexpected_reply_error("details"));
        };
        heard.supply = Some(convert_to_supply(&details));
        heard.clock = measure_clock_quality_if_two_samples(client)?;
    }
    let statistics = client.link_statistics();
    heard.frames = (statistics.frames_sent, statistics.repeats);
    Ok(heard)
}

fn convert_to_supply(details: &DetailsReply) -> Supply {
    Supply {
        rail_v: details.rail_millivolts.iter().map(|millivolts| f64::from(*millivolts) / 1e3).collect(),
        interlock_closed: details.interlock_closed,
        stop_released: details.stop_released,
        earth_bonded: details.earth_bonded,
    }
}

/// Reads the board's clock for a while.
fn measure_clock_quality_if_two_samples(client: &mut Client) -> Result<Option<Clock>, LinkError> {
    let mut sync = ClockSync::new(Instant::now());
    for _ in 0..CLOCK_READINGS {
        let Reply::Clock { now_us } = client.request(&Request::Clock)? else {
            return Err(unexpected_reply_error("clock"));
        };
        if let Some((sent, received)) = client.last_answered_frame_written_at().zip(client.last_reply_read_at()) {
            sync.add_sample_forgetting_earlier_if_board_clock_went_back(sent, received, now_us);
        }
        std::thread::sleep(CLOCK_EVERY);
    }
    Ok(sync.quality_if_two_samples().map(|quality| Clock {
        rate_ppm: Some(quality.rate_ppm),
        half_round_trip_s: quality.half_round_trip_s,
        worst_s: quality.residual_worst_s,
    }))
}

fn unexpected_reply_error(request: &'static str) -> LinkError {
    LinkError::Unexpected { request, reply: "a reply of another type".into() }
}
