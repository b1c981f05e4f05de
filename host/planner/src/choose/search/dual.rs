//! What no combination can beat, at given dual variables.
//!
//! With lambda on the targets a and mu on the limits b, every combination reaches at most mu . b + sum_i phi_i with
//! phi_i = max(0, pull_i) U_i and lambda . a = 1, and costs at least lambda . a - mu . b - sum_i phi_i with
//! phi_i = max over 0 <= u <= U_i of (pull_i - P_i) u - E_i u^2; pull_i = lambda . h_i - mu . r_i.

use super::{CandidateSet, SearchGoal};
use crate::choose::allocate::DualVariables;
use crate::choose::assignment::{Assignment, count_frequencies_below_each_with_spacing};
use crate::scene::MAX_ACTUATORS;

/// Rounding of a bound, as a part of the sums that it is the difference of.
const ROUNDING: f64 = 1e-14;

/// A part of the set of all combinations: for each actuator the candidates that remain, in ascending order.
#[derive(Clone, Debug)]
pub struct SearchRegion {
    pub lists: Vec<Vec<usize>>,
}

impl SearchRegion {
    /// The region of all combinations.
    pub fn with_all_candidates(choices: &CandidateSet) -> Self {
        Self { lists: choices.candidates.iter().map(|list| (0..list.len()).collect()).collect() }
    }

    /// Number of combinations, whether they keep their spacing or not; saturates for very many.
    pub fn count_combinations(&self) -> usize {
        self.lists.iter().fold(1, |product, list| product.saturating_mul(list.len()))
    }

    pub fn is_empty(&self) -> bool {
        self.lists.iter().any(Vec::is_empty)
    }

    pub fn contains_candidate(&self, actuator: usize, candidate: usize) -> bool {
        self.lists.get(actuator).is_some_and(|list| list.binary_search(&candidate).is_ok())
    }
}

/// The Lagrangian bound of a region at given dual variables.
#[derive(Clone, Debug)]
pub struct LagrangianBound {
    /// No combination is worth more.
    pub bound: f64,
    /// The one with the best sum.
    pub choice: [usize; MAX_ACTUATORS],
    /// Of each actuator's candidates what they earn, and with which force, list by list.
    earned: Vec<Vec<(f64, f64)>>,
    /// Of each actuator what all others earn at best, and the rest of the bound.
    others: [f64; MAX_ACTUATORS],
}

impl LagrangianBound {
    /// Evaluates the bound; `None` if no frequencies of the region keep their spacing.
    pub fn evaluate_over_region_if_frequency_spacing_can_be_kept(
        choices: &CandidateSet,
        region: &SearchRegion,
        duals: &DualVariables,
        goal: SearchGoal,
    ) -> Option<Self> {
        let p = region.lists.len();
        let (targets, limits) = (choices.wanted.len(), choices.allowed.len());
        let some = |duals: &[f64]| -> Vec<(usize, f64)> {
            duals.iter().copied().enumerate().filter(|(_, dual)| *dual != 0.0).collect()
        };
        let (gain, load) = (some(&duals.gain), some(&duals.load));
        // The frequencies in use.
        let mut place = vec![usize::MAX; choices.frequencies_hz.len()];
        for (list, candidates) in region.lists.iter().zip(&choices.candidates) {
            list.iter().for_each(|index| place[candidates[*index].node] = 0);
        }
        let mut hz = Vec::with_capacity(place.len());
        for (place, own) in place.iter_mut().zip(&choices.frequencies_hz).filter(|(place, _)| **place == 0) {
            *place = hz.len();
            hz.push(*own);
        }
        let f = hz.len();
        let mut value = vec![f64::NEG_INFINITY; p * f];
        let mut at = vec![usize::MAX; p * f];
        let mut earned: Vec<Vec<(f64, f64)>> = Vec::with_capacity(p);
        for (i, list) in region.lists.iter().enumerate() {
            let (gains, loads) = (&choices.gains[i], &choices.loads[i]);
            let own = list.iter().map(|index| {
                let candidate = &choices.candidates[i][*index];
                let pull: f64 = gain.iter().map(|(t, dual)| dual * gains[index * targets + t]).sum();
                let push: f64 = load.iter().map(|(c, dual)| dual * loads[index * limits + c]).sum();
                let earns = goal.find_max_lagrangian_term_and_force_n_for_value_per_n(
                    candidate.energy,
                    candidate.power,
                    candidate.max_force_n,
                    pull - push,
                );
                let place = i * f + place[candidate.node];
                if earns.0 > value[place] {
                    (value[place], at[place]) = (earns.0, *index);
                }
                earns
            });
            earned.push(own.collect());
        }
        let lags = count_frequencies_below_each_with_spacing(&hz, choices.spacing_hz);
        let mut sums = Assignment::default();
        sums.fill_best_sums_of_actuator_sets(p, value, &lags);
        let nodes = sums.best_frequency_of_each_actuator_if_spacing_can_be_kept(&lags)?;
        let mut choice = [0; MAX_ACTUATORS];
        for i in 0..p {
            choice[i] = at[i * f + nodes[i]];
        }
        let sum = |duals: &[(usize, f64)], of: &[f64]| duals.iter().map(|(row, dual)| dual * of[*row]).sum::<f64>();
        let (asked, allowed) = (sum(&gain, &choices.wanted), sum(&load, &choices.allowed));
        let asked = if goal == SearchGoal::Cost { asked } else { 0.0 };
        let constant = allowed - asked + ROUNDING * (allowed + asked + sums.best_sum_of_all_actuators());
        let all = (1 << p) - 1;
        let mut others = [0.0; MAX_ACTUATORS];
        for (i, others) in others.iter_mut().enumerate().take(p) {
            *others = constant + sums.best_sum_over_first_frequencies(all & !(1 << i), f);
        }
        Some(Self { bound: constant + sums.best_sum_of_all_actuators(), choice, earned, others })
    }

    /// Removes the candidates that are in no combination worth more than `value`.
    pub fn remove_candidates_that_cannot_exceed(&self, region: &mut SearchRegion, value: f64) {
        for ((list, earned), others) in region.lists.iter_mut().zip(&self.earned).zip(&self.others) {
            let mut of = earned.iter();
            list.retain(|_| of.next().is_some_and(|(earns, _)| others + earns > value));
        }
    }

    /// `candidate_or_best_if_none` of an actuator, the candidate with the largest Lagrangian term if that is `None`, with its force in N;
    /// `None` if it is not in `region`, which is the region that was evaluated.
    pub fn candidate_and_force_n_if_in_region(
        &self,
        region: &SearchRegion,
        actuator: usize,
        candidate_or_best_if_none: Option<usize>,
    ) -> Option<(usize, f64)> {
        let (list, earned) = (region.lists.get(actuator)?, self.earned.get(actuator)?);
        let place = match candidate_or_best_if_none {
            Some(candidate) => list.binary_search(&candidate).ok()?,
            None => (0..earned.len()).max_by(|a, b| earned[*a].0.total_cmp(&earned[*b].0))?,
        };
        Some((list[place], earned[place].1))
    }
}
