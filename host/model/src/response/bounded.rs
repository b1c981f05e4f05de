//! Response curves with a bound on their error.

use super::sweep::{AccelerationSweep, Arithmetic, SurfaceShapes};
use super::{ResponseError, compute_acceleration_curves_per_newton};
use crate::model::bounded::{ComparedValues, RefinableQuestion, answer_with_error_bounds};
use crate::model::estimator::{FrequencyRounding, SHARPEST};
use crate::model::{Accuracy, BoundedAnswer, ModelError, PanelModel};
use crate::scene::Scene;
use num_complex::Complex64;
use std::marker::PhantomData;

/// Tolerance from which on single precision does for a sweep: its own error is 6e-6 of a curve's peak at most.
pub const SINGLE_DOES: f64 = 1e-5;
/// Most values of a sweep: 1.6 GB in single precision, three levels of them at once.
pub const MOST_SWEEP_VALUES: f64 = 7e7;
/// Values of a sweep that are compared at least, where it has more: from one level to the next errors change slowly along
/// the surface (waves are several points long), so that a lattice shows the largest.
const COMPARED: usize = 100_000;
/// Points along a side that are compared at least.
const LEAST_ALONG: usize = 9;
/// Largest difference at any point over the largest at the points compared: 1.05 at most on the random scenes of
/// `host/model/tests/numerics/sweep.rs`.
const BETWEEN_POINTS: f64 = 1.25;

/// Acceleration, relative to that of the surface under the same force, which is as good as none.
const NOTHING: f64 = 1e-6;
/// Tolerance that a sweep meets with the usual number of modes.
const RESIDUALS_DO: f64 = 1e-3;
/// The same for a sweep that has a time instead of a tolerance.
const WITHIN_TIME: f64 = 1e-4;
/// Error of a product over the rounding of its numbers, relative to the largest value on a curve: sums of dozens of terms
/// that are up to a few times larger than what they add up to.
const ARITHMETIC: f64 = 50.0;

/// Frequencies asked for, below which others beside them are compared as well: at a single one, two levels may agree by chance
/// (a patch's corners: 9e-5 between orders 9 and 11, 2e-4 between 11 and 13), as their difference passes through zero there.
const FEW: usize = 16;
/// The others, as multiples of each.
const BESIDE: [f64; 6] = [0.95, 0.985, 0.995, 1.005, 1.015, 1.05];
/// What is compared there is relative to the curve's peak, or to this part of itself beside a resonance.
const PART_BESIDE: f64 = 0.5;

/// Acceleration at one point for 1 N at each actuator alone.
struct PointCurvesQuestion {
    /// Below this a curve is what rounding makes of none, in m/s^2.
    nothing: f64,
    at: (f64, f64),
    /// Those asked for, and those that are compared only.
    frequencies_hz: Vec<f64>,
    /// How many were asked for.
    asked: usize,
    max_hz: f64,
}

/// Acceleration at all points of a grid for 1 N at each actuator alone.
struct SurfaceSweepQuestion<'a, T> {
    scene: &'a Scene,
    nothing: f64,
    x_m: &'a [f64],
    y_m: &'a [f64],
    frequencies_hz: &'a [f64],
    /// What the model is reduced for.
    modes_hz: f64,
    /// Columns and rows that are compared.
    compared: [Vec<usize>; 2],
    arithmetic: PhantomData<T>,
}

