//! What the device logic needs of hardware. The firmware implements it with timers and pins, the simulated device
//! with a panel that it integrates in time.

use crate::MAX_CHANNELS;
use crate::protocol::{BoardKind, ChannelLimits, FAILURE_MESSAGE, FaultCode, FirmwareVersion, IMAGE_NAME, ResetCause};
use crate::supply::{Finding, Senses, Supply};
use crate::waveform::Preload;
use heapless::{String, Vec};

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
    /// Name of the image.
    pub image: String<IMAGE_NAME>,
    /// Its version.
    pub firmware: FirmwareVersion,
    /// One per channel.
    pub channels: Vec<ChannelLimits, MAX_CHANNELS>,
    /// A fault that ended the previous run (a panic, a HardFault, the watchdog, a brown-out); latched from the start.
    pub fault_before_reset: Option<(FaultCode, u32)>,
    /// What it said then.
    pub failure: String<FAILURE_MESSAGE>,
}

/// The hardware under the device logic.
pub trait Board {
    /// Facts that do not change.
    fn info(&self) -> &BoardInfo;

    /// Time since boot in us; never goes back.
    fn now_us(&mut self) -> u64;

    /// Everything off: electrodes low, timers stopped, supply disabled, set-points at zero, discharge switches closed. Cannot
    /// fail and takes effect before it returns.
    fn outputs_off(&mut self);

    /// Measures rails, current and loops, and tells what tripped since the last call.
    fn sense(&mut self) -> Senses;

    /// Tries every comparator and break that has to switch off in hardware: each must trip when made to, and
    /// rest afterwards. Electrodes stay off.
    ///
    /// # Errors
    /// The first that did not do so.
    fn test_trips(&mut self) -> Result<(), Finding>;

    /// Enables or disables the supply, sets its set-points and discharge switches.
    fn set_supply(&mut self, supply: &Supply);

    /// Loads all timers with [`crate::waveform::IDLE`] and starts them in the same clock, the electrodes still low. The moment
    /// is the zero of [`Preload::at`].
    ///
    /// # Errors
    /// The fault that keeps the hardware from it; the caller then switches everything off.
    fn start_timers(&mut self) -> Result<(), FaultCode>;

    /// Lets the timers reach the electrodes' pins, or takes the pins from them.
    ///
    /// # Errors
    /// As [`Board::start_timers`].
    fn connect_electrodes(&mut self, connected: bool) -> Result<(), FaultCode>;

    /// Writes one period to a running timer's preload registers; it takes effect at the timer's next boundary, which is at
    /// `preload.at`, at least 50 us from now (the sequencer leaves 100 us, of which it takes some itself).
    ///
    /// # Errors
    /// [`FaultCode::ReadBack`] if a register does not hold it.
    fn preload(&mut self, preload: &Preload) -> Result<(), FaultCode>;

    /// Whether all timers still count; called every ms while they should.
    ///
    /// # Errors
    /// What is wrong, with the channel.
    fn check_timers(&mut self) -> Result<(), Finding>;

    /// Largest acceleration since this was last asked, and in the last 50 ms at least, in 1/1000 m/s^2, where there is an accelerometer.
    fn acceleration_peak_mm_per_s2(&mut self) -> Option<u32>;

    /// Takes the oldest bytes of the log, as many as there are and fit; returns their number.
    fn take_log(&mut self, out: &mut [u8]) -> usize;

    /// Restarts into the chip's own bootloader, a moment after this returns, so that the answer still goes out.
    fn enter_bootloader(&mut self);
}
