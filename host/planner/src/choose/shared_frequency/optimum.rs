//! One frequency, solved: least energy for a peak of 1, or most peak.

use super::barrier::{Objective, solve_by_barrier};
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
pub(super) fn find_least_energy_for_unit_peak_if_no_limit_binds(program: &Program) -> Option<Optimum> {
    let direction = program.optimal_direction_without_limits();
    let scale = program.real_part_of_peak_at_target(&direction).recip();
    let x = direction.map(|x| x * scale);
    (scale.is_finite() && program.is_within_force_and_travel_limits(&x)).then_some(Optimum {
        x,
        cost: scale,
        bound: scale,
    })
}

/// Least energy for a peak of 1 where limits bind; `None` if there is no such peak, or proof that it takes `cost_limit` or more.
pub(super) fn minimise_energy_for_unit_peak_if_reachable_below_cost_limit(
    program: &Program,
    cost_limit: f64,
) -> Option<Optimum> {
    if program.max_peak_without_travel_limits() <= 1.0 {
        return None;
    }
    // Inside, or a proof that there is no inside.
    let inside =
        solve_by_barrier(program, Objective::MostPeak, &[ZERO; MAX_ACTUATORS], PEAK_TOLERANCE, |value, bound| {
            -bound <= 1.0 || -value - 1.0 > INSIDE * (-bound - 1.0)
        });
    if program.real_part_of_peak_at_target(&inside.x) <= 1.0 {
        return None;
    }
    let solution =
        solve_by_barrier(program, Objective::LeastEnergy, &inside.x, ENERGY_TOLERANCE, |_, bound| bound >= cost_limit);
    if solution.bound >= cost_limit {
        return None;
    }
    // The point is inside: a peak above 1 is brought back to it.
    let scale = program.real_part_of_peak_at_target(&solution.x).recip();
    let x = solution.x.map(|x| x * scale);
    Some(Optimum { x, cost: program.energy_of_phasors(&x), bound: solution.bound })
}

/// Most peak within the limits; as good as it gets unless it is proven to cost `cost_limit` or more before.
pub(super) fn maximise_peak_until_proven_no_better_than_known(program: &Program, cost_limit: f64) -> Optimum {
    if !(0..MAX_ACTUATORS).any(|row| program.can_reach_travel_limit(row)) {
        // Every actuator at its limit, all in phase at the target.
        let x = program.gain.map(|gain| if gain == ZERO { ZERO } else { gain.conj() / gain.norm() });
        let cost = -program.max_peak_without_travel_limits();
        return Optimum { x, cost, bound: cost };
    }
    let solution =
        solve_by_barrier(program, Objective::MostPeak, &[ZERO; MAX_ACTUATORS], PEAK_TOLERANCE, |_, bound| {
            bound >= cost_limit
        });
    Optimum { x: solution.x, cost: -program.real_part_of_peak_at_target(&solution.x), bound: solution.bound }
}
