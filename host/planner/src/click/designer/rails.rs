//! Voltages of the rails for a click, and what of its forces fits them, the windows of a board and its supply.

use super::pushes::SlotPush;
use super::{ClickDesigner, Lacks};
use crate::click::options::MAX_STANDING_RAIL_RATIO;
use crate::click::realise::SLOT_S;
use crate::physics::limits::max_mean_supply_current_a;
use era_shared::circuit::{BLEEDER_OHMS, ELECTRODE_PICOFARADS};
use era_shared::limits::{MAX_RAIL_MILLIVOLTS, SEQUENCE_CURRENT_SPAN_MS};
use era_shared::supply::{RAILS, rail_index_of_channel};

/// Room that windows keep for corrections, as a part of their force.
const CORRECTION_HEADROOM: f64 = 0.06;
/// From one voltage of a rail to the next, as a factor: forces are up to a sixth larger than needed, and windows narrower.
const RAIL_STEP: f64 = 1.08;
/// Least voltage in V of a rail that is used: a board does not discharge rails below 60 V, and its self-test leaves them at 50 V.
const LEAST_RAIL_V: f64 = 100.0;

impl ClickDesigner<'_> {
    /// Voltages at which the pushes fit their slots, with some room: the least ones of steps, so that clicks at neighbouring places have the same.
    pub(super) fn choose_least_stepped_rail_voltages_v(&self, pushes: &[SlotPush]) -> [f64; RAILS] {
        core::array::from_fn(|rail| {
            let (least_v, highest_v) = self.find_least_and_highest_voltage_of_rail_v(pushes, rail);
            if least_v <= 0.0 {
                return 0.0;
            }
            let steps = ((least_v / LEAST_RAIL_V).ln() / RAIL_STEP.ln() - 1e-9).ceil();
            // Rails are set in whole volts.
            (LEAST_RAIL_V * RAIL_STEP.powf(steps)).ceil().min(highest_v)
        })
    }

    /// These voltages, but with each rail where it stands that stands not much higher than the pushes need; the same, if the supply's current is not
    /// enough for that.
    pub(super) fn use_present_rail_voltages_where_suitable_else_given(
        &self,
        pushes: &[SlotPush],
        rails: [f64; RAILS],
    ) -> [f64; RAILS] {
        let kept: [f64; RAILS] = core::array::from_fn(|rail| {
            let (least_v, highest_v) = self.find_least_and_highest_voltage_of_rail_v(pushes, rail);
            let stands_v = self.options.standing_rails_v.get(rail).copied().unwrap_or(0.0);
            let fits =
                least_v > 0.0 && (least_v..=highest_v.min(MAX_STANDING_RAIL_RATIO * least_v)).contains(&stands_v);
            if fits { stands_v } else { rails.get(rail).copied().unwrap_or(0.0) }
        });
        if self.highest_mean_current_a(pushes, &kept) > max_mean_supply_current_a() { rails } else { kept }
    }

    /// The voltage in V at which the pushes on a rail fit their slots, with some room, 0 without any; and the highest one that its actuators take.
    pub(super) fn find_least_and_highest_voltage_of_rail_v(&self, pushes: &[SlotPush], rail: usize) -> (f64, f64) {
        let on_rail = pushes.iter().filter(|push| rail_index_of_channel(push.actuator) == rail);
        let most = on_rail.map(|push| push.part).fold(0.0, f64::max);
        let highest = (0..self.actuators.len()).filter(|i| rail_index_of_channel(*i) == rail);
        let highest_v = highest.filter_map(|i| self.actuators.get(i)).map(|own| own.highest_v).fold(0.0, f64::max);
        let least_v = (highest_v * (most * (1.0 + CORRECTION_HEADROOM)).min(1.0).sqrt()).max(LEAST_RAIL_V);
        (if most > 0.0 { least_v } else { 0.0 }, highest_v)
    }

    /// The pushes as parts of the full force at the rails' voltages; what no window can make is left out or made as small as it can be.
    pub(super) fn rescale_pushes_to_rail_voltages_dropping_weak_ones(
        &self,
        pushes: &[SlotPush],
        rails: &[f64; RAILS],
    ) -> Vec<SlotPush> {
        let express = |push: &SlotPush| {
            let own = self.actuators.get(push.actuator)?;
            let scale = (rails.get(rail_index_of_channel(push.actuator))? / own.highest_v).powi(2);
            let part = if scale > 0.0 { push.part / scale } else { 0.0 };
            (part >= 0.5 * own.least_part).then(|| SlotPush { part: part.clamp(own.least_part, 1.0), ..*push })
        };
        let expressed: Vec<SlotPush> = pushes.iter().filter_map(express).collect();
        if !expressed.is_empty() {
            return expressed;
        }
        // Of a wish that is too weak for any window the strongest push is left.
        let strongest = pushes.iter().max_by(|a, b| a.part.total_cmp(&b.part));
        let least = |push: &SlotPush| Some(SlotPush { part: self.actuators.get(push.actuator)?.least_part, ..*push });
        strongest.and_then(least).into_iter().collect()
    }

    /// Drops the weakest pushes that a board takes no more of: beyond its number of windows, or its supply's current. Returns which of the two
    /// was too little.
    pub(super) fn drop_weakest_pushes_beyond_board_windows_and_current(
        &self,
        pushes: &mut Vec<SlotPush>,
        rails: &[f64; RAILS],
    ) -> Lacks {
        let mut lacks = Lacks::default();
        loop {
            let has_too_many = pushes.len() > self.options.max_windows_of_each_click();
            let is_current_short = self.highest_mean_current_a(pushes, rails) > max_mean_supply_current_a();
            if !has_too_many && !is_current_short {
                return lacks;
            }
            lacks.windows |= has_too_many;
            lacks.current |= is_current_short && !has_too_many;
            let force = |push: &SlotPush| self.actuators.get(push.actuator).map_or(0.0, |own| own.full_n * push.part);
            let weakest = pushes.iter().enumerate().min_by(|a, b| force(a.1).total_cmp(&force(b.1))).map(|(i, _)| i);
            let Some(weakest) = weakest else { return lacks };
            pushes.remove(weakest);
        }
    }

    /// The largest mean of the supply's current over the time that a board allows it, in A.
    pub(super) fn highest_mean_current_a(&self, pushes: &[SlotPush], rails: &[f64; RAILS]) -> f64 {
        let span_s = f64::from(SEQUENCE_CURRENT_SPAN_MS) * 1e-3;
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "ten slots")]
        let span = (span_s / SLOT_S).ceil() as usize;
        let charge_c = |push: &SlotPush| {
            let board_f = f64::from(ELECTRODE_PICOFARADS.get(push.actuator).copied().unwrap_or(0)) * 1e-12;
            let own_f = self.table.electrodes.get(push.actuator).map_or(0.0, |own| own.capacitance_f);
            own_f.max(board_f) * rails.get(rail_index_of_channel(push.actuator)).copied().unwrap_or(0.0)
        };
        let within = |from: usize| -> f64 {
            pushes.iter().filter(|push| (from..=from + span).contains(&push.slot)).map(charge_c).sum()
        };
        let most_c = pushes.iter().map(|push| within(push.slot)).fold(0.0, f64::max);
        // A board leaves a rail where it is that feeds none of the windows.
        let most_v = f64::from(MAX_RAIL_MILLIVOLTS) / 1e3;
        let is_there = |rail: usize| (0..self.actuators.len()).any(|i| rail_index_of_channel(i) == rail);
        let stands_v = |(rail, volts): (usize, &f64)| if *volts > 0.0 || !is_there(rail) { *volts } else { most_v };
        let rails_v: f64 = rails.iter().enumerate().map(stands_v).sum();
        most_c / span_s + rails_v * 2.0 / f64::from(BLEEDER_OHMS)
    }
}
