//! The best frequencies for several actuators when what each contributes does not depend on the others, but frequencies
//! have to keep their distance.
//!
//! B(S, k), the best sum that the actuators of a set S make at frequencies up to the k-th, is the larger of B(S, k - 1)
//! and, over the i in S, of v_i(k) + B(S without i, the last frequency far enough below the k-th): 2^p p F additions.
//! B also says, for whatever has been chosen from the top down, what the rest can add at most: with it every combination
//! above a given sum can be listed without meeting many others.

use crate::scene::MAX_ACTUATORS;
use pulp::{Arch, Simd, WithSimd};

/// Sums over all sets of actuators and all prefixes of the frequencies.
#[derive(Clone, Debug, Default)]
pub struct Assignment {
    actuators: usize,
    frequencies: usize,
    /// What each actuator contributes at each frequency, actuator by actuator; minus infinity where it cannot be.
    value: Vec<f64>,
    /// B, set by set; entry k is for the first k frequencies.
    best: Vec<f64>,
}

/// For each frequency the number of frequencies that are at least `spacing_hz` below it.
#[must_use]
pub fn count_frequencies_below_each_with_spacing(frequencies_hz: &[f64], spacing_hz: f64) -> Vec<usize> {
    let mut below = 0;
    frequencies_hz
        .iter()
        .map(|hz| {
            while frequencies_hz.get(below).is_some_and(|low| hz - low >= spacing_hz) {
                below += 1;
            }
            below
        })
        .collect()
}

/// The larger of two numbers, neither of which is NaN: one instruction, of which `f64::max` takes several.
#[inline(always)]
fn raise_maximum_to_at_least(maximum: &mut f64, value: f64) {
    *maximum = if value > *maximum { value } else { *maximum };
}

/// Fills the sets, from the smaller ones to the larger ones, for the vector instructions of the machine.
struct FillSets<'a> {
    table: &'a mut Assignment,
    lags: &'a [usize],
    /// Frequencies before this one have none far enough below.
    first: usize,
    /// How many the first of the others has.
    from: usize,
    /// Whether each of these has one more than the one before.
    is_shift: bool,
}

impl WithSimd for FillSets<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        let Self { table: Assignment { actuators, frequencies: f, value, best }, lags, first, from, is_shift } = self;
        let (actuators, f) = (*actuators, *f);
        for set in 1..1 << actuators {
            let (smaller, own) = best.split_at_mut(set * (f + 1));
            let own = &mut own[..=f];
            for i in (0..actuators).filter(|i| set >> i & 1 == 1) {
                let rest = set & !(1 << i);
                let rest = &smaller[rest * (f + 1)..(rest + 1) * (f + 1)];
                let value = &value[i * f..(i + 1) * f];
                for (own, value) in own[1..=first].iter_mut().zip(value) {
                    raise_maximum_to_at_least(own, value + rest[0]);
                }
                let (own, value) = (&mut own[first + 1..], &value[first..]);
                if is_shift {
                    for ((own, value), rest) in own.iter_mut().zip(value).zip(&rest[from.min(f)..]) {
                        raise_maximum_to_at_least(own, value + rest);
                    }
                } else {
                    for ((own, value), lag) in own.iter_mut().zip(value).zip(&lags[first..]) {
                        raise_maximum_to_at_least(own, value + rest[*lag]);
                    }
                }
            }
            let mut most = f64::NEG_INFINITY;
            for entry in own {
                raise_maximum_to_at_least(&mut most, *entry);
                *entry = most;
            }
        }
    }
}

impl Assignment {
    /// Fills the table. `contributions` holds the contribution of each actuator at each frequency, actuator by actuator;
    /// `counts_below` comes from [`count_frequencies_below_each_with_spacing`].
    pub fn fill_best_sums_of_actuator_sets(
        &mut self,
        actuators: usize,
        contributions: Vec<f64>,
        counts_below: &[usize],
    ) {
        let f = counts_below.len();
        self.actuators = actuators;
        self.frequencies = f;
        self.value = contributions;
        let sets = 1 << actuators;
        self.best.clear();
        self.best.resize(sets * (f + 1), f64::NEG_INFINITY);
        self.best[..=f].fill(0.0);
        // Frequencies with none far enough below come first; from there on equidistant ones are a plain shift.
        let first = counts_below.partition_point(|lag| *lag == 0);
        let from = counts_below.get(first).copied().unwrap_or(0);
        let is_shift = counts_below[first..].windows(2).all(|pair| pair[1] == pair[0] + 1);
        Arch::new().dispatch(FillSets { table: self, lags: counts_below, first, from, is_shift });
    }

    /// The best sum of the actuators of `actuator_mask` (one bit each) over the first `frequency_count` frequencies.
    #[must_use]
    pub fn best_sum_over_first_frequencies(&self, actuator_mask: usize, frequency_count: usize) -> f64 {
        self.best[actuator_mask * (self.frequencies + 1) + frequency_count]
    }

    /// The best sum of all actuators.
    #[must_use]
    pub fn best_sum_of_all_actuators(&self) -> f64 {
        self.best_sum_over_first_frequencies((1 << self.actuators) - 1, self.frequencies)
    }

    /// The contribution of an actuator at a frequency, both by their indices.
    #[must_use]
    pub fn contribution_at(&self, actuator: usize, frequency_index: usize) -> f64 {
        self.value[actuator * self.frequencies + frequency_index]
    }

