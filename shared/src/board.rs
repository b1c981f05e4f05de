//! What the device logic needs of hardware. The firmware implements it with timers and pins, the simulated device
//! with a panel that it integrates in time.

use crate::MAX_CHANNELS;
use crate::protocol::{BoardKind, ChannelLimits, FAILURE_MESSAGE, FaultCode, FirmwareVersion, IMAGE_NAME, ResetCause};
use crate::safety::ElectrodePulses;
use crate::supply::{FaultFinding, RAILS, SensorReadings, SupplyCommand};
use crate::waveform::{Electrode, TimerPreload};
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
    /// What the previous run has kept; `None` if it is not known, and then channels begin with all of their credit.
    pub kept_before_reset: Option<KeptRun>,
}

/// What the next start must know of a run.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct KeptRun {
    /// Whether high voltage may be on.
    pub is_live: bool,
    /// Whether the measurement of the rails was found wrong, so that a rail may be charged whatever it shows.
    pub is_measurement_distrusted: bool,
    /// The credit of each channel in ms.
    pub credit_ms: [u32; MAX_CHANNELS],
}

impl KeptRun {
    /// The one that counts of the copies that memory has kept: the one that says live, then the one that distrusts.
    #[must_use]
    pub fn choose_copy_preferring_live_then_distrusted(copies: [Option<Self>; 2]) -> Option<Self> {
        copies.into_iter().flatten().max_by_key(|copy| (copy.is_live, copy.is_measurement_distrusted))
    }
}

/// The hardware under the device logic.
pub trait Board {
    /// Facts that do not change.
    fn info(&self) -> &BoardInfo;

    /// Time since boot in us; never goes back.
    fn now_us(&mut self) -> u64;

    /// Everything off: electrodes low, timers stopped, supply disabled, set-points at zero, discharge switches closed. Cannot
    /// fail and takes effect before it returns.
    fn switch_outputs_off(&mut self);

    /// Measures rails, current and safety loops. What has tripped since the last call is part of the readings, and is reported once.
    fn read_sensors_and_take_trip(&mut self) -> SensorReadings;

    /// Tests every comparator and break input that switches off in hardware: each must trip when it is made to, and must be
    /// released afterwards. Electrodes stay off.
    ///
    /// # Errors
    /// The first of them that does not trip, or that stays tripped.
    fn test_trip_circuits(&mut self) -> Result<(), FaultFinding>;

    /// Tests the inputs of the comparators that switch off at too much voltage: with their threshold lowered below the self-test's
    /// voltage, those of the rails that are `charged` must trip, the others must not, and all must be released afterwards. Electrodes
    /// stay off.
    ///
    /// # Errors
    /// The first of them that does not do so.
    fn test_over_voltage_inputs(&mut self, charged: [bool; RAILS]) -> Result<(), FaultFinding>;

    /// Switches one electrode to its rail [`crate::limits::TEST_PULSES`] times, for [`crate::limits::TEST_PULSE_MICROSECONDS`] each and with
    /// [`crate::limits::TEST_PAUSE_MICROSECONDS`] after each, while all others stay low and no timer reaches a pin, and measures its rail after
    /// the first and after the last pulse. The supply is disabled, the rails stand at the self-test's voltage. The electrode is low when this
    /// returns, whatever it returns.
    ///
    /// # Errors
    /// What has tripped, or [`FaultCode::ArmFailed`] if another electrode is not low, or its own pad does not become high.
    fn pulse_electrode_and_get_rail_mv_after_first_and_last(
        &mut self,
        channel: usize,
        electrode: Electrode,
    ) -> Result<ElectrodePulses, FaultFinding>;

    /// Keeps what the next start must know of this run. To be called every ms, and whenever everything has been switched off.
    fn store_run_record_for_next_boot(&mut self, run: KeptRun);

    /// Enables or disables the supply, and sets its set-points and discharge switches.
    fn apply_supply_command(&mut self, command: &SupplyCommand);

    /// Loads all timers with [`crate::waveform::IDLE`] and starts them at the same clock edge. The electrodes stay low. That moment
    /// is the zero of [`TimerPreload::at`].
    ///
    /// # Errors
    /// The fault that prevents the start; the caller then switches everything off.
    fn start_timers(&mut self) -> Result<(), FaultCode>;

    /// Connects the timers' outputs to the electrodes' pins, or disconnects them and holds the pins low.
    ///
    /// # Errors
    /// As [`Board::start_timers`].
    fn set_timers_connected_to_electrodes(&mut self, connected: bool) -> Result<(), FaultCode>;

    /// Writes one period to a running timer's preload registers. It takes effect at the timer's next boundary, `preload.at`,
    /// which is at least 50 us ahead: the sequencer leaves 100 us and uses some of them itself.
    ///
    /// # Errors
    /// [`FaultCode::ReadBack`] if a register does not hold what was written.
    fn write_preload_and_check_read_back(&mut self, preload: &TimerPreload) -> Result<(), FaultCode>;

    /// Checks that all timers still count and hold what was written to them. To be called every ms while they run.
    ///
    /// # Errors
    /// The fault, with the channel.
    fn check_timers_still_count_and_hold_settings(&mut self) -> Result<(), FaultFinding>;

    /// Largest acceleration in 1/1000 m/s^2 since the last call, or of the last 50 ms if that is longer; `None` without an
    /// accelerometer.
    fn take_peak_acceleration_mm_per_s2_if_sensor_exists(&mut self) -> Option<u32>;

    /// Moves the oldest bytes of the log to `buffer`, as many as there are and fit; returns their number.
    fn take_log_bytes(&mut self, buffer: &mut [u8]) -> usize;

    /// Has the chip restart into its own bootloader a moment after this returns, so that the reply is still sent.
    fn request_bootloader_restart(&mut self);
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn of_two_copies_of_a_run_the_one_that_warns_counts() {
        let copy = |is_live, is_measurement_distrusted| {
            Some(KeptRun { is_live, is_measurement_distrusted, credit_ms: [7; MAX_CHANNELS] })
        };
        let (harmless, distrusts, live) = (copy(false, false), copy(false, true), copy(true, false));
        for (one, other, counts) in [
            (harmless, live, live),
            (harmless, distrusts, distrusts),
            (distrusts, live, live),
            (None, harmless, harmless),
        ] {
            assert_eq!(KeptRun::choose_copy_preferring_live_then_distrusted([one, other]), counts);
            assert_eq!(KeptRun::choose_copy_preferring_live_then_distrusted([other, one]), counts);
        }
        assert_eq!(KeptRun::choose_copy_preferring_live_then_distrusted([None, None]), None);
    }
}
