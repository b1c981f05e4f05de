//! Everything there is to know now: device, plan, measurements, link, daemon.

use super::device::DeviceView;
use crate::daemon::api::schema::to_ms;
use crate::daemon::touch::active_plan::ActivePlan;
use crate::daemon::touch::plan_view::PlanView;
use crate::daemon::touch::request::Finger;
use crate::device::DeviceSnapshot;
use crate::device::convert::achieved_drive_from_wire;
use crate::device::sim::TouchPeak;
use crate::planner::STANDARD_GRAVITY;
use crate::scene::Actuator;
use era_shared::protocol::{ChannelStatus, StatusReply};
use era_shared::safety::SafetyState;
use serde::Serialize;
use std::time::Duration;
use utoipa::ToSchema;

/// Touches whose peaks are told.
pub const MOST_PEAKS: usize = 16;

/// Latest state of the device, the plan, the measurements and the link.
#[derive(Clone, Debug, Serialize, ToSchema)]
#[schema(as = State)]
pub struct StateView {
    /// The device.
    device: DeviceView,
    /// The plan that is driven; null if nothing is driven.
    plan: Option<PlanView>,
    /// Number of that plan, which is also the number of its request; null if nothing is driven.
    plan_id: Option<u64>,
    /// The fingers or targets for which the plan is driven.
    touches: Vec<Finger>,
    /// Measurements of the device; null while the device is not connected, and before its first measurement.
    telemetry: Option<TelemetryView>,
    /// The link to the device.
    link: LinkView,
    /// The daemon itself.
    daemon: DaemonView,
}

/// What a recording keeps of the device.
#[derive(Clone, Debug, Serialize)]
pub struct MeasuredView {
    connected: bool,
    in_doubt: bool,
    /// Null while it is not connected.
    state: Option<&'static str>,
    fault: Option<&'static str>,
    outages: u32,
    restarts: u32,
    /// Measured voltage of each rail in V; null while it is not connected, and of a device that does not tell.
    rail_v: Option<Vec<f64>>,
    telemetry: Option<TelemetryView>,
}

/// Measurements of the device.
#[derive(Clone, Debug, Serialize, ToSchema)]
#[schema(as = Telemetry)]
struct TelemetryView {
    /// Time since the start of the board in ms.
    uptime_ms: u64,
    /// Largest acceleration at the board's sensor in g since the newest touch began. Reading does not reset this value. For a board that is not
    /// simulated, the same as `acceleration_recent_g`. Null without a sensor.
    acceleration_peak_g: Option<f64>,
    /// Largest acceleration at the board's sensor in g since the previous measurement of the daemon (about ten measurements per second); null
    /// without a sensor.
    acceleration_recent_g: Option<f64>,
    /// Largest acceleration under the finger of each of the last 16 touches until the next touch began, the newest touch first. Empty for boards
    /// that are not simulated.
    touch_peaks: Vec<TouchPeakView>,
    /// State of each channel.
    channels: Vec<ChannelView>,
}

/// Peak acceleration that the sensor has measured during a touch.
#[derive(Clone, Copy, Debug, Serialize, ToSchema)]
#[schema(as = TouchPeak)]
struct TouchPeakView {
    /// Number of the touch, which is also the number of its plan.
    plan_id: u64,
    /// Largest acceleration in g from the begin of the touch until the next touch began, or until now.
    peak_g: f64,
}

/// State of a channel.
#[derive(Clone, Debug, Serialize, ToSchema)]
#[schema(as = Channel)]
struct ChannelView {
    /// The `id` of the scene's actuator on this channel; null for a channel without an actuator.
    actuator: Option<String>,
    /// Whether the channel drives.
    active: bool,
    /// Fundamental frequency of the force in Hz; null while the channel does not drive.
    frequency_hz: Option<f64>,
    /// Voltage of the electrodes in V; null while the channel does not drive.
    voltage_v: Option<f64>,
    /// Fraction of each half period for which an electrode is on; null while the channel does not drive.
    pulse_width: Option<f64>,
}

/// The link to the device.
#[derive(Clone, Debug, Serialize, ToSchema)]
#[schema(as = Link)]
struct LinkView {
    /// Median of the last 64 round trips in ms.
    round_trip_ms_median: Option<f64>,
    /// Longest of the last 64 round trips in ms.
    round_trip_ms_worst: Option<f64>,
    /// Mean difference between consecutive round trips of the last 64, in ms.
    round_trip_ms_jitter: Option<f64>,
    /// Time since the last answer of the device in ms; null if the device has never answered.
    keep_alive_age_ms: Option<f64>,
    /// Number of frames that were sent, including repeats.
    frames_sent: u64,
    /// Number of frames that were sent again because no answer came in time.
    repeats: u64,
    /// Number of sequences of received bytes that were not a valid frame.
    crc_errors: u64,
    /// Longest time between two answers of the device while the device was armed, in ms.
    longest_gap_ms: f64,
}