/// Why there are no curves.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum CurveError {
    /// No model.
    #[error(transparent)]
    Model(#[from] ModelError),
    /// No response.
    #[error(transparent)]
    Response(#[from] ResponseError),
}

impl RefinableQuestion for PointCurvesQuestion {
    type Answer = Vec<Vec<Complex64>>;
    type Error = CurveError;

    fn answer_from_model(&self, model: &PanelModel) -> Result<Self::Answer, CurveError> {
        let reduced = model.reduce_with_residual_shapes_of_actuators_damping_and_points(self.max_hz, &[self.at])?;
        let shape = reduced.shape_deflections_at(self.at.0, self.at.1);
        // One beside those asked for may be an undamped resonance.
        let (asked, all) = (&self.frequencies_hz[..self.asked], &self.frequencies_hz);
        Ok(compute_acceleration_curves_per_newton(&reduced, &shape, all)
            .or_else(|_| compute_acceleration_curves_per_newton(&reduced, &shape, asked))?)
    }

    /// For each actuator, relative to the largest magnitude on its curve; beside the frequencies asked for, to half of what is
    /// there if that is more.
    fn relative_difference_of_each_part(&self, coarse: &Self::Answer, fine: &Self::Answer) -> Vec<f64> {
        let nothing = self.nothing;
        let relative = |(coarse, fine): (&Vec<Complex64>, &Vec<Complex64>)| {
            let peak = fine.iter().take(self.asked).map(|z| z.norm()).fold(nothing, f64::max);
            let relative = |(coarse, fine): (&Complex64, &Complex64)| {
                let difference = (coarse - fine).norm();
                if difference == 0.0 { 0.0 } else { difference / peak.max(PART_BESIDE * fine.norm()) }
            };
            coarse.iter().zip(fine).map(relative).fold(0.0, f64::max)
        };
        coarse.iter().zip(fine).map(relative).collect()
    }

    fn kind_of_compared_values(&self) -> ComparedValues {
        if self.asked < FEW { ComparedValues::FewResponses } else { ComparedValues::Curves }
    }

    fn error_floor_of_each_part(&self, fine: &Self::Answer, rounding: FrequencyRounding) -> Vec<f64> {
        vec![SHARPEST * rounding.relative_frequency_error_of_bending_modes_no_finer_mesh_removes(); fine.len()]
    }
}

impl<T: Arithmetic + Into<f64>> SurfaceSweepQuestion<'_, T> {
    /// The sweep that a model of one level gives at the points of a grid.
    fn sweep_model_on_grid(
        &self,
        model: &PanelModel,
        x_m: &[f64],
        y_m: &[f64],
    ) -> Result<AccelerationSweep<T>, CurveError> {
        let reduced = model.reduce_with_residual_shapes_of_actuators_damping_and_points(self.modes_hz, &[])?;
        Ok(SurfaceShapes::new(self.scene, &reduced, x_m, y_m)
            .compute_accelerations_per_newton_at_all_points(self.frequencies_hz)?)
    }

    /// Where a sweep, of all points or of those compared, has the points compared.
    fn indices_of_compared_points(&self, sweep: &AccelerationSweep<T>) -> Vec<usize> {
        let [columns, rows] = &self.compared;
        if sweep.points == columns.len() * rows.len() {
            return (0..sweep.points).collect();
        }
        rows.iter().flat_map(|row| columns.iter().map(move |column| row * self.x_m.len() + column)).collect()
    }
}

/// Indices of `count` lines that are evenly spread, both ends among them and mirror images of each other.
fn choose_evenly_spread_mirrored_line_indices(count: usize, fraction: f64) -> Vec<usize> {
    #[allow(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        clippy::cast_precision_loss,
        reason = "small counts, and `as` saturates"
    )]
    let wanted = ((count as f64 * fraction).ceil() as usize).max(LEAST_ALONG);
    if wanted >= count {
        return (0..count).collect();
    }
    let last = count - 1;
    let half = (wanted - 1) / 2;
    // From both ends towards the middle, so that a symmetrical grid stays one.
    let mut out: Vec<usize> = (0..=half).map(|k| k * last / (2 * half.max(1))).collect();
    let mirrored: Vec<usize> = out.iter().rev().map(|k| last - k).collect();
    out.extend(mirrored);
    out.dedup();
    out
}

impl<T: Arithmetic + Into<f64>> RefinableQuestion for SurfaceSweepQuestion<'_, T> {
    type Answer = AccelerationSweep<T>;
    type Error = CurveError;

    fn answer_from_model(&self, model: &PanelModel) -> Result<Self::Answer, CurveError> {
        self.sweep_model_on_grid(model, self.x_m, self.y_m)
    }

    /// At the points that are compared only.
    fn answer_enough_for_comparison(&self, model: &PanelModel) -> Result<Self::Answer, CurveError> {
        let of = |all: &[f64], which: &[usize]| which.iter().map(|k| all[*k]).collect::<Vec<_>>();
        self.sweep_model_on_grid(model, &of(self.x_m, &self.compared[0]), &of(self.y_m, &self.compared[1]))
    }

    /// For each actuator, the largest over the points compared of the difference relative to the largest magnitude on the
    /// point's curve.
    fn relative_difference_of_each_part(&self, coarse: &Self::Answer, fine: &Self::Answer) -> Vec<f64> {
        let (coarse_at, fine_at) = (self.indices_of_compared_points(coarse), self.indices_of_compared_points(fine));
        let is_all = fine_at.len() == self.x_m.len() * self.y_m.len();
        let safety = if is_all { 1.0 } else { BETWEEN_POINTS };
        (0..fine.actuators)
            .map(|actuator| {
                let mut curves = vec![(0.0_f64, 0.0_f64); fine_at.len()];
                for frequency in 0..self.frequencies_hz.len() {
                    let places = coarse_at.iter().zip(&fine_at);
                    for ((difference, peak), (coarse_at, fine_at)) in curves.iter_mut().zip(places) {
                        let fine = fine.acceleration_per_newton_as_f64(frequency, actuator, *fine_at);
                        *difference = difference.max(
                            (fine - coarse.acceleration_per_newton_as_f64(frequency, actuator, *coarse_at)).norm_sqr(),
                        );
                        *peak = peak.max(fine.norm_sqr());
                    }
                }
                let relative = |(difference, peak): &(f64, f64)| difference.sqrt() / peak.sqrt().max(self.nothing);
                safety * curves.iter().map(relative).fold(0.0, f64::max)
            })
            .collect()
    }

    fn kind_of_compared_values(&self) -> ComparedValues {
        let [columns, rows] = &self.compared;
        let compared = columns.len() * rows.len() * self.frequencies_hz.len();
        if compared < FEW { ComparedValues::FewResponses } else { ComparedValues::Curves }
    }

    fn error_floor_of_each_part(&self, fine: &Self::Answer, rounding: FrequencyRounding) -> Vec<f64> {
        vec![
            SHARPEST * rounding.relative_frequency_error_of_bending_modes_no_finer_mesh_removes()
                + ARITHMETIC * T::ROUNDING;
            fine.actuators
        ]
    }
}

