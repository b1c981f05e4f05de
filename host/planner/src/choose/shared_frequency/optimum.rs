//! One frequency, solved: least energy for a peak of 1, or most peak.

use super::barrier::{Objective, solve};
use super::program::Program;
use super::{Phasors, ZERO};
use crate::scene::MAX_ACTUATORS;

/// Relative gap between value and bound at which the least energy counts as found.
const ENERGY_TOLERANCE: f64 = 1e-11;
/// The same for the most peak, of which a part of 1e-9 is given up (`REACH_SLACK`).
const PEAK_TOLERANCE: f64 = 1e-13;
/// Part of the way from the demanded peak to the most peak that is far enough inside to start from.
const INSIDE: f64 = 0.2;

/// A solved frequency.
#[derive(Clone, Copy, Debug)]
pub(super) struct Optimum {
    /// Phasors in parts of their limits.
    pub(super) x: Phasors,
    /// What is minimised: the energy, or minus the peak.
    pub(super) cost: f64,
    /// No phasors cost less.
    pub(super) bound: f64,
}

/// Least energy for a peak of 1 if no limit binds.
pub(super) fn within_limits(program: &Program) -> Option<Optimum> {
    let direction = program.unlimited();
    let scale = program.peak(&direction).recip();
    let x = direction.map(|x| x * scale);
    (scale.is_finite() && program.allows(&x)).then_some(Optimum { x, cost: scale, bound: scale })
}

/// Least energy for a peak of 1 where limits bind; `None` if there is no such peak, or proof that it takes `limit` or more.
pub(super) fn least_energy(program: &Program, limit: f64) -> Option<Optimum> {
    if program.most_peak() <= 1.0 {
        return None;
    }
    // Inside, or a proof that there is no inside.
    let inside = solve(program, Objective::MostPeak, &[ZERO; MAX_ACTUATORS], PEAK_TOLERANCE, |value, bound| {
        -bound <= 1.0 || -value - 1.0 > INSIDE * (-bound - 1.0)
    });
    if program.peak(&inside.x) <= 1.0 {
        return None;
    }
    let solution = solve(program, Objective::LeastEnergy, &inside.x, ENERGY_TOLERANCE, |_, bound| bound >= limit);
    if solution.bound >= limit {
        return None;
    }
    // The point is inside: a peak above 1 is brought back to it.
    let scale = program.peak(&solution.x).recip();
    let x = solution.x.map(|x| x * scale);
    Some(Optimum { x, cost: program.energy_of(&x), bound: solution.bound })
}

/// Most peak within the limits; as good as it gets unless it is proven to cost `limit` or more before.
pub(super) fn most_peak(program: &Program, limit: f64) -> Optimum {
    if !(0..MAX_ACTUATORS).any(|row| program.may_travel_too_far(row)) {
        // Every actuator at its limit, all in phase at the target.
        let x = program.gain.map(|gain| if gain == ZERO { ZERO } else { gain.conj() / gain.norm() });
        let cost = -program.most_peak();
        return Optimum { x, cost, bound: cost };
    }
    let solution =
        solve(program, Objective::MostPeak, &[ZERO; MAX_ACTUATORS], PEAK_TOLERANCE, |_, bound| bound >= limit);
    Optimum { x: solution.x, cost: -program.peak(&solution.x), bound: solution.bound }
}
