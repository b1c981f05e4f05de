//! Frequencies of rectangular thin plates by Ritz's method with orthonormal Legendre polynomials, written for these tests alone.
//!
//! On the square -1..1 the orthonormal polynomials p_i = sqrt((2 i + 1) / 2) P_i make the mass matrix the identity, and all
//! stiffness integrals are products of the matrix A of p_i' = sum_j A_ij p_j. With r = a / b,
//! lambda^2 = 16 * (integral of w_xx^2 + r^4 w_yy^2 + 2 nu r^2 w_xx w_yy + 2 (1 - nu) r^2 w_xy^2) / (integral of w^2)
//! is omega^2 a^4 rho h / D (Leissa, J. Sound Vib. 31 (1973), with a the side along x). What holds the plate is a set of linear
//! conditions on the coefficients; the stiffness is projected to where all are met. Every value is an upper bound.

use nalgebra::{DMatrix, DVector, SymmetricEigen};

/// How a side is held.
#[derive(Clone, Copy, PartialEq, Eq)]
pub enum Side {
    Free,
    Pinned,
    Clamped,
}

/// A plate: sides left, right, top, bottom; Poisson's ratio; length over width; whether its corners are held, as points.
#[derive(Clone, Copy)]
pub struct Plate {
    pub sides: [Side; 4],
    pub poisson: f64,
    pub aspect: f64,
    pub corners: bool,
}

impl Plate {
    /// lambda of the modes that bend the plate, ascending, and for each how much it fell with the last two polynomials in
    /// each direction, relative: a measure of what is left.
    pub fn frequencies(self, count: usize) -> Vec<(f64, f64)> {
        let (coarse, fine) = (self.lambda(POLYNOMIALS - 2), self.lambda(POLYNOMIALS));
        fine.into_iter().zip(coarse).take(count).map(|(fine, coarse)| (fine, (coarse / fine - 1.0).abs())).collect()
    }

    fn lambda(self, n: usize) -> Vec<f64> {
        let slope = derivatives(n);
        let curvature = &slope * &slope;
        let identity = DMatrix::identity(n, n);
        let (bend, mixed, twist) = (&curvature * curvature.transpose(), curvature, &slope * slope.transpose());
        let r2 = self.aspect * self.aspect;
        let k = bend.kronecker(&identity)
            + identity.kronecker(&bend) * (r2 * r2)
            + (mixed.kronecker(&mixed.transpose()) + mixed.transpose().kronecker(&mixed)) * (self.poisson * r2)
            + twist.kronecker(&twist) * (2.0 * (1.0 - self.poisson) * r2);
        let conditions = self.conditions(n);
        let free = complement(&conditions, n * n);
        let projected = free.tr_mul(&(k * 16.0 * &free));
        let mut squares: Vec<f64> = SymmetricEigen::new(projected).eigenvalues.iter().copied().collect();
        squares.sort_by(f64::total_cmp);
        // Rigid motions are zero but for rounding; the slowest mode in these tests has lambda^2 = 12.
        squares.into_iter().filter(|square| *square > 1.0).map(f64::sqrt).collect()
    }

    /// Vectors that the coefficients must be orthogonal to.
    fn conditions(self, n: usize) -> Vec<DVector<f64>> {
        let mut all = Vec::new();
        let unit = |j: usize| DVector::from_fn(n, |i, _| f64::from(u8::from(i == j)));
        for (k, side) in self.sides.into_iter().enumerate() {
            let end = if k % 2 == 0 { -1.0 } else { 1.0 };
            let held = match side {
                Side::Free => vec![],
                Side::Pinned => vec![values_at(n, end)],
                Side::Clamped => vec![values_at(n, end), slopes_at(n, end)],
            };
            for line in held {
                for j in 0..n {
                    all.push(if k < 2 { line.kronecker(&unit(j)) } else { unit(j).kronecker(&line) });
                }
            }
        }
        if self.corners {
            for (x, y) in [(-1.0, -1.0), (1.0, -1.0), (-1.0, 1.0), (1.0, 1.0)] {
                all.push(values_at(n, x).kronecker(&values_at(n, y)));
            }
        }
        all
    }
}

/// In each direction. Clamped corners beside free edges converge with the sixth power or so, everything else much faster; at 20 the
/// rounding of the largest stiffness (n^8) reaches 1e-8 of the first frequencies.
const POLYNOMIALS: usize = 16;

fn real(n: usize) -> f64 {
    f64::from(u32::try_from(n).expect("a small number"))
}

/// P_i' = sum of (2 j + 1) P_j over j = i - 1, i - 3, ..., normalised.
fn derivatives(n: usize) -> DMatrix<f64> {
    DMatrix::from_fn(n, n, |i, j| {
        if i > j && (i - j) % 2 == 1 { ((2.0 * real(i) + 1.0) * (2.0 * real(j) + 1.0)).sqrt() } else { 0.0 }
    })
}

/// P_i(1) = 1, P_i(-1) = (-1)^i.
fn values_at(n: usize, end: f64) -> DVector<f64> {
    DVector::from_fn(n, |i, _| {
        let sign = if i % 2 == 0 { 1.0 } else { end };
        sign * (real(i) + 0.5).sqrt()
    })
}

/// P_i'(1) = i (i + 1) / 2, P_i'(-1) = (-1)^(i + 1) of that.
fn slopes_at(n: usize, end: f64) -> DVector<f64> {
    DVector::from_fn(n, |i, _| {
        let sign = if i % 2 == 0 { end } else { 1.0 };
        sign * (real(i) + 0.5).sqrt() * real(i) * (real(i) + 1.0) / 2.0
    })
}

/// An orthonormal basis of what is orthogonal to all of `conditions` (which may depend on each other, as at corners).
fn complement(conditions: &[DVector<f64>], size: usize) -> DMatrix<f64> {
    let mut held: Vec<DVector<f64>> = Vec::new();
    let mut basis: Vec<DVector<f64>> = Vec::new();
    let unit = |i: usize| DVector::from_fn(size, |j, _| f64::from(u8::from(i == j)));
    let independent = |vector: &DVector<f64>, of: [&[DVector<f64>]; 2]| {
        let mut rest = vector.normalize();
        // Twice is enough (Kahan, Parlett).
        for _ in 0..2 {
            for other in of.into_iter().flatten() {
                rest -= other * other.dot(&rest);
            }
        }
        let length = rest.norm();
        (length > 1e-6).then(|| rest / length)
    };
    for condition in conditions {
        held.extend(independent(condition, [&held, &[]]));
    }
    for i in 0..size {
        basis.extend(independent(&unit(i), [&held, &basis]));
    }
    assert_eq!(held.len() + basis.len(), size);
    DMatrix::from_columns(&basis)
}
