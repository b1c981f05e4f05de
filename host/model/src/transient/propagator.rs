//! The public solver: one system, one grid of times, any forces and initial states.

use super::blocks::{self, HarmonicOutput};
use super::exponential::{
    count_matrix_products_of_matrix_exponential, largest_column_sum_of_magnitudes, matrix_exponential,
};
use super::state::StateSpace;
use super::system::{
    DecoupledModes, MassCoordinates, check_harmonic_force, check_initial_state, check_shape_and_finiteness,
    check_time_grid,
};
use super::{
    HarmonicForce, InitialState, MotionQuantity, OutputRows, SecondOrderSystem, TimeGrid, TransientError, modal, steady,
};
use nalgebra::{DMatrix, DVector};
use num_complex::Complex64;

/// Modal force, relative to the largest, below which a resonance is not excited.
const NOT_EXCITED: f64 = 1e-9;

/// A system made ready for one grid of times.
#[derive(Clone, Debug)]
pub struct Propagator {
    pub(super) grid: TimeGrid,
    pub(super) kind: PropagatorKind,
    system: SecondOrderSystem,
    /// The factor c of the bound c k u, see [`Propagator::round_off_bound_relative_to_initial_motion_at_index`].
    units_per_step: f64,
}

#[derive(Clone, Debug)]
pub(super) enum PropagatorKind {
    Modal(DecoupledModes),
    Coupled { coordinates: MassCoordinates, state: StateSpace },
}

impl Propagator {
    /// Checks, and decouples or sets up the state space.
    ///
    /// # Errors
    /// Sizes, numbers, symmetry of M and K, mass in every direction.
    pub fn new(system: &SecondOrderSystem, grid: TimeGrid) -> Result<Self, TransientError> {
        system.check_sizes_numbers_and_symmetry_of_mass_and_stiffness()?;
        check_time_grid(grid)?;
        let coordinates = MassCoordinates::new(system)?;
        #[expect(clippy::cast_precision_loss, reason = "a dense matrix's size")]
        let size = 2.0 * system.count_unknowns() as f64;
        let (kind, units_per_step) = if let Some(modes) = coordinates.decouple_into_modes_if_proportionally_damped() {
            // Per step the 2 x 2 propagator's entries (a few units each) and its product; once, n terms per output.
            (PropagatorKind::Modal(modes), 16.0)
        } else {
            let state = StateSpace::new(&coordinates, last_time_but_at_least_one_step_s(grid))?;
            let rounds = 1.0
                + count_matrix_products_of_matrix_exponential(largest_column_sum_of_magnitudes(&state.a) * grid.step_s);
            (PropagatorKind::Coupled { coordinates, state }, rounds * size.powf(1.5))
        };
        Ok(Self { grid, kind, system: system.clone(), units_per_step })
    }

    /// Number of unknowns n.
    #[must_use]
    pub fn count_unknowns(&self) -> usize {
        self.system.count_unknowns()
    }

    /// Whether real modes were found: proportional damping, or none.
    #[must_use]
    pub const fn has_decoupled_modes(&self) -> bool {
        matches!(self.kind, PropagatorKind::Modal(_))
    }

    /// Bound on the round-off of the recurrence at time `index`, relative to the size of the initial free motion (the root
    /// of its energy), for a system that is not driven by its damping.
    ///
    /// A product of two 2n x 2n matrices of norm at most 1 has an error below `(2n)^1.5` u (u = 2^-53; Higham, Accuracy and
    /// Stability, section 3.5, from norms of |A| |B| up to sqrt(2n) times those of A and B). In the coordinates used no
    /// power of the propagator exceeds e in norm, so errors add and are not amplified: e for each of the `index` steps,
    /// whatever block they were taken in, as squaring doubles the error of what it squares. Linear in time. Errors of the
    /// given matrices themselves, w t u in phase, come on top and are of the problem, not of the recurrence.
    #[must_use]
    pub fn round_off_bound_relative_to_initial_motion_at_index(&self, index: usize) -> f64 {
        #[expect(clippy::cast_precision_loss, reason = "at most MOST_TIMES")]
        let steps = index as f64 + 1.0;
        let unit = 0.5 * f64::EPSILON;
        std::f64::consts::E * self.units_per_step * steps * unit
    }

