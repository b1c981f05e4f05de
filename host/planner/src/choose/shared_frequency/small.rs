//! Linear algebra of a few unknowns, in place and without allocation.

use super::{PerPair, ZERO};
use crate::scene::MAX_ACTUATORS;
use num_complex::Complex64;

/// Unknowns of a Newton step: two per phasor.
pub(super) const MOST_UNKNOWNS: usize = 2 * MAX_ACTUATORS;

pub(super) type Vector = [f64; MOST_UNKNOWNS];
pub(super) type Matrix = [Vector; MOST_UNKNOWNS];

/// Sweeps of Jacobi's method; it converges quadratically, and four to five are usual.
const SWEEPS: usize = 12;
/// Off-diagonal entry, over the geometric mean of the two diagonal ones, that counts as none.
const NEGLIGIBLE: f64 = 1e-17;

/// matrix += factor v v^T in its first `n` rows and columns.
pub(super) fn add_lower_triangle_of_outer_product(matrix: &mut Matrix, v: &Vector, factor: f64, n: usize) {
    for i in (0..n).filter(|i| v[*i] != 0.0) {
        let scaled = factor * v[i];
        for j in 0..=i {
            matrix[i][j] += scaled * v[j];
        }
    }
}

/// Solves with the lower triangle of a positive definite matrix, scaled to a unit diagonal: barriers near the limits
/// differ by many powers of ten. The factor takes the matrix' place, the solution that of the right side.
#[expect(clippy::needless_range_loop, reason = "rows and columns of small matrices")]
pub(super) fn solve_in_place_if_positive_definite(n: usize, matrix: &mut Matrix, right: &mut Vector) -> Option<()> {
    let mut scale = [0.0; MOST_UNKNOWNS];
    for i in 0..n {
        let diagonal = matrix[i][i];
        if diagonal <= 0.0 || !diagonal.is_finite() {
            return None;
        }
        scale[i] = diagonal.sqrt().recip();
    }
    for i in 0..n {
        for j in 0..=i {
            let mut entry = matrix[i][j] * scale[i] * scale[j];
            for l in 0..j {
                entry -= matrix[i][l] * matrix[j][l];
            }
            // A pivot lost to rounding: that direction is left alone, as far as the rest allows.
            matrix[i][j] = if i == j { entry.max(1e-15).sqrt() } else { entry / matrix[j][j] };
        }
        right[i] *= scale[i];
        for j in 0..i {
            right[i] -= matrix[i][j] * right[j];
        }
        right[i] /= matrix[i][i];
    }
    for i in (0..n).rev() {
        for j in i + 1..n {
            right[i] -= matrix[j][i] * right[j];
        }
        right[i] /= matrix[i][i];
    }
    for i in 0..n {
        right[i] *= scale[i];
    }
    right[..n].iter().all(|value| value.is_finite()).then_some(())
}

/// Eigenvalues (the diagonal that is left) and eigenvectors (columns) of a Hermitian matrix by Jacobi's method, which
/// leaves alone what is not coupled.
pub(super) fn hermitian_eigenvalues_and_eigenvectors(matrix: &PerPair) -> ([f64; 4], PerPair) {
    let mut a = *matrix;
    let mut vectors = [[ZERO; 4]; 4];
    for (i, row) in vectors.iter_mut().enumerate() {
        row[i] = Complex64::ONE;
    }
    for _ in 0..SWEEPS {
        let mut turned = false;
        for p in 0..3 {
            for q in p + 1..4 {
                let size = a[p][q].norm();
                if size <= NEGLIGIBLE * (a[p][p].re * a[q][q].re).abs().sqrt() {
                    continue;
                }
                turned = true;
                let phase = a[p][q].conj() / size;
                let ratio = (a[q][q].re - a[p][p].re) / (2.0 * size);
                let tangent = ratio.signum() / (ratio.abs() + ratio.hypot(1.0));
                let cosine = tangent.hypot(1.0).recip();
                let (sine, turn) = (tangent * cosine, phase * cosine);
                // Columns of a and of the vectors, then rows of a.
                for row in a.iter_mut().chain(&mut vectors) {
                    let (first, second) = (row[p], row[q]);
                    row[p] = first * cosine - second * phase * sine;
                    row[q] = first * sine + second * turn;
                }
                let (first, second) = (a[p], a[q]);
                for column in 0..4 {
                    a[p][column] = first[column] * cosine - second[column] * phase.conj() * sine;
                    a[q][column] = first[column] * sine + second[column] * turn.conj();
                }
            }
        }
        if !turned {
            break;
        }
    }
    (std::array::from_fn(|i| a[i][i].re), vectors)
}
