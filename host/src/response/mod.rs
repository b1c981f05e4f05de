//! Harmonic response: equations 9 to 15 and 22, 23 of the thesis, in the reduced model's coordinates and with complex
//! phasors in place of the p cos + q sin pairs (u = p - j q).

use crate::model::ReducedModel;
use nalgebra::{DMatrix, DVector};
use num_complex::Complex64;
use rayon::prelude::*;

mod bounded;
mod peak;

pub use bounded::{CurveError, bounded_curves};
pub use peak::{Component, peak_acceleration};

/// Part of the matrix's scale below which a pivot counts as zero: an undamped panel at its resonance.
const SINGULAR: f64 = 1e-12;
/// Modal force, relative to the largest, below which a resonance is not excited.
const NOT_EXCITED: f64 = 1e-9;

/// Why there is no response.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum ResponseError {
    /// Undamped and at a resonance: the response grows without bound (thesis, after equation 15).
    #[error(
        "at {frequency_hz} Hz the panel is at the resonance of an undamped mode ({resonance_hz} Hz) and its response is \
         unbounded: give the scene some damping (surface.damping.loss_factor, say) or leave that frequency out"
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

/// Displacement coordinates q for 1 N at each actuator alone, at one frequency: (Lambda - w^2 + j S + j w C) q = B.
///
/// # Errors
/// [`ResponseError::Unbounded`].
pub fn modal_coordinates(model: &ReducedModel, frequency_hz: f64) -> Result<Vec<DVector<Complex64>>, ResponseError> {
    let n = model.order();
    let omega = std::f64::consts::TAU * frequency_hz;
    // Rows and columns divided by the square root of this have entries of the size of one, whatever springs there are.
    let scale = model.lambda.map(|lambda| 1.0 / (lambda + omega * omega).max(f64::MIN_POSITIVE).sqrt());
    let matrix = DMatrix::from_fn(n, n, |i, j| {
        let stiffness = if i == j { model.lambda[i] - omega * omega } else { 0.0 };
        Complex64::new(stiffness, model.structural[(i, j)] + omega * model.viscous[(i, j)]) * scale[i] * scale[j]
    });
    let force = DMatrix::from_fn(n, model.actuators(), |i, j| Complex64::from(model.force[(i, j)] * scale[i]));
    let unbounded = |mode: usize| ResponseError::Unbounded {
        frequency_hz,
        resonance_hz: model.lambda[mode].sqrt() / std::f64::consts::TAU,
    };
    let mut solution = force.clone();
    if matrix.iter().enumerate().all(|(k, z)| k % (n + 1) == 0 || *z == Complex64::ZERO) {
        // No damping couples the modes: each for itself, so that one at resonance that nothing excites stays at rest.
        let largest = force.iter().map(|z| z.norm()).fold(0.0, f64::max);
        for i in 0..n {
            let singular = matrix[(i, i)].norm() < SINGULAR;
            for j in 0..solution.ncols() {
                if !singular {
                    solution[(i, j)] /= matrix[(i, i)];
                } else if force[(i, j)].norm() > NOT_EXCITED * largest {
                    return Err(unbounded(i));
                } else {
                    solution[(i, j)] = Complex64::ZERO;
                }
            }
        }
    } else {
        let lu = matrix.lu();
        let solved = lu.solve_mut(&mut solution);
        let pivot = (0..n).map(|i| lu.lu_internal()[(i, i)].norm()).fold(f64::INFINITY, f64::min);
        let response = solution.iter().map(|z| z.norm()).fold(0.0, f64::max);
        let load = force.iter().map(|z| z.norm()).fold(f64::MIN_POSITIVE, f64::max);
        if !solved || !response.is_finite() || pivot < SINGULAR && response > 1e-3 / SINGULAR * load {
            let nearest = (0..n)
                .min_by(|a, b| {
                    let distance = |i: usize| (model.lambda[i] - omega * omega).abs();
                    distance(*a).total_cmp(&distance(*b))
                })
                .unwrap_or(0);
            return Err(unbounded(nearest));
        }
    }
    Ok(solution
        .column_iter()
        .map(|column| DVector::from_iterator(n, column.iter().zip(scale.iter()).map(|(z, scale)| z * *scale)))
        .collect())
}

/// Acceleration in m/s^2 at one point for 1 N at each actuator alone: `curves[actuator][frequency]`.
///
/// # Errors
/// [`ResponseError::Unbounded`] at the first frequency that has no answer.
pub fn acceleration_curves(
    model: &ReducedModel,
    shape: &DVector<f64>,
    frequencies_hz: &[f64],
) -> Result<Vec<Vec<Complex64>>, ResponseError> {
    let rows: Vec<Vec<Complex64>> = frequencies_hz
        .par_iter()
        .map(|frequency_hz| {
            // At rest: a constant force accelerates nothing that is held, and a free panel's w^2 q is taken from its limit.
            let minus_omega_squared = -(std::f64::consts::TAU * frequency_hz).powi(2);
            if *frequency_hz == 0.0 {
                return Ok(static_acceleration(model, shape));
            }
            let coordinates = modal_coordinates(model, *frequency_hz)?;
            Ok(coordinates.iter().map(|q| dot(shape, q) * minus_omega_squared).collect())
        })
        .collect::<Result<_, _>>()?;
    Ok((0..model.actuators()).map(|actuator| rows.iter().map(|row| row[actuator]).collect()).collect())
}

/// The acceleration as the frequency goes to zero: that of the rigid motions, F / m and what turns with it.
fn static_acceleration(model: &ReducedModel, shape: &DVector<f64>) -> Vec<Complex64> {
    (0..model.actuators())
        .map(|actuator| {
            let rigid = (0..model.order()).filter(|i| model.lambda[*i] == 0.0 && model.viscous[(*i, *i)] == 0.0);
            Complex64::from(rigid.map(|i| shape[i] * model.force[(i, actuator)]).sum::<f64>())
        })
        .collect()
}

/// Product of a real shape and complex coordinates.
#[must_use]
pub fn dot(shape: &DVector<f64>, coordinates: &DVector<Complex64>) -> Complex64 {
    shape.iter().zip(coordinates.iter()).map(|(shape, q)| q * *shape).sum()
}
