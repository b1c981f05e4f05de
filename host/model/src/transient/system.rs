//! Checks of what is given, mass coordinates, and decoupling.

use super::{HarmonicForce, InitialState, MOST_TIMES, SecondOrderSystem, TimeGrid, TransientError};
use nalgebra::{Cholesky, DMatrix, DVector, SymmetricEigen};

/// Difference from the transpose, relative to the largest entry, that counts as round-off.
const SYMMETRIC: f64 = 1e-12;
/// Off-diagonal rest after decoupling, per unknown and relative to the matrix's norm, that counts as round-off of the
/// eigensolver: a few units in the last place.
const DECOUPLED: f64 = 8.0 * f64::EPSILON;
/// Weight of the damping in the combination that is diagonalised. Any irrational number does: eigenvectors of K + x C are
/// those of both unless two pairs of eigenvalues fall on one sum.
const MIX: f64 = 0.618_033_988_749_894_9;

impl SecondOrderSystem {
    /// Number of unknowns n.
    #[must_use]
    pub fn count_unknowns(&self) -> usize {
        self.m.nrows()
    }

    /// Checks sizes, numbers and symmetry of the matrices.
    pub(super) fn check_sizes_numbers_and_symmetry_of_mass_and_stiffness(&self) -> Result<(), TransientError> {
        let n = self.count_unknowns();
        for (what, matrix) in [("m", &self.m), ("c", &self.c), ("k", &self.k)] {
            check_shape_and_finiteness(what, matrix, n, n)?;
        }
        for (what, matrix) in [("m", &self.m), ("k", &self.k)] {
            check_symmetric(what, matrix)?;
        }
        Ok(())
    }

    /// Distance from the diagonal of the furthest entry in any of the matrices.
    pub(super) fn largest_half_bandwidth_of_matrices(&self) -> usize {
        matrix_half_bandwidth(&self.m).max(matrix_half_bandwidth(&self.c)).max(matrix_half_bandwidth(&self.k))
    }
}

/// Numbers looked at together: what reads a whole matrix takes as long as solving a chain otherwise.
const LANES: usize = 8;

/// Distance from the diagonal of the furthest entry of a square matrix.
fn matrix_half_bandwidth(matrix: &DMatrix<f64>) -> usize {
    let n = matrix.nrows();
    let is_zero = |part: &[f64]| part.iter().fold(0.0, |sum, x| sum + x.abs()) == 0.0;
    // How many zeros a column begins with, and ends with.
    let leading = |column: &[f64]| {
        let chunks = column.chunks(LANES).take_while(|chunk| is_zero(chunk)).count() * LANES;
        chunks + column.iter().skip(chunks).take_while(|x| **x == 0.0).count()
    };
    let trailing = |column: &[f64]| {
        let chunks = column.rchunks(LANES).take_while(|chunk| is_zero(chunk)).count() * LANES;
        chunks + column.iter().rev().skip(chunks).take_while(|x| **x == 0.0).count()
    };
    let mut band = 0;
    for (j, column) in matrix.as_slice().chunks_exact(n.max(1)).enumerate() {
        // What is beyond the band found so far.
        let (above, below) = (&column[..j.saturating_sub(band)], &column[(j + band + 1).min(n)..]);
        band += (above.len() - leading(above).min(above.len())).max(below.len() - trailing(below).min(below.len()));
    }
    band
}

/// The largest magnitude; NaN or infinite if an entry is that.
fn largest_magnitude_or_nonfinite(matrix: &DMatrix<f64>) -> f64 {
    let (chunks, rest) = matrix.as_slice().as_chunks::<LANES>();
    let (mut most, mut sum) = ([0.0; LANES], [0.0; LANES]);
    for chunk in chunks {
        for ((most, sum), x) in most.iter_mut().zip(&mut sum).zip(chunk) {
            *most = if x.abs() > *most { x.abs() } else { *most };
            // Zero, unless x is no finite number: then NaN.
            *sum += x * 0.0;
        }
    }
    let most = most.iter().chain(rest.iter()).fold(0.0_f64, |most, x| most.max(x.abs()));
    most + sum.iter().sum::<f64>() + rest.iter().map(|x| x * 0.0).sum::<f64>()
}

