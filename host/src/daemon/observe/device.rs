//! The device as last seen: its state, its fault, its supply and its clock.

use crate::daemon::api::schema::{text_choice_schema, to_ms};
use crate::device::session::LinkAtFault;
use crate::device::{ClockQuality, DeviceIdentity, DeviceSnapshot, TARGET_KINDS};
use era_shared::protocol::{ChargeRule, Fault};
use era_shared::safety::SafetyState;
use serde::Serialize;
use utoipa::ToSchema;
use utoipa::openapi::schema::Object;

/// The device as last seen.
#[derive(Clone, Debug, Serialize, ToSchema)]
#[schema(as = Device)]
pub struct DeviceView {
    /// What it is.
    #[schema(schema_with = device_kind_schema)]
    kind: &'static str,
    /// Path of its serial port.
    port: String,
    /// Whether it answers.
    connected: bool,
    /// Whether it does not answer just now and may be only late: it is asked on.
    in_doubt: bool,
    /// Why it does not; null if it does.
    problem: Option<String>,
    /// Its safety state; null while it is not connected, or if it has not told any.
    #[schema(schema_with = safety_state_schema)]
    state: Option<&'static str>,
    /// The fault that it has latched.
    fault: Option<FaultView>,
    /// Version of its firmware.
    firmware: Option<String>,
    /// Name of its firmware's image; empty with protocol version 1.
    image: Option<String>,
    /// Protocol version spoken with it.
    protocol: Option<u8>,
    /// Unique identifier of its chip, in hexadecimal.
    board_id: Option<String>,
    /// Different after every start of it.
    boot_id: Option<u32>,
    /// Why it last started.
    reset_cause: Option<String>,
    /// What the previous run of the firmware said when it failed; null if it did not.
    failure: Option<String>,
    /// Restarts of it noticed since the daemon began.
    restarts: u32,
    /// How often the link was lost since then.
    outages: u32,
    /// How often it did not answer within 50 ms since then: late, or lost.
    doubts: u32,
    /// How many faults were latched since then.
    faults: u32,
    /// Latched silences of the host that were cleared by policy.
    silences_cleared: u32,
    /// What of the board does not go with the scene.
    mismatch: Option<String>,
    /// Whether it was away and waits for POST /v1/arm.
    waits_to_be_armed: bool,
    /// What the board measures of its supply and loops, and what each channel may still drive; null while it is not connected, and with
    /// protocol version 1.
    supply: Option<SupplyView>,
    /// How well the board's clock is known.
    clock: Option<ClockView>,
}

/// A latched fault.
#[derive(Clone, Debug, Serialize, ToSchema)]
#[schema(as = Fault)]
struct FaultView {
    /// Its number.
    code: u8,
    /// Its name.
    name: &'static str,
    /// What it means and what to do about it.
    message: &'static str,
    /// What takes it away: POST /v1/faults/clear.
    #[schema(schema_with = fault_action_schema)]
    action: &'static str,
    /// A number that goes with it: the channel, the silence in ms, a program counter.
    detail: u32,
    /// Faults raised since, this one included.
    count: u16,
    /// What was known of the link when it was seen.
    link: FaultLinkView,
}

/// What was known of the link when a fault was seen.
#[derive(Clone, Copy, Debug, Serialize, ToSchema)]
#[schema(as = FaultLink)]
struct FaultLinkView {
    /// Longest time in ms in which the device answered nothing, no sign of life either, since it had been seen without this fault.
    keep_alive_age_ms: f64,
    /// Longest time between two signs of life to the armed device until then, in ms.
    longest_gap_ms: f64,
    /// Median of the last round trips in ms.
    round_trip_ms_median: Option<f64>,
    /// Longest of the last round trips in ms.
    round_trip_ms_worst: Option<f64>,
    /// Mean difference between one of the last round trips and the next in ms.
    round_trip_ms_jitter: Option<f64>,
    /// Frames sent again until then as no answer came.
    repeats: u64,
    /// Stretches of received bytes until then that were no frame.
    crc_errors: u64,
    /// How often the link was lost until then.
    outages: u32,
}

/// Supply, loops and what each channel may still drive.
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
    /// For how long each channel may still drive at its largest force in the long run, in s.
    credit_s: Vec<f64>,
    /// How driving is charged: every drive its time, or its time times the square of its part of the channel's largest force.
    #[schema(schema_with = charge_rule_schema)]
    credit_rule: &'static str,
    /// For how long each channel may go on as it drives now, bursts and rests aside, in s; null where it never runs out. Null
    /// altogether with a board of protocol version 2, which does not tell.
    credit_lasts_s: Option<Vec<Option<f64>>>,
}

/// How well the board's clock is known.
#[derive(Clone, Copy, Debug, Serialize, ToSchema)]
#[schema(as = Clock)]
struct ClockView {
    /// How much faster than the host's it runs, in parts per million.
    rate_ppm: f64,
    /// Least half round trip in us, the bound on the error of its offset.
    half_round_trip_us: f64,
    /// Root mean square of the last prediction errors in us.
    residual_rms_us: f64,
    /// Largest of them in us.
    residual_worst_us: f64,
    /// Samples taken, those left out included.
    samples: u64,
    /// Samples left out as late.
    outliers: u64,
}

fn device_kind_schema() -> Object {
    text_choice_schema(TARGET_KINDS, false, "What it is.")
}

fn safety_state_schema() -> Object {
    let text = "Its safety state; null while it is not connected, or if it has not told any.";
    text_choice_schema(SafetyState::ALL.map(SafetyState::name), true, text)
}

fn fault_action_schema() -> Object {
    text_choice_schema(["clear"], false, "What takes it away: POST /v1/faults/clear.")
}

fn charge_rule_schema() -> Object {
    let text = "How driving is charged: every drive its time, or its time times the square of its part of the channel's largest force.";
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
                    .map(|i| credit.remaining_drive_time_ms(i).map(|ms| ms as f64 / 1e3))
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
