//! The simulated board: timers, rails and loops as numbers, the panel in the electrodes' place.

use super::electrodes::BrokenElectrode;
use super::panel::SimPanel;
use super::rails::SimRail;
use super::timer::SimTimer;
use era_shared::board::{Board, BoardInfo, KeptRun};
use era_shared::limits::REFERENCE_MILLIVOLTS;
use era_shared::protocol::{BoardKind, ChannelLimits, FaultCode, FirmwareVersion, ResetCause};
use era_shared::safety::ElectrodePulses;
use era_shared::supply::{FaultFinding, RAILS, SensorReadings, SupplyCommand};
use era_shared::waveform::{Electrode, TimerPreload};
use std::time::{Duration, Instant};

/// What a longer time between two readings of its clock is counted as: the tick of the device's loop.
const TICK: Duration = Duration::from_millis(1);
/// A longer time from one reading of its clock to the next is no tick that came late: the computer stood still, and the board with it. What comes late
/// by less is counted as it is, so that the board's clock follows the computer's.
const STALL: Duration = Duration::from_millis(25);

/// Where the board's time comes from.
#[derive(Clone, Copy, Debug)]
pub enum Clock {
    /// Wall-clock time since the given instant, without what the computer stood still.
    Wall(Instant),
    /// Time in us that the owner sets, for runs faster than real time.
    Manual(u64),
}

/// What is wrong with the hardware.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Defects {
    /// The enclosure is open.
    pub interlock_open: bool,
    /// The emergency stop is pressed.
    pub stop_pressed: bool,
    /// The bond to protective earth is broken.
    pub earth_open: bool,
    /// This rail, counted from 0, is shorted.
    pub shorted_rail: Option<usize>,
    /// Average current of the supply in uA, over what rails and electrodes take.
    pub leakage_microamps: u32,
    /// The comparator or break that does not trip, by its number in the troubleshooting table.
    pub dead_trip: Option<u32>,
    /// The channel whose timer stands still.
    pub stopped_timer: Option<u32>,
    /// An electrode that is broken.
    pub broken_electrode: Option<BrokenElectrode>,
}

/// Mistakes of a board that nothing in it notices, which no board may make: with them it is seen that whoever judges a board from outside
/// ([`super::SimObservations`]) would notice.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Mistakes {
    /// The timers of drives that are set from now on have B's windows where A's are.
    pub both_electrodes: bool,
    /// The dead-man time does not count: the board takes every tick for a sign of life.
    pub deaf_to_silence: bool,
    /// A stop does not count: the board takes it for a sign of life.
    pub deaf_to_stops: bool,
    /// Switching the outputs off leaves the timers running at the electrodes.
    pub outputs_stay_on: bool,
    /// The timer of this channel, counted from 0, takes no drive.
    pub idle_channel: Option<usize>,
    /// The periods of all drives that are set from now on are a tick too long.
    pub long_periods: bool,
    /// The periods of channel n, counted from 0, begin n times 10 us too late.
    pub late_periods: bool,
    /// What stands at the electrodes, in percent of what the board measures; as it should be without.
    pub rails_percent: Option<u32>,
}

/// A board without hardware.
#[derive(Debug)]
pub struct SimBoard {
    info: BoardInfo,
    clock: Clock,
    panel: SimPanel,
    supply: SupplyCommand,
    defects: Defects,
    mistakes: Mistakes,
    /// What the board keeps over a reset: whether it was live, and its credit in ms.
    kept: Option<KeptRun>,
    /// The timers run since this time in us.
    started_us: Option<u64>,
    leaving: bool,
    /// When its clock was last read, and how long the computer has stood still since that was last asked.
    read: Instant,
    stood: Duration,
    /// The time in us that is told in place of the clock's, if one is.
    held_us: Option<u64>,
}

impl SimBoard {
    /// Its identifier unless it is named.
    pub const ID: [u8; 12] = *b"sim-board-01";

