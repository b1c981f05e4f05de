//! What a frequency achieves without limits: s = h^T E^-1 conj(h).
//!
//! E is nearly singular where two actuators act alike (at a resonance of the panel they all excite the same mode). It is
//! therefore taken with a ridge: E + d diag(E) with d = [`RIDGE`], which adds at most d sum_i E_ii |u_i|^2 to any energy
//! and changes optima by d over the least eigenvalue of E scaled to a unit diagonal, 1e-9 for one of 1e-5. Rounding in E
//! itself does as much. Where E is even less definite (differences of rounded numbers), d grows until all pivots are
//! positive.

use super::{TargetField, actuator_indices_in_mask};

/// Relative ridge on the diagonal: 45 times the rounding of a double, of which a pivot gathers a few.
const RIDGE: f64 = 1e-14;
/// Factor by which the ridge grows where it is not enough, and the most it gets: beyond, E is no energy.
const RIDGE_GROWTH: f64 = 16.0;
const MOST_RIDGE: f64 = 1e-3;
/// Part of the ridge that a pivot has to keep.
const PIVOT_FRACTION: f64 = 0.25;

/// The optimum at one frequency if nothing were limited.
#[derive(Clone, Copy, Debug)]
pub(super) struct UnlimitedEfficiency {
    /// s, peak squared over energy; 0 where nothing can be driven.
    pub(super) efficiency: f64,
    /// The ridge.
    pub(super) ridge: f64,
    /// Actuators that can be driven, as a mask.
    pub(super) usable: u8,
}

impl UnlimitedEfficiency {
    pub(super) fn compute_efficiency_of_all_drivable_actuators(
        field: &TargetField<'_>,
        frequency_index: usize,
    ) -> Self {
        let (usable, mut ridge) = (drivable_actuator_mask(field, frequency_index), RIDGE);
        while usable != 0 && ridge <= MOST_RIDGE {
            if let Some(efficiency) =
                compute_unlimited_efficiency_if_positive_definite(field, frequency_index, usable, ridge)
            {
                return Self { efficiency, ridge, usable };
            }
            ridge *= RIDGE_GROWTH;
        }
        Self { efficiency: 0.0, ridge, usable: 0 }
    }
}

/// Who can be driven at a frequency: a force is allowed, moves the surface, and there is a limit to what it moves.
fn drivable_actuator_mask(field: &TargetField<'_>, frequency: usize) -> u8 {
    let drivable = |i: usize| {
        let (energy, force, gain) =
            (field.energy[frequency][i][i].re, field.max_force_n[frequency][i], field.gain[frequency][i]);
        let travels = (0..field.actuators)
            .all(|row| field.max_travel_m[row] > 0.0 && field.travel[frequency][row][i].is_finite());
        energy > 0.0 && energy.is_finite() && force > 0.0 && force.is_finite() && gain.is_finite() && travels
    };
    (0..field.actuators).filter(|i| drivable(*i)).fold(0, |mask, i| mask | 1 << i)
}

/// s by Gaussian elimination; `None` if E is not positive definite.
fn compute_unlimited_efficiency_if_positive_definite(
    field: &TargetField<'_>,
    frequency: usize,
    actuator_mask: u8,
    ridge: f64,
) -> Option<f64> {
    // What is left of E (its lower triangle) and of conj(h).
    let mut matrix = field.energy[frequency];
    let mut right = field.gain[frequency].map(|gain| gain.conj());
    for i in actuator_indices_in_mask(actuator_mask) {
        matrix[i][i] = (matrix[i][i].re * (1.0 + ridge)).into();
    }
    let mut efficiency = 0.0;
    for i in actuator_indices_in_mask(actuator_mask) {
        let pivot = matrix[i][i].re;
        if pivot.is_nan() || pivot <= PIVOT_FRACTION * ridge * field.energy[frequency][i][i].re {
            return None;
        }
        efficiency += right[i].norm_sqr() / pivot;
        for row in actuator_indices_in_mask(actuator_mask).filter(|row| *row > i) {
            let factor = matrix[row][i] / pivot;
            let eliminated = factor * right[i];
            right[row] -= eliminated;
            for column in actuator_indices_in_mask(actuator_mask).filter(|column| *column > i && *column < row) {
                let eliminated = factor * matrix[column][i].conj();
                matrix[row][column] -= eliminated;
            }
            matrix[row][row].re -= (factor * matrix[row][i].conj()).re;
        }
    }
    Some(efficiency)
}
