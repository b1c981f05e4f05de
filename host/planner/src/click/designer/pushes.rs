//! Forces of slots: the least ones for a peak, fewer of them, and corrected ones.

use super::ClickDesigner;
use crate::click::program::{ForceProgram, MotionBounds, SampleBound, SlotForce, SolvedForces, TargetResponses};
use crate::click::slots::SLOT_SAMPLES;
use crate::physics::limits::Limit;
use era_shared::supply::{RAILS, rail_index_of_channel};

/// Part of the peak that is as good as all of it.
pub(super) const WHOLE: f64 = 0.999;
/// Part of an actuator's force that is all of it.
const FULL: f64 = 0.95;
/// How many times as much force as needed windows may have.
const SPARE_FORCE: f64 = 1.7;
/// Times that slots are made dearer that have little force.
const REWEIGHTED: usize = 2;
/// Least peak in m/s^2 that counts as a motion: a ten-thousandth of what is felt at best.
const MOVED: f64 = 1e-6;

/// Forces of slots.
#[derive(Clone)]
pub(super) struct ChosenPushes {
    pub(super) pushes: Vec<SlotPush>,
    /// The bounds that they keep, and those of them that keep them from less.
    pub(super) bounds: MotionBounds,
    pub(super) tight: Vec<SampleBound>,
    /// The largest force that they may have, as a part of the full one.
    pub(super) scale: f64,
    /// The largest peak in m/s^2 within the bounds.
    pub(super) strongest: f64,
    /// The peak in m/s^2 that they are for, and the part of it that they make.
    pub(super) reachable: f64,
    pub(super) peak: f64,
    /// Their peak as a part of what is asked for.
    pub(super) reached: f64,
}

/// A force of a slot that becomes a window: as a part of the actuator's full one at its rail's voltage.
#[derive(Clone, Copy, Debug)]
pub(super) struct SlotPush {
    pub(super) actuator: usize,
    pub(super) slot: usize,
    pub(super) is_positive: bool,
    pub(super) part: f64,
}

impl ClickDesigner<'_> {
    /// Forces of slots in parts of each actuator's full one, and the peak as a part of what is asked for. They come from forces that are not
    /// much larger than needed, so that windows are wide.
    pub(super) fn choose_least_force_pushes_for_asked_or_largest_reachable_peak(
        &self,
        asked: f64,
        bounds: Option<MotionBounds>,
    ) -> Option<ChosenPushes> {
        let bounds = bounds?;
        // In m/s^2: a programme whose peak is small beside what is asked for has no digits left.
        let (_, strongest) =
            self.solve_least_forces_or_largest_peak_within_bounds(1.0, bounds, 1.0, |_, _| 1.0, &[], true)?;
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
        self.choose_pushes_of_least_force_for_reachable_peak(
            asked,
            bounds,
            (asked.min(strongest_peak), strongest_peak),
            &strongest.tight,
        )
    }

    /// The least pushes for a peak of `reachable` m/s^2, of which `strongest` is the largest within the bounds.
    pub(super) fn choose_pushes_of_least_force_for_reachable_peak(
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
        let (pushes, solved) =
            self.solve_least_forces_or_largest_peak_within_bounds(reachable, bounds, scale, |_, _| 1.0, first, false)?;
        let (tight, peak) = (solved.tight, solved.goal);
        let reached = peak * reachable / asked;
        Some(ChosenPushes { pushes, tight, bounds, scale, strongest, reachable, peak, reached })
    }

    /// The same peak from few slots, so that none is too weak for a window.
    pub(super) fn choose_fewer_pushes(&self, mut chosen: ChosenPushes) -> ChosenPushes {
        for _ in 0..REWEIGHTED {
            let ChosenPushes { pushes, tight, bounds, scale, reachable, peak, .. } = &chosen;
            let is_weak = |push: &SlotPush| {
                self.actuators.get(push.actuator).is_some_and(|own| push.part < own.least_part * scale)
            };
            // Where all force is needed there is none to move to other slots.
            if *peak < WHOLE || pushes.len() <= self.options.max_windows_of_each_click() && !pushes.iter().any(is_weak)
            {
                break;
            }
            let cost = |actuator: usize, slot: usize| {
                let own = pushes.iter().find(|push| push.actuator == actuator && push.slot == slot);
                1.0 / (own.map_or(0.0, |own| own.part) / scale + 0.1)
            };
            let again =
                self.solve_least_forces_or_largest_peak_within_bounds(*reachable, *bounds, *scale, cost, tight, false);
            let Some((pushes, solved)) = again.filter(|(_, solved)| solved.goal >= peak * WHOLE) else { break };
            chosen = ChosenPushes { pushes, tight: solved.tight, peak: solved.goal, ..chosen };
        }
        chosen
    }

    /// Actuators that a click uses in full, with what keeps them from more; all of those that have a force if none is.
    pub(super) fn list_limiting_actuators_and_limits_at_full_force_else_of_all_used(
        &self,
        pushes: &[SlotPush],
    ) -> Vec<(usize, Limit)> {
        let uses = |least: f64| -> Vec<(usize, Limit)> {
            let used = |actuator: usize| pushes.iter().any(|push| push.actuator == actuator && push.part >= least);
            let own = self.actuators.iter().enumerate().filter(|(actuator, _)| used(*actuator));
            own.map(|(_, own)| (own.limited_by, own.limit)).collect()
        };
        let full = uses(FULL);
        if full.is_empty() { uses(0.0) } else { full }
    }

    /// Solves for forces up to `scale` of the full ones, at these costs of slots: the least, or, with `largest`, those of the largest peak.
    pub(super) fn solve_least_forces_or_largest_peak_within_bounds(
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
            self.targets.iter().map(TargetResponses::with_nominal_panel_only).collect()
        } else {
            self.targets.clone()
        };
        let program = ForceProgram { targets, forces, bounds, asked, first };
        let solved = if largest {
            program.find_largest_peak()?
        } else {
            program.find_least_forces_for_peak_or_largest_reachable_part()?
        };
        let pushes = program.forces.iter().zip(&solved.values).filter(|(_, value)| **value > 1e-6);
        let pushes = pushes.map(|(force, value)| SlotPush {
            actuator: force.actuator,
            slot: force.slot,
            is_positive: force.force_n > 0.0,
            part: *value * scale,
        });
        Some((pushes.collect(), solved))
    }

    /// The parts of the pushes at which the bounds are missed least, given what windows make of the present ones.
    pub(super) fn correct_pushes_and_get_tight_bounds(
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
            let motion = linear.acceleration_of_target_divided_by_asked_peak(target, 0, &values);
            motion.into_iter().zip(felt).map(|(linear, felt)| felt - linear * asked).collect()
        };
        let besides: Vec<Vec<f64>> = self.targets.iter().zip(felt).map(subtract).collect();
        let targets =
            self.targets.iter().zip(&besides).map(|(own, besides)| TargetResponses { besides, ..*own }).collect();
        let program = ForceProgram { targets, ..linear };
        let solved = program.find_forces_exceeding_bounds_least_at_peak_fraction(peak)?;
        let corrected =
            pushes.iter().zip(solved.values).map(|(push, part)| SlotPush { part: part.clamp(0.0, 1.0), ..*push });
        Some((corrected.collect(), solved.tight))
    }
}
