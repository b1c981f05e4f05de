//! Windows that are given one by one: checks, rails, start.

use super::{Device, Goals};
use crate::MAX_CHANNELS;
use crate::board::Board;
use crate::circuit::{ELECTRODE_PICOFARADS, SUPPLY_RISE_MS, add_percent, both_bleeders_of_one_rail_microamps};
use crate::limits::{
    MAX_AVERAGE_MICROAMPS, RAIL_SLOPE_MILLIVOLTS_PER_MS, SEQUENCE_CURRENT_SPAN_MS, SWITCHED_DISCHARGE_MS,
};
use crate::protocol::{ChannelLimits, Refusal, WindowSequence};
use crate::safety::{CreditCharge, LinkId, PlannedDrive, SafetyEvent};
use crate::supply::{
    RAILS, is_rail_far_enough_above_set_point_to_discharge, rail_index_of_channel, round_down_to_dac_step_millivolts,
};
use crate::waveform::{PlacedWindows, SEQUENCE_TICK_CLOCKS, SequenceError};

/// From the time at which a set-point is reached until the rail has followed, in us: twice the supply's rise time.
const SETTLING_US: u64 = 2_000 * SUPPLY_RISE_MS as u64;
/// A sequence may be asked for this long before its start, in us.
const EARLIEST_US: u64 = 10_000_000;
/// A channel counts as driving at most this long before a window, in us, rounded up from 8.4 ms: its period is preloaded when a blank
/// period of up to 65 535 ticks of 0.1 us begins, half a guard of up to 1 ms is a part of it, and the device looks every ms and up to
/// 0.3 ms later.
const COUNTED_AHEAD_US: u64 = 9_000;
/// A rail may be this many parts in a hundred above its set-point without being wrong: dividers, converter and the supply's overshoot.
const RAIL_EXCESS_PERCENT: u32 = 5;

impl Device {
    /// Checks a sequence of windows and has it played; returns when it begins, in us of the board's time.
    pub(super) fn play_window_sequence_and_get_start_us(
        &mut self,
        board: &mut impl Board,
        link: LinkId,
        sequence: &WindowSequence,
        now_us: u64,
    ) -> Result<u64, Refusal> {
        if self.safety.is_armed_by_other_link(link) {
            return Err(Refusal::OtherLink);
        }
        let state = self.state();
        if !state.is_live() || self.sequencer.is_none() {
            return Err(Refusal::State { state, event: SafetyEvent::Drive });
        }
        let limits = &board.info().channels;
        // Where it begins is known once the rails are; everything else is checked before.
        let mut placed = PlacedWindows::from_sequence(limits, &sequence.windows).map_err(Refusal::Sequence)?;
        let used = placed.used_channels();
        for (channel, limit) in limits.iter().enumerate().filter(|(channel, _)| used.get(*channel) == Some(&true)) {
            let rail = rail_index_of_channel(channel);
            let requested_millivolts = sequence.rail_millivolts.get(rail).copied().unwrap_or(u32::MAX);
            if requested_millivolts > limit.max_voltage_millivolts {
                return Err(Refusal::Sequence(SequenceError::Voltage {
                    rail: u8::try_from(rail + 1).unwrap_or(u8::MAX),
                    requested_millivolts,
                    max_millivolts: limit.max_voltage_millivolts,
                }));
            }
            if let Some(wait_ms) = self.budget.required_wait_ms(channel) {
                return Err(Refusal::Duty { channel: u8::try_from(channel).unwrap_or(u8::MAX), wait_ms });
            }
        }
        let ticks_per_ms = limits.first().map_or(1, |limits| limits.timer_clock_hz) / SEQUENCE_TICK_CLOCKS / 1000;
        let (requested_ms, max_ms) =
            (placed.last_window_end_tick().div_ceil(ticks_per_ms.max(1)), u32::from(self.budget.burst_limit_ms()));
        if requested_ms > max_ms {
            return Err(Refusal::Sequence(SequenceError::TooLong { requested_ms, max_ms }));
        }
        let rails = self.rail_targets_keeping_unused_rails(&sequence.rail_millivolts, used);
        let bleeders_microamps: u32 = rails.into_iter().map(both_bleeders_of_one_rail_microamps).sum();
        let requested_microamps = highest_moving_average_of_sequence_current_microamps(sequence, ticks_per_ms)
            .saturating_add(bleeders_microamps);
        if requested_microamps > MAX_AVERAGE_MICROAMPS {
            return Err(Refusal::Current { requested_microamps, max_microamps: MAX_AVERAGE_MICROAMPS });
        }
        let ready_us = now_us + self.rails_settling_us(rails);
        let sequencer = self.sequencer.as_mut().ok_or(Refusal::State { state, event: SafetyEvent::Drive })?;
        let asked_us = if sequence.start_us == 0 { ready_us } else { sequence.start_us };
        if asked_us < ready_us || asked_us > now_us.saturating_add(EARLIEST_US) {
            return Err(Refusal::Start { start_us: asked_us, now_us });
        }
        let earliest = sequencer.earliest_sequence_start_clock(used, now_us);
        let start = sequencer.clocks_since_start(asked_us).max(if sequence.start_us == 0 { earliest } else { 0 });
        if start < earliest {
            return Err(Refusal::Start { start_us: asked_us, now_us });
        }
        self.check_burst_and_credit_of_windows(limits, &placed, rails, start, now_us)?;
        placed.set_start_clock(start);
        self.handle_safety_event(board, SafetyEvent::Drive, &Goals::default())?;
        self.rails.set_targets(rails);
        let sequencer = self.sequencer.as_mut().ok_or(Refusal::State { state, event: SafetyEvent::Drive })?;
        sequencer.play_windows_at_their_times_ending_drives_at_next_boundary(&placed, now_us);
        let start_us = sequencer.board_time_of_clock_us(start);
        self.connect_timers_to_electrodes_if_not_yet(board)
            .and_then(|()| self.write_due_preloads_and_check_no_window_was_missed(board))
            .map_err(|(code, detail)| {
                self.switch_all_off_and_latch_fault(board, code, detail, now_us);
                self.safety.fault().map_or(Refusal::Malformed, Refusal::Fault)
            })?;
        Ok(start_us)
    }

