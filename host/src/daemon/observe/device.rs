//! The device as last seen: its state, its fault, its supply and its clock.

use crate::daemon::api::schema::{text_choice_schema, to_ms};
use crate::device::session::LinkAtFault;
use crate::device::{ClockQuality, DeviceIdentity, DeviceSnapshot, TARGET_KINDS};
use era_shared::protocol::{ChargeRule, Fault};
use era_shared::safety::SafetyState;
use serde::Serialize;
use utoipa::ToSchema;
use utoipa::openapi::schema::Object;

/// Latest state of the device.
#[derive(Clone, Debug, Serialize, ToSchema)]
#[schema(as = Device)]
pub struct DeviceView {
    /// Kind of the device.
    #[schema(schema_with = device_kind_schema)]
    kind: &'static str,
    /// Path of the serial port of the device.
    port: String,
    /// Whether the device answers.
    connected: bool,
    /// Whether the device does not answer at present, but may be only late; the daemon continues to ask.
    in_doubt: bool,
    /// Why the device does not answer; null if it answers.
    problem: Option<String>,
    /// Safety state of the device; null while the device is not connected or has not sent a state.
    #[schema(schema_with = safety_state_schema)]
    state: Option<&'static str>,
    /// The fault that the device has latched; null without a fault.
    fault: Option<FaultView>,
    /// Version of the firmware.
    firmware: Option<String>,
    /// Name of the firmware image; empty with protocol version 1.
    image: Option<String>,
    /// Protocol version that the daemon and the device use.
    protocol: Option<u8>,
    /// Unique identifier of the chip, in hexadecimal.
    board_id: Option<String>,
    /// A number that changes at every start of the device.
    boot_id: Option<u32>,
    /// Cause of the last start of the device.
    reset_cause: Option<String>,
    /// Error message of the previous run of the firmware; null if that run did not fail.
    failure: Option<String>,
    /// Number of restarts of the device that the daemon has detected.
    restarts: u32,
    /// Number of losses of the link since the start of the daemon.
    outages: u32,
    /// Number of requests after which the device sent nothing for 50 ms, since the start of the daemon: the answer was late or lost.
    doubts: u32,
    /// Number of faults that the device has latched since the start of the daemon.
    faults: u32,
    /// Number of faults host-silent that the daemon cleared because of --clear-silence.
    silences_cleared: u32,
    /// How the board differs from what the scene needs; null if it does not differ.
    mismatch: Option<String>,
    /// Whether the device had an outage and stays disarmed until POST /v1/arm.
    waits_to_be_armed: bool,
    /// Measurements of the supply and the safety loops, and the remaining drive time of each channel; null while the device is not connected, and
    /// with protocol version 1.
    supply: Option<SupplyView>,
    /// Estimate of the board's clock, with its errors.
    clock: Option<ClockView>,
}

/// A latched fault.
#[derive(Clone, Debug, Serialize, ToSchema)]
#[schema(as = Fault)]
struct FaultView {
    /// Number of the fault.
    code: u8,
    /// Name of the fault.
    name: &'static str,
    /// Meaning of the fault, and the remedy.
    message: &'static str,
    /// Action that clears the fault: POST /v1/faults/clear.
    #[schema(schema_with = fault_action_schema)]
    action: &'static str,
    /// Detail of the fault as a number, such as the channel, the silence in ms or a program counter.
    detail: u32,
    /// Number of faults since this fault was latched, including this fault.
    count: u16,
    /// Values of the link when the daemon detected the fault.
    link: FaultLinkView,
}

/// Values of the link when the daemon detected a fault.
#[derive(Clone, Copy, Debug, Serialize, ToSchema)]
#[schema(as = FaultLink)]
struct FaultLinkView {
    /// Longest time in ms without any answer of the device, since the daemon last read a state without this fault.
    keep_alive_age_ms: f64,
    /// Longest time between two answers of the device while the device was armed, until the fault, in ms.
    longest_gap_ms: f64,
    /// Median of the last 64 round trips in ms.
    round_trip_ms_median: Option<f64>,
    /// Longest of the last 64 round trips in ms.
    round_trip_ms_worst: Option<f64>,
    /// Mean difference between consecutive round trips of the last 64, in ms.
    round_trip_ms_jitter: Option<f64>,
    /// Number of frames that were sent again until the fault, because no answer came in time.
    repeats: u64,
    /// Number of sequences of received bytes until the fault that were not a valid frame.
    crc_errors: u64,
    /// Number of losses of the link until the fault.
    outages: u32,
}

/// Supply, safety loops, and the remaining drive time of each channel.
#[derive(Clone, Debug, Serialize, ToSchema)]
#[schema(as = Supply)]
struct SupplyView {
    /// Set-point of each rail in V.
    set_point_v: Vec<f64>,
    /// Measured voltage of each rail in V.
    rail_v: Vec<f64>,
    /// Average current of the supply in mA.
    average_current_ma: f64,
    /// Whether the enclosure is closed.
    interlock_closed: bool,
    /// Whether the emergency stop is not pressed.
    stop_released: bool,
    /// Whether panel and moving masses are bonded to earth.
    earth_bonded: bool,
    /// Credit of each channel: time in s for which the channel may still drive with its largest force.
    credit_s: Vec<f64>,
    /// How a drive uses up the credit of its channel: by its time, or by its time multiplied by (force / largest force of the channel)^2.
    #[schema(schema_with = charge_rule_schema)]
    credit_rule: &'static str,
    /// Time in s after which the present drive of each channel has used up the credit, without regard to bursts and rests; null for a channel whose
    /// credit lasts without limit. Null for all channels with protocol version 2.
    credit_lasts_s: Option<Vec<Option<f64>>>,
}

