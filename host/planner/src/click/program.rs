//! Linear programmes over forces in slots, with the bounds on the motion added where they are broken.
//!
//! The motion is bounded at each of some thousand samples on several panels, of which a few dozen matter: a programme begins with a few,
//! is solved, and gets those bounds that its solution breaks most, until none is broken by more than [`BROKEN`].

use super::slots::SlotResponses;
use microlp::{ComparisonOp, LinearExpr, OptimizationDirection, Problem, Variable};
use std::time::Duration;

/// Part of a bound by which it may be broken.
const BROKEN: f64 = 0.01;
/// Most bounds that are added at once.
const MOST_ADDED: usize = 16;
/// Most times that bounds are added.
const MOST_ROUNDS: usize = 40;
/// Longest time for one solution; some ms are usual.
const LONGEST: Duration = Duration::from_secs(2);
/// Samples at which the motion is bounded: 300 ms.
pub const LOOKED_AT: usize = 1200;
/// Samples between those bounds that a programme begins with.
const FIRST_STRIDE: usize = 8;

/// A force that a programme chooses: its value times `force_n` over a slot of an actuator.
#[derive(Clone, Copy, Debug)]
pub struct SlotForce {
    /// Index of the actuator.
    pub actuator: usize,
    /// The slot.
    pub slot: usize,
    /// Force in N of the value 1; its sign is that of the force.
    pub force_n: f64,
    /// Least and largest value.
    pub bounds: (f64, f64),
    /// Cost per value.
    pub cost: f64,
}

/// Bounds on the motion.
#[derive(Clone, Copy, Debug)]
pub struct MotionBounds {
    /// Sample at which the peak comes.
    pub peak_sample: usize,
    /// First sample at which it is to be quiet.
    pub quiet_sample: usize,
    /// Part of the peak allowed before that, on the panel and on those off it.
    pub before: [f64; 2],
    /// The same from then on.
    pub after: [f64; 2],
}

impl MotionBounds {
    fn allowed_fraction(&self, panel: usize, sample: usize) -> f64 {
        let [own, off] = if sample >= self.quiet_sample { self.after } else { self.before };
        if panel == 0 { own } else { off }
    }
}

/// The variable beside the forces.
#[derive(Clone, Copy, Debug)]
enum Goal {
    /// The peak as a part of what is asked for (or in m/s^2, if nothing is), at a cost and up to a value: all bounds are parts of it.
    Peak { cost: f64, largest: f64 },
    /// By which part all bounds, and the peak by a fifth of it, may be missed; the peak is given.
    Excess { peak: f64 },
}

/// A solution.
#[derive(Clone, Debug)]
pub struct SolvedForces {
    /// Of each force.
    pub values: Vec<f64>,
    /// The peak as a part of what is asked for, or the part by which bounds are missed.
    pub goal: f64,
}

/// The programme.
#[derive(Clone, Debug)]
pub struct ForceProgram<'a> {
    /// The panel, and those off it.
    pub panels: &'a [SlotResponses],
    /// What it chooses.
    pub forces: Vec<SlotForce>,
    /// The bounds.
    pub bounds: MotionBounds,
    /// The peak asked for in m/s^2.
    pub asked: f64,
    /// Acceleration in m/s^2, sample by sample on every panel, that is there besides; may be empty.
    pub besides: &'a [f64],
}