    /// Complex amplitudes of the displacements in the steady state under `drive`, length n; n^2 steps if decoupled.
    ///
    /// # Errors
    /// [`TransientError::Unbounded`] at an undamped resonance that the force excites; sizes and numbers.
    pub fn solve_steady_amplitudes(&self, drive: &HarmonicForce) -> Result<DVector<Complex64>, TransientError> {
        check_harmonic_force(drive, self.count_unknowns())?;
        let PropagatorKind::Modal(modes) = &self.kind else {
            return steady::solve_steady_state_of_already_checked_system(&self.system, drive);
        };
        let force = modes.shapes.tr_mul(&drive.force_n);
        let (omega, square) = (drive.omega_rad_s, drive.omega_rad_s * drive.omega_rad_s);
        let phasor = Complex64::from_polar(1.0, drive.phase_rad);
        let (mut re, mut im) = (DVector::zeros(force.len()), DVector::zeros(force.len()));
        let largest = force.amax();
        for (mode, f) in force.iter().enumerate() {
            let lambda = modes.lambda[mode];
            let stiffness = Complex64::new(lambda - square, omega * modes.damping[mode]);
            if stiffness.norm() > steady::SINGULAR * (lambda.abs() + square) {
                let coordinate = phasor * *f / stiffness;
                (re[mode], im[mode]) = (coordinate.re, coordinate.im);
            } else if f.abs() > NOT_EXCITED * largest {
                return Err(TransientError::Unbounded { omega_rad_s: omega });
            }
        }
        Ok((&modes.shapes * re).zip_map(&(&modes.shapes * im), Complex64::new))
    }

    /// Motion under harmonic forces from t = 0 (equation 19): `count` x r, one column per output, in m, m/s or m/s^2.
    ///
    /// # Errors
    /// Sizes and numbers. At an undamped resonance there is an answer, which grows with t.
    pub fn compute_motion_under_harmonics_row_per_time(
        &self,
        initial: &InitialState,
        drives: &[HarmonicForce],
        outputs: OutputRows<'_>,
        quantity: MotionQuantity,
    ) -> Result<DMatrix<f64>, TransientError> {
        check_initial_state(initial, self.count_unknowns())?;
        let mut free = initial.clone();
        let mut waves = Vec::with_capacity(drives.len());
        for drive in drives {
            let omega = drive.omega_rad_s;
            let amplitudes = match self.solve_steady_amplitudes(drive) {
                Err(TransientError::Unbounded { .. }) => {
                    return self.compute_motion_with_phasor_states_row_per_time(initial, drives, outputs, quantity);
                }
                other => other?,
            };
            free.displacement.zip_apply(&amplitudes, |q, u| *q -= u.re);
            // Re(j w u) = -w Im u.
            free.velocity.zip_apply(&amplitudes, |v, u| *v += omega * u.im);
            let factor = match quantity {
                MotionQuantity::Displacement => Complex64::ONE,
                MotionQuantity::Velocity => Complex64::new(0.0, omega),
                MotionQuantity::Acceleration => Complex64::from(-omega * omega),
            };
            let at_outputs = |u: &DVector<Complex64>| -> Vec<Complex64> {
                match outputs {
                    OutputRows::All => u.iter().map(|u| u * factor).collect(),
                    OutputRows::Rows(rows) => rows
                        .row_iter()
                        .map(|row| row.iter().zip(u.iter()).map(|(r, u)| u * *r).sum::<Complex64>() * factor)
                        .collect(),
                }
            };
            self.check_output_rows(outputs)?;
            waves.push(HarmonicOutput { omega_rad_s: omega, amplitudes: at_outputs(&amplitudes) });
        }
        self.check_output_rows(outputs)?;
        let TimeGrid { step_s, count } = self.grid;
        Ok(match &self.kind {
            PropagatorKind::Modal(modes) => {
                let (q, v) = (&modes.to * free.displacement, &modes.to * free.velocity);
                modal::compute_modal_series_row_per_time(
                    modes,
                    &output_rows_over_coordinates(outputs, &modes.shapes),
                    quantity,
                    (&q, &v),
                    &waves,
                    (step_s, count),
                )
            }
            PropagatorKind::Coupled { coordinates, state } => {
                let z = state.build_state(&(&coordinates.to * free.displacement), &(&coordinates.to * free.velocity));
                let rows =
                    state.output_rows_over_state(&output_rows_over_coordinates(outputs, &coordinates.back), quantity);
                blocks::compute_series_with_harmonics_row_per_time(
                    &rows,
                    matrix_exponential(&(&state.a * step_s)),
                    &z,
                    &waves,
                    step_s,
                    count,
                )
            }
        })
    }

