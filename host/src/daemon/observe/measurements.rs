//! What the device measures: under which touch, and for a recording whenever its state changes, and every tenth of a second while it is on.

use super::recording::Recorder;
use super::state::MeasuredView;
use crate::device::DeviceSnapshot;
use era_shared::limits::DISCHARGED_MILLIVOLTS;
use era_shared::protocol::FaultCode;
use era_shared::safety::SafetyState;
use serde_json::json;
use std::time::{Duration, Instant};
use tokio::sync::watch;

/// Between two lines of a device that is on. Its sensor tells the peak since it was last asked, some ten times a second.
const BETWEEN: Duration = Duration::from_millis(100);

/// What makes a line of its own at once.
#[derive(Clone, Debug, PartialEq, Eq)]
struct DeviceCondition {
    connected: bool,
    in_doubt: bool,
    state: Option<SafetyState>,
    fault: Option<FaultCode>,
    boot_id: Option<u32>,
}

impl DeviceCondition {
    fn from_snapshot(device: &DeviceSnapshot) -> Self {
        let fault = device.status.as_ref().and_then(|status| status.fault);
        Self {
            connected: device.connected,
            in_doubt: device.in_doubt,
            state: device.state().filter(|_| device.connected),
            fault: fault.map(|fault| fault.code),
            boot_id: device.identity.as_ref().map(|identity| identity.boot_id),
        }
    }

    /// Whether its rails may be up.
    fn is_live_or_discharging(&self) -> bool {
        self.state.is_some_and(|state| state.is_live() || state == SafetyState::Discharging)
    }
}

/// Whether its rails were above what is safe to touch when they were last measured, as they are after a fault, too.
fn are_rails_charged(device: &DeviceSnapshot) -> bool {
    let rails = device.telemetry.iter().flat_map(|telemetry| telemetry.rail_millivolts.iter());
    device.connected && rails.copied().any(|volts| volts >= DISCHARGED_MILLIVOLTS)
}

/// Records what the device measures until the daemon ends, which `closing` tells.
pub async fn record_every_change_and_measurements_while_rails_up(
    mut snapshots: watch::Receiver<DeviceSnapshot>,
    mut closing: watch::Receiver<bool>,
    recorder: &Recorder,
    make_view: impl Fn(&DeviceSnapshot) -> MeasuredView,
) {
    let mut last: Option<(DeviceCondition, Instant)> = None;
    loop {
        {
            let device = snapshots.borrow_and_update().clone();
            let (condition, now) = (DeviceCondition::from_snapshot(&device), Instant::now());
            let is_due = last.as_ref().is_none_or(|(before, noted)| {
                *before != condition
                    || ((condition.is_live_or_discharging() || are_rails_charged(&device))
                        && now.duration_since(*noted) >= BETWEEN)
            });
            if is_due {
                recorder.queue_line_or_count_as_left_out_if_full("measured", || json!(make_view(&device)));
                last = Some((condition, now));
            }
        }
        tokio::select! {
            changed = snapshots.changed() => if changed.is_err() { break },
            _ = closing.wait_for(|is_closing| *is_closing) => break,
        }
    }
}
