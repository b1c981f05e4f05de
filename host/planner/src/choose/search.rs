//! The choice of frequencies: the best combination of all, and the proof that it is.
//!
//! With a dual variable on every target and every shared limit the problem falls apart into one for each actuator: what is left of
//! the cost is sum_i phi_i(f_i), phi_i the most that actuator i earns at a frequency at these dual variables. Whatever the
//! dual variables, no combination is better than what they say of all together (weak duality, `dual`), and the best sum over all
//! frequencies that keep their distance is a table ([`crate::choose::assignment`]).
//!
//! Where limits do not bind, the combination with the best sum at its own dual variables is the optimum, and a few rounds find it. Where
//! they do, `branch` divides the frequencies again and again: each part has a bound, at the dual variables that are best for it
//! (`mixture`), and parts whose bound is no better than the best combination known are done.

mod branch;
mod dual;
mod mixture;
#[cfg(test)]
mod tests;

use crate::choose::allocate::{ActuatorTerms, Allocation, DualVariables, allocate_forces};
use crate::request::SearchEffort;
use crate::scene::MAX_ACTUATORS;
use branch::BranchAndBound;

/// One actuator at one frequency with one pulse width.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Candidate {
    /// Index into the frequencies.
    pub node: usize,
    /// E of the cost E u^2 + P u of a force u: mean square elsewhere per N^2, for objectives that count it.
    pub energy: f64,
    /// P of that cost: power per N, for the objective that counts it.
    pub power: f64,
    /// Most force in N.
    pub max_force_n: f64,
    /// What the caller knows it by.
    pub tag: usize,
}

/// All candidates with the rows of the problem.
#[derive(Clone, Debug, Default)]
pub struct CandidateSet {
    /// Frequencies in Hz, ascending.
    pub frequencies_hz: Vec<f64>,
    /// Candidates of each actuator in ascending order of frequency; at most four actuators.
    pub candidates: Vec<Vec<Candidate>>,
    /// Of each actuator, candidate by candidate: what it adds to each target per N.
    pub gains: Vec<Vec<f64>>,
    /// Of each actuator, candidate by candidate: what it adds to each shared limit per N.
    pub loads: Vec<Vec<f64>>,
    /// What each target wants.
    pub wanted: Vec<f64>,
    /// What each shared limit allows.
    pub allowed: Vec<f64>,
    /// Least distance of two frequencies in Hz.
    pub spacing_hz: f64,
    /// How much may be looked at.
    pub work: SearchEffort,
    /// Whether energies are estimates: good enough to find what reaches most, not to tell its forces.
    pub is_estimated: bool,
}

/// The best combination.
#[derive(Clone, Debug, PartialEq)]
pub struct BestCombination {
    /// Index of each actuator's candidate.
    pub chosen: [usize; MAX_ACTUATORS],
    /// Its forces.
    pub allocation: Allocation,
    /// By which part of its cost, or of what it reaches, another combination could be better at most; 0 where it is
    /// proven to be the best.
    pub gap: f64,
    /// Where the wishes are not met: no combination meets more of them than this part.
    pub most: f64,
    /// Steps that it took ([`SearchEffort`]).
    pub steps: usize,
}

/// Whether two frequencies may be driven together, apart from their spacing.
pub type PairFilter<'a> = &'a dyn Fn(f64, f64) -> bool;

impl CandidateSet {
    /// The combination that meets the largest fraction of the wishes, and of those that meet as much the one with the
    /// least cost. `None` if no frequencies keep their spacing.
    #[must_use]
    pub fn find_best_combination_if_spacing_can_be_kept(
        &self,
        is_allowed_pair: PairFilter<'_>,
    ) -> Option<BestCombination> {
        self.find_best_combination_from_guess_if_spacing_can_be_kept(is_allowed_pair, None)
    }

    /// The same search, started with a combination that may be a good one.
    #[must_use]
    pub fn find_best_combination_from_guess_if_spacing_can_be_kept(
        &self,
        is_allowed_pair: PairFilter<'_>,
        first_guess: Option<[usize; MAX_ACTUATORS]>,
    ) -> Option<BestCombination> {
        BranchAndBound::new(self, is_allowed_pair).search_for_reach_then_cost(first_guess)
    }

    /// The best allocation by evaluating every combination, and the number of combinations: the reference for
    /// [`CandidateSet::find_best_combination_if_spacing_can_be_kept`] with short lists of frequencies.
    #[must_use]
    pub fn find_best_allocation_exhaustively_and_count_combinations(
        &self,
        is_allowed_pair: PairFilter<'_>,
    ) -> (Option<Allocation>, u64) {
        let (mut best, mut looked) = (None, 0);
        self.evaluate_all_combinations_and_keep_best(
            is_allowed_pair,
            &mut Vec::with_capacity(MAX_ACTUATORS),
            &mut best,
            &mut looked,
        );
        (best, looked)
    }

    fn evaluate_all_combinations_and_keep_best(
        &self,
        is_allowed_pair: PairFilter<'_>,
        chosen: &mut Vec<usize>,
        best: &mut Option<Allocation>,
        evaluated: &mut u64,
    ) {
        let i = chosen.len();
        if i == self.candidates.len() {
            *evaluated += 1;
            let found = self.allocate_combination(chosen);
            if best.as_ref().is_none_or(|best| meets_more_or_as_much_at_less_cost(&found, best)) {
                *best = Some(found);
            }
            return;
        }
        for index in 0..self.candidates[i].len() {
            if (0..i).all(|j| self.have_spaced_and_allowed_frequencies(is_allowed_pair, (i, index), (j, chosen[j]))) {
                chosen.push(index);
                self.evaluate_all_combinations_and_keep_best(is_allowed_pair, chosen, best, evaluated);
                chosen.pop();
            }
        }
    }

