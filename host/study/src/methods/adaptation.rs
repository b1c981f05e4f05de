//! Covariance matrix adaptation, (mu/mu_w, lambda)-CMA-ES with negative weights: appendix A of "The CMA Evolution Strategy: A Tutorial" by N. Hansen (arXiv 1604.00772v2).
//! The tests hold it against what is published of the reference implementation (c-cmaes, `doc.txt`).

use era_model::scene::random::RandomSequence;
use nalgebra::{DMatrix, DVector, SymmetricEigen};
use std::collections::VecDeque;
use std::f64::consts::TAU;

/// Greatest over least deviation, squared, from which on rounding decides where points are.
const MOST_CONDITION: f64 = 1e14;
/// Difference of values that is none.
const EQUAL_VALUES: f64 = 1e-12;

/// Where the next generation is looked for: a normal distribution.
#[derive(Clone, Debug)]
pub struct CovarianceAdaptation {
    rates: AdaptationRates,
    mean: DVector<f64>,
    step: f64,
    covariance: DMatrix<f64>,
    /// Its eigenvectors B, and the roots D of its eigenvalues.
    axes: DMatrix<f64>,
    lengths: DVector<f64>,
    path_of_step: DVector<f64>,
    path_of_covariance: DVector<f64>,
    /// Of the generation that was asked for: (x - mean) / step of each point.
    steps: Vec<DVector<f64>>,
    generations: i32,
    /// The best values of the last generations.
    best: VecDeque<f64>,
    is_degenerate: bool,
}

/// Weights and learning rates: they follow from the dimensions and the size of a generation alone.
#[derive(Clone, Debug)]
struct AdaptationRates {
    /// Of each point, the best first; negative ones of the worse half.
    weights: Vec<f64>,
    /// Effective selection mass mu_eff.
    effective_mass: f64,
    path_of_step: f64,
    damping: f64,
    path_of_covariance: f64,
    rank_one: f64,
    rank_mu: f64,
    /// Mean length of a normal vector.
    normal_length: f64,
}

impl AdaptationRates {
    #[expect(clippy::cast_precision_loss, reason = "small counts")]
    fn new(dimensions: usize, population: usize) -> Self {
        let (n, lambda) = (dimensions as f64, population as f64);
        let half = population / 2;
        // Weights before they are scaled.
        let raw: Vec<f64> = (1..=population).map(|i| ((lambda + 1.0) / 2.0).ln() - (i as f64).ln()).collect();
        let mass_of = |part: &[f64]| part.iter().sum::<f64>().powi(2) / part.iter().map(|w| w * w).sum::<f64>();
        let (mass, mass_of_worse) = (mass_of(&raw[..half]), mass_of(&raw[half..]));
        // Learning rates.
        let path_of_step = (mass + 2.0) / (n + mass + 5.0);
        let damping = 1.0 + 2.0 * (((mass - 1.0) / (n + 1.0)).sqrt() - 1.0).max(0.0) + path_of_step;
        let path_of_covariance = (4.0 + mass / n) / (n + 4.0 + 2.0 * mass / n);
        let rank_one = 2.0 / ((n + 1.3).powi(2) + mass);
        let rank_mu = (2.0 * (0.25 + mass + 1.0 / mass - 2.0) / ((n + 2.0).powi(2) + mass)).min(1.0 - rank_one);
        // Weights: the better half's sum to one, the worse half's to as much as leaves the covariance positive definite.
        let positive: f64 = raw.iter().filter(|w| **w > 0.0).sum();
        let negative: f64 = -raw.iter().filter(|w| **w < 0.0).sum::<f64>();
        let least = (1.0 + rank_one / rank_mu)
            .min(1.0 + 2.0 * mass_of_worse / (mass + 2.0))
            .min((1.0 - rank_one - rank_mu) / (n * rank_mu));
        let weights = raw.iter().map(|w| if *w >= 0.0 { w / positive } else { w * least / negative }).collect();
        let normal_length = n.sqrt() * (1.0 - 1.0 / (4.0 * n) + 1.0 / (21.0 * n * n));
        Self {
            weights,
            effective_mass: mass,
            path_of_step,
            damping,
            path_of_covariance,
            rank_one,
            rank_mu,
            normal_length,
        }
    }
}

impl CovarianceAdaptation {
    /// A search that begins around `mean` with the deviation `step` in every dimension, both in units of the coordinates; `population` is the number of
    /// points of a generation, two or more.
    pub fn new(mean: Vec<f64>, step: f64, population: usize) -> Self {
        let n = mean.len();
        Self {
            rates: AdaptationRates::new(n, population),
            mean: DVector::from_vec(mean),
            step,
            covariance: DMatrix::identity(n, n),
            axes: DMatrix::identity(n, n),
            lengths: DVector::from_element(n, 1.0),
            path_of_step: DVector::zeros(n),
            path_of_covariance: DVector::zeros(n),
            steps: Vec::new(),
            generations: 0,
            best: VecDeque::new(),
            is_degenerate: false,
        }
    }

