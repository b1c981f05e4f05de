//! The choice of frequencies: the best combination of all, and the proof that it is.
//!
//! With a price on every target and every shared limit the problem falls apart into one for each actuator: what is left of
//! the cost below is sum_i phi_i(f_i), phi_i the most that actuator i earns at a frequency at these prices. Whatever the
//! prices, no combination costs less than the prices of the wishes minus the sum of its phi_i (weak duality), and the best
//! sum over all frequencies that keep their distance is a table ([`super::assignment`]). The prices come from the best
//! combination known ([`super::allocate`]). Where limits do not bind, the combination with the best sum at its own prices
//! is the optimum; where they do, all combinations whose bound is better than the best one known are looked at.

#[cfg(test)]
mod tests;

use super::allocate::{Allocation, MOST, Prices, Setting, allocate};
use super::assignment::{Assignment, lags};

/// Rounding of a bound: what is nearer than this to the best is as good.
const SAME: f64 = 1e-12;
/// New prices tried before combinations are listed.
const ROUNDS: usize = 12;
/// Of all prices tried, those with the best bounds: each prunes other combinations.
const KEPT: usize = 3;
/// By how much more than the bound a combination may cost, or less than it reach, while none is known that fits: tried one
/// after the other.
const SLACKS: [f64; 4] = [1e-3, 1e-1, 10.0, f64::INFINITY];

/// How much is looked at where limits bind, before the search ends with what is proven by then.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Work {
    /// For a touch: some milliseconds.
    #[default]
    Touch,
    /// For a study: up to some tenths of a second.
    Study,
}

impl Work {
    /// Combinations whose forces are worked out, at most.
    const fn leaves(self) -> usize {
        match self {
            Work::Touch => 500,
            Work::Study => 50_000,
        }
    }

    /// Partial combinations looked at, at most.
    const fn nodes(self) -> usize {
        20 * self.leaves()
    }
}

/// One actuator at one frequency with one pulse width.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Candidate {
    /// Index into the frequencies.
    pub node: usize,
    /// Mean square elsewhere per N^2.
    pub energy: f64,
    /// Cost per N.
    pub power: f64,
    /// Most force in N.
    pub max_force_n: f64,
    /// What the caller knows it by.
    pub tag: usize,
}

/// Everything that may be chosen from.
#[derive(Clone, Debug, Default)]
pub struct Choices {
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
    pub work: Work,
}

/// The best combination.
#[derive(Clone, Debug, PartialEq)]
pub struct Found {
    /// Index of each actuator's candidate.
    pub chosen: [usize; MOST],
    /// Its forces.
    pub allocation: Allocation,
    /// By which part of its cost, or of what it reaches, another combination could be better at most; 0 where it is
    /// proven to be the best.
    pub gap: f64,
}

/// Whether two frequencies may go together, other than by their distance.
pub type Fits<'a> = &'a dyn Fn(f64, f64) -> bool;

impl Choices {
    /// The combination that reaches most of what is wanted, and of those that reach as much the one that costs least.
    /// `None` if no frequencies keep their distance.
    #[must_use]
    pub fn best(&self, fits: Fits<'_>) -> Option<Found> {
        let mut search = Search::new(self, fits);
        search.run()
    }

    /// The forces of one combination.
    #[must_use]
    pub fn allocation(&self, chosen: &[usize]) -> Allocation {
        const NOTHING: Setting<'_> = Setting { energy: 0.0, power: 0.0, max_force_n: 0.0, gain: &[], load: &[] };
        let mut settings = [NOTHING; MOST];
        let p = self.candidates.len();
        for (i, setting) in settings.iter_mut().enumerate().take(p) {
            *setting = self.setting(i, chosen[i]);
        }
        allocate(&settings[..p], &self.wanted, &self.allowed)
    }

    fn setting(&self, actuator: usize, index: usize) -> Setting<'_> {
        let candidate = &self.candidates[actuator][index];
        let (t, c) = (self.wanted.len(), self.allowed.len());
        Setting {
            energy: candidate.energy,
            power: candidate.power,
            max_force_n: candidate.max_force_n,
            gain: &self.gains[actuator][index * t..(index + 1) * t],
            load: &self.loads[actuator][index * c..(index + 1) * c],
        }
    }

    /// What a candidate earns at the prices of a combination: its part in what that is worth.
    #[must_use]
    pub fn earned(&self, actuator: usize, index: usize, known: &Allocation) -> f64 {
        let kind = if known.met >= 1.0 { Kind::Cost } else { Kind::Reach };
        self.earns(actuator, index, &known.prices, kind)
    }

    /// The most that a candidate earns at these prices.
    fn earns(&self, actuator: usize, index: usize, prices: &Prices, kind: Kind) -> f64 {
        let setting = self.setting(actuator, index);
        let sum = |prices: &[f64], entries: &[f64]| prices.iter().zip(entries).map(|(a, b)| a * b).sum::<f64>();
        let pull = sum(&prices.gain, setting.gain) - sum(&prices.load, setting.load);
        match kind {
            Kind::Reach => pull.max(0.0) * setting.max_force_n,
            Kind::Cost => {
                let pull = (pull - setting.power).max(0.0);
                if pull < 2.0 * setting.energy * setting.max_force_n {
                    pull * pull / (4.0 * setting.energy)
                } else {
                    (pull - setting.energy * setting.max_force_n) * setting.max_force_n
                }
            }
        }
    }
}