    /// The best sum of all actuators with one of them at a given frequency. `table_in_descending_order` is the table over the same
    /// frequencies in descending order; `count_at_least_spacing_below` frequencies lie at least the spacing below that one, `count_at_least_spacing_above` at least
    /// the spacing above it.
    #[must_use]
    pub fn best_spaced_sum_with_actuator_at_frequency(
        &self,
        table_in_descending_order: &Self,
        actuator: usize,
        frequency: usize,
        count_at_least_spacing_below: usize,
        count_at_least_spacing_above: usize,
    ) -> f64 {
        let others = ((1 << self.actuators) - 1) & !(1 << actuator);
        let mut best = f64::NEG_INFINITY;
        // All divisions of the others into some below and the rest above.
        let mut lower = others;
        loop {
            best = best.max(
                self.best_sum_over_first_frequencies(lower, count_at_least_spacing_below)
                    + table_in_descending_order
                        .best_sum_over_first_frequencies(others & !lower, count_at_least_spacing_above),
            );
            if lower == 0 {
                return best + self.contribution_at(actuator, frequency);
            }
            lower = (lower - 1) & others;
        }
    }

    /// One combination with the best sum, as a frequency index per actuator; `None` if no combination keeps the
    /// spacing.
    #[must_use]
    pub fn best_frequency_of_each_actuator_if_spacing_can_be_kept(
        &self,
        counts_below: &[usize],
    ) -> Option<[usize; MAX_ACTUATORS]> {
        let mut chosen = [0; MAX_ACTUATORS];
        let (mut set, mut upto) = ((1 << self.actuators) - 1, self.frequencies);
        while set != 0 {
            let best = self.best_sum_over_first_frequencies(set, upto);
            if best == f64::NEG_INFINITY {
                return None;
            }
            // The first prefix that has it ends with a chosen frequency.
            let row = &self.best[set * (self.frequencies + 1)..(set + 1) * (self.frequencies + 1)];
            let k = row.partition_point(|entry| *entry < best).checked_sub(1)?;
            let is_last = |i: &usize| {
                set >> i & 1 == 1
                    && self.contribution_at(*i, k)
                        + self.best_sum_over_first_frequencies(set & !(1 << i), counts_below[k])
                        == best
            };
            let i = (0..self.actuators).find(is_last)?;
            chosen[i] = k;
            set &= !(1 << i);
            upto = counts_below[k];
        }
        Some(chosen)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn exhaustive(p: usize, value: &[f64], hz: &[f64], spacing: f64) -> f64 {
        fn descend(
            p: usize,
            value: &[f64],
            hz: &[f64],
            spacing: f64,
            chosen: &mut Vec<usize>,
            sum: f64,
            best: &mut f64,
        ) {
            let i = chosen.len();
            if i == p {
                *best = best.max(sum);
                return;
            }
            for k in 0..hz.len() {
                if chosen.iter().all(|other| (hz[*other] - hz[k]).abs() >= spacing) {
                    chosen.push(k);
                    descend(p, value, hz, spacing, chosen, sum + value[i * hz.len() + k], best);
                    chosen.pop();
                }
            }
        }
        let mut best = f64::NEG_INFINITY;
        descend(p, value, hz, spacing, &mut Vec::new(), 0.0, &mut best);
        best
    }

    proptest! {
        #[test]
        fn it_is_the_exhaustive_optimum(
            p in 1_usize..=4,
            steps in prop::collection::vec(1_u8..15, 3..12),
            seed in prop::collection::vec(0_u8..20, 48),
        ) {
            let hz: Vec<f64> = steps.iter().scan(50.0, |hz, step| { *hz += f64::from(*step); Some(*hz) }).collect();
            let value: Vec<f64> = seed.iter().take(p * hz.len()).map(|v| if *v == 0 { f64::NEG_INFINITY } else { f64::from(*v) }).collect();
            let lags = count_frequencies_below_each_with_spacing(&hz, 20.0);
            let mut assignment = Assignment::default();
            assignment.fill_best_sums_of_actuator_sets(p, value.clone(), &lags);
            let expected = exhaustive(p, &value, &hz, 20.0);
            prop_assert_eq!(assignment.best_sum_of_all_actuators(), expected);
            // The same from above, and the best sum through every place.
            let turned: Vec<f64> = hz.iter().rev().map(|hz| 1e3 - hz).collect();
            let mirrored_lags = super::count_frequencies_below_each_with_spacing(&turned, 20.0);
            let mut mirrored = Assignment::default();
            let f = hz.len();
            let turned_value = (0..p).flat_map(|i| (0..f).rev().map(move |k| (i, k))).map(|(i, k)| value[i * f + k]).collect();
            mirrored.fill_best_sums_of_actuator_sets(p, turned_value, &mirrored_lags);
            for i in 0..p {
                let through = |k: usize| assignment.best_spaced_sum_with_actuator_at_frequency(&mirrored, i, k, lags[k], mirrored_lags[f - 1 - k]);
                prop_assert_eq!((0..f).map(through).fold(f64::NEG_INFINITY, f64::max), expected);
            }
            match assignment.best_frequency_of_each_actuator_if_spacing_can_be_kept(&lags) {
                None => prop_assert_eq!(expected, f64::NEG_INFINITY),
                Some(chosen) => {
                    prop_assert_eq!((0..p).map(|i| assignment.contribution_at(i, chosen[i])).sum::<f64>(), expected);
                    for i in 0..p { for j in 0..i { prop_assert!((hz[chosen[i]] - hz[chosen[j]]).abs() >= 20.0); } }
                }
            }
        }
    }
}