    /// Draws the next generation: population x dimensions coordinates.
    pub fn draw_generation_points(&mut self, random: &mut RandomSequence) -> Vec<Vec<f64>> {
        let n = self.mean.len();
        let of = |_| &self.axes * self.lengths.component_mul(&DVector::from_fn(n, |_, _| draw_normal(random)));
        self.steps = (0..self.rates.weights.len()).map(of).collect();
        self.steps.iter().map(|step| (&self.mean + self.step * step).iter().copied().collect()).collect()
    }

    /// Learns from a value for each point of the generation that was drawn last, less being better.
    pub fn update_from_generation_losses(&mut self, losses: &[f64]) {
        let mut order: Vec<usize> = (0..self.steps.len()).collect();
        let value = |point: &usize| losses.get(*point).copied().unwrap_or(f64::INFINITY);
        order.sort_by(|a, b| value(a).total_cmp(&value(b)));
        let ranked: Vec<&DVector<f64>> = order.iter().map(|point| &self.steps[*point]).collect();
        let (rates, n) = (&self.rates, self.mean.len());
        self.generations += 1;
        // Selection and recombination.
        let zero = DVector::zeros(n);
        let better = rates.weights.iter().zip(&ranked).filter(|(weight, _)| **weight > 0.0);
        let mean_step = better.fold(zero, |sum, (weight, step)| sum + *weight * *step);
        self.mean += self.step * &mean_step;
        // Path of the step size.
        let unscaled = |step: &DVector<f64>| &self.axes * self.axes.tr_mul(step).component_div(&self.lengths);
        let rate = rates.path_of_step;
        self.path_of_step = (1.0 - rate) * &self.path_of_step
            + (rate * (2.0 - rate) * rates.effective_mass).sqrt() * unscaled(&mean_step);
        let length = self.path_of_step.norm();
        // Path of the covariance, which waits while the step size grows fast.
        let expected = (1.0 - (1.0 - rate).powi(2 * (self.generations + 1))).sqrt();
        #[expect(clippy::cast_precision_loss, reason = "a small count")]
        let is_short = length / expected < (1.4 + 2.0 / (n as f64 + 1.0)) * rates.normal_length;
        let rate = rates.path_of_covariance;
        self.path_of_covariance *= 1.0 - rate;
        if is_short {
            self.path_of_covariance += (rate * (2.0 - rate) * rates.effective_mass).sqrt() * &mean_step;
        }
        // Rank-one and rank-mu update.
        let missing = if is_short { 0.0 } else { rate * (2.0 - rate) };
        let sum: f64 = rates.weights.iter().sum();
        self.covariance *= 1.0 + rates.rank_one * missing - rates.rank_one - rates.rank_mu * sum;
        let path = &self.path_of_covariance;
        self.covariance.ger(rates.rank_one, path, path, 1.0);
        for (weight, step) in rates.weights.iter().zip(&ranked) {
            #[expect(clippy::cast_precision_loss, reason = "a small count")]
            let weight = if *weight >= 0.0 { *weight } else { weight * n as f64 / unscaled(step).norm_squared() };
            self.covariance.ger(rates.rank_mu * weight, step, step, 1.0);
        }
        self.step *= (rates.path_of_step / rates.damping * (length / rates.normal_length - 1.0)).exp();
        self.record_best_loss_of_generation(order.first().map_or(f64::INFINITY, value));
        self.update_covariance_axes_or_mark_degenerate();
    }

    /// Generations over which a best value that stays the same ends a search (appendix B.3, EqualFunValues).
    fn flat_generations_that_end_search(&self) -> usize {
        11 + (30 * self.mean.len()).div_ceil(self.rates.weights.len())
    }

    fn record_best_loss_of_generation(&mut self, best_loss: f64) {
        if self.best.len() == self.flat_generations_that_end_search() {
            self.best.pop_front();
        }
        self.best.push_back(best_loss);
    }

    fn update_covariance_axes_or_mark_degenerate(&mut self) {
        let covariance = 0.5 * (&self.covariance + self.covariance.transpose());
        let is_finite =
            self.step.is_finite() && covariance.iter().chain(self.mean.iter()).all(|value| value.is_finite());
        if !is_finite {
            self.is_degenerate = true;
            return;
        }
        let eigen = SymmetricEigen::new(covariance.clone());
        let (least, most) = (eigen.eigenvalues.min(), eigen.eigenvalues.max());
        self.is_degenerate = !(least > 0.0 && most < MOST_CONDITION * least);
        if !self.is_degenerate {
            (self.axes, self.lengths, self.covariance) =
                (eigen.eigenvectors, eigen.eigenvalues.map(f64::sqrt), covariance);
        }
    }

