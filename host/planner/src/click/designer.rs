//! The steps from a wished peak to windows: forces of slots, voltages of rails, widths, corrections.

use super::actuator::ClickActuator;
use super::felt::{SAMPLE_S, felt_motion_from_means};
use super::measures::{ClickMeasures, measure_click};
use super::motion::{WindowMotion, simulate_windows};
use super::options::{ClickOptions, Preference};
use super::program::{ForceProgram, LOOKED_AT, MotionBounds, SampleBound, SlotForce, SolvedForces, TargetResponses};
use super::realise::{SLOT_S, TICK_S, find_window_width_s, narrowest_window_s, place_window_in_slot_s};
use super::window::ClickWindow;
use crate::PlanTable;
use crate::physics::limits::{Electrodes, Limit, max_mean_supply_current_a};
use crate::physics::rise::PanelPoles;
use crate::scene::MAX_ACTUATORS;
use era_shared::circuit::{BLEEDER_OHMS, ELECTRODE_PICOFARADS};
use era_shared::limits::{MAX_RAIL_MILLIVOLTS, SEQUENCE_CURRENT_SPAN_MS};
use era_shared::supply::{RAILS, rail_index_of_channel};
use era_shared::waveform::{Electrode, MAX_WINDOWS};
use nalgebra::DVector;

/// Samples of a slot.
pub const SLOT_SAMPLES: usize = 4;
/// From when on a click is to be quiet if it can be, in s.
const SOON_QUIET_S: f64 = 0.030;
/// Part of the peak asked for that a click has to reach to be taken as it is.
const STRONG_ENOUGH: f64 = 0.8;
/// Times in s at which the peak may come, the best first: later it is felt as late.
const PEAKS_S: [f64; 2] = [0.012, 0.0145];
/// Parts of the peak that may be left on the panel and on panels off it; windows and rounding take what is left to a tenth and a fifth.
const CRISP: [f64; 2] = [0.085, 0.15];
/// The same where a crisp click is too weak and strength is preferred, one after the other.
const LESS_CRISP: [[f64; 2]; 2] = [[0.4, 0.6], [1.0, 1.1]];
/// How many times as strong as the crisp click one has to be that rings: fingers notice that a vibration is 10 to 30 % stronger.
const WORTH_RINGING: f64 = 1.25;
/// Part of the motion's peak before it is quiet, on the panel and on panels off it.
const BEFORE: [f64; 2] = [1.0, 1.1];
/// Parts of the peak that unlimited windows reach, which are tried where a board has too few windows for all of it: each is at most a sixth
/// weaker than the one before.
const WEAKER: [f64; 7] = [0.93, 0.86, 0.78, 0.69, 0.60, 0.51, 0.43];
/// Part of the peak that is as good as all of it.
const WHOLE: f64 = 0.999;
/// The same of what windows really make.
const NEARLY_WHOLE: f64 = 0.96;
/// Part of an actuator's force that is all of it.
const FULL: f64 = 0.95;
/// How many times as much force as needed windows may have.
const SPARE_FORCE: f64 = 1.7;
/// Times that slots are made dearer that have little force.
const REWEIGHTED: usize = 2;
/// Before the time asked for, in s, a click is to be quiet: the burst's lead, and what the motion takes from one sample to the next.
const SPARE_S: f64 = 1.5e-3;
/// Rounds of correction by what windows really do.
const CORRECTIONS: usize = 3;
/// Part by which windows may miss the bounds without another correction: what is left counts from a tenth on, and is chosen below 0.085.
const GOOD_ENOUGH: f64 = 0.03;
/// Room that windows keep for corrections, as a part of their force.
const ROOM: f64 = 0.06;
/// Part of the travel that may be used: a rail that is 5 % above its set-point makes a tenth more force.
const USED_TRAVEL: f64 = 0.90;
/// Least part of the wished peak that a click has: a place that does not move is no click.
const LEAST_CLICK: f64 = 0.05;
/// Least peak in m/s^2 that counts as a motion: a ten-thousandth of what is felt at best.
const MOVED: f64 = 1e-6;
/// Least voltage in V of a rail that is used: a board does not discharge rails below 60 V, and its self-test leaves them at 50 V.
const LEAST_RAIL_V: f64 = 100.0;

