//! Damping over a basis, and the one kind that needs modes of its own: the same ratio on every mode.

use super::assembly::Assembled;
use super::eigen::Modes;
use nalgebra::{DMatrix, DVector, SymmetricEigen};

/// Part of a vector's modal mass below which what the modes leave of it is rounding.
const NOTHING_LEFT: f64 = 1e-10;

/// Damping matrices over some basis.
#[derive(Clone, Debug)]
pub struct Damping {
    /// Viscous, multiplies velocities.
    pub viscous: DMatrix<f64>,
    /// Hysteretic, already times the loss factor: multiplies j times displacements.
    pub structural: DMatrix<f64>,
}

/// Damping of the viscous ratio `ratio` on every mode of the panel `supported`, over the columns of `vectors` (its unknowns
/// x n, and each of at most unit modal mass). `modes` are its lowest.
///
/// For them it is the sum of 2 zeta omega (M phi)(M phi)'. For all that lies above, C = 2 zeta M # K, the geometric mean of
/// what mass and stiffness the modes leave over: on a mode it is 2 zeta omega, and it needs no modes.
pub(super) fn same_ratio(ratio: f64, supported: &Assembled, modes: &Modes, vectors: &DMatrix<f64>) -> DMatrix<f64> {
    let along = supported.mass.times(&modes.vectors).tr_mul(vectors);
    let mut weighted = along.clone();
    for (mut row, lambda) in weighted.row_iter_mut().zip(&modes.lambda) {
        row *= lambda.sqrt();
    }
    let above = vectors - &modes.vectors * &along;
    let (mass, stiffness) =
        (above.tr_mul(&supported.mass.times(&above)), above.tr_mul(&supported.stiffness.times(&above)));
    2.0 * ratio * (along.tr_mul(&weighted) + geometric_mean(&mass, &stiffness))
}

/// A # B = A^1/2 (A^-1/2 B A^-1/2)^1/2 A^1/2 for symmetric semidefinite A and B, on the range of A.
fn geometric_mean(a: &DMatrix<f64>, b: &DMatrix<f64>) -> DMatrix<f64> {
    let n = a.nrows();
    if n == 0 {
        return DMatrix::zeros(0, 0);
    }
    let of_a = SymmetricEigen::new(0.5 * (a + a.transpose()));
    let range: Vec<usize> = (0..n).filter(|i| of_a.eigenvalues[*i] > NOTHING_LEFT).collect();
    if range.is_empty() {
        return DMatrix::zeros(n, n);
    }
    let axes = of_a.eigenvectors.select_columns(&range);
    let lengths = DVector::from_iterator(range.len(), range.iter().map(|i| of_a.eigenvalues[*i].sqrt()));
    let inner = axes.tr_mul(&(b * &axes));
    let scaled = DMatrix::from_fn(range.len(), range.len(), |i, j| {
        0.5 * (inner[(i, j)] + inner[(j, i)]) / (lengths[i] * lengths[j])
    });
    let of_b = SymmetricEigen::new(scaled);
    let root = of_b.eigenvalues.map(|value| value.max(0.0).sqrt());
    let middle = &of_b.eigenvectors * DMatrix::from_diagonal(&root) * of_b.eigenvectors.transpose();
    let half = axes * DMatrix::from_diagonal(&lengths);
    &half * middle * half.transpose()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// X = A # B is what solves X A^-1 X = B, whatever way it is computed.
    #[test]
    fn the_geometric_mean_solves_its_equation() {
        let a = DMatrix::from_row_slice(3, 3, &[4.0, 1.0, 0.5, 1.0, 3.0, 0.2, 0.5, 0.2, 2.0]);
        let b = DMatrix::from_row_slice(3, 3, &[9.0, -2.0, 1.0, -2.0, 5.0, 0.3, 1.0, 0.3, 70.0]);
        let x = geometric_mean(&a, &b);
        let back = &x * a.try_inverse().unwrap() * &x;
        assert!((back - b).amax() < 1e-11, "{x}");
    }
}
