//! The hardware behind the device logic of `era-shared`.

use crate::clock_check::{self, ClockCheck};
use crate::clocks::TIMER_CLOCK_HZ;
use crate::pins::CHANNELS;
use crate::{
    average_current, bootloader, breaks, comparators, electrode_test, log, outputs, permit, run_record, sense, supply,
    timers, trip,
};
use embassy_time::{Duration, Instant};
use era_shared::board::{Board, BoardInfo, KeptRun};
use era_shared::protocol::{ChannelLimits, FaultCode};
use era_shared::safety::ElectrodePulses;
use era_shared::supply::{FaultFinding, RAILS, SensorReadings, SupplyCommand};
use era_shared::waveform::{Electrode, IDLE, TimerPeriod, TimerPreload};

/// What each channel can do.
pub const CHANNEL_LIMITS: ChannelLimits = ChannelLimits::BOARD;
// What the shared limits say must be what this board's clock tree really is.
const _: () = assert!(CHANNEL_LIMITS.timer_clock_hz == TIMER_CLOCK_HZ);

/// Clocks in a us.
const CLOCKS_PER_US: u64 = TIMER_CLOCK_HZ as u64 / 1_000_000;
/// Least time in which a counter is looked at again when it seems to stand.
const COUNT_WAIT: Duration = Duration::from_micros(20);

/// Detail of a finding about the comparators' settings, beyond all channels.
const DETAIL_COMPARATORS: u32 = 10;
/// Likewise about the timer that makes the permit.
const DETAIL_PERMIT: u32 = 11;
/// Likewise about the timer from which all time comes.
const DETAIL_TIME: u32 = 12;

/// The fault to report for a step that has failed with `fallback`: a trip that has come meanwhile, as it is the reason for the failure, or else
/// `fallback`.
fn take_trip_code_or(fallback: FaultCode) -> FaultCode {
    trip::take_trip().map_or(fallback, |(code, _)| code)
}

/// The STM32G474 actuator board.
pub struct Stm32Board {
    info: BoardInfo,
    /// When the timers were started, in us of the board's time.
    started_us: u64,
    /// What each timer's preload registers hold.
    loaded: [TimerPeriod; CHANNELS],
    /// Each counter's value at the last check.
    counts: [Option<u16>; CHANNELS],
    connected: bool,
    /// A fault that was found at the start and cannot go before the next one.
    lasting_fault: Option<FaultFinding>,
    clock_check: ClockCheck,
}

impl Stm32Board {
    /// The board, with everything off.
    pub fn new(mut info: BoardInfo, lasting_fault: Option<FaultFinding>) -> Self {
        info.channels = core::iter::repeat_n(CHANNEL_LIMITS, CHANNELS).collect();
        outputs::force_outputs_off_withdraw_permit_and_stop_timers();
        Self {
            info,
            started_us: 0,
            loaded: [IDLE; CHANNELS],
            counts: [None; CHANNELS],
            connected: false,
            lasting_fault,
            clock_check: ClockCheck::new(),
        }
    }

    /// Whether a channel's counter has moved since the last check.
    fn has_counter_moved_since_last_check_or_within_two_ticks(&mut self, channel: usize) -> bool {
        let (Some(last), Some(period)) = (self.counts.get_mut(channel), self.loaded.get(channel)) else {
            return false;
        };
        let now = timers::read_counter(channel);
        let Some(before) = last.replace(now) else { return true };
        if now != before {
            return true;
        }
        // A period that divides the time between two looks brings the counter back to where it was: two ticks decide.
        let ticks = Duration::from_micros(u64::from(period.divider) * 2 / CLOCKS_PER_US);
        let end = Instant::now() + ticks.max(COUNT_WAIT);
        while Instant::now() <= end {
            let now = timers::read_counter(channel);
            if now != before {
                *last = Some(now);
                return true;
            }
        }
        false
    }

    /// What is wrong with the board itself now.
    fn find_stored_startup_fault_or_present_clock_or_permit_fault(&mut self) -> Option<FaultFinding> {
        if let Some(finding) =
            self.lasting_fault.or_else(|| self.clock_check.look_if_due_and_find_lasting_clock_fault())
        {
            return Some(finding);
        }
        if !clock_check::is_time_base_prescaler_intact() {
            return Some((FaultCode::ReadBack, DETAIL_TIME));
        }
        // With interrupts masked, so that a break between the two looks is not taken for a line that does not follow.
        cortex_m::interrupt::free(|_| {
            if permit::is_withdrawn_by_break() {
                // A break whose interrupt has not run; one that runs after this notes its reason itself.
                return Some(breaks::find_trip_cause_or_assume_over_current());
            }
            permit::check_line_level_matches_permit().err()
        })
    }

    fn check_timers_count_and_trip_settings_hold(&mut self) -> Result<(), FaultFinding> {
        if !comparators::are_all_settings_intact() {
            return Err((FaultCode::ReadBack, DETAIL_COMPARATORS));
        }
        if !permit::are_permit_timer_settings_intact() {
            return Err((FaultCode::ReadBack, DETAIL_PERMIT));
        }
        if self.connected && !timers::WITH_BREAK.into_iter().all(timers::is_main_output_enabled) {
            // A break whose interrupt has not run, or not been enabled.
            return Err(breaks::find_trip_cause_or_assume_over_current());
        }
        for (channel, number) in (0..CHANNELS).zip(0..) {
            if !timers::is_counting(channel) || !self.has_counter_moved_since_last_check_or_within_two_ticks(channel) {
                return Err((FaultCode::TimerStopped, number));
            }
            let loaded =
                self.loaded.get(channel).is_some_and(|it| timers::are_registers_intact(channel, it, self.connected));
            if !loaded {
                return Err((FaultCode::ReadBack, number));
            }
        }
        Ok(())
    }
}