/// A click before its figures are read.
#[derive(Clone, Debug)]
pub struct BuiltClick {
    /// From the first slot's beginning.
    pub windows: Vec<ClickWindow>,
    pub motion: WindowMotion,
    /// Actuators that are used in full, and what keeps them from more.
    pub saturated: Vec<(usize, Limit)>,
    pub lacks: Lacks,
}

/// What a board has too little of for a click.
#[derive(Clone, Copy, Debug, Default)]
pub struct Lacks {
    pub current: bool,
    pub windows: bool,
}

/// Forces of slots.
struct ChosenPushes {
    pushes: Vec<SlotPush>,
    /// The bounds that they keep, and those of them that keep them from less.
    bounds: MotionBounds,
    tight: Vec<SampleBound>,
    /// The largest force that they may have, as a part of the full one.
    scale: f64,
    /// The largest peak in m/s^2 within the bounds.
    strongest: f64,
    /// The peak in m/s^2 that they are for, and the part of it that they make.
    reachable: f64,
    peak: f64,
    /// Their peak as a part of what is asked for.
    reached: f64,
}

/// A click, and what it is.
#[derive(Clone, Debug)]
struct JudgedClick {
    built: BuiltClick,
    is_crisp: bool,
    /// As a part of what is asked for.
    peak: f64,
}

impl JudgedClick {
    /// The crisp one of two, or the stronger one of two that are alike.
    fn or_better(self, other: &Self) -> Self {
        let is_better = (other.is_crisp, other.peak.min(1.0)) > (self.is_crisp, self.peak.min(1.0));
        if is_better { other.clone() } else { self }
    }
}

/// A force of a slot that becomes a window: as a part of the actuator's full one at its rail's voltage.
#[derive(Clone, Copy, Debug)]
struct SlotPush {
    actuator: usize,
    slot: usize,
    is_positive: bool,
    part: f64,
}

/// Designs clicks for some targets, in the acceleration of the first.
pub struct ClickDesigner<'a> {
    pub table: &'a PlanTable,
    pub poles: &'a PanelPoles,
    /// Mode shapes of the targets.
    pub shapes: &'a [DVector<f64>],
    /// How each of them moves, without anything besides.
    pub targets: Vec<TargetResponses<'a>>,
    pub actuators: &'a [ClickActuator],
    pub options: ClickOptions,
}

