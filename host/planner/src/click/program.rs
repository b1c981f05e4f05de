//! Linear programmes over forces in slots, with the bounds on the motion added where they are broken.
//!
//! The motion is bounded at each of some thousand samples on several panels, of which a few dozen matter: a programme begins with those that
//! mattered before, is solved, and gets those bounds that its solution breaks most, until none is broken by more than [`BROKEN`].

use super::dual_simplex::{BoundedVariable, DualSimplex};
use super::slots::SlotResponses;

/// Part of a bound by which it may be broken.
const BROKEN: f64 = 0.01;
/// Most bounds that are added at once.
const MOST_ADDED: usize = 16;
/// Most times that bounds are added.
const MOST_ROUNDS: usize = 40;
/// Samples at which the motion is bounded: 300 ms.
pub const LOOKED_AT: usize = 1200;
/// What a force costs at least, as a part of the largest cost: forces that cost nothing would be exchanged for each other without end.
const LEAST_COST: f64 = 1e-5;

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

/// A bound on a target's motion at a sample, from above (`sign` 1) or below (-1).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SampleBound {
    target: usize,
    panel: usize,
    sample: usize,
    sign: f64,
}

/// A solution.
#[derive(Clone, Debug)]
pub struct SolvedForces {
    /// The bounds that keep it from less cost.
    pub tight: Vec<SampleBound>,
    /// Of each force.
    pub values: Vec<f64>,
    /// The peak as a part of what is asked for, or the part by which bounds are missed.
    pub goal: f64,
}

/// How a target of a click moves.
#[derive(Clone, Copy, Debug)]
pub struct TargetResponses<'a> {
    /// On the panel, and on those off it.
    pub panels: &'a [SlotResponses],
    /// What its acceleration is multiplied by in the programme, so that its wish is that of the first target.
    pub factor: f64,
    /// Its acceleration so multiplied, in m/s^2, sample by sample and the same on every panel, that is there besides; may be empty.
    pub besides: &'a [f64],
}

impl TargetResponses<'_> {
    /// The same without the panels that are off.
    pub fn with_nominal_panel_only(&self) -> Self {
        Self { panels: self.panels.get(..1).unwrap_or(&[]), ..*self }
    }

    /// What is there besides at a sample, in m/s^2.
    fn added_acceleration_at_sample_m_per_s2(&self, sample: usize) -> f64 {
        self.besides.get(sample).copied().unwrap_or(0.0)
    }
}

/// The programme: the same peak at all targets, at the same time.
#[derive(Clone, Debug)]
pub struct ForceProgram<'a> {
    /// At least one.
    pub targets: Vec<TargetResponses<'a>>,
    /// What it chooses.
    pub forces: Vec<SlotForce>,
    /// The bounds.
    pub bounds: MotionBounds,
    /// The peak asked for in m/s^2.
    pub asked: f64,
    /// Bounds to begin with.
    pub first: &'a [SampleBound],
}

