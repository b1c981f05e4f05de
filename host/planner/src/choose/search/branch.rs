//! Branch and bound over the frequencies.

use super::dual::{LagrangianBound, SearchRegion};
use super::mixture::{self, Column, Mixture};
use super::{BestCombination, CandidateSet, PairFilter, SearchGoal, meets_more_or_as_much_at_less_cost};
use crate::choose::allocate::{Allocation, DualVariables};
use crate::scene::MAX_ACTUATORS;

/// What is nearer than this to the best, as a part of it, is as good.
const AS_GOOD: f64 = 1e-10;
/// Part of the wishes that is nothing: a millionth of what wishes count at most over what can be reached at all.
const NEGLIGIBLE_FRACTION: f64 = 1e-12;
/// Bounds of all combinations together, at most, before they are divided, and those of a part.
const FIRST_ROUNDS: usize = 30;
const PART_ROUNDS: usize = 6;
/// Rounds in which the dual variables of a combination's own forces are tried: where no limit binds they prove it to be the best.
const OWN_DUALS: usize = 3;
/// Part of its distance from what is known within which a bound may stay of the least that it can become.
const NEAR_LEAST: f64 = 0.1;
/// Columns kept of a mixture besides those in use.
const MOST_COLUMNS: usize = 48;
/// Combinations of a part that are looked at one by one.
const FEW: usize = 12;
/// Other frequencies of one actuator that are tried around a combination.
const TRIED: usize = 4;
/// Rounds for which a mixture is looked for that does all that is asked for.
const FEASIBLE_ROUNDS: usize = 8;
/// Part of a wish that may be missing by rounding.
const MISSING: f64 = 1e-9;

/// A part of the set of all combinations.
struct Subproblem {
    /// No combination of it is worth more.
    bound: f64,
    space: SearchRegion,
    columns: Vec<Column>,
    /// Of the bound.
    duals: DualVariables,
}

/// The state of a search.
pub struct BranchAndBound<'a> {
    choices: &'a CandidateSet,
    fits: PairFilter<'a>,
    kind: SearchGoal,
    best: Option<([usize; MAX_ACTUATORS], Allocation)>,
    /// Whether other frequencies have been tried around the best.
    is_polished: bool,
    /// What is counted against the most of them; of the reach, half of it at most is left for the cost.
    steps: usize,
    /// All of them.
    taken: usize,
    /// No combination is worth more.
    bound: f64,
    most_steps: usize,
}

impl<'a> BranchAndBound<'a> {
    pub fn new(choices: &'a CandidateSet, fits: PairFilter<'a>) -> Self {
        let most_steps = choices.work.max_search_steps(choices.candidates.iter().map(Vec::len).sum());
        Self {
            choices,
            fits,
            kind: SearchGoal::Cost,
            best: None,
            is_polished: false,
            steps: 0,
            taken: 0,
            bound: f64::INFINITY,
            most_steps,
        }
    }

    /// Finds the largest fraction of the wishes that can be met, then the least cost.
    pub fn search_for_reach_then_cost(
        mut self,
        first_combination: Option<[usize; MAX_ACTUATORS]>,
    ) -> Option<BestCombination> {
        if let Some(first_combination) = first_combination {
            self.allocate_and_count_combination_keeping_it_if_allowed_and_best(&first_combination);
        }
        let whole = SearchRegion::with_all_candidates(self.choices);
        let first = LagrangianBound::evaluate_over_region_if_frequency_spacing_can_be_kept(
            self.choices,
            &whole,
            &self.duals_at_which_one_actuator_meets_wishes(),
            SearchGoal::Cost,
        )?;
        let allocation = self.allocate_and_count_combination_keeping_it_if_allowed_and_best(&first.choice);
        let mut duals = allocation.duals.clone();
        if self.best.as_ref().is_none_or(|(_, best)| best.met < 1.0) {
            self.kind = SearchGoal::Reach;
            let gap = self.search_present_goal_and_return_relative_gap((allocation.met < 1.0).then_some(duals));
            let (chosen, allocation) = self.best.as_ref()?;
            if allocation.met < 1.0 {
                let (chosen, allocation, most) = (*chosen, allocation.clone(), self.bound.min(1.0));
                return Some(BestCombination { chosen, allocation, gap, most, steps: self.taken });
            }
            duals = allocation.duals.clone();
            self.kind = SearchGoal::Cost;
        }
        let gap = self.search_present_goal_and_return_relative_gap(Some(duals));
        let (chosen, allocation) = self.best?;
        Some(BestCombination { chosen, allocation, gap, most: 1.0, steps: self.taken })
    }

