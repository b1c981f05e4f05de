//! What the device answers.

use super::Fault;
use super::identity::{BoardKind, ChannelLimits, FirmwareVersion, ResetCause};
use crate::MAX_CHANNELS;
use crate::safety::{SafetyEvent, SafetyState};
use crate::waveform::{DriveError, SequenceError};
use heapless::Vec;
use serde::{Deserialize, Serialize};

/// The answer to one request.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[allow(
    clippy::large_enum_variant,
    reason = "the firmware has no heap for the large variants, and only one reply exists at a time"
)]
pub enum Reply {
    /// To `Hello`.
    Hello(HelloReply),
    /// To `Arm`.
    Armed {
        /// The dead-man time in force, in ms.
        deadman_ms: u16,
    },
    /// To `Disarm`: everything is off.
    Disarmed,
    /// To `SetDrives`: what the timers really do.
    DrivesSet {
        /// In the order asked for.
        achieved: Vec<AchievedDrive, MAX_CHANNELS>,
    },
    /// To `Stop`: everything is off.
    Stopped,
    /// To `KeepAlive`.
    Alive {
        /// The safety state now.
        state: SafetyState,
    },
    /// To `Status`.
    Status(StatusReply),
    /// To `Faults`.
    Faults {
        /// The latched fault.
        latched: Option<Fault>,
    },
    /// To `ClearFaults`.
    FaultsCleared,
    /// To `Telemetry`.
    Telemetry(TelemetryReply),
    /// The request was not carried out, and nothing changed.
    Refused(Refusal),
    /// To `Hello`, from version 2 on.
    Welcome(super::WelcomeReply),
    /// To `ArmWith`.
    ArmedWith {
        /// The dead-man time in force, in ms.
        deadman_ms: u16,
        /// The longest burst in force, in ms.
        burst_ms: u16,
    },
    /// To `Prepare`: what the timers will do.
    Prepared {
        /// In the order asked for.
        achieved: Vec<AchievedDrive, MAX_CHANNELS>,
    },
    /// To `Play`: the effect waits for its start.
    Playing,
    /// To `Clock`.
    Clock {
        /// The board's time in us.
        now_us: u64,
    },
    /// To `Details`.
    Details(super::DetailsReply),
    /// To `Log`: the next bytes of the log, none if there are none.
    Log {
        /// defmt frames, which may be cut anywhere.
        bytes: Vec<u8, { super::LOG_CHUNK }>,
    },
    /// To `Bootloader`: the board restarts now and does not answer again.
    Bootloader,
    /// To `Credit`.
    Credit(super::CreditReply),
    /// To `PlayWindows`: the windows wait for their start.
    WindowsPlaying {
        /// When the sequence begins, in us of the board's time.
        start_us: u64,
    },
    /// To `NumberedFault`.
    NumberedFault {
        /// Counts faults that were latched since the board started, from 1; 0 if there was none.
        number: u32,
        /// The latched fault.
        latched: Option<Fault>,
    },
}