/// The daemon itself.
#[derive(Clone, Debug, Serialize, ToSchema)]
#[schema(as = Daemon)]
struct DaemonView {
    /// Version of the daemon.
    version: &'static str,
    /// Time since the start of the daemon in s.
    uptime_s: f64,
}

/// What device, scene and sensor tell, of which the views are made.
#[derive(Debug)]
pub struct ViewSources<'a> {
    /// The device as last seen.
    pub device: &'a DeviceSnapshot,
    /// The scene's actuators, in the order of the board's channels.
    pub actuators: &'a [Actuator],
    /// The largest accelerations under the last [`MOST_PEAKS`] touches, the newest first.
    pub touch_peaks: Vec<TouchPeak>,
}

impl StateView {
    /// Everything there is to know now.
    #[must_use]
    pub fn new(
        sources: &ViewSources<'_>,
        driven: Option<&ActivePlan>,
        heard_ago: Option<Duration>,
        uptime: Duration,
    ) -> Self {
        let device = sources.device;
        Self {
            device: DeviceView::new(device),
            plan: driven.map(|active| active.plan.clone()),
            plan_id: driven.map(|active| active.id),
            touches: driven.map_or_else(Vec::new, |active| active.touches.clone()),
            telemetry: TelemetryView::new(sources).filter(|_| device.connected),
            link: LinkView::new(device, heard_ago),
            daemon: DaemonView { version: env!("CARGO_PKG_VERSION"), uptime_s: uptime.as_secs_f64() },
        }
    }
}

impl MeasuredView {
    /// What is known of the device.
    #[must_use]
    pub fn new(sources: &ViewSources<'_>) -> Self {
        let device = sources.device;
        let here = device.connected;
        let volts = |millivolts: &u32| f64::from(*millivolts) / 1e3;
        Self {
            connected: here,
            in_doubt: device.in_doubt,
            state: device.state().filter(|_| here).map(SafetyState::name),
            fault: device.status.as_ref().and_then(|status| status.fault).map(|fault| fault.code.name()),
            outages: device.outages,
            restarts: device.restarts,
            rail_v: device
                .details
                .as_ref()
                .filter(|_| here)
                .map(|known| known.rail_millivolts.iter().map(volts).collect()),
            telemetry: TelemetryView::new(sources).filter(|_| here),
        }
    }
}

impl TelemetryView {
    fn new(sources: &ViewSources<'_>) -> Option<Self> {
        let device = sources.device;
        let telemetry = device.telemetry.as_ref()?;
        let names = sources.actuators;
        let channel = |(i, channel): (usize, &ChannelStatus)| {
            let si = channel.drive.as_ref().map(achieved_drive_from_wire);
            ChannelView {
                actuator: names.get(i).map(|actuator| actuator.id.clone()),
                active: si.is_some(),
                frequency_hz: si.map(|drive| drive.frequency_hz),
                voltage_v: si.map(|drive| drive.voltage_v),
                pulse_width: si.map(|drive| drive.pulse_width),
            }
        };
        let channels = |status: &StatusReply| status.channels.iter().enumerate().map(channel).collect();
        let recent_g = telemetry.acceleration_peak_mm_per_s2.map(|peak| f64::from(peak) / 1e3 / STANDARD_GRAVITY);
        let view =
            |peak: &TouchPeak| TouchPeakView { plan_id: peak.plan_id, peak_g: peak.peak_m_per_s2 / STANDARD_GRAVITY };
        let touch_peaks: Vec<TouchPeakView> = sources.touch_peaks.iter().map(view).collect();
        Some(Self {
            uptime_ms: telemetry.uptime_us / 1000,
            acceleration_peak_g: touch_peaks.first().map(|newest| newest.peak_g).or(recent_g),
            acceleration_recent_g: recent_g,
            touch_peaks,
            channels: device.status.as_ref().map(channels).unwrap_or_default(),
        })
    }
}

impl LinkView {
    fn new(device: &DeviceSnapshot, heard_ago: Option<Duration>) -> Self {
        let trips = device.round_trips;
        Self {
            round_trip_ms_median: trips.median.map(to_ms),
            round_trip_ms_worst: trips.worst.map(to_ms),
            round_trip_ms_jitter: trips.jitter.map(to_ms),
            keep_alive_age_ms: heard_ago.map(to_ms),
            frames_sent: device.link.frames_sent,
            repeats: device.link.repeats,
            crc_errors: device.link.bad_frames,
            longest_gap_ms: to_ms(device.longest_gap),
        }
    }
}
