//! The frequencies and forces with the largest minimum over points, proven.
//!
//! Every point is a target of [`crate::choose::search`], all with the same wish, and so large a one that it is out of reach: the part of
//! it that all get at most is the largest minimum. Few points matter. The search begins with some; where what it finds is weaker at another
//! point than at these, that one joins them (a cutting plane). What is best for some of the points bounds what is best for all.

use super::space::ReachSpace;
use crate::MIN_SPACING_HZ;
use crate::choose::search::{Candidate, CandidateSet};
use crate::request::SearchEffort;
use crate::scene::MAX_ACTUATORS;

/// Relative difference of minima that counts as none.
const EQUAL_VALUES: f64 = 1e-9;
/// Points to begin with.
const FIRST_POINTS: usize = 6;
/// Points that may join them. Some ten are usual.
const MOST_ADDED: usize = 200;
/// The wish, in parts of the sum of the largest gains.
const BEYOND: f64 = 2.0;

/// The combination of frequencies and forces with the largest minimum over points.
#[derive(Clone, Debug, PartialEq)]
pub struct MaxMinCombination {
    /// Frequency of each actuator, as an index.
    pub choice: Vec<usize>,
    /// Part of full force of each.
    pub parts: Vec<f64>,
    /// Least gain over the points.
    pub least: f64,
    /// No choice has more than this; `least` unless the search ended before that was proven.
    pub upper: f64,
    /// Steps of the searches that it took ([`SearchEffort`]): of each round at most as many as of all together.
    pub steps: usize,
}

/// The combination with the largest minimum gain over `points`. `first_guess` is a good combination, if one is known. `None`
/// if no frequencies keep their spacing, or without points.
#[must_use]
pub fn find_frequencies_with_largest_least_gain_if_spacing_possible(
    space: &ReachSpace,
    points: &[usize],
    allowed_effort: SearchEffort,
    first_guess: Option<&[usize]>,
) -> Option<MaxMinCombination> {
    if points.is_empty() || space.count_actuators() == 0 {
        return None;
    }
    let step = points.len().div_ceil(FIRST_POINTS);
    let mut active: Vec<usize> = points.iter().copied().step_by(step).collect();
    let mut first_guess: Option<Vec<usize>> = first_guess.map(<[usize]>::to_vec);
    let mut best: Option<MaxMinCombination> = None;
    let mut upper = f64::INFINITY;
    let mut steps = 0;
    // With little work as long as points join.
    let mut effort = SearchEffort::Touch;
    for _ in 0..MOST_ADDED {
        let (choices, unit) = build_candidate_set_and_unreachable_common_target_peak(space, &active, effort);
        let known = first_guess.as_ref().and_then(|first_guess| find_candidate_of_each_actuator(&choices, first_guess));
        let found = choices.find_best_combination_from_guess_if_spacing_can_be_kept(&|_, _| true, known)?;
        upper = upper.min(found.most * unit);
        steps += found.steps;
        let at = |i: usize| choices.candidates[i][found.chosen[i]].tag;
        let choice: Vec<usize> = (0..space.count_actuators()).map(at).collect();
        let parts: Vec<f64> = found.allocation.forces_n.iter().take(choice.len()).copied().collect();
        let peaks = points.iter().map(|x| (space.peak_at_point(*x, &choice, &parts), *x));
        let (least, worst) = peaks.min_by(|a, b| a.0.total_cmp(&b.0))?;
        first_guess = Some(choice.clone());
        if best.as_ref().is_none_or(|best| least > best.least) {
            best = Some(MaxMinCombination { choice, parts, least, upper, steps });
        }
        if best.as_ref().is_some_and(|best| upper <= best.least * (1.0 + EQUAL_VALUES)) {
            break;
        }
        if effort == allowed_effort
            && (active.contains(&worst)
                || steps >= allowed_effort.max_search_steps(count_candidates_of_all_actuators(&choices)))
        {
            break;
        }
        if active.contains(&worst) {
            effort = allowed_effort;
        } else {
            active.push(worst);
        }
    }
    let best = best?;
    let is_proven = upper <= best.least * (1.0 + EQUAL_VALUES);
    Some(MaxMinCombination { upper: if is_proven { best.least } else { upper }, steps, ..best })
}

/// The candidates at these points, with forces as fractions of full force, and the wish that all points have.
fn build_candidate_set_and_unreachable_common_target_peak(
    space: &ReachSpace,
    points: &[usize],
    allowed_effort: SearchEffort,
) -> (CandidateSet, f64) {
    let p = space.count_actuators().min(MAX_ACTUATORS);
    let mut choices = CandidateSet {
        frequencies_hz: space.frequencies_hz.clone(),
        candidates: vec![Vec::new(); p],
        gains: vec![Vec::new(); p],
        loads: vec![Vec::new(); p],
        allowed: vec![1.0; space.limits],
        spacing_hz: MIN_SPACING_HZ - 1e-9,
        work: allowed_effort,
        ..CandidateSet::default()
    };
    let mut unit = 0.0;
    for i in 0..p {
        let mut largest = 0.0_f64;
        for frequency in space.usable_frequency_indices(i) {
            let gains = space.weighted_acceleration_at_full_force_at_each_point(i, frequency);
            let own = points.iter().map(|x| f64::from(gains[*x]));
            largest = largest.max(own.clone().fold(0.0, f64::max));
            choices.gains[i].extend(own);
            choices.loads[i].extend_from_slice(space.usage_fraction_of_each_limit_at_max_force(i, frequency));
            let candidate = Candidate { node: frequency, energy: 0.0, power: 0.0, max_force_n: 1.0, tag: frequency };
            choices.candidates[i].push(candidate);
        }
        unit += largest;
    }
    let unit = if unit > 0.0 { BEYOND * unit } else { 1.0 };
    choices.wanted = vec![unit; points.len()];
    (choices, unit)
}

/// Total number of candidates.
fn count_candidates_of_all_actuators(choices: &CandidateSet) -> usize {
    choices.candidates.iter().map(Vec::len).sum()
}

/// For each actuator the index of the candidate with the given frequency; `None` if one is missing.
fn find_candidate_of_each_actuator(choices: &CandidateSet, frequencies: &[usize]) -> Option<[usize; MAX_ACTUATORS]> {
    let mut chosen = [0; MAX_ACTUATORS];
    for ((chosen, list), frequency) in chosen.iter_mut().zip(&choices.candidates).zip(frequencies) {
        *chosen = list.binary_search_by_key(frequency, |candidate| candidate.node).ok()?;
    }
    Some(chosen)
}
