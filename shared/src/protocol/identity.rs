//! What a board is and can do.

use crate::limits::{GUARD_NANOSECONDS, MAX_RAIL_MILLIVOLTS};
use serde::{Deserialize, Serialize};

/// Which kind of board answers.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum BoardKind {
    /// The simulated device in the host program.
    Simulated,
    /// The STM32G474 actuator board (also when it runs in the emulator: it is the same image).
    Stm32G474,
}

/// Why the processor last started.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum ResetCause {
    /// Power came on, or it dipped below the brown-out level.
    PowerOn,
    /// The reset pin.
    Pin,
    /// The firmware asked for it.
    Software,
    /// A watchdog.
    Watchdog,
    /// Low power or option bytes, or not known.
    Other,
}

/// Version of the firmware image.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct FirmwareVersion {
    /// Semantic version.
    pub major: u8,
    /// Semantic version.
    pub minor: u8,
    /// Semantic version.
    pub patch: u8,
    /// First eight hexadecimal digits of the source's commit, as ASCII; zeros if not known.
    pub commit: [u8; 8],
}

/// What one channel can do. The board enforces it; the host plans with it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct ChannelLimits {
    /// Lowest frequency in 1/1000 Hz.
    pub min_frequency_millihertz: u32,
    /// Highest frequency in 1/1000 Hz.
    pub max_frequency_millihertz: u32,
    /// Highest electrode voltage in mV; also the full scale of the rail's set-point.
    pub max_voltage_millivolts: u32,
    /// Shortest time in ns for which both electrodes are off between two windows.
    pub min_guard_ns: u32,
    /// Clock of the timer before its prescaler, in Hz.
    pub timer_clock_hz: u32,
}

impl ChannelLimits {
    /// What a channel of the STM32G474 board can do; the simulated board does the same.
    pub const BOARD: Self = Self {
        // A period at 1 Hz is 170 000 000 clocks, well within what the prescaler and the 16-bit counter can count.
        min_frequency_millihertz: 1_000,
        // The upper end of what skin feels.
        max_frequency_millihertz: 1_000_000,
        max_voltage_millivolts: MAX_RAIL_MILLIVOLTS,
        min_guard_ns: GUARD_NANOSECONDS,
        // SYSCLK, undivided, as all four timers get it.
        timer_clock_hz: 170_000_000,
    };
}