/// Estimate of the board's clock, with its errors.
#[derive(Clone, Copy, Debug, Serialize, ToSchema)]
#[schema(as = Clock)]
struct ClockView {
    /// How much faster the board's clock runs than the host's clock, in parts per million.
    rate_ppm: f64,
    /// Half of the shortest round trip in us, which is the bound on the error of the offset.
    half_round_trip_us: f64,
    /// Root mean square of the last 32 errors of the predicted board time in us.
    residual_rms_us: f64,
    /// Largest of the last 32 errors of the predicted board time in us.
    residual_worst_us: f64,
    /// Number of samples, including those that were not used.
    samples: u64,
    /// Number of samples that were not used because they came late.
    outliers: u64,
}

fn device_kind_schema() -> Object {
    text_choice_schema(TARGET_KINDS, false, "Kind of the device.")
}

fn safety_state_schema() -> Object {
    let text = "Safety state of the device; null while the device is not connected or has not sent a state.";
    text_choice_schema(SafetyState::ALL.map(SafetyState::name), true, text)
}

fn fault_action_schema() -> Object {
    text_choice_schema(["clear"], false, "Action that clears the fault: POST /v1/faults/clear.")
}

fn charge_rule_schema() -> Object {
    let text = "How a drive uses up the credit of its channel: by its time, or by its time multiplied by (force / largest force of \
                the channel)^2.";
    text_choice_schema([ChargeRule::Time, ChargeRule::ForceSquared].map(ChargeRule::name), false, text)
}

impl DeviceView {
    /// What is known of a device.
    #[must_use]
    pub fn new(device: &DeviceSnapshot) -> Self {
        let status = device.status.as_ref();
        let identity = device.identity.as_ref();
        Self {
            kind: device.kind,
            port: device.path.clone(),
            connected: device.connected,
            in_doubt: device.in_doubt,
            problem: device.problem.clone(),
            // Of a board that is gone, or may be, nobody knows.
            state: status.filter(|_| device.connected).map(|status| status.state.name()),
            fault: status.and_then(|status| status.fault).zip(device.link_at_fault).map(FaultView::new),
            firmware: identity.map(DeviceIdentity::firmware_version_and_commit_text),
            image: identity.map(|known| known.image.clone()),
            protocol: device.protocol,
            board_id: identity.map(|known| DeviceIdentity::board_id_hex(known.board_id)),
            boot_id: identity.map(|known| known.boot_id),
            reset_cause: identity.map(|known| format!("{:?}", known.reset_cause)),
            failure: identity.map(|known| known.failure.clone()).filter(|failure| !failure.is_empty()),
            restarts: device.restarts,
            outages: device.outages,
            doubts: device.doubts,
            faults: device.faults,
            silences_cleared: device.cleared,
            mismatch: device.mismatch.clone(),
            waits_to_be_armed: device.waits_to_be_armed,
            supply: SupplyView::new(device).filter(|_| device.connected),
            clock: device.clock.map(ClockView::new),
        }
    }
}

impl FaultView {
    fn new((fault, link): (Fault, LinkAtFault)) -> Self {
        Self {
            code: fault.code.number(),
            name: fault.code.name(),
            message: fault.code.advice(),
            action: "clear",
            detail: fault.detail,
            count: fault.count,
            link: FaultLinkView::new(link),
        }
    }
}

impl FaultLinkView {
    fn new(known: LinkAtFault) -> Self {
        let trips = known.round_trips;
        Self {
            keep_alive_age_ms: to_ms(known.silence),
            longest_gap_ms: to_ms(known.longest_gap),
            round_trip_ms_median: trips.median.map(to_ms),
            round_trip_ms_worst: trips.worst.map(to_ms),
            round_trip_ms_jitter: trips.jitter.map(to_ms),
            repeats: known.link.repeats,
            crc_errors: known.link.bad_frames,
            outages: known.outages,
        }
    }
}

impl SupplyView {
    fn new(device: &DeviceSnapshot) -> Option<Self> {
        let details = device.details.as_ref()?;
        let volts = |values: &[u32]| values.iter().map(|millivolts| f64::from(*millivolts) / 1e3).collect();
        Some(Self {
            set_point_v: volts(&details.set_point_millivolts),
            rail_v: volts(&details.rail_millivolts),
            average_current_ma: f64::from(details.average_microamps) / 1e3,
            interlock_closed: details.interlock_closed,
            stop_released: details.stop_released,
            earth_bonded: details.earth_bonded,
            credit_s: details.credit_ms.iter().map(|ms| f64::from(*ms) / 1e3).collect(),
            // A board that does not tell charges by time.
            credit_rule: device.credit.as_ref().map_or(ChargeRule::Time, |credit| credit.rule).name(),
            credit_lasts_s: device.credit.as_ref().map(|credit| {
                (0..credit.channels.len())
                    .map(|i| credit.drive_time_ms_until_credit_runs_out_if_ever(i).map(|ms| ms as f64 / 1e3))
                    .collect()
            }),
        })
    }
}

impl ClockView {
    fn new(clock: ClockQuality) -> Self {
        Self {
            rate_ppm: clock.rate_ppm,
            half_round_trip_us: clock.half_round_trip_s * 1e6,
            residual_rms_us: clock.residual_rms_s * 1e6,
            residual_worst_us: clock.residual_worst_s * 1e6,
            samples: clock.samples,
            outliers: clock.outliers,
        }
    }
}
