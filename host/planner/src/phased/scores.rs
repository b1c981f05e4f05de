//! What groups achieve without limits: s = h^T E^-1 conj(h) for every subset of actuators and every frequency.
//!
//! E is nearly singular where two actuators act alike (at a resonance of the panel they all excite the same mode). It is
//! therefore taken with a ridge: E + d diag(E) with d = [`RIDGE`], which adds at most d sum_i E_ii |u_i|^2 to any energy
//! and changes optima by d over the least eigenvalue of E scaled to a unit diagonal, 1e-9 for one of 1e-5. Rounding in E
//! itself does as much. Where E is even less definite (differences of rounded numbers), d grows until all pivots are
//! positive.

use super::{Field, PerActuator, PerPair, SUBSETS, ZERO};
use num_complex::Complex64;

/// Relative ridge on the diagonal: 45 times the rounding of a double, of which a pivot gathers a few.
const RIDGE: f64 = 1e-14;
/// Factor by which the ridge grows where it is not enough, and the most it gets: beyond, E is no energy.
const RIDGE_GROWTH: f64 = 16.0;
const MOST_RIDGE: f64 = 1e-3;
/// Part of the ridge that a pivot has to keep.
const PIVOT_PART: f64 = 0.25;

/// For every frequency: what each subset achieves.
pub(super) struct Scores {
    /// Peak squared over energy, by subset; without [`Scores::of_all_subsets`] only that of all actuators.
    pub(super) of: Vec<[f64; SUBSETS]>,
    /// The ridge.
    pub(super) ridge: Vec<f64>,
    /// Actuators that can be driven, as a mask.
    pub(super) usable: Vec<u8>,
}

impl Scores {
    pub(super) fn new(field: &Field<'_>, all_subsets: bool) -> Self {
        let count = field.frequencies_hz.len();
        let mut scores =
            Self { of: vec![[0.0; SUBSETS]; count], ridge: vec![RIDGE; count], usable: Vec::with_capacity(count) };
        for (k, of) in scores.of.iter_mut().enumerate() {
            let mut usable = usable(field, k);
            while usable != 0 && !at(field, k, usable, scores.ridge[k], all_subsets, of) {
                scores.ridge[k] *= RIDGE_GROWTH;
                if scores.ridge[k] > MOST_RIDGE {
                    (usable, *of) = (0, [0.0; SUBSETS]);
                }
            }
            scores.usable.push(usable);
        }
        scores
    }
}

/// Who can be driven at a frequency: a force is allowed, moves the surface, and there is a limit to what it moves.
fn usable(field: &Field<'_>, k: usize) -> u8 {
    let drivable = |i: usize| {
        let (energy, force, gain) = (field.energy[k][i][i].re, field.max_force_n[k][i], field.gain[k][i]);
        let travels =
            (0..field.actuators).all(|row| field.max_travel_m[row] > 0.0 && field.travel[k][row][i].is_finite());
        energy > 0.0 && energy.is_finite() && force > 0.0 && force.is_finite() && gain.is_finite() && travels
    };
    (0..field.actuators).filter(|i| drivable(*i)).fold(0, |mask, i| mask | 1 << i)
}

/// Fills in the scores at one frequency; `false` if E is not positive definite.
#[expect(clippy::needless_range_loop, reason = "rows and columns of small matrices")]
fn at(field: &Field<'_>, k: usize, usable: u8, ridge: f64, all_subsets: bool, of: &mut [f64; SUBSETS]) -> bool {
    let is_usable = |i: usize| usable >> i & 1 == 1;
    let (mut matrix, mut right, mut floor) = ([[ZERO; 4]; 4], [ZERO; 4], [0.0; 4]);
    for i in 0..field.actuators {
        if !is_usable(i) {
            // Decoupled, and achieves nothing.
            matrix[i][i] = Complex64::ONE;
            continue;
        }
        let diagonal = field.energy[k][i][i].re;
        matrix[i][i].re = diagonal * (1.0 + ridge);
        floor[i] = PIVOT_PART * ridge * diagonal;
        right[i] = field.gain[k][i].conj();
        for j in 0..i {
            if is_usable(j) {
                matrix[i][j] = field.energy[k][i][j];
            }
        }
    }
    let elimination = Elimination { actuators: field.actuators, floor };
    if all_subsets {
        elimination.descend::<true>(0, &matrix, &right, 0.0, 0, of)
    } else {
        elimination.descend::<false>(0, &matrix, &right, 0.0, 0, of)
    }
}

/// Gaussian elimination, one actuator after the other. What is left after eliminating a subset serves all subsets that
/// continue it, so that all of them together cost little more than the whole set.
struct Elimination {
    actuators: usize,
    floor: [f64; 4],
}

impl Elimination {
    #[expect(clippy::needless_range_loop, reason = "rows and columns of small matrices")]
    fn descend<const ALL: bool>(
        &self,
        first: usize,
        matrix: &PerPair,
        right: &PerActuator,
        sum: f64,
        subset: usize,
        of: &mut [f64; SUBSETS],
    ) -> bool {
        let until = if ALL { self.actuators } else { first + 1 };
        for i in first..until {
            let pivot = matrix[i][i].re;
            if pivot.is_nan() || pivot <= self.floor[i] {
                return false;
            }
            let inverse = pivot.recip();
            let (sum, subset) = (sum + right[i].norm_sqr() * inverse, subset | 1 << i);
            of[subset] = sum;
            if i + 1 == self.actuators {
                continue;
            }
            let (mut matrix, mut right) = (*matrix, *right);
            for row in i + 1..self.actuators {
                let factor = matrix[row][i] * inverse;
                right[row] -= factor * right[i];
                for column in i + 1..row {
                    let other = matrix[column][i].conj();
                    matrix[row][column] -= factor * other;
                }
                matrix[row][row].re -= matrix[row][i].norm_sqr() * inverse;
            }
            if !self.descend::<ALL>(i + 1, &matrix, &right, sum, subset, of) {
                return false;
            }
        }
        true
    }
}