    /// Dual variables at which some actuator alone would just meet the wishes, without limits.
    fn duals_at_which_one_actuator_meets_wishes(&self) -> DualVariables {
        let choices = self.choices;
        let targets = choices.wanted.len();
        let dual = |t: usize| {
            let mut sum = 0.0;
            let mut least = f64::INFINITY;
            for (candidates, gains) in choices.candidates.iter().zip(&choices.gains) {
                let mut best = 0.0_f64;
                for (candidate, gains) in candidates.iter().zip(gains.chunks(targets)) {
                    let gain = gains[t];
                    if candidate.energy > 0.0 {
                        best = best.max(gain * gain / candidate.energy);
                    }
                    if gain > 0.0 {
                        least = least.min(candidate.power / gain);
                    }
                }
                sum += best;
            }
            let energy = if sum > 0.0 { 2.0 * choices.wanted[t] / sum } else { 0.0 };
            // A hair above, so that what earns nothing else does not hide the one that earns.
            let power = if least.is_finite() { least * (1.0 + 1e-9) } else { 0.0 };
            #[expect(clippy::cast_precision_loss, reason = "some hundred targets")]
            let share = 1.0 / targets as f64;
            (energy + power).max(f64::MIN_POSITIVE) * share
        };
        DualVariables { gain: (0..targets).map(dual).collect(), load: vec![0.0; choices.allowed.len()] }
    }

    /// Counts one step against the budget.
    const fn count_search_step(&mut self) {
        self.steps += 1;
        self.taken += 1;
    }

    /// Allocates the forces of a combination, and keeps it if it is the best one that is allowed.
    fn allocate_and_count_combination_keeping_it_if_allowed_and_best(
        &mut self,
        candidate_indices: &[usize; MAX_ACTUATORS],
    ) -> Allocation {
        self.count_search_step();
        let allocation = self.choices.allocate_combination(candidate_indices);
        let fits = self.is_allowed_combination(candidate_indices);
        if fits && self.best.as_ref().is_none_or(|(_, best)| meets_more_or_as_much_at_less_cost(&allocation, best)) {
            if self.best.is_none() {
                // A long way to the first one leaves some for better ones.
                self.steps = self.steps.min(self.most_steps / 2);
            }
            self.best = Some((*candidate_indices, allocation.clone()));
            self.is_polished = false;
        }
        allocation
    }

    fn is_allowed_combination(&self, candidate_indices: &[usize; MAX_ACTUATORS]) -> bool {
        let p = self.choices.candidates.len();
        (0..p).all(|i| {
            (0..i).all(|j| {
                self.choices.have_spaced_and_allowed_frequencies(
                    self.fits,
                    (i, candidate_indices[i]),
                    (j, candidate_indices[j]),
                )
            })
        })
    }

    /// The value up to which a bound excludes a subproblem: the best known value plus the tolerance.
    fn pruning_threshold(&self) -> f64 {
        let worth = self
            .best
            .as_ref()
            .map_or(f64::NEG_INFINITY, |(_, best)| self.kind.value_to_maximise_or_minus_infinity_if_wishes_unmet(best));
        match self.kind {
            _ if !worth.is_finite() => worth,
            SearchGoal::Reach => worth + AS_GOOD * worth + NEGLIGIBLE_FRACTION,
            SearchGoal::Cost => worth + AS_GOOD * worth.abs(),
        }
    }

    /// Whether the goal is the reach and all wishes are met.
    fn is_reach_goal_with_wishes_met(&self) -> bool {
        self.kind == SearchGoal::Reach && self.best.as_ref().is_some_and(|(_, best)| best.met >= 1.0)
    }

    /// Whether the budget of steps is used up. It never is before a combination is known that may be driven.
    const fn is_combination_known_and_step_budget_spent(&self) -> bool {
        self.best.is_some() && self.steps >= self.most_steps
    }

    /// The relative gap by which a combination could be better than the best known, if no combination is worth more
    /// than `upper_bound`.
    fn relative_optimality_gap(&self, upper_bound: f64) -> f64 {
        let Some((_, best)) = self.best.as_ref().filter(|_| upper_bound > self.pruning_threshold()) else { return 0.0 };
        match self.kind {
            SearchGoal::Reach => upper_bound.min(1.0) / best.met.max(NEGLIGIBLE_FRACTION) - 1.0,
            SearchGoal::Cost => ((best.cost + upper_bound) / best.cost).min(1.0),
        }
    }