    /// The forces of one combination.
    #[must_use]
    pub fn allocate_combination(&self, candidate_indices: &[usize]) -> Allocation {
        const NOT_DRIVEN: ActuatorTerms<'_> =
            ActuatorTerms { energy: 0.0, power: 0.0, max_force_n: 0.0, gain: &[], load: &[] };
        let mut settings = [NOT_DRIVEN; MAX_ACTUATORS];
        let p = self.candidates.len();
        for (i, setting) in settings.iter_mut().enumerate().take(p) {
            *setting = self.candidate_terms(i, candidate_indices[i]);
        }
        allocate_forces(&settings[..p], &self.wanted, &self.allowed)
    }

    fn candidate_terms(&self, actuator: usize, index: usize) -> ActuatorTerms<'_> {
        let candidate = &self.candidates[actuator][index];
        let (t, c) = (self.wanted.len(), self.allowed.len());
        ActuatorTerms {
            energy: candidate.energy,
            power: candidate.power,
            max_force_n: candidate.max_force_n,
            gain: &self.gains[actuator][index * t..(index + 1) * t],
            load: &self.loads[actuator][index * c..(index + 1) * c],
        }
    }

    fn candidate_frequency_hz(&self, actuator: usize, candidate: usize) -> f64 {
        self.frequencies_hz[self.candidates[actuator][candidate].node]
    }

    /// Whether two candidates, each an actuator and an index, may be driven together.
    fn have_spaced_and_allowed_frequencies(
        &self,
        is_allowed_pair: PairFilter<'_>,
        a: (usize, usize),
        b: (usize, usize),
    ) -> bool {
        let (a, b) = (self.candidate_frequency_hz(a.0, a.1), self.candidate_frequency_hz(b.0, b.1));
        (a - b).abs() >= self.spacing_hz && is_allowed_pair(a, b)
    }

    /// The Lagrangian term of a candidate at the dual variables of an allocation.
    #[must_use]
    pub fn lagrangian_term_at_duals_of(&self, actuator: usize, candidate: usize, allocation: &Allocation) -> f64 {
        let kind = if allocation.met >= 1.0 { SearchGoal::Cost } else { SearchGoal::Reach };
        kind.find_max_lagrangian_term_and_force_n(&self.candidate_terms(actuator, candidate), &allocation.duals).0
    }
}

/// The goal of a search.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum SearchGoal {
    /// The most of what is wanted.
    Reach,
    /// The least cost with all of it.
    Cost,
}

impl SearchGoal {
    /// The largest Lagrangian term of a candidate at these dual variables, and the force in N at which it has it.
    fn find_max_lagrangian_term_and_force_n(self, candidate: &ActuatorTerms<'_>, duals: &DualVariables) -> (f64, f64) {
        let sum = |duals: &[f64], entries: &[f64]| duals.iter().zip(entries).map(|(a, b)| a * b).sum::<f64>();
        let pull = sum(&duals.gain, candidate.gain) - sum(&duals.load, candidate.load);
        self.find_max_lagrangian_term_and_force_n_for_value_per_n(
            candidate.energy,
            candidate.power,
            candidate.max_force_n,
            pull,
        )
    }

    /// The same for a candidate with the value `value_per_n` per newton at the dual variables.
    fn find_max_lagrangian_term_and_force_n_for_value_per_n(
        self,
        energy: f64,
        power: f64,
        max_force_n: f64,
        value_per_n: f64,
    ) -> (f64, f64) {
        let value_per_n = if self == SearchGoal::Cost { value_per_n - power } else { value_per_n };
        if value_per_n <= 0.0 {
            (0.0, 0.0)
        } else if self == SearchGoal::Reach || value_per_n >= 2.0 * energy * max_force_n {
            let energy = if self == SearchGoal::Cost { energy } else { 0.0 };
            ((value_per_n - energy * max_force_n) * max_force_n, max_force_n)
        } else {
            (value_per_n * value_per_n / (4.0 * energy), value_per_n / (2.0 * energy))
        }
    }

    /// The value of an allocation, the larger the better: the fraction of the wishes that it meets, or minus its
    /// cost; minus infinity if it does not meet what is required.
    fn value_to_maximise_or_minus_infinity_if_wishes_unmet(self, allocation: &Allocation) -> f64 {
        match self {
            SearchGoal::Reach => allocation.met,
            SearchGoal::Cost if allocation.met >= 1.0 => -allocation.cost,
            SearchGoal::Cost => f64::NEG_INFINITY,
        }
    }
}

/// Whether `candidate` meets more than `other`, or as much at a lower cost.
#[must_use]
pub fn meets_more_or_as_much_at_less_cost(candidate: &Allocation, other: &Allocation) -> bool {
    // Relative: what is far beyond reach is met in a small part by all.
    const AS_MUCH: f64 = 1e-9;
    candidate.met > other.met * (1.0 + AS_MUCH)
        || candidate.met >= other.met * (1.0 - AS_MUCH) && candidate.cost < other.cost
}
