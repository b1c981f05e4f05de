//! Branch and bound over the frequencies.

use super::dual::{Evaluation, Space};
use super::mixture::{self, Column, Mixture};
use super::{BestCombination, Choices, Fits, Kind, is_better};
use crate::choose::allocate::{Allocation, Duals};
use crate::scene::MAX_ACTUATORS;

/// What is nearer than this to the best, as a part of it, is as good.
const AS_GOOD: f64 = 1e-10;
/// Part of the wishes that is nothing: a millionth of what wishes count at most over what can be reached at all.
const NO_PART: f64 = 1e-12;
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

/// A part of all combinations.
struct Part {
    /// No combination of it is worth more.
    bound: f64,
    space: Space,
    columns: Vec<Column>,
    /// Of the bound.
    duals: Duals,
}

/// The state of a search.
pub struct BranchAndBound<'a> {
    choices: &'a Choices,
    fits: Fits<'a>,
    kind: Kind,
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
    pub fn new(choices: &'a Choices, fits: Fits<'a>) -> Self {
        let most_steps = choices.work.steps(choices.candidates.iter().map(Vec::len).sum());
        Self {
            choices,
            fits,
            kind: Kind::Cost,
            best: None,
            is_polished: false,
            steps: 0,
            taken: 0,
            bound: f64::INFINITY,
            most_steps,
        }
    }

    /// First what reaches, then what it costs.
    pub fn run(mut self, known: Option<[usize; MAX_ACTUATORS]>) -> Option<BestCombination> {
        if let Some(known) = known {
            self.consider(&known);
        }
        let whole = Space::whole(self.choices);
        let first = Evaluation::of(self.choices, &whole, &self.first_duals(), Kind::Cost)?;
        let allocation = self.consider(&first.choice);
        let mut duals = allocation.duals.clone();
        if self.best.as_ref().is_none_or(|(_, best)| best.met < 1.0) {
            self.kind = Kind::Reach;
            let gap = self.settle((allocation.met < 1.0).then_some(duals));
            let (chosen, allocation) = self.best.as_ref()?;
            if allocation.met < 1.0 {
                let (chosen, allocation, most) = (*chosen, allocation.clone(), self.bound.min(1.0));
                return Some(BestCombination { chosen, allocation, gap, most, steps: self.taken });
            }
            duals = allocation.duals.clone();
            self.kind = Kind::Cost;
        }
        let gap = self.settle(Some(duals));
        let (chosen, allocation) = self.best?;
        Some(BestCombination { chosen, allocation, gap, most: 1.0, steps: self.taken })
    }

    /// Dual variables at which some actuator would just do alone, without limits.
    fn first_duals(&self) -> Duals {
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
        Duals { gain: (0..targets).map(dual).collect(), load: vec![0.0; choices.allowed.len()] }
    }

    const fn step(&mut self) {
        self.steps += 1;
        self.taken += 1;
    }

    /// Works out a combination, and keeps it if it is the best that fits.
    fn consider(&mut self, chosen: &[usize; MAX_ACTUATORS]) -> Allocation {
        self.step();
        let allocation = self.choices.allocation(chosen);
        let fits = self.is_allowed(chosen);
        if fits && self.best.as_ref().is_none_or(|(_, best)| is_better(&allocation, best)) {
            if self.best.is_none() {
                // A long way to the first one leaves some for better ones.
                self.steps = self.steps.min(self.most_steps / 2);
            }
            self.best = Some((*chosen, allocation.clone()));
            self.is_polished = false;
        }
        allocation
    }

    fn is_allowed(&self, chosen: &[usize; MAX_ACTUATORS]) -> bool {
        let p = self.choices.candidates.len();
        (0..p).all(|i| (0..i).all(|j| self.choices.go_together(self.fits, (i, chosen[i]), (j, chosen[j]))))
    }

    /// What is worth no more is as good as the best known.
    fn enough(&self) -> f64 {
        let worth = self.best.as_ref().map_or(f64::NEG_INFINITY, |(_, best)| self.kind.worth(best));
        match self.kind {
            _ if !worth.is_finite() => worth,
            Kind::Reach => worth + AS_GOOD * worth + NO_PART,
            Kind::Cost => worth + AS_GOOD * worth.abs(),
        }
    }

    /// Whether all wishes are met, where that was the question.
    fn is_met(&self) -> bool {
        self.kind == Kind::Reach && self.best.as_ref().is_some_and(|(_, best)| best.met >= 1.0)
    }

    /// Whether enough has been looked at. Before any combination is known that may be driven, it never has.
    const fn is_spent(&self) -> bool {
        self.best.is_some() && self.steps >= self.most_steps
    }

    /// By which part of it something could be better than the best known, if nothing is worth more than `bound`.
    fn gap(&self, bound: f64) -> f64 {
        let Some((_, best)) = self.best.as_ref().filter(|_| bound > self.enough()) else { return 0.0 };
        match self.kind {
            Kind::Reach => bound.min(1.0) / best.met.max(NO_PART) - 1.0,
            Kind::Cost => ((best.cost + bound) / best.cost).min(1.0),
        }
    }

    /// Finds the best combination; returns the gap.
    fn settle(&mut self, duals: Option<Duals>) -> f64 {
        // What the reach took, half of it at most, is not missing for the cost.
        self.steps = (self.steps / 2).min(self.most_steps / 2);
        let targets = self.choices.wanted.len();
        // Of what reaches nothing known, any that make all that is asked for cost one.
        let sum: f64 = self.choices.wanted.iter().sum();
        let duals = duals
            .unwrap_or_else(|| Duals { gain: vec![1.0 / sum; targets], load: vec![0.0; self.choices.allowed.len()] });
        let mut whole = Part { bound: f64::INFINITY, space: Space::whole(self.choices), columns: Vec::new(), duals };
        if let Some((chosen, allocation)) = &self.best {
            for (i, force_n) in allocation.forces_n.iter().enumerate().take(self.choices.candidates.len()) {
                mixture::add(&mut whole.columns, i, chosen[i], *force_n);
            }
        }
        self.bound = if self.tighten(&mut whole, FIRST_ROUNDS, OWN_DUALS) { self.divide(whole) } else { self.enough() };
        self.gap(self.bound)
    }

    /// Divides the part with the most promising bound until none is better than what is known; what no combination is worth more than.
    fn divide(&mut self, whole: Part) -> f64 {
        let mut open = vec![whole];
        loop {
            let most = (0..open.len()).max_by(|a, b| open[*a].bound.total_cmp(&open[*b].bound));
            let Some(part) = most.map(|at| open.swap_remove(at)) else { return self.enough() };
            if self.is_met() || part.bound <= self.enough() {
                return self.enough();
            }
            if self.is_spent() {
                return part.bound;
            }
            for mut half in halves(part) {
                if half.space.combinations() <= FEW {
                    self.list(&half.space);
                } else if self.tighten(&mut half, PART_ROUNDS, 0) {
                    open.push(half);
                }
            }
        }
    }

    /// Looks at every combination of a part.
    fn list(&mut self, space: &Space) {
        let mut at = [0; MAX_ACTUATORS];
        loop {
            let mut chosen = [0; MAX_ACTUATORS];
            for ((chosen, list), at) in chosen.iter_mut().zip(&space.lists).zip(&at) {
                let Some(candidate) = list.get(*at) else { return };
                *chosen = *candidate;
            }
            if self.is_allowed(&chosen) {
                self.consider(&chosen);
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

    /// Improves the dual variables of a part and leaves out what they show to be no better than the best known, which improves on the
    /// way; whether anything is left. The dual variables of the combination found are tried first, `own_duals` times.
    fn tighten(&mut self, part: &mut Part, rounds: usize, own_duals: usize) -> bool {
        let mut next = part.duals.clone();
        for round in 0..rounds {
            if self.is_spent() {
                break;
            }
            self.step();
            let found = Evaluation::of(self.choices, &part.space, &next, self.kind);
            let Some(found) = found else { return false };
            let is_better = found.bound < part.bound;
            if is_better {
                part.bound = found.bound;
                part.duals.clone_from(&next);
            }
            let allocation = self.consider(&found.choice);
            if self.is_met() || part.bound <= self.enough() {
                return false;
            }
            if round > 0 && !self.is_polished {
                self.polish();
                if self.is_met() || part.bound <= self.enough() {
                    return false;
                }
            }
            let is_new = self.add_columns(part, &found, Some((&found.choice, &allocation)));
            found.reduce(&mut part.space, self.enough());
            if part.space.is_empty() {
                return false;
            }
            part.columns.retain(|column| part.space.has(column.actuator, column.candidate));
            // The dual variables are those of the reach where not all is met.
            let has_duals = (self.kind == Kind::Reach) == (allocation.met < 1.0);
            if round < own_duals && has_duals && allocation.duals != next {
                next = allocation.duals;
                continue;
            }
            if !is_new && !is_better {
                break;
            }
            let Ok(mixture) = self.mixture(part) else { return false };
            let Some(mixture) = mixture else { break };
            self.consider_shares(part, &found.choice);
            // Once it is near what it can become, only a division helps, unless it can become no better than what is known.
            let (enough, least) = (self.enough(), mixture.worth);
            if least > enough && part.bound - least <= NEAR_LEAST * (part.bound - enough) {
                break;
            }
            next = if is_better { mixture.duals } else { middle(&part.duals, &mixture.duals) };
        }
        !part.space.is_empty()
    }

    /// Looks at the combination of what has the largest shares of a part's mixture.
    fn consider_shares(&mut self, part: &Part, otherwise: &[usize; MAX_ACTUATORS]) {
        let mut chosen = *otherwise;
        for (i, chosen) in chosen.iter_mut().enumerate().take(self.choices.candidates.len()) {
            let own = part.columns.iter().filter(|column| column.actuator == i && column.share > 0.0);
            let largest = own.max_by(|a, b| a.share.total_cmp(&b.share));
            *chosen = largest.map_or(*chosen, |column| column.candidate);
        }
        if chosen != *otherwise && self.is_allowed(&chosen) {
            self.consider(&chosen);
        }
    }

    /// What earns most at the dual variables of `found`, and a combination with its forces; whether any is new.
    fn add_columns(
        &self,
        part: &mut Part,
        found: &Evaluation,
        known: Option<(&[usize; MAX_ACTUATORS], &Allocation)>,
    ) -> bool {
        let mut is_new = false;
        let Part { space, columns, .. } = part;
        for i in 0..self.choices.candidates.len() {
            for candidate in [None, Some(found.choice[i])] {
                if let Some((candidate, force_n)) = found.force_of(space, i, candidate) {
                    is_new |= mixture::add(columns, i, candidate, force_n);
                }
            }
            if let Some((chosen, allocation)) = known {
                is_new |= mixture::add(columns, i, chosen[i], allocation.forces_n[i]);
            }
        }
        is_new
    }

    /// The best mixture of a part; an error if nothing of it does all that is asked for, `None` if that is not known.
    fn mixture(&mut self, part: &mut Part) -> Result<Option<Mixture>, ()> {
        if part.columns.len() > MOST_COLUMNS {
            part.columns.retain(|column| column.share > 0.0);
        }
        for _ in 0..FEASIBLE_ROUNDS {
            self.step();
            let Some(mixture) = mixture::best(self.choices, &mut part.columns, self.kind) else { return Ok(None) };
            if self.kind == Kind::Reach || mixture.met >= 1.0 - MISSING {
                return Ok(Some(mixture));
            }
            let found = Evaluation::of(self.choices, &part.space, &mixture.duals, Kind::Reach).ok_or(())?;
            if found.bound < 1.0 - MISSING {
                return Err(());
            }
            if !self.add_columns(part, &found, None) {
                return Ok(None);
            }
        }
        Ok(None)
    }

    /// Tries other frequencies of one actuator at a time around the best combination, those that earn more at its dual variables: no
    /// other one can be better.
    fn polish(&mut self) {
        while !self.is_polished && !self.is_spent() && !self.is_met() {
            self.is_polished = true;
            let Some((chosen, allocation)) = self.best.clone() else { return };
            let choices = self.choices;
            for i in 0..choices.candidates.len() {
                let own = choices.earned(i, chosen[i], &allocation);
                let earned =
                    (0..choices.candidates[i].len()).map(|index| (choices.earned(i, index, &allocation), index));
                let mut other = chosen;
                let mut earned: Vec<(f64, usize)> = earned
                    .filter(|(earned, index)| {
                        other[i] = *index;
                        *earned > own * (1.0 + AS_GOOD) && self.is_allowed(&other)
                    })
                    .collect();
                earned.sort_by(|a, b| b.0.total_cmp(&a.0));
                for (_, index) in earned.into_iter().take(TRIED) {
                    other[i] = index;
                    self.consider(&other);
                }
            }
        }
    }
}

/// A part in two: where its best mixture has one actuator at several frequencies, between these.
fn halves(part: Part) -> [Part; 2] {
    let mut most = (0.0, 0, 0);
    let mut longest = 0;
    for (i, list) in part.space.lists.iter().enumerate() {
        if list.len() > part.space.lists[longest].len() {
            longest = i;
        }
        let place = |column: &Column| list.binary_search(&column.candidate).ok().map(|at| (at, column.share));
        let shared = part.columns.iter().filter(|column| column.actuator == i && column.share > 0.0);
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
    let (actuator, cut) = if cut > 0 { (actuator, cut) } else { (longest, part.space.lists[longest].len() / 2) };
    [true, false].map(|is_lower| {
        let mut space = part.space.clone();
        let list = &mut space.lists[actuator];
        if is_lower {
            list.truncate(cut);
        } else {
            list.drain(..cut);
        }
        let columns = part.columns.iter().filter(|column| space.has(column.actuator, column.candidate));
        Part { bound: part.bound, columns: columns.copied().collect(), space, duals: part.duals.clone() }
    })
}

fn middle(a: &Duals, b: &Duals) -> Duals {
    let mean = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| 0.5 * (a + b)).collect();
    Duals { gain: mean(&a.gain, &b.gain), load: mean(&a.load, &b.load) }
}