    /// Finds the best combination for the present goal; returns the optimality gap.
    fn search_present_goal_and_return_relative_gap(&mut self, duals: Option<DualVariables>) -> f64 {
        // What the reach took, half of it at most, is not missing for the cost.
        self.steps = (self.steps / 2).min(self.most_steps / 2);
        let targets = self.choices.wanted.len();
        // Of what reaches nothing known, any that make all that is asked for cost one.
        let sum: f64 = self.choices.wanted.iter().sum();
        let duals = duals.unwrap_or_else(|| DualVariables {
            gain: vec![1.0 / sum; targets],
            load: vec![0.0; self.choices.allowed.len()],
        });
        let mut whole = Subproblem {
            bound: f64::INFINITY,
            space: SearchRegion::with_all_candidates(self.choices),
            columns: Vec::new(),
            duals,
        };
        if let Some((chosen, allocation)) = &self.best {
            for (i, force_n) in allocation.forces_n.iter().enumerate().take(self.choices.candidates.len()) {
                mixture::add_column_and_is_new(&mut whole.columns, i, chosen[i], *force_n);
            }
        }
        self.bound =
            if self.tighten_bound_trying_combinations_and_can_still_improve(&mut whole, FIRST_ROUNDS, OWN_DUALS) {
                self.search_by_branching_and_return_value_bound(whole)
            } else {
                self.pruning_threshold()
            };
        self.relative_optimality_gap(self.bound)
    }

    /// Divides the subproblem with the most promising bound until none is better than the best known value; returns a
    /// bound on the value of all combinations.
    fn search_by_branching_and_return_value_bound(&mut self, whole: Subproblem) -> f64 {
        let mut open = vec![whole];
        loop {
            let most = (0..open.len()).max_by(|a, b| open[*a].bound.total_cmp(&open[*b].bound));
            let Some(part) = most.map(|at| open.swap_remove(at)) else { return self.pruning_threshold() };
            if self.is_reach_goal_with_wishes_met() || part.bound <= self.pruning_threshold() {
                return self.pruning_threshold();
            }
            if self.is_combination_known_and_step_budget_spent() {
                return part.bound;
            }
            for mut half in split_candidate_frequencies_of_most_mixed_actuator(part) {
                if half.space.count_combinations() <= FEW {
                    self.evaluate_every_combination_of_region(&half.space);
                } else if self.tighten_bound_trying_combinations_and_can_still_improve(&mut half, PART_ROUNDS, 0) {
                    open.push(half);
                }
            }
        }
    }

    /// Evaluates every combination of a subproblem.
    fn evaluate_every_combination_of_region(&mut self, space: &SearchRegion) {
        let mut at = [0; MAX_ACTUATORS];
        loop {
            let mut chosen = [0; MAX_ACTUATORS];
            for ((chosen, list), at) in chosen.iter_mut().zip(&space.lists).zip(&at) {
                let Some(candidate) = list.get(*at) else { return };
                *chosen = *candidate;
            }
            if self.is_allowed_combination(&chosen) {
                self.allocate_and_count_combination_keeping_it_if_allowed_and_best(&chosen);
            }
            // The next, as an odometer counts.
            let mut places = at.iter_mut().zip(&space.lists);
            loop {
                let Some((at, list)) = places.next() else { return };
                *at += 1;
                if *at < list.len() {
                    break;
                }
                *at = 0;
            }
        }
    }