impl Board for Stm32Board {
    fn info(&self) -> &BoardInfo {
        &self.info
    }

    fn now_us(&mut self) -> u64 {
        Instant::now().as_micros()
    }

    fn switch_outputs_off(&mut self) {
        outputs::force_outputs_off_withdraw_permit_and_stop_timers();
        self.connected = false;
    }

    fn read_sensors_and_take_trip(&mut self) -> SensorReadings {
        let measured = sense::measure_rails_loops_earth_bond_and_reference();
        let [interlock_millivolts, stop_millivolts] = measured.loop_millivolts;
        // Before the trips: what a break has withdrawn has its reason there, if its interrupt works.
        let standing_fault = self.find_stored_startup_fault_or_present_clock_or_permit_fault();
        SensorReadings {
            rail_millivolts: measured.rail_millivolts,
            average_microamps: average_current::read_average_microamps_or_max_if_stale(),
            // Both: the comparator acts without software, the level tells a closed loop from a shorted one.
            interlock_closed: comparators::is_interlock_comparator_intact_and_not_tripped()
                && sense::is_loop_level_closed(interlock_millivolts),
            stop_released: comparators::is_emergency_stop_comparator_intact_and_not_tripped()
                && sense::is_loop_level_closed(stop_millivolts),
            interlock_millivolts,
            stop_millivolts,
            earth_bonded: measured.earth_bonded,
            reference_millivolts: measured.reference_millivolts,
            trip: trip::take_trip(),
            standing_fault,
        }
    }

    fn test_trip_circuits(&mut self) -> Result<(), FaultFinding> {
        match outputs::find_output_not_low() {
            None => breaks::test_permit_line_comparators_and_break_interrupt(),
            Some(pin) => Err((FaultCode::ArmFailed, pin)),
        }
    }

    fn test_over_voltage_inputs(&mut self, charged: [bool; RAILS]) -> Result<(), FaultFinding> {
        match outputs::find_electrode_not_low() {
            None => breaks::test_over_voltage_inputs(charged),
            Some(pin) => Err((FaultCode::ArmFailed, pin)),
        }
    }

    fn pulse_electrode_and_get_rail_mv_after_first_and_last(
        &mut self,
        channel: usize,
        electrode: Electrode,
    ) -> Result<ElectrodePulses, FaultFinding> {
        electrode_test::pulse_electrode_and_get_rail_mv_after_first_and_last(channel, electrode)
    }

    fn store_run_record_for_next_boot(&mut self, run: KeptRun) {
        run_record::keep_run_record(run);
    }

    fn apply_supply_command(&mut self, command: &SupplyCommand) {
        supply::apply_supply_command_or_off_if_tripped(command);
    }

    fn start_timers(&mut self) -> Result<(), FaultCode> {
        self.loaded = [IDLE; CHANNELS];
        self.counts = [None; CHANNELS];
        // With interrupts masked, so that the time noted is that of the start.
        cortex_m::interrupt::free(|_| {
            let started = timers::enable_break_interrupt_and_start_timers_if_registers_hold();
            self.started_us = Instant::now().as_micros();
            if started { Ok(()) } else { Err(FaultCode::ReadBack) }
        })
        .map_err(take_trip_code_or)
    }

    fn set_timers_connected_to_electrodes(&mut self, connected: bool) -> Result<(), FaultCode> {
        cortex_m::interrupt::free(|masked| {
            if let Some((code, _)) = trip::take_trip() {
                return Err(code);
            }
            if connected {
                // Still low: outputs that MOE switches off are driven low, and TIM4 runs blank periods.
                outputs::set_timers_connected_to_electrodes(masked, true);
                timers::set_main_outputs(true);
            } else {
                timers::set_main_outputs(false);
                outputs::set_timers_connected_to_electrodes(masked, false);
            }
            self.connected = connected;
            Ok(())
        })
    }

    fn write_preload_and_check_read_back(&mut self, preload: &TimerPreload) -> Result<(), FaultCode> {
        let Some(loaded) = self.loaded.get_mut(preload.channel) else { return Err(FaultCode::DriveFailed) };
        // With interrupts masked for 2 us, so that nothing comes between the look at the clock and the last register.
        cortex_m::interrupt::free(|masked| {
            let now_us = Instant::now().as_micros().saturating_sub(self.started_us);
            if preload.is_too_late_to_write(now_us, CLOCKS_PER_US) {
                // Its place in time is lost, and with it the phase.
                return Err(FaultCode::DriveFailed);
            }
            *loaded = preload.period;
            if timers::write_preload_and_check_read_back(masked, preload.channel, &preload.period) {
                Ok(())
            } else {
                Err(FaultCode::ReadBack)
            }
        })
        .map_err(take_trip_code_or)
    }

    /// Detail: the channel, [`DETAIL_COMPARATORS`] or [`DETAIL_PERMIT`].
    fn check_timers_still_count_and_hold_settings(&mut self) -> Result<(), FaultFinding> {
        self.check_timers_count_and_trip_settings_hold().map_err(|finding| trip::take_trip().unwrap_or(finding))
    }

    fn take_peak_acceleration_mm_per_s2_if_sensor_exists(&mut self) -> Option<u32> {
        None
    }

    fn take_log_bytes(&mut self, buffer: &mut [u8]) -> usize {
        log::take_log_bytes(buffer)
    }

    fn request_bootloader_restart(&mut self) {
        bootloader::ask_task_to_reset_into_bootloader();
    }
}