impl ClickDesigner<'_> {
    /// Sets what the accelerations of the targets are multiplied by, in their order.
    pub fn set_factors_of_targets(&mut self, factors: &[f64]) {
        self.targets.iter_mut().zip(factors).for_each(|(target, factor)| target.factor = *factor);
    }

    /// The largest crisp peak in m/s^2 that forces of the actuators can make.
    pub fn find_largest_crisp_peak(&self) -> f64 {
        let bounds = choose_bounds(PEAKS_S[0], self.options.crisp_s - SPARE_S, CRISP);
        let solved = bounds.and_then(|bounds| self.solve_for_bounds(1.0, bounds, 1.0, |_, _| 1.0, &[], true));
        solved.map_or(0.0, |(_, strongest)| strongest.goal)
    }

    /// The first click of those tried that is what was asked for, or the best of them. Of most of them the linear programme says that they
    /// are too weak, and only the best of those is worked out.
    pub fn design_for_peak(&self, asked: f64) -> Option<BuiltClick> {
        if asked <= 0.0 {
            return Some(self.build(&[], &[0.0; RAILS], (Vec::new(), Lacks::default())));
        }
        let crisp_s = self.options.crisp_s - SPARE_S;
        let is_strong_and_crisp = |found: &JudgedClick| found.is_crisp && found.peak >= STRONG_ENOUGH;
        let soon = self.choose_pushes(asked, choose_bounds(PEAKS_S[0], SOON_QUIET_S.min(crisp_s), CRISP));
        let soon = soon.filter(|chosen| chosen.reached >= STRONG_ENOUGH);
        let soon = soon.and_then(|chosen| self.realise_or_weaken(asked, chosen, is_strong_and_crisp));
        if let Some(found) = soon.filter(is_strong_and_crisp) {
            return Some(found.built);
        }
        let chosen = |peak_s: f64| self.choose_pushes(asked, choose_bounds(peak_s, crisp_s, CRISP));
        let mut crisp: Vec<ChosenPushes> = PEAKS_S.into_iter().filter_map(chosen).collect();
        // The earlier peak is preferred to one that is hardly stronger.
        crisp.sort_by(|a, b| b.reached.min(NEARLY_WHOLE).total_cmp(&a.reached.min(NEARLY_WHOLE)));
        let mut best: Option<JudgedClick> = None;
        for chosen in crisp {
            if best.as_ref().is_some_and(|best| best.is_crisp && best.peak >= chosen.reached.min(STRONG_ENOUGH)) {
                break;
            }
            let Some(found) = self.realise_or_weaken(asked, chosen, |found| found.is_crisp) else { continue };
            best = Some(best.map_or_else(|| found.clone(), |best| best.or_better(&found)));
        }
        if let Some(best) = &best
            && best.is_crisp
            && (best.peak >= STRONG_ENOUGH || self.options.preference == Preference::Crispness)
        {
            return Some(best.built.clone());
        }
        let least = best.as_ref().filter(|best| best.is_crisp).map_or(0.0, |best| WORTH_RINGING * best.peak);
        for after in LESS_CRISP {
            let Some(chosen) = self.choose_pushes(asked, choose_bounds(PEAKS_S[0], crisp_s, after)) else { continue };
            let is_stronger = |peak: f64| peak >= least && best.as_ref().is_none_or(|best| peak > best.peak);
            if is_stronger(chosen.reached)
                && let Some(found) = self.realise_or_weaken(asked, chosen, |_| true)
                && is_stronger(found.peak)
            {
                best = Some(found);
            }
            if best.as_ref().is_some_and(|best| best.peak >= STRONG_ENOUGH) {
                break;
            }
        }
        best.map(|best| best.built)
    }

    /// The click of chosen pushes. If it is not good because it needs more windows than a board has, or because its windows miss the bounds: the
    /// strongest good one of those with a lower peak, within the same bounds.
    fn realise_or_weaken(
        &self,
        asked: f64,
        chosen: ChosenPushes,
        is_good: impl Fn(&JudgedClick) -> bool,
    ) -> Option<JudgedClick> {
        let ChosenPushes { bounds, strongest, reachable, peak, .. } = chosen;
        let first = self.realise(asked, self.choose_fewer_pushes(chosen))?;
        if is_good(&first) && !first.built.lacks.windows {
            return Some(first);
        }
        let weaker = |part: f64| {
            let weaker = self.choose_least_pushes(asked, bounds, (part * peak * reachable, strongest), &[])?;
            self.realise(asked, self.choose_fewer_pushes(weaker)).filter(|found| is_good(found))
        };
        let Some(mut found) = WEAKER.into_iter().find_map(weaker) else { return Some(first) };
        // What keeps it from more is what made the first one bad, not the actuators, which have force left.
        found.built.lacks.windows |= first.built.lacks.windows;
        if peak * reachable >= NEARLY_WHOLE * asked {
            found.built.saturated.clear();
        }
        Some(if is_good(&first) { first.or_better(&found) } else { found })
    }

    /// The click of chosen pushes.
    fn realise(&self, asked: f64, chosen: ChosenPushes) -> Option<JudgedClick> {
        let ChosenPushes { pushes: chosen, bounds, reachable, peak, mut tight, .. } = chosen;
        let rails = self.choose_rail_voltages(&chosen);
        let mut pushes = self.express_at_rail_voltages(&chosen, &rails);
        let lacks = self.drop_pushes_beyond_board(&mut pushes, &rails);
        let is_short = reachable < asked || peak < WHOLE;
        let saturated = if is_short { self.list_actuators_at_full_force(&chosen) } else { Vec::new() };
        // From here on what can be reached is what is asked for.
        let wished = asked;
        let asked = reachable;
        let mut best: Option<(f64, JudgedClick)> = None;
        for round in 0..=CORRECTIONS {
            let built = self.build(&pushes, &rails, (saturated.clone(), lacks));
            let felt = self.list_felt_motion_as_at_first_target(&built.motion);
            let coarse: Vec<Vec<f64>> = felt.iter().map(|felt| felt.iter().copied().step_by(4).collect()).collect();
            let excess = coarse.iter().map(|felt| worst_excess(felt, bounds, asked * peak)).fold(0.0, f64::max);
            if best.as_ref().is_none_or(|(least, _)| excess < *least) {
                let measures: Vec<ClickMeasures> = felt.iter().map(|felt| measure_click(felt)).collect();
                let is_crisp = |own: &ClickMeasures| {
                    own.peak >= LEAST_CLICK * asked && self.options.is_motion_crisp(&own.count_times_from_burst())
                };
                let least_peak = measures.iter().map(|own| own.peak).fold(f64::INFINITY, f64::min);
                let judged = JudgedClick { built, is_crisp: measures.iter().all(is_crisp), peak: least_peak / wished };
                best = Some((excess, judged));
            }
            if excess <= GOOD_ENOUGH || round == CORRECTIONS {
                break;
            }
            let corrected = self.correct_pushes(&pushes, &rails, &coarse, bounds, (asked, peak), &tight);
            let Some(corrected) = corrected else { break };
            (pushes, tight) = corrected;
        }
        best.map(|(_, judged)| judged)
    }

    /// The felt acceleration of every target, multiplied so that its wish is that of the first.
    fn list_felt_motion_as_at_first_target(&self, motion: &WindowMotion) -> Vec<Vec<f64>> {
        let multiply = |(means, target): (&Vec<f64>, &TargetResponses)| {
            felt_motion_from_means(means).into_iter().map(|felt| target.factor * felt).collect()
        };
        motion.mean_acceleration.iter().zip(&self.targets).map(multiply).collect()
    }

    /// Forces of slots in parts of each actuator's full one, and the peak as a part of what is asked for. They come from forces that are not
    /// much larger than needed, so that windows are wide.
    fn choose_pushes(&self, asked: f64, bounds: Option<MotionBounds>) -> Option<ChosenPushes> {
        let bounds = bounds?;
        // In m/s^2: a programme whose peak is small beside what is asked for has no digits left.
        let (_, strongest) = self.solve_for_bounds(1.0, bounds, 1.0, |_, _| 1.0, &[], true)?;
        let strongest_peak = strongest.goal;
        if strongest_peak < MOVED {
            return Some(ChosenPushes {
                pushes: Vec::new(),
                tight: Vec::new(),
                bounds,
                scale: 1.0,
                strongest: strongest_peak,
                reachable: asked,
                peak: 0.0,
                reached: 0.0,
            });
        }
        self.choose_least_pushes(asked, bounds, (asked.min(strongest_peak), strongest_peak), &strongest.tight)
    }

    /// The least pushes for a peak of `reachable` m/s^2, of which `strongest` is the largest within the bounds.
    fn choose_least_pushes(
        &self,
        asked: f64,
        bounds: MotionBounds,
        (reachable, strongest): (f64, f64),
        first: &[SampleBound],
    ) -> Option<ChosenPushes> {
        // A place that does not move has no peak to choose for.
        if strongest < MOVED {
            return None;
        }
        let scale = (SPARE_FORCE * reachable / strongest).min(1.0);
        let (pushes, solved) = self.solve_for_bounds(reachable, bounds, scale, |_, _| 1.0, first, false)?;
        let (tight, peak) = (solved.tight, solved.goal);
        let reached = peak * reachable / asked;
        Some(ChosenPushes { pushes, tight, bounds, scale, strongest, reachable, peak, reached })
    }

    /// The same peak from few slots, so that none is too weak for a window.
    fn choose_fewer_pushes(&self, mut chosen: ChosenPushes) -> ChosenPushes {
        for _ in 0..REWEIGHTED {
            let ChosenPushes { pushes, tight, bounds, scale, reachable, peak, .. } = &chosen;
            let is_weak = |push: &SlotPush| {
                self.actuators.get(push.actuator).is_some_and(|own| push.part < own.least_part * scale)
            };
            // Where all force is needed there is none to move to other slots.
            if *peak < WHOLE || pushes.len() <= MAX_WINDOWS && !pushes.iter().any(is_weak) {
                break;
            }
            let cost = |actuator: usize, slot: usize| {
                let own = pushes.iter().find(|push| push.actuator == actuator && push.slot == slot);
                1.0 / (own.map_or(0.0, |own| own.part) / scale + 0.1)
            };
            let again = self.solve_for_bounds(*reachable, *bounds, *scale, cost, tight, false);
            let Some((pushes, solved)) = again.filter(|(_, solved)| solved.goal >= peak * WHOLE) else { break };
            chosen = ChosenPushes { pushes, tight: solved.tight, peak: solved.goal, ..chosen };
        }
        chosen
    }

    /// Actuators that a click uses in full, with what keeps them from more; all of those that have a force if none is.
    fn list_actuators_at_full_force(&self, pushes: &[SlotPush]) -> Vec<(usize, Limit)> {
        let uses = |least: f64| -> Vec<(usize, Limit)> {
            let used = |actuator: usize| pushes.iter().any(|push| push.actuator == actuator && push.part >= least);
            let own = self.actuators.iter().enumerate().filter(|(actuator, _)| used(*actuator));
            own.map(|(_, own)| (own.limited_by, own.limit)).collect()
        };
        let full = uses(FULL);
        if full.is_empty() { uses(0.0) } else { full }
    }

    /// Solves for forces up to `scale` of the full ones, at these costs of slots: the least, or, with `largest`, those of the largest peak.
    fn solve_for_bounds(
        &self,
        asked: f64,
        bounds: MotionBounds,
        scale: f64,
        cost: impl Fn(usize, usize) -> f64,
        first: &[SampleBound],
        largest: bool,
    ) -> Option<(Vec<SlotPush>, SolvedForces)> {
        let slots = (bounds.quiet_sample / SLOT_SAMPLES).saturating_sub(2);
        let mut forces = Vec::with_capacity(2 * slots * self.actuators.len());
        for (actuator, own) in self.actuators.iter().enumerate() {
            for slot in 0..slots {
                let cost = if largest { 0.0 } else { cost(actuator, slot) };
                for force_n in [own.full_n * scale, -own.full_n * scale] {
                    forces.push(SlotForce { actuator, slot, force_n, bounds: (0.0, 1.0), cost });
                }
            }
        }
        let targets = if largest {
            self.targets.iter().map(TargetResponses::without_panels_off).collect()
        } else {
            self.targets.clone()
        };
        let program = ForceProgram { targets, forces, bounds, asked, first };
        let solved = if largest { program.find_largest_peak()? } else { program.find_least_forces_for_peak()? };
        let pushes = program.forces.iter().zip(&solved.values).filter(|(_, value)| **value > 1e-6);
        let pushes = pushes.map(|(force, value)| SlotPush {
            actuator: force.actuator,
            slot: force.slot,
            is_positive: force.force_n > 0.0,
            part: *value * scale,
        });
        Some((pushes.collect(), solved))
    }

    /// The least voltages at which the pushes fit their slots, with some room.
    fn choose_rail_voltages(&self, pushes: &[SlotPush]) -> [f64; RAILS] {
        let mut rails = [0.0; RAILS];
        for (rail, voltage_v) in rails.iter_mut().enumerate() {
            let on_rail = pushes.iter().filter(|push| rail_index_of_channel(push.actuator) == rail);
            let most = on_rail.map(|push| push.part).fold(0.0, f64::max);
            let highest = (0..self.actuators.len()).filter(|i| rail_index_of_channel(*i) == rail);
            let highest_v = highest.filter_map(|i| self.actuators.get(i)).map(|own| own.highest_v).fold(0.0, f64::max);
            // Rails are set in whole volts, rounded up where there is room.
            if most > 0.0 {
                *voltage_v =
                    (highest_v * (most * (1.0 + ROOM)).min(1.0).sqrt()).ceil().max(LEAST_RAIL_V).min(highest_v);
            }
        }
        rails
    }

    /// The pushes as parts of the full force at the rails' voltages; what no window can make is left out or made as small as it can be.
    fn express_at_rail_voltages(&self, pushes: &[SlotPush], rails: &[f64; RAILS]) -> Vec<SlotPush> {
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
    fn drop_pushes_beyond_board(&self, pushes: &mut Vec<SlotPush>, rails: &[f64; RAILS]) -> Lacks {
        let mut lacks = Lacks::default();
        loop {
            let has_too_many = pushes.len() > MAX_WINDOWS;
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
    fn highest_mean_current_a(&self, pushes: &[SlotPush], rails: &[f64; RAILS]) -> f64 {
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

    /// The windows of pushes, and what they do.
    fn build(
        &self,
        pushes: &[SlotPush],
        rails: &[f64; RAILS],
        (saturated, lacks): (Vec<(usize, Limit)>, Lacks),
    ) -> BuiltClick {
        let window = |push: &SlotPush| {
            let own = self.actuators.get(push.actuator)?;
            let width_s = round_to_tick_s(find_window_width_s(own.charging, push.part).max(narrowest_window_s()));
            let begin_s = round_to_tick_s(slot_begin_s(push.slot) + place_window_in_slot_s(width_s));
            Some(ClickWindow {
                actuator: push.actuator,
                electrode: if push.is_positive { Electrode::A } else { Electrode::B },
                begin_s,
                width_s,
                voltage_v: rails.get(rail_index_of_channel(push.actuator)).copied()?,
            })
        };
        let windows: Vec<ClickWindow> = pushes.iter().filter_map(window).collect();
        self.build_from_windows(windows, (saturated, lacks))
    }

    fn build_from_windows(
        &self,
        windows: Vec<ClickWindow>,
        (saturated, lacks): (Vec<(usize, Limit)>, Lacks),
    ) -> BuiltClick {
        let motion = simulate_windows(self.table, self.poles, self.shapes, &windows);
        BuiltClick { windows, motion, saturated, lacks }
    }

    /// The same windows at voltages that make this part of the force.
    pub fn weaken(&self, built: &BuiltClick, part: f64) -> BuiltClick {
        let mut windows = built.windows.clone();
        windows.iter_mut().for_each(|window| window.voltage_v = (window.voltage_v * part.sqrt()).floor());
        self.build_from_windows(windows, (built.saturated.clone(), built.lacks))
    }

    /// The parts of the pushes at which the bounds are missed least, given what windows make of the present ones.
    fn correct_pushes(
        &self,
        pushes: &[SlotPush],
        rails: &[f64; RAILS],
        felt: &[Vec<f64>],
        bounds: MotionBounds,
        (asked, peak): (f64, f64),
        first: &[SampleBound],
    ) -> Option<(Vec<SlotPush>, Vec<SampleBound>)> {
        let force = |push: &SlotPush| {
            let own = self.actuators.get(push.actuator)?;
            let scale = (rails.get(rail_index_of_channel(push.actuator))? / own.highest_v).powi(2);
            let force_n = own.full_n * scale * if push.is_positive { 1.0 } else { -1.0 };
            Some(SlotForce {
                actuator: push.actuator,
                slot: push.slot,
                force_n,
                bounds: (own.least_part, 1.0),
                cost: 1e-4,
            })
        };
        let forces = pushes.iter().map(force).collect::<Option<Vec<_>>>()?;
        let values: Vec<f64> = pushes.iter().map(|push| push.part).collect();
        let linear = ForceProgram { targets: self.targets.clone(), forces, bounds, asked, first };
        let subtract = |(target, felt): (&TargetResponses, &Vec<f64>)| -> Vec<f64> {
            let motion = linear.motion_of_target(target, 0, &values);
            motion.into_iter().zip(felt).map(|(linear, felt)| felt - linear * asked).collect()
        };
        let besides: Vec<Vec<f64>> = self.targets.iter().zip(felt).map(subtract).collect();
        let targets =
            self.targets.iter().zip(&besides).map(|(own, besides)| TargetResponses { besides, ..*own }).collect();
        let program = ForceProgram { targets, ..linear };
        let solved = program.find_forces_with_least_excess(peak)?;
        let corrected =
            pushes.iter().zip(solved.values).map(|(push, part)| SlotPush { part: part.clamp(0.0, 1.0), ..*push });
        Some((corrected.collect(), solved.tight))
    }

    /// The actuator whose mass goes furthest beyond its limit, and by which factor, if any does.
    pub fn find_largest_travel_excess(&self, motion: &WindowMotion) -> Option<(usize, f64)> {
        let excess =
            |(i, (travel_m, own)): (usize, (&f64, &Electrodes))| (i, travel_m / (USED_TRAVEL * own.max_travel_m()));
        let all = motion.travel_m.iter().zip(&self.table.electrodes).take(MAX_ACTUATORS).enumerate().map(excess);
        all.filter(|(_, excess)| *excess > 1.0).max_by(|a, b| a.1.total_cmp(&b.1))
    }
}

/// By which part a motion misses its bounds or its peak, at most.
fn worst_excess(felt: &[f64], bounds: MotionBounds, peak: f64) -> f64 {
    let missed = |(sample, x): (usize, &f64)| {
        let allowed = if sample >= bounds.quiet_sample { bounds.after[0] } else { bounds.before[0] };
        x.abs() / (allowed * peak) - 1.0
    };
    let reached = felt.get(bounds.peak_sample).copied().unwrap_or(0.0) / peak;
    let counted = felt.iter().enumerate().take(LOOKED_AT).map(missed).fold(0.0, f64::max);
    counted.max(5.0 * (1.0 - reached))
}

/// The bounds of a peak at a time that is quiet from another one on; `None` if it would have to be quiet before.
fn choose_bounds(peak_s: f64, quiet_s: f64, after: [f64; 2]) -> Option<MotionBounds> {
    let (peak_sample, quiet_sample) = (time_to_sample(peak_s), time_to_sample(quiet_s));
    (peak_s < quiet_s).then_some(MotionBounds { peak_sample, quiet_sample, before: BEFORE, after })
}

#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "some hundred samples")]
fn time_to_sample(time_s: f64) -> usize {
    (time_s / SAMPLE_S).round() as usize
}

#[expect(clippy::cast_precision_loss, reason = "some slots")]
fn slot_begin_s(slot: usize) -> f64 {
    slot as f64 * SLOT_S
}

fn round_to_tick_s(time_s: f64) -> f64 {
    (time_s / TICK_S).round() * TICK_S
}