    /// Improves the dual variables of a subproblem and removes candidates that cannot be better than the best known
    /// combination, which improves on the way. Returns whether anything remains. The dual variables of the
    /// combination found are tried first, `rounds_at_best_duals` times.
    fn tighten_bound_trying_combinations_and_can_still_improve(
        &mut self,
        subproblem: &mut Subproblem,
        rounds: usize,
        rounds_at_best_duals: usize,
    ) -> bool {
        let mut next = subproblem.duals.clone();
        for round in 0..rounds {
            if self.is_combination_known_and_step_budget_spent() {
                break;
            }
            self.count_search_step();
            let found = LagrangianBound::evaluate_over_region_if_frequency_spacing_can_be_kept(
                self.choices,
                &subproblem.space,
                &next,
                self.kind,
            );
            let Some(found) = found else { return false };
            let is_better = found.bound < subproblem.bound;
            if is_better {
                subproblem.bound = found.bound;
                subproblem.duals.clone_from(&next);
            }
            let allocation = self.allocate_and_count_combination_keeping_it_if_allowed_and_best(&found.choice);
            if self.is_reach_goal_with_wishes_met() || subproblem.bound <= self.pruning_threshold() {
                return false;
            }
            if round > 0 && !self.is_polished {
                self.improve_best_combination_locally();
                if self.is_reach_goal_with_wishes_met() || subproblem.bound <= self.pruning_threshold() {
                    return false;
                }
            }
            let is_new = self.add_columns_and_is_any_new(subproblem, &found, Some((&found.choice, &allocation)));
            found.remove_candidates_that_cannot_exceed(&mut subproblem.space, self.pruning_threshold());
            if subproblem.space.is_empty() {
                return false;
            }
            subproblem.columns.retain(|column| subproblem.space.contains_candidate(column.actuator, column.candidate));
            // The dual variables are those of the reach where not all is met.
            let has_duals = (self.kind == SearchGoal::Reach) == (allocation.met < 1.0);
            if round < rounds_at_best_duals && has_duals && allocation.duals != next {
                next = allocation.duals;
                continue;
            }
            if !is_new && !is_better {
                break;
            }
            let Ok(mixture) = self.find_best_mixture_if_known_or_prove_infeasible(subproblem) else { return false };
            let Some(mixture) = mixture else { break };
            self.evaluate_combination_of_largest_shares(subproblem, &found.choice);
            // Once it is near what it can become, only a division helps, unless it can become no better than what is known.
            let (enough, least) = (self.pruning_threshold(), mixture.worth);
            if least > enough && subproblem.bound - least <= NEAR_LEAST * (subproblem.bound - enough) {
                break;
            }
            next = if is_better { mixture.duals } else { mean_of_dual_variables(&subproblem.duals, &mixture.duals) };
        }
        !subproblem.space.is_empty()
    }

    /// Evaluates the combination of the columns with the largest shares in the mixture of a subproblem.
    fn evaluate_combination_of_largest_shares(&mut self, subproblem: &Subproblem, fallback: &[usize; MAX_ACTUATORS]) {
        let mut chosen = *fallback;
        for (i, chosen) in chosen.iter_mut().enumerate().take(self.choices.candidates.len()) {
            let own = subproblem.columns.iter().filter(|column| column.actuator == i && column.share > 0.0);
            let largest = own.max_by(|a, b| a.share.total_cmp(&b.share));
            *chosen = largest.map_or(*chosen, |column| column.candidate);
        }
        if chosen != *fallback && self.is_allowed_combination(&chosen) {
            self.allocate_and_count_combination_keeping_it_if_allowed_and_best(&chosen);
        }
    }

    /// Adds the columns with the largest Lagrangian terms of `found`, and a combination with its forces; returns
    /// whether any column is new.
    fn add_columns_and_is_any_new(
        &self,
        subproblem: &mut Subproblem,
        found: &LagrangianBound,
        known: Option<(&[usize; MAX_ACTUATORS], &Allocation)>,
    ) -> bool {
        let mut is_new = false;
        let Subproblem { space, columns, .. } = subproblem;
        for i in 0..self.choices.candidates.len() {
            for candidate in [None, Some(found.choice[i])] {
                if let Some((candidate, force_n)) = found.candidate_and_force_n_if_in_region(space, i, candidate) {
                    is_new |= mixture::add_column_and_is_new(columns, i, candidate, force_n);
                }
            }
            if let Some((chosen, allocation)) = known {
                is_new |= mixture::add_column_and_is_new(columns, i, chosen[i], allocation.forces_n[i]);
            }
        }
        is_new
    }

    /// The best mixture of a subproblem; an error if nothing in it can meet the wishes, `None` if that is not known.
    fn find_best_mixture_if_known_or_prove_infeasible(
        &mut self,
        subproblem: &mut Subproblem,
    ) -> Result<Option<Mixture>, ()> {
        if subproblem.columns.len() > MOST_COLUMNS {
            subproblem.columns.retain(|column| column.share > 0.0);
        }
        for _ in 0..FEASIBLE_ROUNDS {
            self.count_search_step();
            let Some(mixture) =
                mixture::set_best_mixture_shares_if_anything_reached(self.choices, &mut subproblem.columns, self.kind)
            else {
                return Ok(None);
            };
            if self.kind == SearchGoal::Reach || mixture.met >= 1.0 - MISSING {
                return Ok(Some(mixture));
            }
            let found = LagrangianBound::evaluate_over_region_if_frequency_spacing_can_be_kept(
                self.choices,
                &subproblem.space,
                &mixture.duals,
                SearchGoal::Reach,
            )
            .ok_or(())?;
            if found.bound < 1.0 - MISSING {
                return Err(());
            }
            if !self.add_columns_and_is_any_new(subproblem, &found, None) {
                return Ok(None);
            }
        }
        Ok(None)
    }