/// What is looked for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Kind {
    /// The most of what is wanted.
    Reach,
    /// The least cost with all of it.
    Cost,
}

/// The problem at one set of prices.
struct Bound {
    /// Cost: that of the wishes at the prices; reach: that of the limits.
    constant: f64,
    sums: Assignment,
    /// What each actuator's candidates earn.
    earned: Vec<Vec<f64>>,
}

struct Search<'a> {
    choices: &'a Choices,
    fits: Fits<'a>,
    lags: Vec<usize>,
    /// Of each actuator, for each frequency, where its candidates begin.
    starts: Vec<Vec<usize>>,
    best: Option<([usize; MOST], Allocation)>,
    bounds: Vec<Bound>,
    kind: Kind,
    /// Sums up to these, one per bound, are no better than the best known.
    enough: Vec<f64>,
    leaves: usize,
    nodes: usize,
    /// Some were not looked at.
    is_cut: bool,
}

impl<'a> Search<'a> {
    fn new(choices: &'a Choices, fits: Fits<'a>) -> Self {
        let nodes = choices.frequencies_hz.len();
        let starts = choices.candidates.iter().map(|list| {
            let mut starts = Vec::with_capacity(nodes + 1);
            let mut at = 0;
            for node in 0..=nodes {
                while list.get(at).is_some_and(|candidate| candidate.node < node) {
                    at += 1;
                }
                starts.push(at);
            }
            starts
        });
        Self {
            choices,
            fits,
            lags: lags(&choices.frequencies_hz, choices.spacing_hz),
            starts: starts.collect(),
            best: None,
            bounds: Vec::new(),
            kind: Kind::Cost,
            enough: Vec::new(),
            leaves: 0,
            nodes: 0,
            is_cut: false,
        }
    }

    fn run(&mut self) -> Option<Found> {
        let mut prices = self.first_prices();
        let allocation = self.look(&prices)?;
        if allocation.met >= 1.0 {
            prices = allocation.prices;
        } else {
            self.kind = Kind::Reach;
            self.bounds.clear();
            let gap = self.improve(allocation.prices);
            match &self.best {
                Some((chosen, best)) if best.met < 1.0 => {
                    return Some(Found { chosen: *chosen, allocation: best.clone(), gap });
                }
                Some((_, best)) => prices = best.prices.clone(),
                None => return None,
            }
            self.kind = Kind::Cost;
            self.bounds.clear();
        }
        let gap = self.improve(prices);
        let (chosen, allocation) = self.best.clone()?;
        Some(Found { chosen, allocation, gap })
    }

