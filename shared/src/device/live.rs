//! What happens by itself: time-outs, the self-test, the rails, the timers' next periods.

use super::{Device, Goals};
use crate::MAX_CHANNELS;
use crate::board::Board;
use crate::circuit::shortest_discharge_us;
use crate::limits::{BLEEDER_MS, DISCHARGE_LIMIT_MS, DISCHARGED_MILLIVOLTS, SWITCHED_DISCHARGE_MS};
use crate::protocol::{ChannelLimits, FaultCode, Refusal};
use crate::safety::{
    self, CreditCharge, ElectrodeFindings, SafetyAction, SafetyEvent, SafetyState, SelfTest, SelfTestVerdict,
    electrode_fault_detail, judge_electrode_pulses,
};
use crate::supply::{
    FaultFinding, RAILS, SensorReadings, SupplyCommand, encode_first_charged_rail_as_fault_detail_if_any,
    rail_index_of_channel,
};
use crate::waveform::{FULL_STRENGTH, Sequencer};

/// Between two looks at the readings, in us; the soft start's steps follow it, and levels of envelopes are worked out as often
/// (they take effect at the next boundary of the drive).
const TICK_US: u64 = 1_000;
/// How much later than the hardware the device notes that everything was switched off, in us at most: a tick, and what delays it.
const NOTED_LATE_US: u64 = 2 * TICK_US;
/// A rail this many parts in a hundred above its set-point is taken into account in the windows' width; what is less is the
/// measurement's own error.
const RAIL_EXCESS_PERCENT: u32 = 2;

impl Device {
    /// Does what is due by now: time-outs, the checks of every ms, preloads. To be called at least every ms. Returns the board's time in us at which
    /// the next call is due.
    pub fn do_due_work_and_tell_next_due_us(&mut self, board: &mut impl Board) -> u64 {
        let now_us = board.now_us();
        if let Some(silence_us) = self.safety.host_silence_us_if_over_deadman(now_us) {
            let silence_ms = u32::try_from(silence_us / 1000).unwrap_or(u32::MAX);
            self.switch_all_off_and_latch_fault(board, FaultCode::HostSilent, silence_ms, now_us);
        }
        // No tick is ever planned further ahead than one: a time that is has changed by itself, and waiting for it would be the end of all checks.
        if now_us >= self.next_tick_us || self.next_tick_us - now_us > TICK_US {
            // Not a fixed grid: after a pause there is nothing to catch up with.
            self.next_tick_us = now_us + TICK_US;
            if let Err((code, detail)) = self.run_millisecond_checks_and_advance_state(board, now_us) {
                self.switch_all_off_and_latch_fault(board, code, detail, now_us);
            }
            self.tick_done = true;
        }
        if let Err((code, detail)) = self.write_due_preloads_and_check_no_window_was_missed(board) {
            self.switch_all_off_and_latch_fault(board, code, detail, now_us);
        }
        let due_us = self
            .sequencer
            .as_ref()
            .and_then(Sequencer::next_extra_poll_time_us_if_playing_or_too_near)
            .unwrap_or(u64::MAX);
        due_us.min(self.next_tick_us)
    }

    fn run_millisecond_checks_and_advance_state(
        &mut self,
        board: &mut impl Board,
        now_us: u64,
    ) -> Result<(), FaultFinding> {
        let readings = board.read_sensors_and_take_trip();
        self.measured_millivolts = readings.rail_millivolts;
        if let Some(finding) = readings.trip {
            return Err(finding);
        }
        if let Some(finding) = readings.standing_fault
            && self.state() != SafetyState::Fault
        {
            return Err(finding);
        }
        if let Some(finding) = self.reference.update_and_find_lasting_reference_fault(now_us, &readings)
            && self.state() != SafetyState::Fault
        {
            return Err(finding);
        }
        // In every state: who is off earns and rests.
        let charges =
            self.compute_credit_charge_rates_of_driving_channels(&board.info().channels, &readings.rail_millivolts);
        let must_stop = self.budget.account_and_find_channels_to_stop(now_us, charges);
        self.store_run_record_for_next_boot(board, self.state().is_live());
        match self.state() {
            SafetyState::Boot => Ok(()),
            SafetyState::Safe => match encode_first_charged_rail_as_fault_detail_if_any(&readings) {
                Some(rail) => Err((FaultCode::RailImplausible, rail)),
                None => Ok(()),
            },
            SafetyState::Discharging | SafetyState::Fault => {
                self.check_discharge_is_in_time_and_distrust_if_too_fast(now_us, &readings)?;
                let is_discharged = encode_first_charged_rail_as_fault_detail_if_any(&readings).is_none();
                if self.state() == SafetyState::Discharging
                    && is_discharged
                    && !self.is_rail_measurement_distrusted(now_us)
                {
                    self.distrusted = false;
                    // Accepted in this state alone, so it cannot be refused.
                    let _ = self.handle_safety_event(board, SafetyEvent::Discharged, &Goals::default());
                }
                Ok(())
            }
            SafetyState::Arming => {
                if !self.supply.is_enabled_or_any_discharge_open() {
                    self.check_discharge_is_in_time_and_distrust_if_too_fast(now_us, &readings)?;
                }
                self.step_self_test_and_arm_with_held_drives_when_passed(board, now_us, &readings)
            }
            SafetyState::Armed | SafetyState::Running => {
                self.end_drives_that_must_stop_or_fault_if_windows_unfinished(must_stop)?;
                self.check_while_live_advance_rails_and_rest_if_no_drive(board, now_us, &readings)
            }
        }
    }

