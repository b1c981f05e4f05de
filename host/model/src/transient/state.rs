//! The state of a system whose damping couples its modes.

use super::system::MassCoordinates;
use super::{MotionQuantity, TransientError};
use nalgebra::{Cholesky, DMatrix, DVector};

/// z' = A z for z = (W p, p', phasors), p in mass coordinates and `W^T W` = K + sigma.
///
/// |z|^2 is twice the energy plus sigma |p|^2: with damping that takes energy out, it grows by no more than a factor
/// e^(sqrt(sigma) t), so that sigma = 1/T^2 keeps exp(A t) below e in norm for all t up to T, and 1/T^2 is what holds
/// rigid motions.
#[derive(Clone, Debug)]
pub(super) struct StateSpace {
    /// A, 1/s.
    pub a: DMatrix<f64>,
    /// W.
    w: DMatrix<f64>,
    /// Its inverse.
    w_inverse: DMatrix<f64>,
}

impl StateSpace {
    /// For times up to `horizon_s`.
    pub fn new(coordinates: &MassCoordinates, horizon_s: f64) -> Result<Self, TransientError> {
        let k = &coordinates.k;
        let n = k.nrows();
        let (least, norm) = (horizon_s.powi(-2), k.norm());
        // The second is for a singular K whose zeros are negative by round-off, the third for an indefinite one.
        for sigma in [least, least + 1e-13 * norm, least + 2.0 * norm] {
            let shifted = k + DMatrix::from_diagonal_element(n, n, sigma);
            let Some(factor) = Cholesky::new(shifted) else { continue };
            let lower = factor.l();
            let Some(lower_inverse) = lower.solve_lower_triangular(&DMatrix::identity(n, n)) else { continue };
            let (w, w_inverse) = (lower.transpose(), lower_inverse.transpose());
            let mut a = DMatrix::zeros(2 * n, 2 * n);
            a.view_mut((0, n), (n, n)).copy_from(&w);
            // -K W^-1 = -W^T + sigma W^-1, without the cancellation that a product with K would bring.
            a.view_mut((n, 0), (n, n)).copy_from(&(&w_inverse * sigma - &lower));
            a.view_mut((n, n), (n, n)).copy_from(&-&coordinates.c);
            return Ok(Self { a, w, w_inverse });
        }
        Err(TransientError::NotFinite { what: "k" })
    }

    fn count_unknowns(&self) -> usize {
        self.w.nrows()
    }

    /// The state of p and p'.
    pub fn build_state(&self, p: &DVector<f64>, velocity: &DVector<f64>) -> DVector<f64> {
        let n = self.count_unknowns();
        let mut z = DVector::zeros(self.a.nrows());
        z.rows_mut(0, n).copy_from(&(&self.w * p));
        z.rows_mut(n, n).copy_from(velocity);
        z
    }

    /// Rows that take the quantity from the state, for `rows` (r x n) that take it from p, p' or p''.
    pub fn output_rows_over_state(&self, rows: &DMatrix<f64>, quantity: MotionQuantity) -> DMatrix<f64> {
        let n = self.count_unknowns();
        let mut out = DMatrix::zeros(rows.nrows(), self.a.nrows());
        match quantity {
            MotionQuantity::Displacement => out.columns_mut(0, n).copy_from(&(rows * &self.w_inverse)),
            MotionQuantity::Velocity => out.columns_mut(n, n).copy_from(rows),
            MotionQuantity::Acceleration => out.copy_from(&(rows * self.a.rows(n, n))),
        }
        out
    }

    /// With two more states per harmonic force, its phasor, which the forces follow: no steady state is needed. `drives`
    /// are angular frequency and the force on p. Returns the amplitude at which each phasor must start.
    pub fn append_phasor_states_and_get_one_start_amplitude_per_drive(
        mut self,
        drives: &[(f64, DVector<f64>)],
    ) -> (Self, Vec<f64>) {
        let n = self.count_unknowns();
        let size = 2 * n + 2 * drives.len();
        let norm = super::exponential::largest_column_sum_of_magnitudes(&self.a).max(f64::MIN_POSITIVE);
        self.a = self.a.resize(size, size, 0.0);
        let mut amplitudes = Vec::with_capacity(drives.len());
        for (i, (omega, force)) in drives.iter().enumerate() {
            let at = 2 * n + 2 * i;
            // In units that make the column no larger than the rest of A, for the sake of the exponential's scaling.
            let amplitude = (force.norm() / norm).max(f64::MIN_POSITIVE);
            self.a.view_mut((n, at), (n, 1)).copy_from(&(force / amplitude));
            self.a[(at, at + 1)] = -omega;
            self.a[(at + 1, at)] = *omega;
            amplitudes.push(amplitude);
        }
        (self, amplitudes)
    }
}
