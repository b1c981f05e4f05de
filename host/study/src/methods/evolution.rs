//! Points that depend on results: the covariance matrix adaptation evolution strategy (Hansen and Ostermeier 2001), several searches beside each other.
//!
//! Every generation is had by going through all before it with the values that are known: they are the same again, as the random
//! numbers are, and nothing but values has to be kept to go on after a stop.

use super::adaptation::CovarianceAdaptation;
use crate::spec::StudyMethod;
use era_model::scene::random::RandomSequence;

/// A stream of random numbers of its own.
const STREAM: u64 = 0xe701;
/// Deviation of the first generation, in parts of a dimension: nearly all of it is within two.
const FIRST_DEVIATION: f64 = 0.3;
/// Deviation in parts of a dimension below which a search has arrived: a tenth of a millimetre of ten centimetres.
const ARRIVED: f64 = 1e-3;

/// The generations of a study.
#[derive(Clone, Debug, PartialEq)]
pub struct Evolution {
    dimensions: usize,
    population: usize,
    runs: usize,
    generations: usize,
    seed: u64,
}

impl Evolution {
    /// The generations of a method over so many dimensions.
    #[must_use]
    pub fn new(method: &StudyMethod, dimensions: usize) -> Self {
        let (population, runs) = (method.population.max(2), method.runs.max(1));
        let generations = method.designs / (population * runs);
        Self { dimensions, population, runs, generations, seed: method.seed }
    }

    /// Number of designs of a generation.
    #[must_use]
    pub const fn designs_per_generation_of_one_search(&self) -> usize {
        self.population
    }

    /// Number of searches beside each other.
    #[must_use]
    pub const fn searches_beside_each_other(&self) -> usize {
        self.runs
    }

    /// Number of generations of each search.
    #[must_use]
    pub const fn generations_per_search(&self) -> usize {
        self.generations
    }

    /// The points of the generation after those that are told: losses of each of their points, less being better. A search that has
    /// arrived begins anew elsewhere.
    #[must_use]
    pub fn points_of_next_generation_restarting_ended_search(
        &self,
        run_index: usize,
        losses_so_far: &[Vec<f64>],
    ) -> Vec<Vec<f64>> {
        if self.dimensions == 0 {
            return vec![Vec::new(); self.population];
        }
        let mut random = RandomSequence::new(self.seed, STREAM + run_index as u64);
        let (all, mut losses_so_far) = (losses_so_far.len(), losses_so_far.iter());
        loop {
            let middle = if run_index == 0 && losses_so_far.len() == all {
                vec![0.5; self.dimensions]
            } else {
                (0..self.dimensions).map(|_| random.next_between(0.2, 0.8)).collect()
            };
            let mut search = CovarianceAdaptation::new(middle, FIRST_DEVIATION, self.population);
            while !search.has_search_ended(ARRIVED) {
                let points = search.draw_generation_points(&mut random);
                let Some(values) = losses_so_far.next() else {
                    return points
                        .into_iter()
                        .map(|point| point.into_iter().map(fold_into_unit_interval).collect())
                        .collect();
                };
                search.update_from_generation_losses(values);
            }
        }
    }

    /// What each of some wishes counts in a run: all of one wish first, then between them.
    #[must_use]
    #[expect(clippy::cast_precision_loss, reason = "small counts")]
    pub fn wish_weights_of_run(&self, run_index: usize, wish_count: usize) -> Vec<f64> {
        let only = |wish: usize| (0..wish_count).map(|k| f64::from(u8::from(k == wish))).collect();
        match (wish_count, self.runs) {
            (0 | 1, _) => vec![1.0; wish_count],
            (2, 2..) => {
                let part = run_index as f64 / (self.runs - 1) as f64;
                vec![1.0 - part, part]
            }
            _ if run_index < wish_count => only(run_index),
            _ if run_index == wish_count => vec![1.0 / wish_count as f64; wish_count],
            _ => {
                // Evenly over the simplex.
                let mut random = RandomSequence::new(self.seed, STREAM.wrapping_sub(1 + run_index as u64));
                let parts: Vec<f64> = (0..wish_count).map(|_| -(1.0 - random.next_unit_number()).ln()).collect();
                let whole: f64 = parts.iter().sum();
                parts.into_iter().map(|part| part / whole).collect()
            }
        }
    }
}