    /// Checks that the rails fall as their discharge switches make them fall: neither more slowly nor faster.
    fn check_discharge_is_in_time_and_distrust_if_too_fast(
        &mut self,
        now_us: u64,
        readings: &SensorReadings,
    ) -> Result<(), FaultFinding> {
        let elapsed_us = now_us.saturating_sub(self.off_since_us);
        for (rail, measured) in readings.rail_millivolts.into_iter().enumerate() {
            let from = self.off_millivolts.get(rail).copied().unwrap_or(0);
            // What switches off in hardware does so up to two ms before it is noted here.
            let earliest_us = u64::from(shortest_discharge_us(from, DISCHARGED_MILLIVOLTS));
            if measured < DISCHARGED_MILLIVOLTS && elapsed_us + NOTED_LATE_US < earliest_us {
                // No rail falls so fast: its divider is broken. What it shows does not count until a bleeder has done its work.
                self.distrusted = true;
            }
        }
        let Some(rail) = encode_first_charged_rail_as_fault_detail_if_any(readings) else { return Ok(()) };
        // Each is counted once, also where another fault came first.
        if !self.discharges_slowly && elapsed_us > u64::from(SWITCHED_DISCHARGE_MS) * 1000 {
            self.discharges_slowly = true;
            return Err((FaultCode::DischargeSlow, rail));
        }
        if !self.still_charged && elapsed_us > u64::from(DISCHARGE_LIMIT_MS) * 1000 {
            self.still_charged = true;
            return Err((FaultCode::DischargeFailed, rail));
        }
        Ok(())
    }

    /// Whether the rails count as charged whatever is measured, because the measurement was found wrong.
    pub(super) const fn is_rail_measurement_distrusted(&self, now_us: u64) -> bool {
        self.distrusted && now_us.saturating_sub(self.off_since_us) < BLEEDER_MS as u64 * 1000
    }

    /// One step of the self-test.
    fn step_self_test_and_arm_with_held_drives_when_passed(
        &mut self,
        board: &mut impl Board,
        now_us: u64,
        readings: &SensorReadings,
    ) -> Result<(), FaultFinding> {
        let is_distrusted = self.is_rail_measurement_distrusted(now_us);
        let Some(self_test) = &mut self.self_test else { return Err((FaultCode::ArmFailed, 0)) };
        match self_test.advance(now_us, readings, !is_distrusted) {
            SelfTestVerdict::Continue(supply) => {
                self.command_supply(board, supply);
                Ok(())
            }
            SelfTestVerdict::TryTrips => board.test_trip_circuits(),
            SelfTestVerdict::TryOverVoltageInputs(charged) => board.test_over_voltage_inputs(charged),
            SelfTestVerdict::TryElectrode { channel, electrode } => {
                self.command_supply(board, safety::BLEED);
                let pulses = board.pulse_electrode_and_get_rail_mv_after_first_and_last(channel, electrode)?;
                self.command_supply(board, safety::CHARGE);
                // The rails get their ms before they are looked at.
                self.next_tick_us = board.now_us() + TICK_US;
                self.electrodes.add_finding_and_report_faulty_electrode(
                    channel,
                    electrode,
                    judge_electrode_pulses(channel, &pulses),
                )
            }
            SelfTestVerdict::Failed(finding) => Err(finding),
            SelfTestVerdict::Passed => {
                self.self_test = None;
                let held = self.held.take();
                // Faults have been raised where they arose.
                if self.handle_safety_event(board, SafetyEvent::TestPassed, &Goals::default()).is_ok()
                    && let Some(goals) = held
                {
                    let event = if goals.iter().any(Option::is_some) { SafetyEvent::Drive } else { SafetyEvent::Rest };
                    let _ = self.handle_safety_event(board, event, &goals);
                }
                Ok(())
            }
        }
    }

