//! What the host asks of the device.

use crate::MAX_CHANNELS;
use crate::supply::RAILS;
use crate::waveform::{Effect, MAX_WINDOWS, SequenceWindow};
use heapless::Vec;
use serde::{Deserialize, Serialize};

/// A command from the host. Every one is answered by exactly one [`super::Reply`] with the same sequence number, and
/// every one but `Play`, `ClearFaults` and `Log` can be repeated without harm if the answer was lost; `PlayOnce` and `ClearFault` take the place of the first
/// two.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[allow(
    clippy::large_enum_variant,
    reason = "the firmware has no heap for the large variant, and only one request exists at a time"
)]
pub enum Request {
    /// Who are you? Always allowed.
    Hello {
        /// Oldest protocol version that the host speaks.
        host_min: u8,
        /// Newest protocol version that the host speaks.
        host_current: u8,
    },
    /// Make ready to drive. The link that arms is the one whose silence switches everything off.
    Arm {
        /// Longest silence in ms, or the board's default (250 ms).
        deadman_ms: Option<u16>,
    },
    /// Everything off, session over.
    Disarm,
    /// Sets the drives of all channels at once: channels that are not named are switched off. If one of them is out of
    /// range, nothing changes.
    SetDrives {
        /// At most one per channel.
        drives: Vec<ChannelDrive, MAX_CHANNELS>,
    },
    /// Everything off, from any link and in any state.
    Stop,
    /// I am still here.
    KeepAlive,
    /// State, drives and counters.
    Status,
    /// The latched fault, if any.
    Faults,
    /// Forget the latched fault; the device is then safe, and off.
    ClearFaults,
    /// What the board measures.
    Telemetry,
    /// As `Arm`, with the longest burst. From version 2 on, as all that follows.
    ArmWith {
        /// Longest silence in ms, or the board's default.
        deadman_ms: Option<u16>,
        /// Longest time in ms for which a channel drives without a rest, or the board's default (2 s).
        burst_ms: Option<u16>,
    },
    /// As `SetDrives`, but the channels stay silent until an effect is played on them.
    Prepare {
        /// At most one per channel.
        drives: Vec<ChannelDrive, MAX_CHANNELS>,
    },
    /// Plays an effect on a channel that has a drive. Up to four wait for each channel.
    Play {
        /// 0-based.
        channel: u8,
        /// When, in us of the board's time; 0: at once.
        start_us: u64,
        /// What.
        effect: Effect,
    },
    /// The board's time.
    Clock,
    /// What is measured, and what the board still allows.
    Details,
    /// The next bytes of the board's log.
    Log,
    /// Restart into the bootloader in the chip's ROM, to be flashed over USB. Only while nothing can be live.
    Bootloader {
        /// [`BOOTLOADER_KEY`], so that no broken or mistaken request does it.
        key: u32,
    },
    /// What the channels may still drive, and what they are charged. From version 3 on.
    Credit,
    /// As `Play`, but once: a number that was played already is answered and not played again. From version 4 on, as all that
    /// follows.
    PlayOnce {
        /// Given by the host: another one for every effect, the same one when it repeats a request.
        number: u32,
        /// 0-based.
        channel: u8,
        /// When, in us of the board's time; 0: at once, or when those that wait have ended.
        start_us: u64,
        /// What.
        effect: Effect,
    },
    /// Plays windows that are given one by one, on all channels from one clock edge; whatever was driven ends. All of them are refused
    /// if one is out of range.
    PlayWindows(WindowSequence),
    /// The latched fault, if any, and its number.
    NumberedFault,
    /// Forget the latched fault if it is the one with this number; a newer one stays.
    ClearFault {
        /// From `NumberedFault`.
        number: u32,
    },
}

/// Windows that are given one by one.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct WindowSequence {
    /// As in [`Request::PlayOnce`].
    pub number: u32,
    /// When the sequence begins, in us of the board's time; 0: as soon as the rails are there.
    pub start_us: u64,
    /// Voltage of each rail in mV.
    pub rail_millivolts: [u32; RAILS],
    /// In the order of time on each channel.
    pub windows: Vec<SequenceWindow, MAX_WINDOWS>,
}

/// What a `Bootloader` request must carry: "BOOT".
pub const BOOTLOADER_KEY: u32 = 0x424F_4F54;

impl Request {
    /// The first protocol version that has this request.
    #[must_use]
    pub const fn introduced_in_version(&self) -> u8 {
        match self {
            Request::Hello { .. }
            | Request::Arm { .. }
            | Request::Disarm
            | Request::SetDrives { .. }
            | Request::Stop
            | Request::KeepAlive
            | Request::Status
            | Request::Faults
            | Request::ClearFaults
            | Request::Telemetry => 1,
            Request::ArmWith { .. }
            | Request::Prepare { .. }
            | Request::Play { .. }
            | Request::Clock
            | Request::Details
            | Request::Log
            | Request::Bootloader { .. } => 2,
            Request::Credit => 3,
            Request::PlayOnce { .. }
            | Request::PlayWindows(_)
            | Request::NumberedFault
            | Request::ClearFault { .. } => 4,
        }
    }
}

/// The drive of one ERA: electrodes A and B in turn, each for `pulse_width` of its half period and centred in it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct ChannelDrive {
    /// 0-based.
    pub channel: u8,
    /// Frequency of the force's fundamental in 1/1000 Hz.
    pub frequency_millihertz: u32,
    /// Fraction of its half period for which an electrode is on, in parts per million.
    pub pulse_width_ppm: u32,
    /// Phase of the force, F ~ cos(2 pi (f t + phase)), in millionths of a turn, below 1 000 000. The common time origin
    /// of all channels is the moment at which the drives take effect.
    pub phase_microturns: u32,
    /// Electrode voltage in mV.
    pub voltage_millivolts: u32,
}