    /// Prices at which some actuator would just do alone, without limits.
    fn first_prices(&self) -> Prices {
        let choices = self.choices;
        let targets = choices.wanted.len();
        let price = |t: usize| {
            let mut sum = 0.0;
            let mut least = f64::INFINITY;
            for i in 0..choices.candidates.len() {
                let mut best = 0.0_f64;
                for (index, candidate) in choices.candidates[i].iter().enumerate() {
                    let gain = choices.gains[i][index * targets + t];
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
            #[allow(clippy::cast_precision_loss, reason = "at most ten targets")]
            let share = 1.0 / targets as f64;
            (energy + power).max(f64::MIN_POSITIVE) * share
        };
        Prices { gain: (0..targets).map(price).collect(), load: vec![0.0; choices.allowed.len()] }
    }

    /// Adds the bound of these prices, and looks at the combination that is best there.
    fn look(&mut self, prices: &Prices) -> Option<Allocation> {
        let choices = self.choices;
        let (p, f) = (choices.candidates.len(), choices.frequencies_hz.len());
        let mut value = vec![f64::NEG_INFINITY; p * f];
        let mut at = vec![None; p * f];
        let mut earned: Vec<Vec<f64>> = Vec::with_capacity(p);
        for (i, list) in choices.candidates.iter().enumerate() {
            earned.push((0..list.len()).map(|index| choices.earns(i, index, prices, self.kind)).collect());
            for (index, (candidate, earns)) in list.iter().zip(&earned[i]).enumerate() {
                let (earns, place) = (*earns, i * f + candidate.node);
                if earns > value[place] {
                    (value[place], at[place]) = (earns, Some(index));
                }
            }
        }
        let sum = |prices: &[f64], of: &[f64]| prices.iter().zip(of).map(|(a, b)| a * b).sum::<f64>();
        let constant = match self.kind {
            Kind::Cost => sum(&prices.gain, &choices.wanted) - sum(&prices.load, &choices.allowed),
            Kind::Reach => sum(&prices.load, &choices.allowed),
        };
        let mut sums = Assignment::default();
        sums.fill(p, value, &self.lags);
        let nodes = sums.choice(&self.lags)?;
        let mut chosen = [0; MOST];
        for i in 0..p {
            chosen[i] = at[i * f + nodes[i]]?;
        }
        self.bounds.push(Bound { constant, sums, earned });
        Some(self.consider(&chosen))
    }

    /// Works out a combination, and keeps it if it is the best that fits.
    fn consider(&mut self, chosen: &[usize; MOST]) -> Allocation {
        let allocation = self.choices.allocation(chosen);
        let p = self.choices.candidates.len();
        let hz = |i: usize| self.choices.frequencies_hz[self.choices.candidates[i][chosen[i]].node];
        let fits = (0..p).all(|i| (0..i).all(|j| (self.fits)(hz(i), hz(j))));
        if fits && self.best.as_ref().is_none_or(|(_, best)| is_better(&allocation, best)) {
            self.best = Some((*chosen, allocation.clone()));
        }
        allocation
    }

    /// What no combination can beat: the highest lower bound of the cost, or the lowest upper bound of the reach.
    fn bound(&self) -> f64 {
        let of = |bound: &Bound| match self.kind {
            Kind::Cost => bound.constant - bound.sums.most(),
            Kind::Reach => bound.constant + bound.sums.most(),
        };
        let all = self.bounds.iter().map(of);
        match self.kind {
            Kind::Cost => all.fold(0.0, f64::max),
            Kind::Reach => all.fold(1.0, f64::min),
        }
    }

    /// How much better than the best one known a combination can be, as a part of it.
    fn gap(&self) -> f64 {
        let Some((_, best)) = &self.best else { return f64::INFINITY };
        let bound = self.bound();
        match self.kind {
            _ if self.kind == Kind::Cost && best.met < 1.0 => f64::INFINITY,
            Kind::Cost if best.cost <= bound => 0.0,
            Kind::Cost => (best.cost - bound) / best.cost,
            Kind::Reach if best.met >= bound => 0.0,
            Kind::Reach => bound / best.met.max(f64::MIN_POSITIVE) - 1.0,
        }
    }

    /// Prices of one combination after the other until they show nothing better, then the list of those that may be. Returns
    /// the gap.
    ///
    /// The bound is a concave function of the prices, and between those of two combinations that take turns it is better than
    /// at either: where new prices bring nothing, the middle between them and the best ones is tried.
    fn improve(&mut self, prices: Prices) -> f64 {
        let mut center = prices.clone();
        let mut next = prices;
        let mut best = self.bound();
        for round in 0..ROUNDS {
            let Some(allocation) = self.look(&next) else { break };
            if self.gap() <= SAME {
                return 0.0;
            }
            if self.kind == Kind::Reach && self.best.as_ref().is_some_and(|(_, best)| best.met >= 1.0) {
                return 0.0;
            }
            let bound = self.bound();
            let gained = match self.kind {
                Kind::Cost => bound - best,
                Kind::Reach => best - bound,
            };
            if gained > 1e-9 * best.abs() || round == 0 {
                center = next.clone();
                best = bound;
            }
            let usable = match self.kind {
                Kind::Cost => allocation.met >= 1.0,
                Kind::Reach => allocation.met < 1.0,
            };
            next = if usable && allocation.prices != next {
                middle(&center, &allocation.prices)
            } else if self.kind == Kind::Cost {
                // It does not reach at this price: a higher one.
                scaled(&next, 1.5)
            } else {
                break;
            };
        }
        let kind = self.kind;
        let of = |bound: &Bound| match kind {
            Kind::Cost => -(bound.constant - bound.sums.most()),
            Kind::Reach => bound.constant + bound.sums.most(),
        };
        self.bounds.sort_by(|a, b| of(a).total_cmp(&of(b)));
        self.bounds.truncate(KEPT);
        let bound = self.bound();
        for slack in SLACKS {
            // With a combination known only what is better than it; otherwise what is not too far from the bound.
            let usable = self.best.as_ref().filter(|(_, best)| self.kind == Kind::Reach || best.met >= 1.0).is_some();
            self.set_enough(if usable { 0.0 } else { slack }, bound);
            let all = (1 << self.choices.candidates.len()) - 1;
            let sums = [0.0; KEPT];
            self.list(all, self.choices.frequencies_hz.len(), &sums, &mut [0; MOST]);
            if usable
                || self.is_cut
                || self.best.as_ref().is_some_and(|(_, best)| self.kind == Kind::Reach || best.met >= 1.0)
            {
                if !usable && !self.is_cut {
                    // One is known now: whatever lies between.
                    self.set_enough(0.0, bound);
                    self.list(all, self.choices.frequencies_hz.len(), &sums, &mut [0; MOST]);
                }
                break;
            }
        }
        if self.is_cut { self.gap() } else { 0.0 }
    }

    /// Sums that are not worth looking at: those of combinations no better than the best one, or than `slack` beyond `bound`.
    fn set_enough(&mut self, slack: f64, bound: f64) {
        let worth = match (&self.best, self.kind) {
            (Some((_, best)), Kind::Cost) if best.met >= 1.0 => best.cost * (1.0 - SAME),
            (Some((_, best)), Kind::Reach) => best.met * (1.0 + SAME),
            (_, Kind::Cost) => bound * (1.0 + slack),
            (_, Kind::Reach) => bound / (1.0 + slack),
        };
        self.enough = self
            .bounds
            .iter()
            .map(|bound| match self.kind {
                Kind::Cost => bound.constant - worth,
                Kind::Reach => worth - bound.constant,
            })
            .collect();
    }

    fn is_worth(&self, set: usize, upto: usize, sums: &[f64; KEPT]) -> bool {
        let all = self.bounds.iter().zip(&self.enough).zip(sums);
        all.into_iter().all(|((bound, enough), sum)| sum + bound.sums.best(set, upto) > *enough)
    }

    /// Looks at all combinations of the actuators of `set` at the first `upto` frequencies that may be better.
    fn list(&mut self, set: usize, upto: usize, sums: &[f64; KEPT], chosen: &mut [usize; MOST]) {
        if set == 0 {
            self.leaves += 1;
            if self.leaves > self.choices.work.leaves() {
                self.is_cut = true;
                return;
            }
            self.consider(chosen);
            if self.kind == Kind::Reach && self.best.as_ref().is_some_and(|(_, best)| best.met >= 1.0) {
                // All is met: the cost decides, which is looked for next.
                self.enough.fill(f64::INFINITY);
            } else if self.best.is_some() {
                self.set_enough_from_best();
            }
            return;
        }
        for node in (0..upto).rev() {
            if self.is_cut || !self.is_worth(set, node + 1, sums) {
                return;
            }
            self.nodes += 1;
            if self.nodes > self.choices.work.nodes() {
                self.is_cut = true;
                return;
            }
            for i in (0..self.choices.candidates.len()).filter(|i| set >> i & 1 == 1) {
                let rest = set & !(1 << i);
                let (from, to) = (self.starts[i][node], self.starts[i][node + 1]);
                for index in from..to {
                    let mut with = *sums;
                    for (sum, bound) in with.iter_mut().zip(&self.bounds) {
                        *sum += bound.earned[i][index];
                    }
                    if self.is_worth(rest, self.lags[node], &with) {
                        chosen[i] = index;
                        self.list(rest, self.lags[node], &with, chosen);
                    }
                }
            }
        }
    }

    fn set_enough_from_best(&mut self) {
        let usable = self.best.as_ref().is_some_and(|(_, best)| self.kind == Kind::Reach || best.met >= 1.0);
        if usable {
            self.set_enough(0.0, 0.0);
        }
    }
}

fn middle(a: &Prices, b: &Prices) -> Prices {
    let mean = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| 0.5 * (a + b)).collect();
    Prices { gain: mean(&a.gain, &b.gain), load: mean(&a.load, &b.load) }
}

fn scaled(prices: &Prices, factor: f64) -> Prices {
    let of = |prices: &[f64]| prices.iter().map(|price| price * factor).collect();
    Prices { gain: of(&prices.gain), load: of(&prices.load) }
}

/// More is met, or as much at less cost.
#[must_use]
pub fn is_better(a: &Allocation, b: &Allocation) -> bool {
    // Relative: what is far beyond reach is met in a small part by all.
    const AS_MUCH: f64 = 1e-9;
    a.met > b.met * (1.0 + AS_MUCH) || a.met >= b.met * (1.0 - AS_MUCH) && a.cost < b.cost
}
