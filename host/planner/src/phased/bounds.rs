//! Bounds on what every group is worth at every frequency, and the best choice by them.
//!
//! With prices l on the peak and m_i on travel, any choice of groups A costs at least
//! l - sum m_i - sum over A of worth(S, f; l, m) (Lagrangian relaxation, in the units in which the wanted peak and the
//! travel limits are 1). That is separable, so the best choice by the bounds comes from dynamic programming over the
//! frequencies, lowest first: best(k, mask) = max of best(k - 1, mask) and, over the subsets S of mask,
//! best(last frequency that keeps its distance from k, mask without S) + worth(S, k).

use super::leaf::{self, Prices, Worth};
use super::program::{Choice, Program, Units};
use super::scores::Scores;
use super::{Field, Grouping, SUBSETS};

/// Which groups may be where.
pub(super) struct Layout {
    /// All actuators.
    pub(super) all: u8,
    /// (mask, mask without group, group) for every group that may be in a mask, groups of one mask in a row.
    transitions: Vec<(usize, usize, usize)>,
    /// For each frequency how many lower ones keep their distance.
    pub(super) lag: Vec<usize>,
}

/// `best[k][mask]`: the most that groups at the first k frequencies are worth that make up mask.
pub(super) type Prefix = Vec<[f64; SUBSETS]>;

impl Layout {
    pub(super) fn new(field: &Field<'_>, grouping: Grouping, spacing_hz: f64) -> Self {
        let all = (1_usize << field.actuators) - 1;
        let of_mask = |mask: usize| (1..=mask).filter(move |group| group & mask == *group);
        let transitions = match grouping {
            Grouping::Shared => vec![(all, 0, all)],
            Grouping::Mixed => {
                (1..=all).flat_map(|mask| of_mask(mask).map(move |group| (mask, mask & !group, group))).collect()
            }
        };
        let mut low = 0;
        let lag = field.frequencies_hz.iter().enumerate().map(|(k, frequency_hz)| {
            // 1e-9 Hz: frequencies are multiples of a step, and their differences are rounded.
            while low < k && field.frequencies_hz[low] <= frequency_hz - spacing_hz + 1e-9 {
                low += 1;
            }
            low
        });
        #[expect(clippy::cast_possible_truncation, reason = "at most 15")]
        Self { all: all as u8, lag: lag.collect(), transitions }
    }

    pub(super) fn prefix(&self, worth: &[[f64; SUBSETS]]) -> Prefix {
        let mut prefix = Vec::with_capacity(worth.len() + 1);
        let mut best = [f64::NEG_INFINITY; SUBSETS];
        best[0] = 0.0;
        prefix.push(best);
        for (worth, lag) in worth.iter().zip(&self.lag) {
            let lower: &[f64; SUBSETS] = &prefix[*lag];
            for (mask, rest, group) in &self.transitions {
                best[mask % SUBSETS] = best[mask % SUBSETS].max(lower[rest % SUBSETS] + worth[group % SUBSETS]);
            }
            prefix.push(best);
        }
        prefix
    }

    /// The most that any choice is worth.
    pub(super) fn most(&self, prefix: &Prefix) -> f64 {
        prefix.last().map_or(f64::NEG_INFINITY, |best| best[usize::from(self.all)])
    }

    /// A choice that is worth [`Layout::most`].
    pub(super) fn choice(&self, prefix: &Prefix, worth: &[[f64; SUBSETS]]) -> Vec<Choice> {
        let (mut choices, mut mask, mut until) = (Vec::with_capacity(4), usize::from(self.all), worth.len());
        while mask != 0 && until > 0 {
            let k = until - 1;
            let made_of = |transition: &&(usize, usize, usize)| {
                transition.0 == mask
                    && prefix[self.lag[k]][transition.1] + worth[k][transition.2] == prefix[until][mask]
            };
            let changed = prefix[k][mask] != prefix[until][mask];
            match self.transitions.iter().find(made_of).filter(|_| changed) {
                #[expect(clippy::cast_possible_truncation, reason = "at most 15")]
                Some((_, rest, group)) => {
                    choices.push((*group as u8, k));
                    (mask, until) = (*rest, self.lag[k]);
                }
                None => until = k,
            }
        }
        choices
    }

    /// The groups that may be in `mask`: (what is left, group).
    pub(super) fn groups(&self, mask: usize) -> impl Iterator<Item = (usize, usize)> + '_ {
        self.transitions.iter().filter(move |transition| transition.0 == mask).map(|(_, rest, group)| (*rest, *group))
    }
}