/// A coordinate beyond an end as its mirror image there: the search knows no ends.
fn fold_into_unit_interval(coordinate: f64) -> f64 {
    let part = coordinate.rem_euclid(2.0);
    if part > 1.0 { 2.0 - part } else { part }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn evolution(dimensions: usize, population: usize, runs: usize) -> Evolution {
        Evolution { dimensions, population, runs, generations: 100, seed: 3 }
    }

    /// Through the same path as a study's: whole generations asked for, all values told.
    fn found(evolution: &Evolution, run: usize, generations: usize, of: impl Fn(&[f64]) -> f64) -> (Vec<f64>, f64) {
        let mut told: Vec<Vec<f64>> = Vec::new();
        let mut best = (Vec::new(), f64::INFINITY);
        for _ in 0..generations {
            let points = evolution.points_of_next_generation_restarting_ended_search(run, &told);
            assert_eq!(points.len(), evolution.designs_per_generation_of_one_search());
            let losses: Vec<f64> = points.iter().map(|point| of(point)).collect();
            for (point, loss) in points.iter().zip(&losses) {
                assert!(point.iter().all(|part| (0.0..=1.0).contains(part)));
                if *loss < best.1 {
                    best = (point.clone(), *loss);
                }
            }
            told.push(losses);
        }
        best
    }

    /// A long narrow valley off the middle, and one whose least is in a corner.
    #[test]
    fn known_optima_are_found() {
        let valley =
            |x: &[f64]| 100.0 * (x[1] - 0.3 - 0.5 * (x[0] - 0.7)).powi(2) + (x[0] - 0.7).powi(2) + (x[2] - 0.2).powi(2);
        let (at, loss) = found(&evolution(3, 10, 1), 0, 60, valley);
        assert!(loss < 1e-4, "{at:?} {loss}");
        for (part, wanted) in at.iter().zip([0.7, 0.3, 0.2]) {
            assert!((part - wanted).abs() < 0.02, "{at:?}");
        }
        let (at, _) = found(&evolution(2, 8, 1), 0, 40, |x| x[0] + 1.0 - x[1]);
        assert!(at[0] < 0.02 && at[1] > 0.98, "{at:?}");
    }

    /// One of two hollows is deeper: a search that ends in the other one begins anew.
    #[test]
    fn a_search_that_has_arrived_begins_again() {
        let hollow = |x: &[f64], at: f64| -(-((x[0] - at).powi(2) + (x[1] - at).powi(2)) / 0.06).exp();
        let (at, _) = found(&evolution(2, 8, 1), 0, 200, |x| hollow(x, 0.75) + 1.3 * hollow(x, 0.15));
        assert!((at[0] - 0.15).abs() < 0.02 && (at[1] - 0.15).abs() < 0.02, "{at:?}");
    }

    #[test]
    fn what_is_reported_makes_the_same_generations_again_and_other_ones_of_other_values() {
        let evolution = evolution(2, 6, 2);
        let first = evolution.points_of_next_generation_restarting_ended_search(1, &[]);
        let losses: Vec<f64> = first.iter().map(|point| point[0]).collect();
        let second = evolution.points_of_next_generation_restarting_ended_search(1, std::slice::from_ref(&losses));
        assert_eq!(evolution.points_of_next_generation_restarting_ended_search(1, &[]), first);
        assert_eq!(
            evolution.points_of_next_generation_restarting_ended_search(1, std::slice::from_ref(&losses)),
            second
        );
        let turned: Vec<f64> = losses.iter().map(|loss| -loss).collect();
        assert_ne!(evolution.points_of_next_generation_restarting_ended_search(1, &[turned]), second);
        assert_ne!(evolution.points_of_next_generation_restarting_ended_search(0, &[]), first);
    }

    #[test]
    fn weights_go_from_one_wish_to_the_other() {
        let two = evolution(2, 6, 3);
        assert_eq!(
            (0..3).map(|run| two.wish_weights_of_run(run, 2)).collect::<Vec<_>>(),
            [[1.0, 0.0], [0.5, 0.5], [0.0, 1.0]]
        );
        let many = evolution(2, 6, 9);
        for run in 0..9 {
            let weights = many.wish_weights_of_run(run, 3);
            assert!((weights.iter().sum::<f64>() - 1.0).abs() < 1e-12 && weights.iter().all(|part| *part >= 0.0));
        }
        assert_eq!(many.wish_weights_of_run(1, 3), [0.0, 1.0, 0.0]);
        assert_ne!(many.wish_weights_of_run(5, 3), many.wish_weights_of_run(6, 3));
    }

    #[test]
    fn nothing_to_search_is_no_endless_search() {
        assert_eq!(
            evolution(0, 6, 1).points_of_next_generation_restarting_ended_search(0, &[vec![1.0; 6]]),
            vec![Vec::<f64>::new(); 6]
        );
    }

    #[test]
    fn ends_are_mirrors() {
        assert_eq!([-0.25, 0.25, 1.25, 2.25, -1.5].map(fold_into_unit_interval), [0.25, 0.25, 0.75, 0.25, 0.5]);
    }
}