    /// A board with one channel per actuator, `max_voltages_v` their voltage limits.
    #[must_use]
    #[allow(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "`as` saturates; rounded down on purpose"
    )]
    pub fn new(panel: SimPanel, max_voltages_v: &[f64], clock: Clock) -> Self {
        let channels = max_voltages_v
            .iter()
            .map(|volts| ChannelLimits { max_voltage_millivolts: (volts * 1e3) as u32, ..ChannelLimits::BOARD })
            .take(era_shared::MAX_CHANNELS)
            .collect();
        Self {
            info: BoardInfo {
                board: BoardKind::Simulated,
                board_id: Self::ID,
                boot_id: 1,
                reset_cause: ResetCause::PowerOn,
                // Shorter than the longest name there can be.
                image: "simulated".try_into().unwrap_or_default(),
                firmware: FirmwareVersion {
                    major: parse_version_number_or_zero(env!("CARGO_PKG_VERSION_MAJOR")),
                    minor: parse_version_number_or_zero(env!("CARGO_PKG_VERSION_MINOR")),
                    patch: parse_version_number_or_zero(env!("CARGO_PKG_VERSION_PATCH")),
                    commit: *b"00000000",
                },
                channels,
                fault_before_reset: None,
                failure: heapless::String::new(),
                kept_before_reset: None,
            },
            clock,
            panel,
            supply: SupplyCommand { discharge: [true; RAILS], ..SupplyCommand::default() },
            defects: Defects::default(),
            mistakes: Mistakes::default(),
            kept: None,
            started_us: None,
            leaving: false,
            read: Instant::now(),
            stood: Duration::ZERO,
            held_us: None,
        }
    }

    /// The same board with another identifier.
    #[must_use]
    pub fn with_board_id(mut self, board_id: [u8; 12]) -> Self {
        self.info.board_id = board_id;
        self
    }

    /// The same board that reports another kind of board.
    #[must_use]
    pub const fn with_board_kind(mut self, board: BoardKind) -> Self {
        self.info.board = board;
        self
    }

    /// The panel, for its accelerometer.
    pub const fn panel_mut(&mut self) -> &mut SimPanel {
        &mut self.panel
    }

    /// What the reset pin does: drives end and everything but the panel's motion and the rails' charge is forgotten.
    pub fn restart_keeping_panel_motion_and_rail_voltages(&mut self) {
        let was_live = self.kept.is_some_and(|run| run.is_live);
        self.info.fault_before_reset = was_live.then_some((FaultCode::ResetWhileLive, 0));
        self.info.kept_before_reset = self.kept;
        self.switch_outputs_off();
        let now_s = self.board_time_s();
        let volts: [f64; RAILS] = std::array::from_fn(|rail| self.panel.rail(rail).volts_at(now_s));
        // Numbers of faults begin with it: they must differ from those of the run before.
        self.info.boot_id = self.info.boot_id.wrapping_add(0x9E37_79B9);
        self.info.reset_cause = ResetCause::Pin;
        self.leaving = false;
        self.clock = match self.clock {
            Clock::Wall(_) => Clock::Wall(Instant::now()),
            Clock::Manual(_) => Clock::Manual(0),
        };
        self.panel.restart_clock();
        for (rail, volts) in volts.into_iter().enumerate() {
            self.panel.set_rail(rail, SimRail::new_discharging_since(volts, 0.0));
        }
    }

    /// Sets a [`Clock::Manual`].
    pub const fn set_manual_time_us(&mut self, time_us: u64) {
        self.clock = Clock::Manual(time_us);
    }

    /// Tells this time in us in place of the clock's, until `None` is given. It must not be after the clock's, nor before one that was told.
    pub const fn hold_time_at_us(&mut self, time_us: Option<u64>) {
        self.held_us = time_us;
    }

    /// How long the computer, and the simulated board with it, has stood still since the last call.
    pub const fn take_stalled_time_since_last_call(&mut self) -> Duration {
        std::mem::replace(&mut self.stood, Duration::ZERO)
    }

    /// Breaks or mends the hardware.
    pub fn set_defects(&mut self, defects: Defects) {
        if defects != self.defects {
            self.defects = defects;
            self.apply_supply_to_rails();
            self.panel.electrodes.set_broken(defects.broken_electrode);
        }
    }

    /// Makes the board do something wrong that it does not notice.
    pub fn set_mistakes(&mut self, mistakes: Mistakes) {
        if mistakes != self.mistakes {
            self.advance_panel_to_now();
            self.mistakes = mistakes;
            self.panel.set_electrode_fraction_of_rail_voltage(
                mistakes.rails_percent.map_or(1.0, |percent| f64::from(percent) / 100.0),
            );
        }
    }

    /// Whether the board has entered its bootloader. The simulation has none, so that its owner restarts it.
    #[must_use]
    pub const fn has_entered_bootloader(&self) -> bool {
        self.leaving
    }

    /// Whether its high voltage is enabled.
    #[must_use]
    pub const fn is_high_voltage_enabled(&self) -> bool {
        self.supply.enabled
    }

    /// Integrates the panel's motion up to the board's present time.
    pub fn advance_panel_to_now(&mut self) {
        let now_s = self.board_time_s();
        self.panel.advance_to(now_s);
    }

    #[expect(clippy::cast_precision_loss, reason = "microseconds in an f64 are exact for 285 years")]
    fn board_time_s(&mut self) -> f64 {
        self.now_us() as f64 / 1e6
    }

    /// Has the rails follow the last command to the supply from now on. The panel is integrated up to now first, with the rails as they were.
    fn apply_supply_to_rails(&mut self) {
        self.advance_panel_to_now();
        let now_s = self.board_time_s();
        for rail in 0..RAILS {
            let mut state = self.panel.rail(rail);
            state.apply_supply_command(now_s, &self.supply, rail, self.defects.shorted_rail == Some(rail));
            self.panel.set_rail(rail, state);
        }
    }

    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "`as` saturates")]
    fn compute_average_supply_microamps_now(&self) -> u32 {
        (self.panel.electrodes.mean_supply_current_over_last_ms_a() * 1e6).round() as u32
            + self.defects.leakage_microamps
    }

    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "`as` saturates")]
    fn compute_rail_millivolts_now(&mut self) -> [u32; RAILS] {
        let now_s = self.board_time_s();
        std::array::from_fn(|rail| (self.panel.rail(rail).volts_at(now_s) * 1e3).round() as u32)
    }
}