pub(super) fn check_shape_and_finiteness(
    what: &'static str,
    matrix: &DMatrix<f64>,
    expected_rows: usize,
    expected_columns: usize,
) -> Result<(), TransientError> {
    let (rows, columns) = matrix.shape();
    if (rows, columns) != (expected_rows, expected_columns) || expected_columns == 0 {
        return Err(TransientError::Shape { what, rows, columns, expected_rows, expected_columns });
    }
    if largest_magnitude_or_nonfinite(matrix).is_finite() { Ok(()) } else { Err(TransientError::NotFinite { what }) }
}

pub(super) fn check_vector_length_and_finiteness(
    what: &'static str,
    vector: &DVector<f64>,
    expected_length: usize,
) -> Result<(), TransientError> {
    if vector.len() != expected_length {
        let rows = vector.len();
        return Err(TransientError::Shape {
            what,
            rows,
            columns: 1,
            expected_rows: expected_length,
            expected_columns: 1,
        });
    }
    if vector.iter().all(|x| x.is_finite()) { Ok(()) } else { Err(TransientError::NotFinite { what }) }
}

pub(super) fn check_initial_state(initial: &InitialState, unknowns: usize) -> Result<(), TransientError> {
    check_vector_length_and_finiteness("initial displacement", &initial.displacement, unknowns)?;
    check_vector_length_and_finiteness("initial velocity", &initial.velocity, unknowns)
}

pub(super) fn check_harmonic_force(drive: &HarmonicForce, unknowns: usize) -> Result<(), TransientError> {
    check_vector_length_and_finiteness("force", &drive.force_n, unknowns)?;
    check_range("frequency in rad/s", drive.omega_rad_s, 0.0, 1e12)?;
    check_range("phase in rad", drive.phase_rad, -1e6, 1e6)
}

pub(super) fn check_range(what: &'static str, value: f64, min: f64, max: f64) -> Result<(), TransientError> {
    if (min..=max).contains(&value) { Ok(()) } else { Err(TransientError::Range { what, value, min, max }) }
}

#[expect(clippy::cast_precision_loss, reason = "for a message")]
pub(super) fn check_time_grid(grid: TimeGrid) -> Result<(), TransientError> {
    check_range("time step in s", grid.step_s, 1e-12, 1e9)?;
    check_range("number of times", grid.count as f64, 1.0, MOST_TIMES as f64)
}

fn check_symmetric(what: &'static str, matrix: &DMatrix<f64>) -> Result<(), TransientError> {
    let (limit, band) = (SYMMETRIC * largest_magnitude_or_nonfinite(matrix), matrix_half_bandwidth(matrix));
    for column in 0..matrix.ncols() {
        for row in column.saturating_sub(band)..column {
            let difference = (matrix[(row, column)] - matrix[(column, row)]).abs();
            if difference > limit {
                return Err(TransientError::NotSymmetric { what, row, column, difference });
            }
        }
    }
    Ok(())
}

fn is_diagonal(matrix: &DMatrix<f64>) -> bool {
    (0..matrix.ncols()).all(|j| (0..matrix.nrows()).all(|i| i == j || matrix[(i, j)] == 0.0))
}

/// The system in coordinates p = L^T q with M = L L^T, in which the mass is the identity.
#[derive(Clone, Debug)]
pub(super) struct MassCoordinates {
    /// q = back p.
    pub back: DMatrix<f64>,
    /// p = to q.
    pub to: DMatrix<f64>,
    pub c: DMatrix<f64>,
    pub k: DMatrix<f64>,
}