    fn command_supply(&mut self, board: &mut impl Board, supply: SupplyCommand) {
        self.supply = supply;
        board.apply_supply_command(&supply);
    }

    /// For each channel whether its electrodes are in use.
    fn list_whether_each_channel_drives(&self) -> [bool; MAX_CHANNELS] {
        let sequencer = self.sequencer.as_ref();
        core::array::from_fn(|channel| {
            sequencer.is_some_and(|sequencer| sequencer.is_active_or_preloaded_period_driving(channel))
        })
    }

    /// What the channels in use are charged. The wider of a timer's present and next windows counts, and the higher of a rail's measured voltage and
    /// its set-point: a drive is charged for what it does, not for what was asked for. An effect is charged by its present level, a rail that rises or
    /// falls by its present voltage, and a drive that was replaced as before until its last boundary.
    pub(super) fn compute_credit_charge_rates_of_driving_channels(
        &self,
        limits: &[ChannelLimits],
        measured_millivolts: &[u32; RAILS],
    ) -> [Option<CreditCharge>; MAX_CHANNELS] {
        let sequencer = self.sequencer.as_ref();
        core::array::from_fn(|channel| {
            let period = sequencer
                .and_then(|sequencer| sequencer.stronger_of_active_and_preloaded_period_if_any_driving(channel))?;
            let rail = rail_index_of_channel(channel);
            let number = |values: &[u32; RAILS]| values.get(rail).copied().unwrap_or(u32::MAX);
            let millivolts = number(measured_millivolts).max(number(&self.supply.set_point_millivolts));
            let largest = limits.get(channel).map_or(0, |limits| limits.max_voltage_millivolts);
            Some(CreditCharge::from_period(&period, millivolts, largest))
        })
    }

    /// Ends the drives of channels that have driven for as long as they may. A sequence of windows was checked for that beforehand: one that
    /// is not over then would go on without a part of it.
    fn end_drives_that_must_stop_or_fault_if_windows_unfinished(
        &mut self,
        must_stop: [bool; MAX_CHANNELS],
    ) -> Result<(), FaultFinding> {
        let Some(sequencer) = &mut self.sequencer else { return Ok(()) };
        for ((channel, must_stop), active) in must_stop.into_iter().enumerate().zip(&mut self.active) {
            if must_stop && sequencer.has_unfinished_window_sequence(channel) {
                return Err((FaultCode::DriveFailed, u32::try_from(channel).unwrap_or(0)));
            }
            if must_stop {
                sequencer.end_drive_at_next_boundary(channel);
                *active = None;
            }
        }
        Ok(())
    }

    /// Checks readings and timers while live, and moves the rails towards their targets.
    fn check_while_live_advance_rails_and_rest_if_no_drive(
        &mut self,
        board: &mut impl Board,
        now_us: u64,
        readings: &SensorReadings,
    ) -> Result<(), FaultFinding> {
        if let Some(finding) = self.watch.update_and_find_first_fault_in_readings(now_us, readings, &self.supply) {
            return Err(finding);
        }
        board.check_timers_still_count_and_hold_settings()?;
        self.check_no_absent_era_is_driven_at_hazardous_voltage(readings)?;
        let charges = self.sequencer.as_mut().map(Sequencer::take_electrode_charge_counts).unwrap_or_default();
        // A rail that is not where it was set explains a wrong current: it is a fault of its own soon, and no electrode is to be blamed.
        if let Some(finding) =
            self.current.update_and_find_electrode_current_fault(now_us, readings, &self.supply, &charges)
            && !self.watch.is_any_rail_off_set_point_or_was_lately()
        {
            return Err(finding);
        }
        let supply = self.rails.ramp_up_or_drop_set_points_and_build_supply_command(now_us, readings);
        self.command_supply(board, supply);
        let Some(sequencer) = &mut self.sequencer else { return Err((FaultCode::ArmFailed, 0)) };
        set_force_fractions_to_compensate_rail_above_drive_voltage(
            sequencer,
            self.rails.target_millivolts(),
            self.measured_millivolts,
        );
        let wanted = (0..MAX_CHANNELS)
            .any(|channel| sequencer.goal(channel).is_some() || sequencer.has_unfinished_window_sequence(channel));
        if self.state() == SafetyState::Running && !wanted {
            let _ = self.handle_safety_event(board, SafetyEvent::Rest, &Goals::default());
        } else if self.state() == SafetyState::Armed
            && self.connected
            && !self.list_whether_each_channel_drives().contains(&true)
        {
            self.connected = false;
            board.set_timers_connected_to_electrodes(false).map_err(|code| (code, 0))?;
        }
        Ok(())
    }