    /// Motion with the forces' phasors as states: right without a steady state, at the price of a matrix exponential.
    fn compute_motion_with_phasor_states_row_per_time(
        &self,
        initial: &InitialState,
        drives: &[HarmonicForce],
        outputs: OutputRows<'_>,
        quantity: MotionQuantity,
    ) -> Result<DMatrix<f64>, TransientError> {
        self.check_output_rows(outputs)?;
        for drive in drives {
            check_harmonic_force(drive, self.count_unknowns())?;
        }
        let TimeGrid { step_s, count } = self.grid;
        let coordinates = MassCoordinates::new(&self.system)?;
        let force = |drive: &HarmonicForce| (drive.omega_rad_s, coordinates.back.tr_mul(&drive.force_n));
        let forces: Vec<_> = drives.iter().map(force).collect();
        let (state, amplitudes) = StateSpace::new(&coordinates, last_time_but_at_least_one_step_s(self.grid))?
            .append_phasor_states_and_get_one_start_amplitude_per_drive(&forces);
        let to = |vector: &DVector<f64>| &coordinates.to * vector;
        let mut z = state.build_state(&to(&initial.displacement), &to(&initial.velocity));
        for (i, (drive, amplitude)) in drives.iter().zip(amplitudes).enumerate() {
            let at = 2 * self.count_unknowns() + 2 * i;
            z[at] = amplitude * drive.phase_rad.cos();
            z[at + 1] = amplitude * drive.phase_rad.sin();
        }
        let rows = state.output_rows_over_state(&output_rows_over_coordinates(outputs, &coordinates.back), quantity);
        Ok(blocks::compute_series_with_harmonics_row_per_time(
            &rows,
            matrix_exponential(&(&state.a * step_s)),
            &z,
            &[],
            step_s,
            count,
        ))
    }

    pub(super) fn check_output_rows(&self, outputs: OutputRows<'_>) -> Result<(), TransientError> {
        match outputs {
            OutputRows::All => Ok(()),
            OutputRows::Rows(rows) => {
                check_shape_and_finiteness("outputs", rows, rows.nrows().max(1), self.count_unknowns())
            }
        }
    }
}

/// Time of the last step in s.
fn last_time_but_at_least_one_step_s(grid: TimeGrid) -> f64 {
    grid.time_at_index_s(grid.count.max(2) - 1)
}

/// The output rows for unknowns that are `shapes` times coordinates.
pub(super) fn output_rows_over_coordinates(outputs: OutputRows<'_>, shapes: &DMatrix<f64>) -> DMatrix<f64> {
    match outputs {
        OutputRows::All => shapes.clone(),
        OutputRows::Rows(rows) => rows * shapes,
    }
}