/// Most peak that each group has at each frequency if only forces are limited, in m/s^2.
pub(super) fn most_peaks(field: &Field<'_>, scores: &Scores) -> Vec<[f64; SUBSETS]> {
    let at = |k: usize| {
        let mut sums = [0.0; SUBSETS];
        for subset in 1..SUBSETS {
            let lowest = subset.trailing_zeros() as usize;
            let usable = scores.usable[k] >> lowest & 1 == 1;
            let own = if usable { field.gain[k][lowest].norm() * field.max_force_n[k][lowest] } else { 0.0 };
            sums[subset] = sums[subset & (subset - 1)] + own;
        }
        sums
    };
    (0..scores.of.len()).map(at).collect()
}

/// What groups are worth at given prices, at most.
pub(super) struct Bounds {
    pub(super) prices: Prices,
    pub(super) units: Units,
    pub(super) worth: Vec<[f64; SUBSETS]>,
    /// The same in two parts.
    parts: Vec<[Worth; SUBSETS]>,
    quick: Vec<u16>,
}

impl Bounds {
    /// Without solving anything: a group is worth at most what it would be without limits, l^2 s / 4, and at most what it
    /// would be if all forces were at their limits and energy for nothing.
    pub(super) fn new(prices: Prices, units: Units, scores: &Scores, most_peaks: &[[f64; SUBSETS]]) -> Self {
        let free = 0.25 * prices.peak * prices.peak * units.energy / (units.peak * units.peak);
        let limited = prices.peak / units.peak;
        let parts = scores.of.iter().zip(most_peaks).map(|(score, most)| -> [Worth; SUBSETS] {
            std::array::from_fn(|group| {
                let (limits, energy) = (limited * most[group], free * score[group]);
                if prices.energy > 0.0 && energy < limits {
                    Worth { limits: 0.0, energy, tight: false }
                } else {
                    Worth { limits, energy: 0.0, tight: false }
                }
            })
        });
        let parts: Vec<[Worth; SUBSETS]> = parts.collect();
        let worth = parts.iter().map(|parts| std::array::from_fn(|group| parts[group].sum())).collect();
        Self { prices, units, worth, quick: vec![0; parts.len()], parts }
    }

    /// A better bound in a microsecond, unless that was done before; not better than `hopeless` has to be.
    pub(super) fn quicken(&mut self, field: &Field<'_>, scores: &Scores, group: usize, k: usize, hopeless: f64) {
        if !self.is_quick(group, k) {
            self.quick[k] |= 1 << group;
            let worth = leaf::quick_worth(&self.program(field, scores, group, k), &self.prices, hopeless);
            self.put(group, k, worth);
        }
    }

    /// The best bound, or one of `hopeless` or less.
    pub(super) fn tighten(&mut self, field: &Field<'_>, scores: &Scores, group: usize, k: usize, hopeless: f64) {
        let worth = leaf::worth(&self.program(field, scores, group, k), &self.prices, hopeless);
        self.put(group, k, worth);
    }

    pub(super) fn is_quick(&self, group: usize, k: usize) -> bool {
        self.quick[k] >> group & 1 == 1
    }

    pub(super) fn is_tight(&self, group: usize, k: usize) -> bool {
        self.parts[k][group].tight
    }

    #[expect(clippy::cast_possible_truncation, reason = "at most 15")]
    fn program(&self, field: &Field<'_>, scores: &Scores, group: usize, k: usize) -> Program {
        Program::new(field, scores, &[(group as u8, k)], self.units)
    }

    fn put(&mut self, group: usize, k: usize, worth: Worth) {
        if worth.sum() <= self.worth[k][group] {
            self.parts[k][group] = worth;
            self.worth[k][group] = worth.sum();
        }
        self.parts[k][group].tight |= worth.tight;
    }

    /// [`Prices::cost`].
    pub(super) fn cost(&self, worth: f64) -> f64 {
        self.prices.cost(worth)
    }

    /// What a choice is worth at most.
    pub(super) fn parts_of(&self, choices: &[Choice]) -> Worth {
        let mut sum = Worth::default();
        for (group, k) in choices {
            let parts = self.parts[*k][usize::from(*group)];
            sum.limits += parts.limits;
            sum.energy += parts.energy;
        }
        sum
    }
}
