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

use crate::choose::allocate::{Allocation, Duals, Setting, allocate};
use crate::request::Work;
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
    /// Steps that it took ([`Work`]).
    pub steps: usize,
}

/// Whether two frequencies may go together, other than by their distance.
pub type Fits<'a> = &'a dyn Fn(f64, f64) -> bool;

impl Choices {
    /// The combination that reaches most of what is wanted, and of those that reach as much the one that costs least.
    /// `None` if no frequencies keep their distance.
    #[must_use]
    pub fn best(&self, fits: Fits<'_>) -> Option<BestCombination> {
        self.best_from(fits, None)
    }

    /// The same with a combination to begin with, that may be a good one.
    #[must_use]
    pub fn best_from(&self, fits: Fits<'_>, known: Option<[usize; MAX_ACTUATORS]>) -> Option<BestCombination> {
        BranchAndBound::new(self, fits).run(known)
    }

    /// The same by looking at every combination, and how many there are: what [`Choices::best`] is held against, for lists of
    /// frequencies that are short enough.
    #[must_use]
    pub fn exhaustive(&self, fits: Fits<'_>) -> (Option<Allocation>, u64) {
        let (mut best, mut looked) = (None, 0);
        self.descend(fits, &mut Vec::with_capacity(MAX_ACTUATORS), &mut best, &mut looked);
        (best, looked)
    }

    fn descend(&self, fits: Fits<'_>, chosen: &mut Vec<usize>, best: &mut Option<Allocation>, looked: &mut u64) {
        let i = chosen.len();
        if i == self.candidates.len() {
            *looked += 1;
            let found = self.allocation(chosen);
            if best.as_ref().is_none_or(|best| is_better(&found, best)) {
                *best = Some(found);
            }
            return;
        }
        for index in 0..self.candidates[i].len() {
            if (0..i).all(|j| self.go_together(fits, (i, index), (j, chosen[j]))) {
                chosen.push(index);
                self.descend(fits, chosen, best, looked);
                chosen.pop();
            }
        }
    }

    /// The forces of one combination.
    #[must_use]
    pub fn allocation(&self, chosen: &[usize]) -> Allocation {
        const NOT_DRIVEN: Setting<'_> = Setting { energy: 0.0, power: 0.0, max_force_n: 0.0, gain: &[], load: &[] };
        let mut settings = [NOT_DRIVEN; MAX_ACTUATORS];
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

    fn hz(&self, actuator: usize, index: usize) -> f64 {
        self.frequencies_hz[self.candidates[actuator][index].node]
    }

    /// Whether two candidates, each an actuator and an index, may be driven at once.
    fn go_together(&self, fits: Fits<'_>, a: (usize, usize), b: (usize, usize)) -> bool {
        let (a, b) = (self.hz(a.0, a.1), self.hz(b.0, b.1));
        (a - b).abs() >= self.spacing_hz && fits(a, b)
    }

    /// What a candidate earns at the dual variables of a combination: its part in what that is worth.
    #[must_use]
    pub fn earned(&self, actuator: usize, index: usize, known: &Allocation) -> f64 {
        let kind = if known.met >= 1.0 { Kind::Cost } else { Kind::Reach };
        kind.earns(&self.setting(actuator, index), &known.duals).0
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

impl Kind {
    /// The most that a candidate earns at these dual variables, and the force with which it does.
    fn earns(self, setting: &Setting<'_>, duals: &Duals) -> (f64, f64) {
        let sum = |duals: &[f64], entries: &[f64]| duals.iter().zip(entries).map(|(a, b)| a * b).sum::<f64>();
        let pull = sum(&duals.gain, setting.gain) - sum(&duals.load, setting.load);
        self.earns_at(setting.energy, setting.power, setting.max_force_n, pull)
    }

    /// The same with what a newton brings at the dual variables, `pull`.
    fn earns_at(self, energy: f64, power: f64, max_force_n: f64, pull: f64) -> (f64, f64) {
        let pull = if self == Kind::Cost { pull - power } else { pull };
        if pull <= 0.0 {
            (0.0, 0.0)
        } else if self == Kind::Reach || pull >= 2.0 * energy * max_force_n {
            let energy = if self == Kind::Cost { energy } else { 0.0 };
            ((pull - energy * max_force_n) * max_force_n, max_force_n)
        } else {
            (pull * pull / (4.0 * energy), pull / (2.0 * energy))
        }
    }

    /// How good forces are, the more the better: what they reach, or minus what they cost; minus infinity where they do not do
    /// what is asked for.
    fn worth(self, of: &Allocation) -> f64 {
        match self {
            Kind::Reach => of.met,
            Kind::Cost if of.met >= 1.0 => -of.cost,
            Kind::Cost => f64::NEG_INFINITY,
        }
    }
}

/// More is met, or as much at less cost.
#[must_use]
pub fn is_better(a: &Allocation, b: &Allocation) -> bool {
    // Relative: what is far beyond reach is met in a small part by all.
    const AS_MUCH: f64 = 1e-9;
    a.met > b.met * (1.0 + AS_MUCH) || a.met >= b.met * (1.0 - AS_MUCH) && a.cost < b.cost
}
