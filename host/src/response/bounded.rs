//! Response curves with a bound on their error.

use super::sweep::{Arithmetic, SurfaceShapes, Sweep};
use super::{ResponseError, acceleration_curves};
use crate::model::bounded::{HIDDEN_IN_RESPONSES, Question, RESPONSE_SAFETY, Rounding, SHARPEST, bounded};
use crate::model::{Accuracy, Bounded, ModelError, PanelModel};
use crate::scene::Scene;
use num_complex::Complex64;
use std::marker::PhantomData;

/// Acceleration, relative to that of the surface under the same force, which is as good as none.
const NOTHING: f64 = 1e-6;
/// Tolerance that a sweep meets with the usual number of modes.
const RESIDUALS_DO: f64 = 1e-3;
/// Error of a product over the rounding of its numbers, relative to the largest value on a curve: sums of dozens of terms
/// that are up to a few times larger than what they add up to.
const ARITHMETIC: f64 = 50.0;

/// Acceleration at one point for 1 N at each actuator alone.
struct Curves<'a> {
    /// Below this a curve is what rounding makes of none, in m/s^2.
    nothing: f64,
    at: (f64, f64),
    frequencies_hz: &'a [f64],
    max_hz: f64,
}

/// Acceleration at all points of a grid for 1 N at each actuator alone.
struct Surface<'a, T> {
    scene: &'a Scene,
    nothing: f64,
    x_m: &'a [f64],
    y_m: &'a [f64],
    frequencies_hz: &'a [f64],
    /// What the model is reduced for.
    modes_hz: f64,
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

impl Question for Curves<'_> {
    type Answer = Vec<Vec<Complex64>>;
    type Error = CurveError;

    fn ask(&self, model: &PanelModel) -> Result<Self::Answer, CurveError> {
        let reduced = model.reduce(self.max_hz, &[self.at])?;
        let shape = reduced.shape_at(self.at.0, self.at.1);
        Ok(acceleration_curves(&reduced, &shape, self.frequencies_hz)?)
    }

    /// For each actuator, relative to the largest magnitude on its curve.
    fn differences(&self, coarse: &Self::Answer, fine: &Self::Answer) -> Vec<f64> {
        let nothing = self.nothing;
        let relative = |(coarse, fine): (&Vec<Complex64>, &Vec<Complex64>)| {
            let peak = fine.iter().map(|z| z.norm()).fold(0.0, f64::max);
            let difference = coarse.iter().zip(fine).map(|(a, b)| (a - b).norm()).fold(0.0, f64::max);
            if difference == 0.0 { 0.0 } else { difference / peak.max(nothing) }
        };
        coarse.iter().zip(fine).map(relative).collect()
    }

    fn safety(&self) -> f64 {
        RESPONSE_SAFETY
    }

    fn hidden(&self) -> f64 {
        HIDDEN_IN_RESPONSES
    }

    fn floors(&self, fine: &Self::Answer, rounding: Rounding) -> Vec<f64> {
        vec![SHARPEST * rounding.of_bending(); fine.len()]
    }
}

impl<T: Arithmetic + Into<f64>> Question for Surface<'_, T> {
    type Answer = Sweep<T>;
    type Error = CurveError;

    fn ask(&self, model: &PanelModel) -> Result<Self::Answer, CurveError> {
        let reduced = model.reduce(self.modes_hz, &[])?;
        Ok(SurfaceShapes::new(self.scene, &reduced, self.x_m, self.y_m).sweep(self.frequencies_hz)?)
    }

    /// For each actuator, the largest over the points of the difference relative to the largest magnitude on the point's curve.
    fn differences(&self, coarse: &Self::Answer, fine: &Self::Answer) -> Vec<f64> {
        (0..fine.actuators)
            .map(|actuator| {
                let mut curves = vec![(0.0_f64, 0.0_f64); fine.points];
                for frequency in 0..self.frequencies_hz.len() {
                    let (fine, coarse) = (fine.field(frequency, actuator), coarse.field(frequency, actuator));
                    for ((difference, peak), (fine, coarse)) in curves.iter_mut().zip(fine.zip(coarse)) {
                        *difference = difference.max((fine - coarse).norm_sqr());
                        *peak = peak.max(fine.norm_sqr());
                    }
                }
                let relative = |(difference, peak): &(f64, f64)| difference.sqrt() / peak.sqrt().max(self.nothing);
                curves.iter().map(relative).fold(0.0, f64::max)
            })
            .collect()
    }

    fn safety(&self) -> f64 {
        RESPONSE_SAFETY
    }

    fn hidden(&self) -> f64 {
        HIDDEN_IN_RESPONSES
    }

    fn floors(&self, fine: &Self::Answer, rounding: Rounding) -> Vec<f64> {
        vec![SHARPEST * rounding.of_bending() + ARITHMETIC * T::ROUNDING; fine.actuators]
    }
}

/// Acceleration in m/s^2 at the points of the grid of columns `x_m` and rows `y_m` (m) for 1 N at each actuator alone, and
/// for each actuator a bound on the error at any point, relative to the largest magnitude on that point's curve.
///
/// # Errors
/// [`CurveError`].
pub fn bounded_sweep<T: Arithmetic + Into<f64>>(
    scene: &Scene,
    accuracy: Accuracy,
    (x_m, y_m): (&[f64], &[f64]),
    frequencies_hz: &[f64],
) -> Result<Bounded<Sweep<T>>, CurveError> {
    let max_hz = frequencies_hz.iter().copied().fold(1.0, f64::max);
    // There are residual shapes of the actuators but not of every point: what the modes leave out falls with the sixth power
    // of how far they reach, not the eighth, and for tolerances below 1e-3 that is what is missing.
    let modes_hz = max_hz * (RESIDUALS_DO / accuracy.value()).powf(1.0 / 6.0).max(1.0);
    let question =
        Surface { scene, nothing: nothing(scene), x_m, y_m, frequencies_hz, modes_hz, arithmetic: PhantomData::<T> };
    bounded(&question, scene, accuracy, max_hz)
}

/// Acceleration in m/s^2 that counts as none: a millionth of that of the whole surface under 1 N.
fn nothing(scene: &Scene) -> f64 {
    NOTHING / scene.mass_kg()
}

/// Acceleration in m/s^2 at `at` (m) for 1 N at each actuator alone, `answer[actuator][frequency]`, and for each actuator a
/// bound relative to the largest magnitude on its curve.
///
/// # Errors
/// [`CurveError`].
pub fn bounded_curves(
    scene: &Scene,
    accuracy: Accuracy,
    at: (f64, f64),
    frequencies_hz: &[f64],
) -> Result<Bounded<Vec<Vec<Complex64>>>, CurveError> {
    let max_hz = frequencies_hz.iter().copied().fold(1.0, f64::max);
    bounded(&Curves { nothing: nothing(scene), at, frequencies_hz, max_hz }, scene, accuracy, max_hz)
}