    /// Checks that no ERA whose electrodes the self-test has not seen is driven with a hazardous voltage: what is switched there is unknown.
    fn check_no_absent_era_is_driven_at_hazardous_voltage(
        &self,
        readings: &SensorReadings,
    ) -> Result<(), FaultFinding> {
        for (channel, drives) in self.list_whether_each_channel_drives().into_iter().enumerate() {
            let rail = rail_index_of_channel(channel);
            let number = |values: &[u32; RAILS]| values.get(rail).copied().unwrap_or(u32::MAX);
            let highest = number(&readings.rail_millivolts).max(number(&self.supply.set_point_millivolts));
            if drives && self.electrodes.has_no_era_connected(channel) && highest >= DISCHARGED_MILLIVOLTS {
                return Err((FaultCode::Electrode, electrode_fault_detail(channel, None)));
            }
        }
        Ok(())
    }

    /// Writes the preloads that are due to the timers.
    pub(super) fn write_due_preloads_and_check_no_window_was_missed(
        &mut self,
        board: &mut impl Board,
    ) -> Result<(), FaultFinding> {
        let Some(sequencer) = &mut self.sequencer else { return Ok(()) };
        for channel in 0..MAX_CHANNELS {
            // Read anew for each: working out the one before took its time, and the margin before a boundary is short.
            if let Some(preload) = sequencer.advance_and_prepare_next_preload_if_changed(channel, board.now_us()) {
                board
                    .write_preload_and_check_read_back(&preload)
                    .map_err(|code| (code, u32::try_from(channel).unwrap_or(0)))?;
            }
        }
        match sequencer.first_channel_with_missed_window() {
            // Its windows would come at other times than those that were checked.
            Some(channel) => Err((FaultCode::DriveFailed, u32::try_from(channel).unwrap_or(0))),
            None => Ok(()),
        }
    }

    /// Applies an event to the safety machine and carries out the resulting action, or refuses.
    pub(super) fn handle_safety_event(
        &mut self,
        board: &mut impl Board,
        event: SafetyEvent,
        goals: &Goals,
    ) -> Result<(), Refusal> {
        let action = self.safety.apply_event(event).map_err(|state| Refusal::State { state, event })?;
        let now_us = board.now_us();
        self.carry_out_action(board, action, goals, now_us).map_err(|(code, detail)| {
            self.switch_all_off_and_latch_fault(board, code, detail, now_us);
            self.safety.fault().map_or(Refusal::Malformed, Refusal::Fault)
        })
    }

    fn carry_out_action(
        &mut self,
        board: &mut impl Board,
        action: SafetyAction,
        goals: &Goals,
        now_us: u64,
    ) -> Result<(), FaultFinding> {
        match action {
            SafetyAction::Keep => Ok(()),
            SafetyAction::Off => {
                self.switch_all_off(board, now_us);
                Ok(())
            }
            SafetyAction::Test => {
                self.electrodes = ElectrodeFindings::NONE;
                self.self_test = Some(SelfTest::new(now_us, board.info().channels.len()));
                Ok(())
            }
            SafetyAction::Enable => {
                board.start_timers().map_err(|code| (code, 0))?;
                let started_us = board.now_us();
                let clock_hz = board.info().channels.first().map_or(0, |limits| limits.timer_clock_hz);
                self.sequencer = Some(Sequencer::new(clock_hz / 1_000_000, started_us));
                // The rails stay where the self-test has brought them until a drive asks for more.
                self.rails.set_targets(self.supply.set_point_millivolts);
                self.rails.resume_from_set_points(self.supply.set_point_millivolts, now_us);
                Ok(())
            }
            SafetyAction::Apply if self.state() == SafetyState::Arming => {
                self.held = Some(*goals);
                self.remember_achieved_drive_of_each_goal(goals);
                Ok(())
            }
            SafetyAction::Apply => self.apply_goals(board, goals, now_us),
        }
    }

