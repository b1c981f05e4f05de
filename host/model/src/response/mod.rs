//! Harmonic response: equations 9 to 15 and 22, 23 of the thesis, in the reduced model's coordinates and with complex
//! phasors in place of the p cos + q sin pairs (u = p - j q).

use crate::model::ReducedModel;
use nalgebra::DVector;
use num_complex::Complex64;
use rayon::prelude::*;

mod bounded;
mod coordinates;
mod elimination;
mod mirror;
mod peak;
pub mod sweep;

pub use bounded::{
    CurveError, MOST_SWEEP_VALUES, SINGLE_DOES, compute_acceleration_curves_per_newton_with_error_bounds,
    compute_acceleration_sweep_per_newton_with_error_bounds,
};
pub use coordinates::{CoordinateSolver, solve_coordinates_per_newton_at_frequency};
pub use peak::{SineComponent, peak_of_sines_merging_equal_frequencies};

/// Why there is no response.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum ResponseError {
    /// Undamped and at a resonance: the response grows without bound (thesis, after equation 15).
    #[error(
        "at {frequency_hz} Hz the response of the panel is unbounded, because an undamped mode has its resonance at \
         {resonance_hz} Hz: add damping to the scene (such as surface.damping.loss_factor), or omit this frequency"
    )]
    Unbounded {
        /// The frequency asked for.
        frequency_hz: f64,
        /// The mode's.
        resonance_hz: f64,
    },
}

impl ResponseError {
    /// Whether this is about one frequency, so that others may have an answer.
    #[must_use]
    pub const fn is_unbounded(&self) -> bool {
        matches!(self, ResponseError::Unbounded { .. })
    }
}

/// Acceleration in m/s^2 at one point for 1 N at each actuator alone: `curves[actuator][frequency]`.
///
/// # Errors
/// [`ResponseError::Unbounded`] at the first frequency that has no answer.
pub fn compute_acceleration_curves_per_newton(
    model: &ReducedModel,
    shape: &DVector<f64>,
    frequencies_hz: &[f64],
) -> Result<Vec<Vec<Complex64>>, ResponseError> {
    let solver = CoordinateSolver::new(model);
    let rows: Vec<Vec<Complex64>> = frequencies_hz
        .par_iter()
        .map(|frequency_hz| {
            // At rest: a constant force accelerates nothing that is held, and a free panel's w^2 q is taken from its limit.
            let minus_omega_squared = -(std::f64::consts::TAU * frequency_hz).powi(2);
            if *frequency_hz == 0.0 {
                return Ok(acceleration_per_newton_of_each_actuator_at_zero_frequency(model, shape));
            }
            let coordinates = solver.solve_coordinates_per_newton_at(*frequency_hz)?;
            Ok(coordinates.iter().map(|q| multiply_shape_with_coordinates(shape, q) * minus_omega_squared).collect())
        })
        .collect::<Result<_, _>>()?;
    Ok((0..model.count_actuators()).map(|actuator| rows.iter().map(|row| row[actuator]).collect()).collect())
}

/// The acceleration as the frequency goes to zero: that of the rigid motions, F / m and what turns with it.
fn acceleration_per_newton_of_each_actuator_at_zero_frequency(
    model: &ReducedModel,
    shape: &DVector<f64>,
) -> Vec<Complex64> {
    (0..model.count_actuators())
        .map(|actuator| {
            let rigid =
                (0..model.count_coordinates()).filter(|i| model.lambda[*i] == 0.0 && model.viscous[(*i, *i)] == 0.0);
            Complex64::from(rigid.map(|i| shape[i] * model.force[(i, actuator)]).sum::<f64>())
        })
        .collect()
}

/// Product of a real shape and complex coordinates.
#[must_use]
pub fn multiply_shape_with_coordinates(shape: &DVector<f64>, coordinates: &DVector<Complex64>) -> Complex64 {
    shape.iter().zip(coordinates.iter()).map(|(shape, q)| q * *shape).sum()
}
