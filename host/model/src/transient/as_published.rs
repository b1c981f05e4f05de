//! Equations 15 to 21 of the thesis as written, for comparison only.
//!
//! The state matrix is diagonalised with complex eigenvectors and the matrix V of equation 17 is inverted for the
//! amplitudes. At critical damping, and whenever two equal eigenvalues share one eigenvector, V is singular: in rounded
//! arithmetic the eigenvalues come apart by the square root of the round-off and V by as little, and the answer is noise.
//! [`Propagator`](super::Propagator) is what the program uses.

use super::system::{check_harmonic_force, check_initial_state, check_time_grid};
use super::{HarmonicForce, InitialState, SecondOrderSystem, TimeGrid, TransientError};
use faer::Mat;
use faer::linalg::solvers::Solve;
use nalgebra::{DMatrix, DVector};
use num_complex::Complex64;

/// Displacements of all unknowns at all times, `count` x n.
///
/// # Errors
/// Sizes and numbers; [`TransientError::Unbounded`] if equation 15 has no solution, [`TransientError::Defective`] if
/// equation 16 or 21 has none.
pub fn compute_displacements_by_thesis_eigenvectors_row_per_time(
    system: &SecondOrderSystem,
    initial: &InitialState,
    drives: &[HarmonicForce],
    grid: TimeGrid,
) -> Result<DMatrix<f64>, TransientError> {
    system.check_sizes_numbers_and_symmetry_of_mass_and_stiffness()?;
    check_time_grid(grid)?;
    let n = system.count_unknowns();
    check_initial_state(initial, n)?;
    // Equation 15 for each frequency, and the right-hand side of equation 21.
    let (mut x0, mut v0) = (initial.displacement.clone(), initial.velocity.clone());
    let mut particular = Vec::with_capacity(drives.len());
    for drive in drives {
        check_harmonic_force(drive, n)?;
        let (p, q) = solve_particular_cos_and_sin(system, drive)?;
        x0 -= &p;
        v0 -= &q * drive.omega_rad_s;
        particular.push((drive.omega_rad_s, p, q));
    }
    // Equation 16.
    let lu = system.m.clone().lu();
    let (Some(stiffness), Some(damping)) = (lu.solve(&system.k), lu.solve(&system.c)) else {
        return Err(TransientError::NoMass);
    };
    let a = Mat::from_fn(2 * n, 2 * n, |i, j| match (i < n, j < n) {
        (true, _) => f64::from(u8::from(j == i + n)),
        (false, true) => -stiffness[(i - n, j)],
        (false, false) => -damping[(i - n, j - n)],
    });
    let eigen = a.eigen().map_err(|_| TransientError::Defective)?;
    let (vectors, values) = (eigen.U(), eigen.S().column_vector());
    // Equation 21.
    let right = Mat::from_fn(2 * n, 1, |i, _| Complex64::from(if i < n { x0[i] } else { v0[i - n] }));
    let amplitudes = vectors.partial_piv_lu().solve(&right);
    if (0..2 * n).any(|i| !amplitudes[(i, 0)].is_finite()) {
        return Err(TransientError::Defective);
    }
    // Equation 19, one exponential per eigenvalue and time.
    let shapes: DMatrix<Complex64> = DMatrix::from_fn(n, 2 * n, |i, j| vectors[(i, j)] * amplitudes[(j, 0)]);
    let mut out = DMatrix::zeros(grid.count, n);
    let mut sum = DVector::zeros(n);
    for k in 0..grid.count {
        let t = grid.time_at_index_s(k);
        sum.fill(Complex64::ZERO);
        for j in 0..2 * n {
            sum.axpy((values[j] * t).exp(), &shapes.column(j), Complex64::ONE);
        }
        for i in 0..n {
            out[(k, i)] = sum[i].re;
        }
        for (omega, p, q) in &particular {
            let (sin, cos) = (omega * t).sin_cos();
            for i in 0..n {
                out[(k, i)] += p[i] * cos + q[i] * sin;
            }
        }
    }
    Ok(out)
}

/// p and q of equation 15: the particular solution p cos + q sin, from 2n real equations.
///
/// # Errors
/// [`TransientError::Unbounded`] if the matrix is exactly singular; close to it the answer is noise.
pub fn solve_particular_cos_and_sin(
    system: &SecondOrderSystem,
    drive: &HarmonicForce,
) -> Result<(DVector<f64>, DVector<f64>), TransientError> {
    let n = system.count_unknowns();
    let omega = drive.omega_rad_s;
    let dynamic = &system.k - &system.m * (omega * omega);
    let mut matrix = DMatrix::zeros(2 * n, 2 * n);
    matrix.view_mut((0, 0), (n, n)).copy_from(&dynamic);
    matrix.view_mut((n, n), (n, n)).copy_from(&dynamic);
    matrix.view_mut((0, n), (n, n)).copy_from(&(&system.c * omega));
    matrix.view_mut((n, 0), (n, n)).copy_from(&(&system.c * -omega));
    let (sin, cos) = drive.phase_rad.sin_cos();
    // force cos(w t + phase) = h cos(w t) + g sin(w t), h = force cos(phase), g = -force sin(phase).
    let right =
        DVector::from_fn(2 * n, |i, _| if i < n { drive.force_n[i] * cos } else { -drive.force_n[i - n] * sin });
    let solution = matrix.lu().solve(&right).ok_or(TransientError::Unbounded { omega_rad_s: omega })?;
    Ok((solution.rows(0, n).into_owned(), solution.rows(n, n).into_owned()))
}