/// Level of a safety loop: its end resistor of 5.1 kohm and 10 kohm to ground divide 3.3 V.
const fn safety_loop_level_millivolts(is_open: bool) -> u32 {
    if is_open { 0 } else { 2_185 }
}

fn parse_version_number_or_zero(text: &str) -> u8 {
    text.parse().unwrap_or(0)
}

impl Board for SimBoard {
    fn info(&self) -> &BoardInfo {
        &self.info
    }

    fn now_us(&mut self) -> u64 {
        if let Some(held_us) = self.held_us {
            return held_us;
        }
        match &mut self.clock {
            Clock::Wall(start) => {
                let now = Instant::now();
                let gap = now - std::mem::replace(&mut self.read, now);
                if gap > STALL {
                    *start += gap - TICK;
                    self.stood += gap - TICK;
                }
                u64::try_from((now - *start).as_micros()).unwrap_or(u64::MAX)
            }
            Clock::Manual(time_us) => *time_us,
        }
    }

    fn switch_outputs_off(&mut self) {
        // The panel has felt the old drives up to now.
        self.advance_panel_to_now();
        self.started_us = None;
        if !self.mistakes.outputs_stay_on {
            self.panel.set_timers_connected_to_electrodes(false);
            for channel in 0..era_shared::MAX_CHANNELS {
                self.panel.set_channel_timer(channel, None);
            }
        }
        self.apply_supply_command(&SupplyCommand { discharge: [true; RAILS], ..SupplyCommand::default() });
    }