    fn apply_goals(&mut self, board: &mut impl Board, goals: &Goals, now_us: u64) -> Result<(), FaultFinding> {
        let aims = self.rail_target_millivolts_for_goals_keeping_unused(goals);
        self.rails.set_targets(aims);
        let sequencer = self.sequencer.as_mut().ok_or((FaultCode::DriveFailed, 0))?;
        sequencer.set_or_end_drives_from_next_boundary(goals, now_us);
        // From the first period on, which may begin before the next look: a rail that was higher is let down in some ms.
        set_force_fractions_to_compensate_rail_above_drive_voltage(sequencer, aims, self.measured_millivolts);
        if goals.iter().any(Option::is_some) {
            self.connect_timers_to_electrodes_if_not_yet(board)?;
        }
        self.remember_achieved_drive_of_each_goal(goals);
        self.write_due_preloads_and_check_no_window_was_missed(board)
    }

    /// The rails' targets for these goals: the highest voltage that a rail feeds. A rail that feeds nobody stays charged, so that the next
    /// touch need not wait for its soft start.
    pub(super) fn rail_target_millivolts_for_goals_keeping_unused(&self, goals: &Goals) -> [u32; RAILS] {
        let mut targets = self.rails.target_millivolts();
        for (rail, target) in targets.iter_mut().enumerate() {
            let fed = goals.iter().enumerate().filter(|(channel, _)| rail_index_of_channel(*channel) == rail);
            let highest = fed.filter_map(|(_, goal)| goal.map(|goal| goal.program.voltage_millivolts)).max();
            *target = highest.unwrap_or(*target);
        }
        targets
    }

    /// Lets the timers reach the electrodes, if they do not yet.
    pub(super) fn connect_timers_to_electrodes_if_not_yet(
        &mut self,
        board: &mut impl Board,
    ) -> Result<(), FaultFinding> {
        if !self.connected {
            board.set_timers_connected_to_electrodes(true).map_err(|code| (code, 0))?;
            self.connected = true;
        }
        Ok(())
    }

    fn remember_achieved_drive_of_each_goal(&mut self, goals: &Goals) {
        self.active = goals.map(|goal| goal.map(|goal| goal.program.achieved));
    }
}

/// Sets the strengths of all drives for rails with these targets and measured voltages. Where a rail is still above its target, the
/// measured voltage counts.
fn set_force_fractions_to_compensate_rail_above_drive_voltage(
    sequencer: &mut Sequencer,
    target_millivolts: [u32; RAILS],
    measured_millivolts: [u32; RAILS],
) {
    for channel in 0..MAX_CHANNELS {
        let Some(goal) = sequencer.goal(channel) else { continue };
        let of_rail = |values: [u32; RAILS]| values.get(rail_index_of_channel(channel)).copied().unwrap_or(0);
        let (aim, measured) = (of_rail(target_millivolts), of_rail(measured_millivolts));
        let excess = measured > aim.saturating_add(aim / 100 * RAIL_EXCESS_PERCENT);
        let there = if excess { measured } else { aim };
        sequencer.set_force_fraction_q16_of_drive_windows(
            channel,
            compute_window_force_fraction_q16(goal.program.voltage_millivolts, there),
        );
    }
}

/// The fraction of the full force that windows must make so that a rail of `rail_millivolts` acts like one of `wanted_millivolts`, in parts of
/// [`FULL_STRENGTH`]: the force goes with the square of the voltage.
fn compute_window_force_fraction_q16(wanted_millivolts: u32, rail_millivolts: u32) -> u32 {
    if rail_millivolts <= wanted_millivolts {
        return FULL_STRENGTH;
    }
    let full = u64::from(FULL_STRENGTH);
    let ratio = u64::from(wanted_millivolts) * full / u64::from(rail_millivolts);
    u32::try_from(ratio * ratio / full).unwrap_or(FULL_STRENGTH)
}
