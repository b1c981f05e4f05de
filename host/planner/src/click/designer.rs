//! The steps from a wished peak to windows: forces of slots (`pushes`), voltages of rails (`rails`), widths, corrections.

mod pushes;
mod rails;

use self::pushes::{ChosenPushes, SlotPush, WHOLE};
use super::actuator::ClickActuator;
use super::felt::{SAMPLE_S, filter_50_us_means_to_felt_motion_at_16_khz};
use super::measures::{ClickMeasures, measure_click};
use super::motion::{WindowMotion, simulate_windows};
use super::options::{ClickOptions, Preference};
use super::program::{LOOKED_AT, MotionBounds, TargetResponses};
use super::realise::{
    SLOT_S, TICK_S, find_window_width_for_force_fraction_s, narrowest_window_s, place_window_in_slot_s,
};
use super::window::ClickWindow;
use crate::PlanTable;
use crate::physics::limits::{Electrodes, Limit};
use crate::physics::rise::PanelPoles;
use crate::scene::MAX_ACTUATORS;
use era_shared::supply::{RAILS, rail_index_of_channel};
use era_shared::waveform::Electrode;
use nalgebra::DVector;

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
/// How many times as strong as a click that peaks or is quiet sooner one has to be to be preferred: what fingers hardly notice is not waited for.
const WORTH_WAITING: f64 = 1.05;
/// How many times as strong as the crisp click one has to be that rings: fingers notice that a vibration is 10 to 30 % stronger.
const WORTH_RINGING: f64 = 1.25;
/// Part of the motion's peak before it is quiet, on the panel and on panels off it.
const BEFORE: [f64; 2] = [1.0, 1.1];
/// Parts of the peak that unlimited windows reach, which are tried where a board has too few windows for all of it: each is at most a sixth
/// weaker than the one before.
const WEAKER: [f64; 7] = [0.93, 0.86, 0.78, 0.69, 0.60, 0.51, 0.43];
/// The same of what windows really make.
const NEARLY_WHOLE: f64 = 0.96;
/// Before the time asked for, in s, a click is to be quiet: the burst's lead, and what the motion takes from one sample to the next.
const SPARE_S: f64 = 1.5e-3;
/// Rounds of correction by what windows really do.
const CORRECTIONS: usize = 3;
/// Part by which windows may miss the bounds without another correction: what is left counts from a tenth on, and is chosen below 0.085.
const GOOD_ENOUGH: f64 = 0.03;
/// Part of the travel that may be used: a rail that is 5 % above its set-point makes a tenth more force.
const USED_TRAVEL: f64 = 0.90;
/// Least part of the wished peak that a click has: a place that does not move is no click.
const LEAST_CLICK: f64 = 0.05;

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
    pub fn find_largest_crisp_peak_or_0_m_per_s2(&self) -> f64 {
        let bounds = motion_bounds_if_peak_precedes_quiet(PEAKS_S[0], self.options.crisp_s - SPARE_S, CRISP);
        let solved = bounds.and_then(|bounds| {
            self.solve_least_forces_or_largest_peak_within_bounds(1.0, bounds, 1.0, |_, _| 1.0, &[], true)
        });
        solved.map_or(0.0, |(_, strongest)| strongest.goal)
    }

    /// The first click of those tried that is what was asked for, or the best of them: quiet soon, then quiet in time, then one that rings. Of most
    /// of them the linear programme says that they are too weak, and only the best of those is worked out.
    pub fn design_click_for_peak_or_best_weaker_if_solved(&self, asked: f64) -> Option<BuiltClick> {
        if asked <= 0.0 {
            return Some(self.build(&[], &[0.0; RAILS], (Vec::new(), Lacks::default())));
        }
        let crisp_s = self.options.crisp_s - SPARE_S;
        let is_strong_and_crisp = |found: &JudgedClick| found.is_crisp && found.peak >= STRONG_ENOUGH;
        let is_whole = |found: &JudgedClick| found.is_crisp && found.peak >= NEARLY_WHOLE;
        let soon = self.choose_least_force_pushes_for_asked_or_largest_reachable_peak(
            asked,
            motion_bounds_if_peak_precedes_quiet(PEAKS_S[0], SOON_QUIET_S.min(crisp_s), CRISP),
        );
        let soon = soon.filter(|chosen| chosen.reached >= STRONG_ENOUGH);
        // Rather than a weaker one, one that is quiet later is tried.
        let soon = soon.and_then(|chosen| {
            self.build_judged_click_at_present_rails_or_least_rails_if_better(asked, self.choose_fewer_pushes(chosen))
        });
        let mut best = soon.filter(is_strong_and_crisp);
        if let Some(found) = best.take_if(|found| is_whole(found)) {
            return Some(found.built);
        }
        let chosen = |peak_s: f64| {
            self.choose_least_force_pushes_for_asked_or_largest_reachable_peak(
                asked,
                motion_bounds_if_peak_precedes_quiet(peak_s, crisp_s, CRISP),
            )
        };
        let mut crisp: Vec<ChosenPushes> = PEAKS_S.into_iter().filter_map(chosen).collect();
        // The earlier peak is preferred to one that is hardly stronger.
        crisp.sort_by(|a, b| b.reached.min(NEARLY_WHOLE).total_cmp(&a.reached.min(NEARLY_WHOLE)));
        for chosen in crisp {
            let reached = chosen.reached.min(NEARLY_WHOLE);
            if best.as_ref().is_some_and(|best| best.is_crisp && WORTH_WAITING * best.peak >= reached) {
                break;
            }
            let Some(found) =
                self.build_click_of_pushes_or_weaker_one_if_not_good(asked, chosen, |found| found.is_crisp)
            else {
                continue;
            };
            best = Some(match best {
                Some(sooner) if sooner.is_crisp && WORTH_WAITING * sooner.peak >= found.peak.min(1.0) => sooner,
                Some(other) => other.or_better(&found),
                None => found,
            });
        }
        if let Some(best) = &best
            && best.is_crisp
            && (best.peak >= STRONG_ENOUGH || self.options.preference == Preference::Crispness)
        {
            return Some(best.built.clone());
        }
        let least = best.as_ref().filter(|best| best.is_crisp).map_or(0.0, |best| WORTH_RINGING * best.peak);
        for after in LESS_CRISP {
            let Some(chosen) = self.choose_least_force_pushes_for_asked_or_largest_reachable_peak(
                asked,
                motion_bounds_if_peak_precedes_quiet(PEAKS_S[0], crisp_s, after),
            ) else {
                continue;
            };
            let is_stronger = |peak: f64| peak >= least && best.as_ref().is_none_or(|best| peak > best.peak);
            if is_stronger(chosen.reached)
                && let Some(found) = self.build_click_of_pushes_or_weaker_one_if_not_good(asked, chosen, |_| true)
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
    fn build_click_of_pushes_or_weaker_one_if_not_good(
        &self,
        asked: f64,
        chosen: ChosenPushes,
        is_good: impl Fn(&JudgedClick) -> bool,
    ) -> Option<JudgedClick> {
        let ChosenPushes { bounds, strongest, reachable, peak, .. } = chosen;
        let first =
            self.build_judged_click_at_present_rails_or_least_rails_if_better(asked, self.choose_fewer_pushes(chosen))?;
        if is_good(&first) && !first.built.lacks.windows {
            return Some(first);
        }
        let weaker = |part: f64| {
            let weaker = self.choose_pushes_of_least_force_for_reachable_peak(
                asked,
                bounds,
                (part * peak * reachable, strongest),
                &[],
            )?;
            self.build_judged_click_at_present_rails_or_least_rails_if_better(asked, self.choose_fewer_pushes(weaker))
                .filter(|found| is_good(found))
        };
        let Some(mut found) = WEAKER.into_iter().find_map(weaker) else { return Some(first) };
        // What keeps it from more is what made the first one bad, not the actuators, which have force left.
        found.built.lacks.windows |= first.built.lacks.windows;
        if peak * reachable >= NEARLY_WHOLE * asked {
            found.built.saturated.clear();
        }
        Some(if is_good(&first) { first.or_better(&found) } else { found })
    }

    /// The click of chosen pushes: with the rails where they stand, or, if that click is worse than it need be, with those that it needs.
    fn build_judged_click_at_present_rails_or_least_rails_if_better(
        &self,
        asked: f64,
        chosen: ChosenPushes,
    ) -> Option<JudgedClick> {
        let least = self.choose_least_stepped_rail_voltages_v(&chosen.pushes);
        let standing = self.use_present_rail_voltages_where_suitable_else_given(&chosen.pushes, least);
        if standing.map(f64::to_bits) == least.map(f64::to_bits) {
            return self.build_corrected_click_at_rails_and_judge_it(asked, chosen, &least);
        }
        let as_strong = NEARLY_WHOLE * chosen.reached;
        let found = self.build_corrected_click_at_rails_and_judge_it(asked, chosen.clone(), &standing)?;
        if found.is_crisp && found.peak >= as_strong {
            return Some(found);
        }
        let other = self.build_corrected_click_at_rails_and_judge_it(asked, chosen, &least);
        Some(match other {
            Some(other) => found.or_better(&other),
            None => found,
        })
    }

    fn build_corrected_click_at_rails_and_judge_it(
        &self,
        asked: f64,
        chosen: ChosenPushes,
        rails: &[f64; RAILS],
    ) -> Option<JudgedClick> {
        let ChosenPushes { pushes: chosen, bounds, reachable, peak, mut tight, .. } = chosen;
        let mut pushes = self.rescale_pushes_to_rail_voltages_dropping_weak_ones(&chosen, rails);
        let lacks = self.drop_weakest_pushes_beyond_board_windows_and_current(&mut pushes, rails);
        let is_short = reachable < asked || peak < WHOLE;
        let saturated = if is_short {
            self.list_limiting_actuators_and_limits_at_full_force_else_of_all_used(&chosen)
        } else {
            Vec::new()
        };
        // From here on what can be reached is what is asked for.
        let wished = asked;
        let asked = reachable;
        let mut best: Option<(f64, JudgedClick)> = None;
        for round in 0..=CORRECTIONS {
            let built = self.build(&pushes, rails, (saturated.clone(), lacks));
            let felt = self.list_felt_acceleration_of_each_target_scaled_to_first_wish(&built.motion);
            let coarse: Vec<Vec<f64>> = felt.iter().map(|felt| felt.iter().copied().step_by(4).collect()).collect();
            let excess = coarse
                .iter()
                .map(|felt| worst_miss_relative_to_bounds_or_five_times_peak_shortfall(felt, bounds, asked * peak))
                .fold(0.0, f64::max);
            if best.as_ref().is_none_or(|(least, _)| excess < *least) {
                let measures: Vec<ClickMeasures> = felt.iter().map(|felt| measure_click(felt)).collect();
                let is_crisp = |own: &ClickMeasures| {
                    own.peak >= LEAST_CLICK * asked
                        && self
                            .options
                            .does_motion_peak_and_become_quiet_in_time(&own.shift_times_to_count_from_burst_start())
                };
                let least_peak = measures.iter().map(|own| own.peak).fold(f64::INFINITY, f64::min);
                let judged = JudgedClick { built, is_crisp: measures.iter().all(is_crisp), peak: least_peak / wished };
                best = Some((excess, judged));
            }
            if excess <= GOOD_ENOUGH || round == CORRECTIONS {
                break;
            }
            let corrected =
                self.correct_pushes_and_get_tight_bounds(&pushes, rails, &coarse, bounds, (asked, peak), &tight);
            let Some(corrected) = corrected else { break };
            (pushes, tight) = corrected;
        }
        best.map(|(_, judged)| judged)
    }

    /// The felt acceleration of every target, multiplied so that its wish is that of the first.
    fn list_felt_acceleration_of_each_target_scaled_to_first_wish(&self, motion: &WindowMotion) -> Vec<Vec<f64>> {
        let multiply = |(means, target): (&Vec<f64>, &TargetResponses)| {
            filter_50_us_means_to_felt_motion_at_16_khz(means).into_iter().map(|felt| target.factor * felt).collect()
        };
        motion.mean_acceleration.iter().zip(&self.targets).map(multiply).collect()
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
            let width_s = round_to_tick_s(
                find_window_width_for_force_fraction_s(own.charging, push.part).max(narrowest_window_s()),
            );
            let begin_s = round_to_tick_s(slot_begin_s(push.slot) + place_window_in_slot_s(own.charging, width_s));
            Some(ClickWindow {
                actuator: push.actuator,
                electrode: if push.is_positive { Electrode::A } else { Electrode::B },
                begin_s,
                width_s,
                voltage_v: rails.get(rail_index_of_channel(push.actuator)).copied()?,
            })
        };
        let windows: Vec<ClickWindow> = pushes.iter().filter_map(window).collect();
        self.build_click_of_windows_and_simulate_motion(windows, (saturated, lacks))
    }

    fn build_click_of_windows_and_simulate_motion(
        &self,
        windows: Vec<ClickWindow>,
        (saturated, lacks): (Vec<(usize, Limit)>, Lacks),
    ) -> BuiltClick {
        let motion = simulate_windows(self.table, self.poles, self.shapes, &windows);
        BuiltClick { windows, motion, saturated, lacks }
    }

    /// The same windows at voltages that make this part of the force.
    pub fn scale_window_voltages_of_built_click_to_force_fraction(&self, built: &BuiltClick, part: f64) -> BuiltClick {
        let mut windows = built.windows.clone();
        windows.iter_mut().for_each(|window| window.voltage_v = (window.voltage_v * part.sqrt()).floor());
        self.build_click_of_windows_and_simulate_motion(windows, (built.saturated.clone(), built.lacks))
    }

    /// The windows of a click, and the same again `after_s` later. If the second click, which begins while the first one still moves a mass, takes the
    /// mass too far, both are weakened, and the actuator of this mass is returned.
    pub fn repeat_click_within_travel_and_get_limiting_actuator(
        &self,
        built: &BuiltClick,
        after_s: f64,
    ) -> (BuiltClick, Option<usize>) {
        let move_later = |window: &ClickWindow| ClickWindow { begin_s: window.begin_s + after_s, ..*window };
        let windows = built.windows.iter().copied().chain(built.windows.iter().map(move_later)).collect();
        let both = self.build_click_of_windows_and_simulate_motion(windows, (built.saturated.clone(), built.lacks));
        match self.find_actuator_and_ratio_of_largest_travel_above_usable_travel(&both.motion) {
            Some((actuator, excess)) => {
                (self.scale_window_voltages_of_built_click_to_force_fraction(&both, 0.97 / excess), Some(actuator))
            }
            None => (both, None),
        }
    }

    /// The first one of two clicks, whose windows begin before `after_s`.
    pub fn keep_windows_of_first_click(&self, both: &BuiltClick, after_s: f64) -> BuiltClick {
        let windows = both.windows.iter().copied().filter(|window| window.begin_s < after_s).collect();
        self.build_click_of_windows_and_simulate_motion(windows, (both.saturated.clone(), both.lacks))
    }

    /// The actuator whose mass goes furthest beyond its limit, and by which factor, if any does.
    pub fn find_actuator_and_ratio_of_largest_travel_above_usable_travel(
        &self,
        motion: &WindowMotion,
    ) -> Option<(usize, f64)> {
        let excess =
            |(i, (travel_m, own)): (usize, (&f64, &Electrodes))| (i, travel_m / (USED_TRAVEL * own.max_travel_m()));
        let all = motion.travel_m.iter().zip(&self.table.electrodes).take(MAX_ACTUATORS).enumerate().map(excess);
        all.filter(|(_, excess)| *excess > 1.0).max_by(|a, b| a.1.total_cmp(&b.1))
    }
}

/// By which part a motion misses its bounds or its peak, at most.
fn worst_miss_relative_to_bounds_or_five_times_peak_shortfall(felt: &[f64], bounds: MotionBounds, peak: f64) -> f64 {
    let missed = |(sample, x): (usize, &f64)| {
        let allowed = if sample >= bounds.quiet_sample { bounds.after[0] } else { bounds.before[0] };
        x.abs() / (allowed * peak) - 1.0
    };
    let reached = felt.get(bounds.peak_sample).copied().unwrap_or(0.0) / peak;
    let counted = felt.iter().enumerate().take(LOOKED_AT).map(missed).fold(0.0, f64::max);
    counted.max(5.0 * (1.0 - reached))
}

/// The bounds of a peak at a time that is quiet from another one on; `None` if it would have to be quiet before.
fn motion_bounds_if_peak_precedes_quiet(peak_s: f64, quiet_s: f64, after: [f64; 2]) -> Option<MotionBounds> {
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
