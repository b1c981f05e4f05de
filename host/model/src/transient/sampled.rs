//! Motion under forces of any course, given at the grid's times and straight in between (first-order hold).

use super::exponential::matrix_exponential;
use super::propagator::{Propagator, PropagatorKind, output_rows_over_coordinates};
use super::system::{DecoupledModes, check_initial_state, check_shape_and_finiteness};
use super::{InitialState, MotionQuantity, OutputRows, TimeGrid, TransientError};
use nalgebra::{DMatrix, DVector};

/// z(k+1) = E z(k) + G0 f(k) + G1 f(k+1), exact for forces that are straight over each step.
struct FirstOrderHold {
    e: DMatrix<f64>,
    g0: DMatrix<f64>,
    g1: DMatrix<f64>,
}

impl FirstOrderHold {
    /// For z' = A z + B f over `step_s`: the exponential of [[A, B, 0], [0, 0, 1/h], [0, 0, 0]] h holds all three (Van
    /// Loan, IEEE Trans. Automatic Control 23 (1978) 395).
    fn new(a: &DMatrix<f64>, b: &DMatrix<f64>, step_s: f64) -> Self {
        let (size, p) = b.shape();
        let mut block = DMatrix::zeros(size + 2 * p, size + 2 * p);
        block.view_mut((0, 0), (size, size)).copy_from(&(a * step_s));
        // Columns of length one at most, so that large forces cost no squarings.
        let scale = b.column_iter().map(|column| column.norm()).fold(0.0, f64::max) * step_s;
        if scale > 0.0 {
            block.view_mut((0, size), (size, p)).copy_from(&(b * (step_s / scale)));
        }
        for i in 0..p {
            block[(size + i, size + p + i)] = 1.0;
        }
        let all = matrix_exponential(&block);
        let constant = all.view((0, size), (size, p)) * scale;
        let g1 = all.view((0, size + p), (size, p)) * scale;
        Self { e: all.view((0, 0), (size, size)).into_owned(), g0: constant - &g1, g1 }
    }

    /// States at all times, size x count, for forces p x count.
    fn compute_states(&self, start: &DVector<f64>, forces: &DMatrix<f64>) -> DMatrix<f64> {
        let count = forces.ncols();
        let (now, next) = (&self.g0 * forces, &self.g1 * forces);
        let mut states = DMatrix::zeros(start.len(), count);
        let mut z = start.clone();
        for k in 0..count {
            states.set_column(k, &z);
            if k + 1 < count {
                let mut after = now.column(k) + next.column(k + 1);
                after.gemv(1.0, &self.e, &z, 1.0);
                z = after;
            }
        }
        states
    }
}

impl Propagator {
    /// Motion under the forces `input` (n x p) times `samples` (p x count, N at the grid's times): `count` x r.
    ///
    /// Exact for forces that are straight between samples; for a force with second derivative f'' the hold itself is off
    /// by up to h^2 |f''| / 8.
    ///
    /// # Errors
    /// Sizes and numbers.
    pub fn compute_motion_under_samples_row_per_time(
        &self,
        initial: &InitialState,
        input: &DMatrix<f64>,
        samples: &DMatrix<f64>,
        outputs: OutputRows<'_>,
        quantity: MotionQuantity,
    ) -> Result<DMatrix<f64>, TransientError> {
        let n = self.count_unknowns();
        let TimeGrid { step_s, count } = self.grid;
        check_initial_state(initial, n)?;
        check_shape_and_finiteness("input", input, n, input.ncols().max(1))?;
        check_shape_and_finiteness("samples", samples, input.ncols(), count)?;
        self.check_output_rows(outputs)?;
        let (mut series, through) = match &self.kind {
            PropagatorKind::Modal(modes) => {
                let force = modes.shapes.transpose() * input;
                let (q, v) = (&modes.to * &initial.displacement, &modes.to * &initial.velocity);
                let scalar = simulate_mode_series_without_force_feedthrough(
                    modes,
                    quantity,
                    (&q, &v),
                    &(&force * samples),
                    step_s,
                );
                let rows = output_rows_over_coordinates(outputs, &modes.shapes);
                (scalar * rows.transpose(), rows * force)
            }
            PropagatorKind::Coupled { coordinates, state } => {
                let force = coordinates.back.transpose() * input;
                let b = {
                    let mut b = DMatrix::zeros(2 * n, force.ncols());
                    b.rows_mut(n, n).copy_from(&force);
                    b
                };
                let start = state
                    .build_state(&(&coordinates.to * &initial.displacement), &(&coordinates.to * &initial.velocity));
                let states = FirstOrderHold::new(&state.a, &b, step_s).compute_states(&start, samples);
                let rows = output_rows_over_coordinates(outputs, &coordinates.back);
                ((state.output_rows_over_state(&rows, quantity) * states).transpose(), rows * force)
            }
        };
        if quantity == MotionQuantity::Acceleration {
            series += samples.transpose() * through.transpose();
        }
        Ok(series)
    }
}

/// The modes' own series (count x n) without what the force adds to the acceleration at once; `forces` are n x count.
fn simulate_mode_series_without_force_feedthrough(
    modes: &DecoupledModes,
    quantity: MotionQuantity,
    (q, v): (&DVector<f64>, &DVector<f64>),
    forces: &DMatrix<f64>,
    step_s: f64,
) -> DMatrix<f64> {
    let mut series = DMatrix::zeros(forces.ncols(), forces.nrows());
    for mode in 0..forces.nrows() {
        let (lambda, damping) = (modes.lambda[mode], modes.damping[mode]);
        // (scale q, q') has entries of one size, as in energy; a motion without stiffness is measured by the step.
        let scale = lambda.abs().sqrt().max(1.0 / step_s);
        let a = DMatrix::from_row_slice(2, 2, &[0.0, scale, -lambda / scale, -damping]);
        let held = FirstOrderHold::new(&a, &DMatrix::from_column_slice(2, 1, &[0.0, 1.0]), step_s);
        let (mut x, mut y) = (scale * q[mode], v[mode]);
        for (k, out) in series.column_mut(mode).iter_mut().enumerate() {
            *out = match quantity {
                MotionQuantity::Displacement => x / scale,
                MotionQuantity::Velocity => y,
                MotionQuantity::Acceleration => -lambda / scale * x - damping * y,
            };
            if k + 1 < forces.ncols() {
                let (now, next) = (forces[(mode, k)], forces[(mode, k + 1)]);
                let forced = |i: usize| held.g0[i] * now + held.g1[i] * next;
                (x, y) = (
                    held.e[(0, 0)] * x + held.e[(0, 1)] * y + forced(0),
                    held.e[(1, 0)] * x + held.e[(1, 1)] * y + forced(1),
                );
            }
        }
    }
    series
}