    /// Checks that no channel has to stop in the middle of its windows, whatever is left of its burst and its credit.
    fn check_burst_and_credit_of_windows(
        &mut self,
        limits: &[ChannelLimits],
        placed: &PlacedWindows,
        rails: [u32; RAILS],
        start: u64,
        now_us: u64,
    ) -> Result<(), Refusal> {
        let with_excess =
            |target| u32::try_from(add_percent(u64::from(target), RAIL_EXCESS_PERCENT)).unwrap_or(u32::MAX);
        let highest_millivolts = rails.map(with_excess);
        let mut present_millivolts = highest_millivolts;
        for (present, measured) in present_millivolts.iter_mut().zip(self.measured_millivolts) {
            *present = measured.max(*present);
        }
        let present_charges = self.compute_credit_charge_rates_of_driving_channels(limits, &present_millivolts);
        let Some(sequencer) = &mut self.sequencer else { return Ok(()) };
        let used = placed.used_channels();
        for (index, limit) in limits.iter().enumerate().filter(|(index, _)| used.get(*index) == Some(&true)) {
            let channel = u8::try_from(index).unwrap_or(u8::MAX);
            let millivolts = highest_millivolts.get(rail_index_of_channel(index)).copied().unwrap_or(u32::MAX);
            let charge = CreditCharge::from_voltage_with_widest_windows(millivolts, limit.max_voltage_millivolts);
            let clocks_per_us = u64::from(limit.timer_clock_hz / 1_000_000);
            let plan = |rest_us| {
                plan_drives_for_window_times(
                    placed.window_begin_and_end_times_us(channel, clocks_per_us),
                    rest_us,
                    charge,
                )
            };
            if let Some(requested_ms) = self.budget.planned_burst_ms_if_at_or_over_burst_limit(plan(COUNTED_AHEAD_US)) {
                let max_ms = u32::from(self.budget.burst_limit_ms());
                return Err(Refusal::Sequence(SequenceError::TooLong { requested_ms, max_ms }));
            }
            // The present drive ends before a sequence of this channel alone could begin.
            let only: [bool; MAX_CHANNELS] = core::array::from_fn(|other| other == index);
            let end_us = if sequencer.is_active_or_preloaded_period_driving(index) {
                let end = sequencer.earliest_sequence_start_clock(only, now_us);
                sequencer.board_time_of_clock_us(end)
            } else {
                now_us
            };
            let present_charge = present_charges.get(index).copied().flatten().unwrap_or(CreditCharge::FULL);
            let last = PlannedDrive {
                rest_us: 0,
                drive_us: end_us.saturating_sub(now_us),
                charge: present_charge.max(self.budget.last_credit_charge_rate(index)),
            };
            let rest_us = sequencer.board_time_of_clock_us(start).saturating_sub(end_us);
            if let Some(wait_ms) = self.budget.required_wait_ms_for_burst_and_credit_of_plan(index, last, plan(rest_us))
            {
                return Err(Refusal::Duty { channel, wait_ms });
            }
        }
        Ok(())
    }

