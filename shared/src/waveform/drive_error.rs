//! Why a drive cannot be had.

use serde::{Deserialize, Serialize};

/// Every way in which a drive can be out of range, with what would be in it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum DriveError {
    /// The board has no such channel.
    NoSuchChannel {
        /// Channels that it has.
        channels: u8,
    },
    /// Frequency below or above the limits, all in 1/1000 Hz.
    Frequency {
        /// As asked for.
        requested_millihertz: u32,
        /// Least allowed.
        min_millihertz: u32,
        /// Most allowed.
        max_millihertz: u32,
    },
    /// Voltage above the limit, in mV.
    Voltage {
        /// As asked for.
        requested_millivolts: u32,
        /// Most allowed.
        max_millivolts: u32,
    },
    /// The windows would leave less than the guard time between them.
    PulseTooWide {
        /// As asked for.
        requested_ppm: u32,
        /// Widest at this frequency.
        widest_ppm: u32,
        /// The guard time that must remain, in ns.
        min_guard_ns: u32,
    },
    /// The windows would be shorter than one tick of the timer.
    PulseTooNarrow {
        /// As asked for.
        requested_ppm: u32,
        /// Narrowest at this frequency.
        narrowest_ppm: u32,
    },
    /// Phase of a whole turn or more, in millionths of a turn.
    Phase {
        /// As asked for.
        requested_microturns: u32,
    },
    /// No prescaler and auto-reload value give this frequency from the timer's clock.
    NotRepresentable {
        /// The timer's clock in Hz.
        timer_clock_hz: u32,
    },
}
