//! Response curves with a bound on their error.

use super::{ResponseError, acceleration_curves};
use crate::model::bounded::{Question, RESPONSE_SAFETY, SHARPEST, bounded};
use crate::model::{Accuracy, Bounded, ModelError, PanelModel};
use crate::scene::Scene;
use num_complex::Complex64;

/// Acceleration, relative to that of the surface under the same force, which is as good as none.
const NOTHING: f64 = 1e-6;

/// Acceleration at one point for 1 N at each actuator alone.
struct Curves<'a> {
    /// Below this a curve is what rounding makes of none, in m/s^2.
    nothing: f64,
    at: (f64, f64),
    frequencies_hz: &'a [f64],
    max_hz: f64,
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

    fn floors(&self, fine: &Self::Answer, rounding: f64) -> Vec<f64> {
        vec![SHARPEST * rounding; fine.len()]
    }
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
    // A force of 1 N on the whole surface, a millionth of which counts as none.
    let surface = &scene.surface;
    let mass = surface.material.density_kg_m3 * surface.thickness_m * surface.length_m * surface.width_m;
    let nothing = NOTHING / mass;
    bounded(&Curves { nothing, at, frequencies_hz, max_hz }, scene, accuracy, max_hz)
}