    /// Tries other frequencies for one actuator at a time around the best combination, those with larger Lagrangian
    /// terms at its dual variables: no others can be better.
    fn improve_best_combination_locally(&mut self) {
        while !self.is_polished
            && !self.is_combination_known_and_step_budget_spent()
            && !self.is_reach_goal_with_wishes_met()
        {
            self.is_polished = true;
            let Some((chosen, allocation)) = self.best.clone() else { return };
            let choices = self.choices;
            for i in 0..choices.candidates.len() {
                let own = choices.lagrangian_term_at_duals_of(i, chosen[i], &allocation);
                let earned = (0..choices.candidates[i].len())
                    .map(|index| (choices.lagrangian_term_at_duals_of(i, index, &allocation), index));
                let mut other = chosen;
                let mut earned: Vec<(f64, usize)> = earned
                    .filter(|(earned, index)| {
                        other[i] = *index;
                        *earned > own * (1.0 + AS_GOOD) && self.is_allowed_combination(&other)
                    })
                    .collect();
                earned.sort_by(|a, b| b.0.total_cmp(&a.0));
                for (_, index) in earned.into_iter().take(TRIED) {
                    other[i] = index;
                    self.allocate_and_count_combination_keeping_it_if_allowed_and_best(&other);
                }
            }
        }
    }
}

/// Splits a subproblem in two between frequencies that one actuator has in its best mixture.
fn split_candidate_frequencies_of_most_mixed_actuator(subproblem: Subproblem) -> [Subproblem; 2] {
    let mut most = (0.0, 0, 0);
    let mut longest = 0;
    for (i, list) in subproblem.space.lists.iter().enumerate() {
        if list.len() > subproblem.space.lists[longest].len() {
            longest = i;
        }
        let place = |column: &Column| list.binary_search(&column.candidate).ok().map(|at| (at, column.share));
        let shared = subproblem.columns.iter().filter(|column| column.actuator == i && column.share > 0.0);
        let places: Vec<(usize, f64)> = shared.filter_map(place).collect();
        let sum: f64 = places.iter().map(|(_, share)| share).sum();
        let (Some(low), Some(high)) = (places.iter().map(|(at, _)| *at).min(), places.iter().map(|(at, _)| *at).max())
        else {
            continue;
        };
        #[expect(clippy::cast_precision_loss, reason = "places in a list of some hundred")]
        let at = |place: usize| place as f64;
        let mean = places.iter().map(|(place, share)| at(*place) * share).sum::<f64>() / sum;
        let spread: f64 = places.iter().map(|(place, share)| (at(*place) - mean).abs() * share).sum();
        if high > low && spread > most.0 {
            #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a place in the list")]
            let cut = (mean.floor() as usize + 1).clamp(low + 1, high);
            most = (spread, i, cut);
        }
    }
    let (_, actuator, cut) = most;
    // A mixture of one combination that is not the best one known, or may not be: in the middle of the longest list.
    let (actuator, cut) = if cut > 0 { (actuator, cut) } else { (longest, subproblem.space.lists[longest].len() / 2) };
    [true, false].map(|is_lower| {
        let mut space = subproblem.space.clone();
        let list = &mut space.lists[actuator];
        if is_lower {
            list.truncate(cut);
        } else {
            list.drain(..cut);
        }
        let columns =
            subproblem.columns.iter().filter(|column| space.contains_candidate(column.actuator, column.candidate));
        Subproblem {
            bound: subproblem.bound,
            columns: columns.copied().collect(),
            space,
            duals: subproblem.duals.clone(),
        }
    })
}

/// The mean of two sets of dual variables.
fn mean_of_dual_variables(a: &DualVariables, b: &DualVariables) -> DualVariables {
    let mean = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| 0.5 * (a + b)).collect();
    DualVariables { gain: mean(&a.gain, &b.gain), load: mean(&a.load, &b.load) }
}
