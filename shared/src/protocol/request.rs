//! What the host asks of the device.

use crate::MAX_CHANNELS;
use heapless::Vec;
use serde::{Deserialize, Serialize};

/// A command from the host. Every one is answered by exactly one [`super::Reply`] with the same sequence number, and
/// every one can be repeated without harm if the answer was lost.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
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