/// Why a request was not carried out.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Refusal {
    /// The frame's protocol version is not spoken here.
    Version {
        /// The version in the frame.
        got: u8,
        /// Oldest spoken by the device.
        device_min: u8,
        /// Newest spoken by the device.
        device_current: u8,
    },
    /// The frame's kind or body could not be understood.
    Malformed,
    /// Not in this state.
    State {
        /// The safety state.
        state: SafetyState,
        /// What was asked for.
        event: SafetyEvent,
    },
    /// A drive is out of range.
    Drive {
        /// The channel asked for.
        channel: u8,
        /// What about it, with the limits.
        error: DriveError,
    },
    /// The same channel twice in one command.
    DuplicateChannel {
        /// The channel.
        channel: u8,
    },
    /// Another link has armed the board; only it may drive.
    OtherLink,
    /// The dead-man time is out of range.
    Deadman {
        /// As asked for.
        requested_ms: u16,
        /// Least allowed.
        min_ms: u16,
        /// Most allowed.
        max_ms: u16,
    },
    /// A fault arose while carrying it out; everything is off.
    Fault(Fault),
    /// The channel has driven for as long as it may.
    Duty {
        /// The channel.
        channel: u8,
        /// When to ask again, in ms.
        wait_ms: u32,
    },
    /// The fault cannot be cleared while its cause is still there.
    StillThere(super::FaultCode),
    /// An effect for a channel that has no drive.
    NoDrive {
        /// The channel.
        channel: u8,
    },
    /// An effect that starts too long ago or too far ahead.
    Start {
        /// As asked for, in us of the board's time.
        start_us: u64,
        /// The board's time.
        now_us: u64,
    },
    /// An effect without segments, with a level beyond 1000, or to be played 0 or more than 1000 times.
    Effect,
    /// As many effects wait for the channel as can.
    QueueFull {
        /// The channel.
        channel: u8,
    },
    /// The longest burst is out of range.
    Burst {
        /// As asked for.
        requested_ms: u16,
        /// Least allowed.
        min_ms: u16,
        /// Most allowed.
        max_ms: u16,
    },
    /// Not while high voltage may be on.
    Live(SafetyState),
    /// The board is about to restart into its bootloader. From version 4 on, as all that follows.
    Restarting,
    /// Another fault is latched than the one that was to be cleared.
    OtherFault {
        /// Its number.
        number: u32,
    },
    /// A sequence of windows is out of range.
    Sequence(SequenceError),
    /// The drives or windows would take more current from the supply than it may deliver on average.
    Current {
        /// What they would take, in uA.
        requested_microamps: u32,
        /// Most allowed.
        max_microamps: u32,
    },
}

/// Who the device is.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct HelloReply {
    /// Oldest protocol version spoken.
    pub protocol_min: u8,
    /// Newest protocol version spoken.
    pub protocol_current: u8,
    /// Kind of board.
    pub board: BoardKind,
    /// Unique identifier of the chip.
    pub board_id: [u8; 12],
    /// Different after every start, so that the host notices a restart.
    pub boot_id: u32,
    /// Why it last started.
    pub reset_cause: ResetCause,
    /// The image.
    pub firmware: FirmwareVersion,
    /// One per channel.
    pub channels: Vec<ChannelLimits, MAX_CHANNELS>,
    /// Dead-man time if `Arm` names none, in ms.
    pub default_deadman_ms: u16,
}

/// What the timers really do for one drive, computed from the register values.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct AchievedDrive {
    /// 0-based.
    pub channel: u8,
    /// In 1e-9 Hz, rounded to the nearest.
    pub frequency_nanohertz: u64,
    /// In parts per million of the half period, rounded down.
    pub pulse_width_ppm: u32,
    /// In millionths of a turn, rounded to the nearest.
    pub phase_microturns: u32,
    /// Both electrodes off between two windows, in ns, rounded down.
    pub guard_ns: u32,
    /// Set-point of the rail in mV, rounded down: never above what was asked for.
    pub voltage_millivolts: u32,
}

/// One channel as it stands.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct ChannelStatus {
    /// The drive in force; `None` if the channel is off.
    pub drive: Option<AchievedDrive>,
}

/// What the device received on its links since boot.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct LinkCounters {
    /// Frames whose CRC was right.
    pub good_frames: u32,
    /// Stretches between zeros that were no frame.
    pub bad_frames: u32,
    /// Good frames that were refused.
    pub refused: u32,
}

/// State, drives and counters.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct StatusReply {
    /// The safety state.
    pub state: SafetyState,
    /// Time since boot in us.
    pub uptime_us: u64,
    /// Differs after every start.
    pub boot_id: u32,
    /// The latched fault.
    pub fault: Option<Fault>,
    /// One per channel.
    pub channels: Vec<ChannelStatus, MAX_CHANNELS>,
    /// What came in.
    pub link: LinkCounters,
}

/// What the board measures.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct TelemetryReply {
    /// Time since boot in us.
    pub uptime_us: u64,
    /// The safety state.
    pub state: SafetyState,
    /// Largest acceleration of the surface at the accelerometer since telemetry was last asked for, and in the last 50 ms at least, in
    /// 1/1000 m/s^2, where there is one.
    pub acceleration_peak_mm_per_s2: Option<u32>,
    /// Set-points of the rails in mV, one per channel.
    pub rail_millivolts: Vec<u32, MAX_CHANNELS>,
}