    /// The rails' targets: those that feed a channel in use at what is asked for, the others where they are.
    fn rail_targets_keeping_unused_rails(
        &self,
        asked_millivolts: &[u32; RAILS],
        used_channels: [bool; MAX_CHANNELS],
    ) -> [u32; RAILS] {
        let mut targets = self.rails.target_millivolts();
        for (rail, target) in targets.iter_mut().enumerate() {
            let feeds =
                used_channels.iter().enumerate().any(|(channel, used)| *used && rail_index_of_channel(channel) == rail);
            if let Some(asked) = asked_millivolts.get(rail).filter(|_| feeds) {
                *target = round_down_to_dac_step_millivolts(*asked);
            }
        }
        targets
    }

    /// How long the rails take to these targets, in us.
    fn rails_settling_us(&self, targets: [u32; RAILS]) -> u64 {
        let one = |((target, now), measured): ((u32, u32), u32)| {
            // One that was set lower a moment ago falls too.
            if target < now || is_rail_far_enough_above_set_point_to_discharge(measured, target) {
                return u64::from(SWITCHED_DISCHARGE_MS) * 1000;
            }
            match target - now {
                0 => 0,
                rise => u64::from(rise) * 1000 / u64::from(RAIL_SLOPE_MILLIVOLTS_PER_MS) + SETTLING_US,
            }
        };
        targets
            .into_iter()
            .zip(self.rails.set_point_millivolts())
            .zip(self.measured_millivolts)
            .map(one)
            .max()
            .unwrap_or(0)
    }
}

/// When a channel drives for windows at these times, in us since the beginning of the sequence, after a rest of `rest_us` before that.
fn plan_drives_for_window_times(
    times_us: impl Iterator<Item = (u64, u64)>,
    rest_us: u64,
    charge: CreditCharge,
) -> impl Iterator<Item = PlannedDrive> {
    let mut last_end_us = None;
    times_us.map(move |(begin_us, end_us)| {
        let pause_us = match last_end_us.replace(end_us) {
            Some(last_end_us) => begin_us.saturating_sub(last_end_us),
            None => begin_us.saturating_add(rest_us),
        };
        PlannedDrive {
            rest_us: pause_us.saturating_sub(COUNTED_AHEAD_US),
            drive_us: end_us - begin_us + pause_us.min(COUNTED_AHEAD_US),
            charge,
        }
    })
}

/// The highest average over [`SEQUENCE_CURRENT_SPAN_MS`] of what the windows take from the supply, in uA: each charges its electrode
/// once.
fn highest_moving_average_of_sequence_current_microamps(sequence: &WindowSequence, ticks_per_ms: u32) -> u32 {
    let span = SEQUENCE_CURRENT_SPAN_MS * ticks_per_ms;
    let mut ends = [0_u32; MAX_CHANNELS];
    let mut edges: heapless::Vec<(u32, u64), { crate::waveform::MAX_WINDOWS }> = heapless::Vec::new();
    for window in &sequence.windows {
        let channel = usize::from(window.channel);
        let Some(end) = ends.get_mut(channel) else { continue };
        let begin = end.saturating_add(window.wait_ticks);
        *end = begin.saturating_add(window.width_ticks);
        let millivolts = sequence.rail_millivolts.get(rail_index_of_channel(channel)).copied().unwrap_or(0);
        let picofarads = ELECTRODE_PICOFARADS.get(channel).copied().unwrap_or(0);
        // pF times mV is fC; as many edges as windows.
        let _ = edges.push((begin, u64::from(picofarads) * u64::from(millivolts)));
    }
    let within = |from: u32| {
        let edges = edges.iter().filter(move |(at, _)| (from..from.saturating_add(span)).contains(at));
        edges.map(|(_, femtocoulombs)| femtocoulombs).sum::<u64>()
    };
    let most_femtocoulombs = edges.iter().map(|(at, _)| within(*at)).max().unwrap_or(0);
    // fC per ms is pA.
    u32::try_from((most_femtocoulombs / u64::from(SEQUENCE_CURRENT_SPAN_MS)).div_ceil(1_000_000)).unwrap_or(u32::MAX)
}