impl MassCoordinates {
    pub fn new(system: &SecondOrderSystem) -> Result<Self, TransientError> {
        if is_diagonal(&system.m) {
            let root = system.m.diagonal().map(f64::sqrt);
            if !root.iter().all(|x| *x > 0.0) {
                return Err(TransientError::NoMass);
            }
            let n = root.len();
            let scaled = |matrix: &DMatrix<f64>| DMatrix::from_fn(n, n, |i, j| matrix[(i, j)] / (root[i] * root[j]));
            return Ok(Self {
                back: DMatrix::from_diagonal(&root.map(|x| 1.0 / x)),
                c: scaled(&system.c),
                k: symmetrise_matrix(scaled(&system.k)),
                to: DMatrix::from_diagonal(&root),
            });
        }
        let lower = Cholesky::new(system.m.clone()).ok_or(TransientError::NoMass)?.l();
        let n = lower.nrows();
        let inverse = lower.solve_lower_triangular(&DMatrix::identity(n, n)).ok_or(TransientError::NoMass)?;
        let back = inverse.transpose();
        Ok(Self {
            c: &inverse * &system.c * &back,
            k: symmetrise_matrix(&inverse * &system.k * &back),
            to: lower.transpose(),
            back,
        })
    }

    /// Real modes, if the damping allows them.
    pub fn decouple_into_modes_if_proportionally_damped(&self) -> Option<DecoupledModes> {
        let n = self.k.nrows();
        if is_diagonal(&self.k) && is_diagonal(&self.c) {
            return Some(DecoupledModes::from_modes_sorted_slowest_decay_first(
                &self.k.diagonal(),
                &self.c.diagonal(),
                &self.back,
                &self.to,
            ));
        }
        let (norm_k, norm_c) = (self.k.norm(), self.c.norm());
        #[expect(clippy::cast_precision_loss, reason = "a dense matrix's size")]
        let limit = DECOUPLED * n as f64;
        let asymmetry = (&self.c - self.c.transpose()).norm();
        if asymmetry > limit * norm_c {
            return None;
        }
        // K C - C K = K C - (K C)^T is the price of one product; an eigensolution would cost fifty.
        let product = &self.k * &self.c;
        if (&product - product.transpose()).norm() > limit * norm_k * norm_c {
            return None;
        }
        let part = |matrix: &DMatrix<f64>, norm: f64| matrix / norm.max(f64::MIN_POSITIVE);
        let vectors = SymmetricEigen::new(part(&self.k, norm_k) + MIX * part(&self.c, norm_c)).eigenvectors;
        let transposed = vectors.transpose();
        let modal = |matrix: &DMatrix<f64>, norm: f64| {
            let full = &transposed * (matrix * &vectors);
            let diagonal = full.diagonal();
            let rest = (full - DMatrix::from_diagonal(&diagonal)).norm();
            (rest <= limit * norm).then_some(diagonal)
        };
        let (lambda, damping) = (modal(&self.k, norm_k)?, modal(&self.c, norm_c)?);
        Some(DecoupledModes::from_modes_sorted_slowest_decay_first(
            &lambda,
            &damping,
            &(&self.back * &vectors),
            &(&transposed * &self.to),
        ))
    }
}

/// The symmetric part of a matrix.
fn symmetrise_matrix(matrix: DMatrix<f64>) -> DMatrix<f64> {
    0.5 * (&matrix + matrix.transpose())
}

/// n real modes, q = shapes p, the slowest to die out first.
#[derive(Clone, Debug)]
pub(super) struct DecoupledModes {
    /// Squared angular frequencies.
    pub lambda: DVector<f64>,
    /// Damping in 1/s.
    pub damping: DVector<f64>,
    /// n x n, mass-normalised.
    pub shapes: DMatrix<f64>,
    /// p = to q.
    pub to: DMatrix<f64>,
}

impl DecoupledModes {
    /// Modes sorted by decay rate, the slowest first.
    fn from_modes_sorted_slowest_decay_first(
        lambda: &DVector<f64>,
        damping: &DVector<f64>,
        shapes: &DMatrix<f64>,
        to: &DMatrix<f64>,
    ) -> Self {
        let rate = |i: &usize| super::oscillator::slower_decay_rate_per_s(lambda[*i], damping[*i]);
        let mut order: Vec<usize> = (0..lambda.len()).collect();
        order.sort_by(|a, b| rate(a).total_cmp(&rate(b)));
        Self {
            lambda: lambda.select_rows(&order),
            damping: damping.select_rows(&order),
            shapes: shapes.select_columns(&order),
            to: to.select_rows(&order),
        }
    }
}