/// Acceleration in m/s^2 at the points of the grid of columns `x_m` and rows `y_m` (m) for 1 N at each actuator alone, and
/// for each actuator a bound on the error at any point, relative to the largest magnitude on that point's curve.
///
/// # Errors
/// [`CurveError`].
pub fn compute_acceleration_sweep_per_newton_with_error_bounds<T: Arithmetic + Into<f64>>(
    scene: &Scene,
    accuracy: Accuracy,
    (x_m, y_m): (&[f64], &[f64]),
    frequencies_hz: &[f64],
) -> Result<BoundedAnswer<AccelerationSweep<T>>, CurveError> {
    let max_hz = frequencies_hz.iter().copied().fold(1.0, f64::max);
    // There are residual shapes of the actuators but not of every point: what the modes leave out falls with the sixth power
    // of how far they reach, not the eighth, and for tolerances below 1e-3 that is what is missing.
    let tolerance =
        if accuracy.time_limit().is_some() { WITHIN_TIME } else { accuracy.relative_tolerance_or_tightest() };
    let modes_hz = max_hz * (RESIDUALS_DO / tolerance).powf(1.0 / 6.0).max(1.0);
    #[expect(clippy::cast_precision_loss, reason = "far below 2^52")]
    let part = {
        let values = (x_m.len() * y_m.len() * frequencies_hz.len() * scene.actuators.len()).max(1) as f64;
        (COMPARED as f64 / values).sqrt().min(1.0)
    };
    let compared = [
        choose_evenly_spread_mirrored_line_indices(x_m.len(), part),
        choose_evenly_spread_mirrored_line_indices(y_m.len(), part),
    ];
    let question = SurfaceSweepQuestion {
        scene,
        nothing: negligible_acceleration_m_per_s2(scene),
        x_m,
        y_m,
        frequencies_hz,
        modes_hz,
        compared,
        arithmetic: PhantomData::<T>,
    };
    answer_with_error_bounds(&question, scene, accuracy, max_hz)
}

/// Acceleration in m/s^2 that counts as none: a millionth of that of the whole surface under 1 N.
fn negligible_acceleration_m_per_s2(scene: &Scene) -> f64 {
    NOTHING / scene.surface_mass_with_air_kg()
}

/// Acceleration in m/s^2 at `at` (m) for 1 N at each actuator alone, `answer[actuator][frequency]`, and for each actuator a
/// bound relative to the largest magnitude on its curve.
///
/// # Errors
/// [`CurveError`].
pub fn compute_acceleration_curves_per_newton_with_error_bounds(
    scene: &Scene,
    accuracy: Accuracy,
    at: (f64, f64),
    frequencies_hz: &[f64],
) -> Result<BoundedAnswer<Vec<Vec<Complex64>>>, CurveError> {
    let max_hz = frequencies_hz.iter().copied().fold(1.0, f64::max);
    let asked = frequencies_hz.len();
    let mut all = frequencies_hz.to_vec();
    if asked < FEW {
        all.extend(frequencies_hz.iter().flat_map(|hz| BESIDE.map(|part| part * hz)));
    }
    let question = PointCurvesQuestion {
        nothing: negligible_acceleration_m_per_s2(scene),
        at,
        frequencies_hz: all,
        asked,
        max_hz,
    };
    let mut found = answer_with_error_bounds(&question, scene, accuracy, max_hz)?;
    found.answer.iter_mut().for_each(|curve| curve.truncate(asked));
    Ok(found)
}

#[cfg(test)]
mod tests {
    use super::choose_evenly_spread_mirrored_line_indices;

    #[test]
    fn a_lattice_has_both_ends_and_is_its_own_mirror_image() {
        for count in [1, 2, 9, 10, 33, 49, 50, 201] {
            for part in [0.01, 0.2, 0.5, 1.0] {
                let at = choose_evenly_spread_mirrored_line_indices(count, part);
                assert_eq!((at[0], at[at.len() - 1]), (0, count - 1), "{count} {part}");
                assert!(at.windows(2).all(|pair| pair[0] < pair[1]), "{at:?}");
                assert!(at.iter().eq(at.iter().rev().map(|k| count - 1 - k).collect::<Vec<_>>().iter()), "{at:?}");
            }
        }
    }
}
