//! What a board says when it is asked. Every question is one that changes nothing on it.

use super::facts::{Answer, Clock, Heard, Supply};
use crate::device::port::{Port, PortError, call_within};
use crate::device::target::link_trouble;
use crate::device::timing::REAL_TIME;
use crate::device::{Client, ClockSync, Identity, LinkError};
use era_shared::protocol::{CURRENT_VERSION, Details, MIN_VERSION, Reply, Request, ResetCause};
use era_shared::safety::State;
use std::time::{Duration, Instant};

/// How often the board's clock is read, and how long between two readings.
const CLOCK_READINGS: u32 = 16;
const CLOCK_EVERY: Duration = Duration::from_millis(40);
/// Longest time for all questions, which take about 1 s: a call on the port may not return.
const ASK_LIMIT: Duration = Duration::from_secs(15);

/// Opens a port and asks who is there. The port must be a board's by its USB identity or named by the user, and nobody
/// else may have it open.
#[must_use]
pub fn ask_board(path: &str) -> Answer {
    let transport = match Port::open(path) {
        Ok(transport) => transport,
        Err(error) => return classify_open_error(&error),
    };
    let asked = call_within(path, ASK_LIMIT, move |step| {
        step.call("read or write", || read_board(&mut Client::patient(Box::new(transport), REAL_TIME.patience)))
    });
    match asked {
        Ok(Ok(heard)) => Answer::Heard(heard),
        Ok(Err(error @ LinkError::Version { .. })) => Answer::Version(error.to_string()),
        Ok(Err(error)) => Answer::Silent(link_trouble(path, &error)),
        Err(error) => Answer::Failed(error.to_string()),
    }
}

fn classify_open_error(error: &PortError) -> Answer {
    match error {
        PortError::Missing { .. } | PortError::NotConnected { .. } => Answer::Missing,
        PortError::Denied { .. } => Answer::Denied,
        PortError::Busy { .. } => Answer::Busy,
        PortError::Late { .. } | PortError::NoPort { .. } | PortError::Failed { .. } => {
            Answer::Failed(error.to_string())
        }
    }
}

/// Asks everything that there is to know.
///
/// # Errors
/// [`LinkError`] if the board does not say who it is, or falls silent.
pub fn read_board(client: &mut Client) -> Result<Heard, LinkError> {
    let hello = Request::Hello { host_min: MIN_VERSION, host_current: CURRENT_VERSION };
    let reply = client.request(&hello)?;
    let identity = Identity::from_reply(reply).ok_or_else(|| unexpected_reply_error("hello"))?;
    let mut heard = Heard {
        firmware: identity.firmware_text(),
        protocol: Some(client.version()),
        failure: Some(identity.failure).filter(|failure| !failure.is_empty()),
        was_watchdog: identity.reset_cause == ResetCause::Watchdog,
        ..Heard::default()
    };
    let Reply::Status(status) = client.request(&Request::Status)? else { return Err(unexpected_reply_error("status")) };
    heard.state = Some(status.state.name().into());
    heard.fault = status.fault.map(|fault| fault.code.into());
    // A board that is armed hears its host in every question: its dead-man timer is not to be held up by ours.
    let is_idle = matches!(status.state, State::Boot | State::Safe | State::Fault | State::Discharging);
    if is_idle && client.version() >= Request::Details.since() {
        let Reply::Details(details) = client.request(&Request::Details)? else {
            return Err(unexpected_reply_error("details"));
        };
        heard.supply = Some(convert_supply(&details));
        heard.clock = measure_clock(client)?;
    }
    let statistics = client.statistics();
    heard.frames = (statistics.frames_sent, statistics.repeats);
    Ok(heard)
}

fn convert_supply(details: &Details) -> Supply {
    Supply {
        rail_v: details.rail_millivolts.iter().map(|millivolts| f64::from(*millivolts) / 1e3).collect(),
        interlock_closed: details.interlock_closed,
        stop_released: details.stop_released,
        earth_bonded: details.earth_bonded,
    }
}

/// Reads the board's clock for a while.
fn measure_clock(client: &mut Client) -> Result<Option<Clock>, LinkError> {
    let mut sync = ClockSync::new(Instant::now());
    for _ in 0..CLOCK_READINGS {
        let Reply::Clock { now_us } = client.request(&Request::Clock)? else {
            return Err(unexpected_reply_error("clock"));
        };
        if let Some((sent, received)) = client.last_frame_written().zip(client.last_reply_read()) {
            sync.sample(sent, received, now_us);
        }
        std::thread::sleep(CLOCK_EVERY);
    }
    Ok(sync.quality().map(|quality| Clock {
        rate_ppm: Some(quality.rate_ppm),
        half_round_trip_s: quality.half_round_trip_s,
        worst_s: quality.residual_worst_s,
    }))
}

fn unexpected_reply_error(request: &'static str) -> LinkError {
    LinkError::Unexpected { request, reply: "another kind of answer".into() }
}