impl ForceProgram<'_> {
    /// The forces of least cost that make the peak, or the largest part of it that they can make.
    #[must_use]
    pub fn find_least_forces_for_peak(&self) -> Option<SolvedForces> {
        /// A thousandth of the peak is worth one slot at full force.
        const WORTH: f64 = 1000.0;
        self.solve(Goal::Peak { cost: -WORTH, largest: 1.0 })
    }

    /// The forces of the largest peak, in parts of what is asked for.
    #[must_use]
    pub fn find_largest_peak(&self) -> Option<SolvedForces> {
        self.solve(Goal::Peak { cost: -1.0, largest: f64::INFINITY })
    }

    /// The forces that miss the bounds least at this part of the peak.
    #[must_use]
    pub fn find_forces_with_least_excess(&self, peak: f64) -> Option<SolvedForces> {
        self.solve(Goal::Excess { peak })
    }

    /// Felt acceleration of a panel, as a part of what is asked for, sample by sample.
    #[must_use]
    pub fn motion_of_panel(&self, panel: usize, values: &[f64]) -> Vec<f64> {
        let Some(responses) = self.panels.get(panel) else { return Vec::new() };
        let mut motion: Vec<f64> =
            (0..LOOKED_AT).map(|sample| self.besides.get(sample).copied().unwrap_or(0.0) / self.asked).collect();
        for (force, value) in self.forces.iter().zip(values).filter(|(_, value)| **value != 0.0) {
            let part = force.force_n * value / self.asked;
            for (sample, motion) in motion.iter_mut().enumerate() {
                *motion += part * responses.acceleration_per_n(force.actuator, force.slot, sample);
            }
        }
        motion
    }

    fn solve(&self, goal: Goal) -> Option<SolvedForces> {
        let mut problem = Problem::new(OptimizationDirection::Minimize);
        problem.set_time_limit(LONGEST);
        let variables: Vec<Variable> =
            self.forces.iter().map(|force| problem.add_var(force.cost, force.bounds)).collect();
        let goal_variable = match goal {
            Goal::Peak { cost, largest } => problem.add_var(cost, (0.0, largest)),
            Goal::Excess { .. } => problem.add_var(1.0, (0.0, f64::INFINITY)),
        };
        let row = |panel: usize, sample: usize, sign: f64, goal_part: f64| {
            let mut row = LinearExpr::empty();
            if let Some(responses) = self.panels.get(panel) {
                for (force, variable) in self.forces.iter().zip(&variables) {
                    let per_n = responses.acceleration_per_n(force.actuator, force.slot, sample);
                    let part = sign * force.force_n * per_n / self.asked;
                    if part.abs() > 1e-12 {
                        row.add(*variable, part);
                    }
                }
            }
            row.add(goal_variable, goal_part);
            row
        };
        let besides = |sample: usize| self.besides.get(sample).copied().unwrap_or(0.0) / self.asked;
        // sign (motion + besides) <= allowed (peak or 1 + excess).
        let bound = |panel: usize, sample: usize, sign: f64| {
            let allowed = self.bounds.allowed_fraction(panel, sample);
            match goal {
                Goal::Peak { .. } => (row(panel, sample, sign, -allowed), -sign * besides(sample)),
                Goal::Excess { peak } => {
                    (row(panel, sample, sign, -allowed * peak), allowed * peak - sign * besides(sample))
                }
            }
        };
        let peak_sample = self.bounds.peak_sample;
        match goal {
            Goal::Peak { .. } => {
                problem.add_constraint(row(0, peak_sample, 1.0, -1.0), ComparisonOp::Eq, -besides(peak_sample));
            }
            Goal::Excess { peak } => {
                let missed = row(0, peak_sample, 1.0, 0.2 * peak);
                problem.add_constraint(missed, ComparisonOp::Ge, peak - besides(peak_sample));
            }
        }
        for sample in (0..self.bounds.quiet_sample + 200).step_by(FIRST_STRIDE) {
            for sign in [1.0, -1.0] {
                let (row, limit) = bound(0, sample, sign);
                problem.add_constraint(row, ComparisonOp::Le, limit);
            }
        }
        let mut solution = problem.solve().ok()?.into_solution().ok()?;
        for _ in 0..MOST_ROUNDS {
            let values: Vec<f64> = variables.iter().map(|variable| solution.var_value(*variable)).collect();
            let reached = solution.var_value(goal_variable);
            let scale = match goal {
                Goal::Peak { .. } => reached,
                Goal::Excess { peak } => peak * (1.0 + reached),
            };
            let mut broken = self.list_broken_bounds(&values, scale);
            if broken.is_empty() {
                return Some(SolvedForces { values, goal: reached });
            }
            broken.sort_by(|a, b| b.excess.total_cmp(&a.excess));
            for BrokenBound { panel, sample, sign, .. } in broken.into_iter().take(MOST_ADDED) {
                let (row, limit) = bound(panel, sample, sign);
                solution = solution.add_constraint(row, ComparisonOp::Le, limit).ok()?.into_solution().ok()?;
            }
        }
        None
    }

    /// The bounds that are broken most in their neighbourhood, if the peak is `scale`.
    fn list_broken_bounds(&self, values: &[f64], scale: f64) -> Vec<BrokenBound> {
        let mut broken = Vec::new();
        for panel in 0..self.panels.len() {
            let motion = self.motion_of_panel(panel, values);
            let excess = |sample: usize| {
                let allowed = self.bounds.allowed_fraction(panel, sample);
                motion.get(sample).map_or(f64::NEG_INFINITY, |motion| motion.abs() / allowed - scale)
            };
            let slack = BROKEN * scale.max(1e-6);
            let is_crest = |sample: &usize| {
                let own = excess(*sample);
                own > slack && own >= excess(sample.wrapping_sub(1)) && own >= excess(sample + 1)
            };
            broken.extend((0..LOOKED_AT).filter(is_crest).map(|sample| BrokenBound {
                panel,
                sample,
                sign: motion.get(sample).map_or(1.0, |motion| motion.signum()),
                excess: excess(sample),
            }));
        }
        broken
    }
}

struct BrokenBound {
    panel: usize,
    sample: usize,
    sign: f64,
    excess: f64,
}
