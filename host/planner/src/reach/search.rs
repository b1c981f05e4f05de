//! The frequencies and forces with the largest minimum over points, proven.
//!
//! Every point is a target of [`crate::choose::search`], all with the same wish, and so large a one that it is out of reach: the part of
//! it that all get at most is the largest minimum. Few points matter. The search begins with some; where what it finds is weaker at another
//! point than at these, that one joins them (a cutting plane). What is best for some of the points bounds what is best for all.

use super::space::Space;
use crate::MIN_SPACING_HZ;
use crate::choose::search::{Candidate, Choices};
use crate::request::Work;
use crate::scene::MAX_ACTUATORS;

/// Relative difference of minima that counts as none.
const EQUAL_VALUES: f64 = 1e-9;
/// Points to begin with.
const FIRST_POINTS: usize = 6;
/// Points that may join them. Some ten are usual.
const MOST_ADDED: usize = 200;
/// The wish, in parts of the sum of the largest gains.
const BEYOND: f64 = 2.0;

/// The best choice.
#[derive(Clone, Debug, PartialEq)]
pub struct Best {
    /// Frequency of each actuator, as an index.
    pub choice: Vec<usize>,
    /// Part of full force of each.
    pub parts: Vec<f64>,
    /// Least gain over the points.
    pub least: f64,
    /// No choice has more than this; `least` unless the search ended before that was proven.
    pub upper: f64,
    /// Steps of the searches that it took ([`Work`]): of each round at most as many as of all together.
    pub steps: usize,
}

/// The choice with the largest least gain over `points`. `hint` is a good one, if known. `None` if no frequencies keep
/// their distance, or without points.
#[must_use]
pub fn best(space: &Space, points: &[usize], work: Work, hint: Option<&[usize]>) -> Option<Best> {
    if points.is_empty() || space.actuators() == 0 {
        return None;
    }
    let step = points.len().div_ceil(FIRST_POINTS);
    let mut active: Vec<usize> = points.iter().copied().step_by(step).collect();
    let mut hint: Option<Vec<usize>> = hint.map(<[usize]>::to_vec);
    let mut best: Option<Best> = None;
    let mut upper = f64::INFINITY;
    let mut steps = 0;
    // With little work as long as points join.
    let mut effort = Work::Touch;
    for _ in 0..MOST_ADDED {
        let (choices, unit) = choices(space, &active, effort);
        let known = hint.as_ref().and_then(|hint| index_of(&choices, hint));
        let found = choices.best_from(&|_, _| true, known)?;
        upper = upper.min(found.most * unit);
        steps += found.steps;
        let at = |i: usize| choices.candidates[i][found.chosen[i]].tag;
        let choice: Vec<usize> = (0..space.actuators()).map(at).collect();
        let parts: Vec<f64> = found.allocation.forces_n.iter().take(choice.len()).copied().collect();
        let peaks = points.iter().map(|x| (space.peak(*x, &choice, &parts), *x));
        let (least, worst) = peaks.min_by(|a, b| a.0.total_cmp(&b.0))?;
        hint = Some(choice.clone());
        if best.as_ref().is_none_or(|best| least > best.least) {
            best = Some(Best { choice, parts, least, upper, steps });
        }
        if best.as_ref().is_some_and(|best| upper <= best.least * (1.0 + EQUAL_VALUES)) {
            break;
        }
        if effort == work && (active.contains(&worst) || steps >= work.steps(candidates(&choices))) {
            break;
        }
        if active.contains(&worst) {
            effort = work;
        } else {
            active.push(worst);
        }
    }
    let best = best?;
    let is_proven = upper <= best.least * (1.0 + EQUAL_VALUES);
    Some(Best { upper: if is_proven { best.least } else { upper }, steps, ..best })
}

/// What may be chosen, forces in parts of full force, and the wish at each of the points.
fn choices(space: &Space, active: &[usize], work: Work) -> (Choices, f64) {
    let p = space.actuators().min(MAX_ACTUATORS);
    let mut choices = Choices {
        frequencies_hz: space.frequencies_hz.clone(),
        candidates: vec![Vec::new(); p],
        gains: vec![Vec::new(); p],
        loads: vec![Vec::new(); p],
        allowed: vec![1.0; space.limits],
        spacing_hz: MIN_SPACING_HZ - 1e-9,
        work,
        ..Choices::default()
    };
    let mut unit = 0.0;
    for i in 0..p {
        let mut largest = 0.0_f64;
        for frequency in space.usable(i) {
            let gains = space.gains(i, frequency);
            let own = active.iter().map(|x| f64::from(gains[*x]));
            largest = largest.max(own.clone().fold(0.0, f64::max));
            choices.gains[i].extend(own);
            choices.loads[i].extend_from_slice(space.usages(i, frequency));
            let candidate = Candidate { node: frequency, energy: 0.0, power: 0.0, max_force_n: 1.0, tag: frequency };
            choices.candidates[i].push(candidate);
        }
        unit += largest;
    }
    let unit = if unit > 0.0 { BEYOND * unit } else { 1.0 };
    choices.wanted = vec![unit; active.len()];
    (choices, unit)
}

/// How many candidates there are.
fn candidates(choices: &Choices) -> usize {
    choices.candidates.iter().map(Vec::len).sum()
}

/// Frequencies as candidates.
fn index_of(choices: &Choices, frequencies: &[usize]) -> Option<[usize; MAX_ACTUATORS]> {
    let mut chosen = [0; MAX_ACTUATORS];
    for ((chosen, list), frequency) in chosen.iter_mut().zip(&choices.candidates).zip(frequencies) {
        *chosen = list.binary_search_by_key(frequency, |candidate| candidate.node).ok()?;
    }
    Some(chosen)
}
