//! What the device logic needs of hardware. The firmware implements it with timers and pins, the simulated device
//! with a panel that it integrates in time.

use crate::MAX_CHANNELS;
use crate::protocol::{BoardKind, ChannelLimits, FaultCode, FirmwareVersion, ResetCause};
use crate::waveform::ChannelProgram;
use heapless::Vec;

/// Facts about the board that do not change while it runs.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct BoardInfo {
    /// Kind of board.
    pub board: BoardKind,
    /// Unique identifier of the chip.
    pub board_id: [u8; 12],
    /// Different after every start.
    pub boot_id: u32,
    /// Why it last started.
    pub reset_cause: ResetCause,
    /// The image.
    pub firmware: FirmwareVersion,
    /// One per channel.
    pub channels: Vec<ChannelLimits, MAX_CHANNELS>,
    /// A fault that ended the previous run (a panic, a HardFault); latched from the start.
    pub fault_before_reset: Option<(FaultCode, u32)>,
}

/// What the board measures now.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Measurements {
    /// Largest acceleration in the last 50 ms, in 1/1000 m/s^2, where there is an accelerometer.
    pub acceleration_peak_mm_per_s2: Option<u32>,
    /// Set-points of the rails in mV, one per channel.
    pub rail_millivolts: Vec<u32, MAX_CHANNELS>,
}

/// One program per channel; `None` switches the channel off.
pub type Programs = [Option<ChannelProgram>; MAX_CHANNELS];

/// The hardware under the device logic.
pub trait Board {
    /// Facts that do not change.
    fn info(&self) -> &BoardInfo;

    /// Time since boot in us; never goes back.
    fn now_us(&mut self) -> u64;

    /// All electrodes off, rails to zero, high voltage disabled. Cannot fail and takes effect before it returns.
    fn outputs_off(&mut self);

    /// Makes ready to drive: high voltage enabled, electrodes still off.
    ///
    /// # Errors
    /// The fault that keeps the hardware from it.
    fn arm(&mut self) -> Result<(), FaultCode>;

    /// Sets all channels at once. Called only when armed, with programs that [`crate::waveform::program`] made.
    ///
    /// # Errors
    /// The fault that keeps the hardware from it; the caller then switches everything off.
    fn apply(&mut self, programs: &Programs) -> Result<(), FaultCode>;

    /// What is measured now.
    fn measure(&mut self) -> Measurements;
}
