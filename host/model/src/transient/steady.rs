//! Steady state under one harmonic force: (K - w^2 M + j w C) u = f e^(j phase), the complex form of equation 15.

use super::{HarmonicForce, SecondOrderSystem, TransientError};
use nalgebra::DVector;
use num_complex::Complex64;

/// Pivot, relative to a matrix with a diagonal of one, below which it counts as zero: an undamped resonance.
pub(super) const SINGULAR: f64 = 1e-12;

/// Complex amplitudes u of the displacements, length n: q(t) = Re(u e^(j w t)) once everything else has died out.
///
/// Gaussian elimination with row exchanges inside the matrices' band, which is found first: n^3 steps for full matrices,
/// n for a chain.
///
/// # Errors
/// [`TransientError::Unbounded`] at an undamped resonance, whether or not the force excites it; sizes and numbers.
pub fn solve_steady_state(
    system: &SecondOrderSystem,
    drive: &HarmonicForce,
) -> Result<DVector<Complex64>, TransientError> {
    system.check_sizes_numbers_and_symmetry_of_mass_and_stiffness()?;
    super::system::check_harmonic_force(drive, system.count_unknowns())?;
    solve_steady_state_of_already_checked_system(system, drive)
}

pub(super) fn solve_steady_state_of_already_checked_system(
    system: &SecondOrderSystem,
    drive: &HarmonicForce,
) -> Result<DVector<Complex64>, TransientError> {
    let n = system.count_unknowns();
    let (omega, square) = (drive.omega_rad_s, drive.omega_rad_s * drive.omega_rad_s);
    // Rows and columns divided by these have a diagonal of one in K + w^2 M, whatever units and springs there are.
    let scale: Vec<f64> = (0..n)
        .map(|i| 1.0 / (system.k[(i, i)].abs() + square * system.m[(i, i)]).max(f64::MIN_POSITIVE).sqrt())
        .collect();
    let mut banded = BandedMatrix::new(n, system.largest_half_bandwidth_of_matrices());
    for column in 0..n {
        for row in column.saturating_sub(banded.band)..(column + banded.band + 1).min(n) {
            let at = (row, column);
            let entry = Complex64::new(system.k[at] - square * system.m[at], omega * system.c[at]);
            *banded.entry_mut(row, column) = entry * scale[row] * scale[column];
        }
    }
    let phasor = Complex64::from_polar(1.0, drive.phase_rad);
    let mut solution: Vec<Complex64> = (0..n).map(|i| phasor * drive.force_n[i] * scale[i]).collect();
    if !banded.solve_in_place_unless_singular(&mut solution) {
        return Err(TransientError::Unbounded { omega_rad_s: omega });
    }
    Ok(DVector::from_fn(n, |i, _| solution[i] * scale[i]))
}

/// A matrix with entries up to `band` from the diagonal, by rows, with room for what row exchanges fill in.
struct BandedMatrix {
    n: usize,
    band: usize,
    width: usize,
    entries: Vec<Complex64>,
}

impl BandedMatrix {
    fn new(n: usize, band: usize) -> Self {
        let width = 3 * band + 1;
        Self { n, band, width, entries: vec![Complex64::ZERO; n * width] }
    }

    fn entry_mut(&mut self, row: usize, column: usize) -> &mut Complex64 {
        &mut self.entries[row * self.width + column + self.band - row]
    }

    /// The entries of a row in columns `from` to `to`, the last not included.
    fn entry_range_of_row(&self, row: usize, from: usize, to: usize) -> std::ops::Range<usize> {
        let start = row * self.width + self.band - row;
        start + from..start + to
    }

    /// Solves in place; false if a pivot vanishes.
    fn solve_in_place_unless_singular(&mut self, solution: &mut [Complex64]) -> bool {
        let n = self.n;
        for k in 0..n {
            let (below, right) = ((k + self.band + 1).min(n), (k + 2 * self.band + 1).min(n));
            let mut pivot = k;
            let mut largest = 0.0;
            for row in k..below {
                let size = self.entry_mut(row, k).norm_sqr();
                if size > largest {
                    (pivot, largest) = (row, size);
                }
            }
            if largest.is_nan() || largest < SINGULAR * SINGULAR {
                return false;
            }
            if pivot != k {
                for column in k..right {
                    let (a, b) = (*self.entry_mut(k, column), *self.entry_mut(pivot, column));
                    (*self.entry_mut(k, column), *self.entry_mut(pivot, column)) = (b, a);
                }
                solution.swap(k, pivot);
            }
            let inverse = self.entry_mut(k, k).inv();
            for row in k + 1..below {
                let factor = *self.entry_mut(row, k) * inverse;
                if factor == Complex64::ZERO {
                    continue;
                }
                let (source, target) = (self.entry_range_of_row(k, k, right), self.entry_range_of_row(row, k, right));
                let (head, tail) = self.entries.split_at_mut(target.start);
                for (t, s) in tail[..right - k].iter_mut().zip(&head[source]) {
                    *t -= factor * s;
                }
                let above = solution[k];
                solution[row] -= factor * above;
            }
        }
        for k in (0..n).rev() {
            let right = (k + 2 * self.band + 1).min(n);
            let sum: Complex64 = self.entries[self.entry_range_of_row(k, k + 1, right)]
                .iter()
                .zip(&solution[k + 1..right])
                .map(|(a, x)| a * x)
                .sum();
            let pivot = *self.entry_mut(k, k);
            solution[k] = (solution[k] - sum) / pivot;
        }
        true
    }
}
