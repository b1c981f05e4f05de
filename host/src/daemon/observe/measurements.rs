//! What the device measures: under which touch, and for a recording whenever its state changes, and every tenth of a second while it is on.

use super::state::MeasuredView;
use crate::daemon::app::{App, closed};
use crate::device::Snapshot;
use crate::device::sim::TouchPeak;
use crate::planner::STANDARD_GRAVITY;
use era_shared::limits::DISCHARGED_MILLIVOLTS;
use era_shared::protocol::FaultCode;
use era_shared::safety::State;
use serde_json::json;
use std::sync::Arc;
use std::time::{Duration, Instant};

/// Between two lines of a device that is on. Its sensor tells the peak since it was last asked, some ten times a second.
const BETWEEN: Duration = Duration::from_millis(100);

/// What makes a line of its own at once.
#[derive(Clone, Debug, PartialEq, Eq)]
struct Condition {
    connected: bool,
    in_doubt: bool,
    state: Option<State>,
    fault: Option<FaultCode>,
    boot_id: Option<u32>,
}

impl Condition {
    fn of(device: &Snapshot) -> Self {
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
    fn is_on(&self) -> bool {
        self.state.is_some_and(|state| state.is_live() || state == State::Discharging)
    }
}

/// Whether its rails were above what is safe to touch when they were last measured, as they are after a fault, too.
fn is_charged(device: &Snapshot) -> bool {
    let rails = device.telemetry.iter().flat_map(|telemetry| telemetry.rail_millivolts.iter());
    device.connected && rails.copied().any(|volts| volts >= DISCHARGED_MILLIVOLTS)
}

impl App {
    /// What the sensor has shown under each of the last `most` touches, the newest first; nothing without a simulated sensor.
    #[must_use]
    pub fn touch_peaks(&self, most: usize) -> Vec<TouchPeak> {
        self.equipment.sim.as_ref().map(|sim| sim.touch_peaks(most)).unwrap_or_default()
    }

    /// The same of touch `id`, in g.
    #[must_use]
    pub fn touch_peak_g(&self, id: u64) -> Option<f64> {
        self.equipment.sim.as_ref()?.touch_peak(id).map(|peak| peak.peak_m_per_s2 / STANDARD_GRAVITY)
    }
}

/// Notes what the device measures until the daemon ends.
pub async fn note(app: Arc<App>) {
    let (mut snapshots, mut closing) = (app.device(), app.closing());
    let mut last: Option<(Condition, Instant)> = None;
    loop {
        {
            let device = snapshots.borrow_and_update().clone();
            let (condition, now) = (Condition::of(&device), Instant::now());
            let is_due = last.as_ref().is_none_or(|(before, noted)| {
                *before != condition
                    || ((condition.is_on() || is_charged(&device)) && now.duration_since(*noted) >= BETWEEN)
            });
            if is_due {
                app.note("measured", || json!(MeasuredView::new(&app, &device)));
                last = Some((condition, now));
            }
        }
        tokio::select! {
            changed = snapshots.changed() => if changed.is_err() { break },
            () = closed(&mut closing) => break,
        }
    }
}