    fn read_sensors_and_take_trip(&mut self) -> SensorReadings {
        self.advance_panel_to_now();
        SensorReadings {
            rail_millivolts: self.compute_rail_millivolts_now(),
            average_microamps: self.compute_average_supply_microamps_now(),
            interlock_closed: !self.defects.interlock_open,
            stop_released: !self.defects.stop_pressed,
            interlock_millivolts: safety_loop_level_millivolts(self.defects.interlock_open),
            stop_millivolts: safety_loop_level_millivolts(self.defects.stop_pressed),
            earth_bonded: !self.defects.earth_open,
            reference_millivolts: REFERENCE_MILLIVOLTS,
            trip: None,
            standing_fault: None,
        }
    }

    fn test_trip_circuits(&mut self) -> Result<(), FaultFinding> {
        self.defects.dead_trip.map_or(Ok(()), |which| Err((FaultCode::SelfTest, which)))
    }

    fn test_over_voltage_inputs(&mut self, _charged: [bool; RAILS]) -> Result<(), FaultFinding> {
        Ok(())
    }

    fn pulse_electrode_and_get_rail_mv_after_first_and_last(
        &mut self,
        channel: usize,
        electrode: Electrode,
    ) -> Result<ElectrodePulses, FaultFinding> {
        self.advance_panel_to_now();
        Ok(self.panel.pulse_electrode_and_get_rail_mv_after_first_and_last(channel, electrode))
    }

    fn store_run_record_for_next_boot(&mut self, run: KeptRun) {
        self.kept = Some(run);
    }

    fn apply_supply_command(&mut self, supply: &SupplyCommand) {
        self.supply = *supply;
        self.apply_supply_to_rails();
    }

    fn start_timers(&mut self) -> Result<(), FaultCode> {
        self.started_us = Some(self.now_us());
        let now_s = self.board_time_s();
        for channel in 0..self.info.channels.len() {
            let source = SimTimer::new(now_s).map_err(|_| FaultCode::ArmFailed)?;
            self.panel.set_channel_timer(channel, Some(source));
        }
        Ok(())
    }

    fn set_timers_connected_to_electrodes(&mut self, connected: bool) -> Result<(), FaultCode> {
        self.advance_panel_to_now();
        self.panel.set_timers_connected_to_electrodes(connected);
        Ok(())
    }

    #[expect(clippy::cast_precision_loss, reason = "clocks in an f64 are exact for 600 days")]
    fn write_preload_and_check_read_back(&mut self, preload: &TimerPreload) -> Result<(), FaultCode> {
        let started_us = self.started_us.ok_or(FaultCode::DriveFailed)?;
        let clocks_per_s = f64::from(ChannelLimits::BOARD.timer_clock_hz);
        let late_s = if self.mistakes.late_periods { 10e-6 * preload.channel as f64 } else { 0.0 };
        let from_s = started_us as f64 / 1e6 + preload.at as f64 / clocks_per_s + late_s;
        if self.mistakes.idle_channel == Some(preload.channel) {
            return Ok(());
        }
        let done_s = self.panel.time_s();
        let source = self.panel.channel_timer_mut(preload.channel).ok_or(FaultCode::DriveFailed)?;
        source
            .preload_repeating_period_and_drop_later_ones(&preload.period, from_s, done_s)
            .map_err(|_| FaultCode::ReadBack)?;
        if self.mistakes.both_electrodes {
            source.make_b_overlap_a_in_last_preload();
        }
        if self.mistakes.long_periods {
            source.lengthen_last_preloaded_period_by_one_tick();
        }
        Ok(())
    }

    fn check_timers_still_count_and_hold_settings(&mut self) -> Result<(), FaultFinding> {
        self.defects.stopped_timer.map_or(Ok(()), |channel| Err((FaultCode::TimerStopped, channel)))
    }

    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "`as` saturates")]
    fn take_peak_acceleration_mm_per_s2_if_sensor_exists(&mut self) -> Option<u32> {
        self.advance_panel_to_now();
        Some((self.panel.accelerometer.take_peak_since_last_call_and_at_least_50_ms_m_per_s2() * 1e3).round() as u32)
    }

    fn take_log_bytes(&mut self, _out: &mut [u8]) -> usize {
        0
    }

    fn request_bootloader_restart(&mut self) {
        self.leaving = true;
    }
}