impl ForceProgram<'_> {
    /// The forces of least cost that make the peak, or the largest part of it that they can make.
    #[must_use]
    pub fn find_least_forces_for_peak_or_largest_reachable_part(&self) -> Option<SolvedForces> {
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
    pub fn find_forces_exceeding_bounds_least_at_peak_fraction(&self, peak: f64) -> Option<SolvedForces> {
        self.solve(Goal::Excess { peak })
    }

    /// Felt acceleration of a target on a panel, as a part of what is asked for, sample by sample.
    #[must_use]
    pub fn acceleration_of_target_divided_by_asked_peak(
        &self,
        target: &TargetResponses,
        panel: usize,
        values: &[f64],
    ) -> Vec<f64> {
        let Some(responses) = target.panels.get(panel) else { return Vec::new() };
        let mut motion: Vec<f64> =
            (0..LOOKED_AT).map(|sample| target.added_acceleration_at_sample_m_per_s2(sample) / self.asked).collect();
        for (force, value) in self.forces.iter().zip(values).filter(|(_, value)| **value != 0.0) {
            let part = target.factor * force.force_n * value / self.asked;
            let per_n = responses.acceleration_record_per_n_over_slot(force.actuator, force.slot);
            motion.iter_mut().zip(per_n).for_each(|(motion, per_n)| *motion += part * per_n);
        }
        motion
    }

    fn solve(&self, goal: Goal) -> Option<SolvedForces> {
        let peak_sample = self.bounds.peak_sample;
        let (first, others) = self.targets.split_first()?;
        let of_peak = self.list_coefficients(first, 0, peak_sample, 1.0);
        let besides = first.added_acceleration_at_sample_m_per_s2(peak_sample) / self.asked;
        // No forces within their bounds make more.
        let reachable: f64 = self
            .forces
            .iter()
            .zip(&of_peak)
            .map(|(force, part)| (part * force.bounds.0).max(part * force.bounds.1).max(0.0))
            .sum();
        let goal_variable = match goal {
            Goal::Peak { cost, largest } => {
                BoundedVariable { lower: 0.0, upper: largest.min(reachable + besides.max(0.0)), cost }
            }
            Goal::Excess { .. } => BoundedVariable { lower: 0.0, upper: f64::INFINITY, cost: 1.0 },
        };
        let least_cost = LEAST_COST * self.forces.iter().fold(goal_variable.cost.abs(), |most, own| most.max(own.cost));
        let choose = |(place, force): (usize, &SlotForce)| {
            #[expect(clippy::cast_precision_loss, reason = "some hundred forces")]
            let own = 1.0 + place as f64 / self.forces.len() as f64;
            BoundedVariable { lower: force.bounds.0, upper: force.bounds.1, cost: force.cost + least_cost * own }
        };
        let mut variables: Vec<BoundedVariable> = self.forces.iter().enumerate().map(choose).collect();
        variables.push(goal_variable);
        let mut simplex = DualSimplex::new(variables);
        match goal {
            Goal::Peak { .. } => {
                let row: Vec<f64> = of_peak.into_iter().chain([-1.0]).collect();
                simplex.add_row(&row, -besides, true);
            }
            Goal::Excess { peak } => {
                let row: Vec<f64> = of_peak.into_iter().map(|part| -part).chain([-0.2 * peak]).collect();
                simplex.add_row(&row, besides - peak, false);
            }
        }
        for other in others {
            // -motion <= besides - peak.
            let (of_goal, limit) = match goal {
                Goal::Peak { .. } => (1.0, 0.0),
                Goal::Excess { peak } => (-0.2 * peak, -peak),
            };
            let row: Vec<f64> =
                self.list_coefficients(other, 0, peak_sample, -1.0).into_iter().chain([of_goal]).collect();
            simplex.add_row(&row, limit + other.added_acceleration_at_sample_m_per_s2(peak_sample) / self.asked, false);
        }
        let mut added = self.first.to_vec();
        added.iter().for_each(|bound| self.add_bound(&mut simplex, *bound, goal));
        for _ in 0..MOST_ROUNDS {
            if !simplex.minimise() {
                return None;
            }
            let (reached, values) = simplex.values().split_last()?;
            let scale = match goal {
                Goal::Peak { .. } => *reached,
                Goal::Excess { peak } => peak * (1.0 + reached),
            };
            let mut broken = self.list_locally_most_exceeded_bounds_with_excess(values, scale);
            if broken.is_empty() {
                let is_tight = |(row, _): &(usize, &SampleBound)| simplex.is_row_tight(row + self.targets.len());
                let tight = added.iter().enumerate().filter(is_tight).map(|(_, bound)| *bound).collect();
                return Some(SolvedForces { values: values.to_vec(), goal: *reached, tight });
            }
            broken.sort_by(|a, b| b.0.total_cmp(&a.0));
            for (_, bound) in broken.into_iter().take(MOST_ADDED) {
                self.add_bound(&mut simplex, bound, goal);
                added.push(bound);
            }
        }
        None
    }

    /// What each force adds to a target's motion at a sample, times `sign`.
    fn list_coefficients(&self, target: &TargetResponses, panel: usize, sample: usize, sign: f64) -> Vec<f64> {
        let Some(responses) = target.panels.get(panel) else { return Vec::new() };
        let add = |force: &SlotForce| {
            let per_n = responses.acceleration_record_per_n_over_slot(force.actuator, force.slot).get(sample);
            sign * target.factor * force.force_n * per_n.copied().unwrap_or(0.0) / self.asked
        };
        self.forces.iter().map(add).collect()
    }

    /// sign (motion + besides) <= allowed (peak or 1 + excess).
    fn add_bound(&self, simplex: &mut DualSimplex, bound: SampleBound, goal: Goal) {
        let SampleBound { target, panel, sample, sign } = bound;
        let Some(target) = self.targets.get(target) else { return };
        let allowed = self.bounds.allowed_fraction(panel, sample);
        let (of_goal, limit) = match goal {
            Goal::Peak { .. } => (-allowed, 0.0),
            Goal::Excess { peak } => (-allowed * peak, allowed * peak),
        };
        let row: Vec<f64> = self.list_coefficients(target, panel, sample, sign).into_iter().chain([of_goal]).collect();
        simplex.add_row(&row, limit - sign * target.added_acceleration_at_sample_m_per_s2(sample) / self.asked, false);
    }

    /// The bounds that are broken most in their neighbourhood, if the peak is `scale`, and by how much.
    fn list_locally_most_exceeded_bounds_with_excess(&self, values: &[f64], scale: f64) -> Vec<(f64, SampleBound)> {
        let mut broken = Vec::new();
        let numbered = self.targets.iter().enumerate();
        for (target, own, panel) in
            numbered.flat_map(|(i, own)| (0..own.panels.len()).map(move |panel| (i, own, panel)))
        {
            let motion = self.acceleration_of_target_divided_by_asked_peak(own, panel, values);
            let excess = |sample: usize| {
                let allowed = self.bounds.allowed_fraction(panel, sample);
                motion.get(sample).map_or(f64::NEG_INFINITY, |motion| motion.abs() / allowed - scale)
            };
            let slack = BROKEN * scale.max(1e-6);
            let is_crest = |sample: &usize| {
                let own = excess(*sample);
                own > slack && own >= excess(sample.wrapping_sub(1)) && own >= excess(sample + 1)
            };
            broken.extend((0..LOOKED_AT).filter(is_crest).map(|sample| {
                let sign = motion.get(sample).map_or(1.0, |motion| motion.signum());
                (excess(sample), SampleBound { target, panel, sample, sign })
            }));
        }
        broken
    }
}