    /// Whether deviations are below `converged_deviation` in every dimension, or nothing more is learnt (appendix B.3: TolX, EqualFunValues, ConditionCov).
    pub fn has_search_ended(&self, converged_deviation: f64) -> bool {
        let deviations = self.covariance.diagonal().map(f64::sqrt);
        let paths = self.path_of_covariance.abs();
        let is_near =
            deviations.iter().chain(paths.iter()).all(|deviation| self.step * deviation < converged_deviation);
        let is_flat = self.best.len() == self.flat_generations_that_end_search() && {
            let (least, most) = self
                .best
                .iter()
                .fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), best| (low.min(*best), high.max(*best)));
            most - least <= EQUAL_VALUES * least.abs().max(EQUAL_VALUES) || least == f64::INFINITY
        };
        self.is_degenerate || is_near || is_flat
    }
}

/// A normal deviate of mean 0 and deviation 1 (Box and Muller 1958).
fn draw_normal(random: &mut RandomSequence) -> f64 {
    (-2.0 * (1.0 - random.next_unit_number()).ln()).sqrt() * (TAU * random.next_unit_number()).cos()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Counts the generations, of the default size, until a function is below 1e-9 from (3, 3, ...) with a deviation of 1; with the search as it is then.
    fn count_generations(n: usize, of: impl Fn(&[f64]) -> f64) -> (usize, CovarianceAdaptation) {
        let mut random = RandomSequence::new(7, 7);
        #[expect(
            clippy::cast_possible_truncation,
            clippy::cast_sign_loss,
            clippy::cast_precision_loss,
            reason = "the usual size"
        )]
        let population = 4 + (3.0 * (n as f64).ln()) as usize;
        let mut search = CovarianceAdaptation::new(vec![3.0; n], 1.0, population);
        for generation in 1..4000 {
            let values: Vec<f64> = search.draw_generation_points(&mut random).iter().map(|point| of(point)).collect();
            if values.iter().any(|value| *value < 1e-9) {
                return (generation, search);
            }
            search.update_from_generation_losses(&values);
        }
        panic!("not found");
    }

    /// A valley a thousand times as long as it is narrow, and turned, as against a sphere. Published with the reference implementation: a search takes between
    /// 100 n and 300 n^2 values, and the covariance learns the inverse of the curvature.
    #[test]
    fn narrow_turned_valleys_are_learnt() {
        const N: usize = 10;
        let (sphere, _) = count_generations(N, |x| x.iter().map(|part| part * part).sum());
        let (turned, search) = count_generations(N, |x| {
            let sum: f64 = x.iter().sum();
            // Reflection about the diagonal: as good as any turn.
            let y = x.iter().map(|part| part - 2.0 * sum / 10.0);
            y.zip(0_i32..).map(|(part, i)| 10_f64.powf(6.0 * f64::from(i) / 9.0) * part * part).sum()
        });
        let values = 100 * N..300 * N * N;
        assert!(values.contains(&(10 * sphere)) && values.contains(&(10 * turned)), "{sphere} {turned}");
        assert!(turned < 8 * sphere, "{sphere} {turned}");
        let ratio = search.lengths.max() / search.lengths.min();
        assert!((300.0..3000.0).contains(&ratio), "{ratio}");
    }

    /// Weights of the better half sum to one and fall from the best on; what is learnt is no more than all.
    #[test]
    fn weights_sum_as_they_should() {
        for (n, population) in [(1, 4), (2, 6), (3, 10), (10, 10), (40, 15)] {
            let rates = AdaptationRates::new(n, population);
            let better: f64 = rates.weights.iter().filter(|weight| **weight > 0.0).sum();
            assert!((better - 1.0).abs() < 1e-12 && rates.weights.is_sorted_by(|a, b| a >= b), "{n}");
            assert!(rates.rank_one + rates.rank_mu <= 1.0 + 1e-12 && rates.effective_mass >= 1.0, "{n}");
        }
    }

    /// A plain and values that nobody has: it ends, and does not go on with numbers that are none.
    #[test]
    fn where_nothing_is_learnt_it_ends() {
        for value in [1.0, f64::INFINITY, f64::NAN] {
            let (mut search, mut random) =
                (CovarianceAdaptation::new(vec![0.5, 0.5], 0.3, 6), RandomSequence::new(1, 1));
            let mut count = 0;
            while !search.has_search_ended(1e-3) {
                assert!(search.draw_generation_points(&mut random).iter().flatten().all(|part| part.is_finite()));
                search.update_from_generation_losses(&[value; 6]);
                count += 1;
                assert!(count < 1000);
            }
        }
    }
}
