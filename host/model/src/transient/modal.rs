//! Series of decoupled modes.

use super::MotionQuantity;
use super::blocks::{DIED_OUT, HarmonicOutput, choose_block_length, unit_phasor_at_index};
use super::oscillator::OscillatorStep;
use super::system::DecoupledModes;
use nalgebra::{DMatrix, DVector};
use num_complex::Complex64;

/// Outputs up to which the modes are weighted before the times are filled in, instead of after.
const FEW: usize = 8;

/// Weights of a mode's displacement and velocity in a quantity: q'' = -lambda q - c q' in free motion.
fn displacement_and_velocity_weights(quantity: MotionQuantity, lambda: f64, damping: f64) -> (f64, f64) {
    match quantity {
        MotionQuantity::Displacement => (1.0, 0.0),
        MotionQuantity::Velocity => (0.0, 1.0),
        MotionQuantity::Acceleration => (-lambda, -damping),
    }
}

/// The quantity over one block for unit displacement (columns 0 to n - 1) and unit velocity (n to 2n - 1) at its start.
fn responses_over_block_to_unit_displacements_then_velocities(
    modes: &DecoupledModes,
    quantity: MotionQuantity,
    step_s: f64,
    length: usize,
) -> DMatrix<f64> {
    let n = modes.lambda.len();
    let mut table = DMatrix::zeros(length, 2 * n);
    let (left, right) = table.as_mut_slice().split_at_mut(length * n);
    for (mode, (from_q, from_v)) in left.chunks_exact_mut(length).zip(right.chunks_exact_mut(length)).enumerate() {
        let (lambda, damping) = (modes.lambda[mode], modes.damping[mode]);
        let step = OscillatorStep::from_time_and_mode(step_s, lambda, damping);
        let (a, b) = displacement_and_velocity_weights(quantity, lambda, damping);
        let (mut unit_q, mut unit_v) = ((1.0, 0.0), (0.0, 1.0));
        for (q, v) in from_q.iter_mut().zip(from_v) {
            *q = a * unit_q.0 + b * unit_q.1;
            *v = a * unit_v.0 + b * unit_v.1;
            (unit_q, unit_v) = (step.advance_state(unit_q), step.advance_state(unit_v));
        }
    }
    table
}

/// Series (`count` x r) of free motion from modal displacement `q` and velocity `v`, plus waves; `rows` are r x n and take
/// the outputs from the modes.
pub fn compute_modal_series_row_per_time(
    modes: &DecoupledModes,
    rows: &DMatrix<f64>,
    quantity: MotionQuantity,
    (q, v): (&DVector<f64>, &DVector<f64>),
    waves: &[HarmonicOutput],
    (step_s, count): (f64, usize),
) -> DMatrix<f64> {
    let outputs = rows.nrows();
    let length = choose_block_length(count, outputs.min(2));
    let blocks = count.div_ceil(length);
    let n = modes.lambda.len();
    let table = responses_over_block_to_unit_displacements_then_velocities(modes, quantity, step_s, length);
    #[expect(clippy::cast_precision_loss, reason = "at most MOST_TIMES")]
    let block_s = length as f64 * step_s;
    // Displacements and velocities at the starts of blocks, 2n x A.
    let mut starts = DMatrix::zeros(2 * n, blocks);
    let mut alive = vec![blocks; n];
    for mode in 0..n {
        let omega = modes.lambda[mode].abs().sqrt();
        let size = |state: (f64, f64)| (omega * state.0).abs().max(state.1.abs());
        let step = OscillatorStep::from_time_and_mode(block_s, modes.lambda[mode], modes.damping[mode]);
        let mut state = (q[mode], v[mode]);
        let dead = DIED_OUT * size(state);
        for a in 0..blocks {
            // A rigid motion has no energy of position and never dies.
            if omega > 0.0 && size(state) <= dead {
                alive[mode] = a;
                break;
            }
            (starts[(mode, a)], starts[(n + mode, a)]) = state;
            state = step.advance_state(state);
        }
    }
    if outputs <= FEW {
        compute_few_output_series_row_per_time(rows, &table, &starts, waves, (length, step_s, count))
    } else {
        compute_many_output_series_row_per_time(rows, &table, &starts, &alive, waves, (length, step_s, count))
    }
}

/// One product: the table, times the block starts weighted for each output.
fn compute_few_output_series_row_per_time(
    rows: &DMatrix<f64>,
    table: &DMatrix<f64>,
    starts: &DMatrix<f64>,
    waves: &[HarmonicOutput],
    (length, step_s, count): (usize, f64, usize),
) -> DMatrix<f64> {
    let (outputs, n) = rows.shape();
    let (blocks, width) = (starts.ncols(), 2 * n + 2 * waves.len());
    let table = keep_first_columns_and_append_waves(table, 2 * n, waves, step_s);
    let mut weighted = DMatrix::zeros(width, blocks * outputs);
    for i in 0..outputs {
        for a in 0..blocks {
            let mut column = weighted.column_mut(i * blocks + a);
            for mode in 0..n {
                column[mode] = rows[(i, mode)] * starts[(mode, a)];
                column[n + mode] = rows[(i, mode)] * starts[(n + mode, a)];
            }
            for (w, wave) in waves.iter().enumerate() {
                let value = wave.amplitudes[i] * unit_phasor_at_index(wave.omega_rad_s, step_s, a * length);
                column[2 * n + 2 * w] = value.re;
                column[2 * n + 2 * w + 1] = value.im;
            }
        }
    }
    let padded = (table * weighted).reshape_generic(nalgebra::Dyn(length * blocks), nalgebra::Dyn(outputs));
    padded.resize_vertically(count, 0.0)
}

/// The table's first columns, and cosine and minus sine of each wave over one block.
fn keep_first_columns_and_append_waves(
    table: &DMatrix<f64>,
    columns: usize,
    waves: &[HarmonicOutput],
    step_s: f64,
) -> DMatrix<f64> {
    let length = table.nrows();
    let mut wide = DMatrix::zeros(length, columns + 2 * waves.len());
    wide.columns_mut(0, columns).copy_from(&table.columns(0, columns));
    for (w, wave) in waves.iter().enumerate() {
        for b in 0..length {
            let value = unit_phasor_at_index(wave.omega_rad_s, step_s, b);
            wide[(b, columns + 2 * w)] = value.re;
            wide[(b, columns + 2 * w + 1)] = -value.im;
        }
    }
    wide
}

/// Block by block: the modes that are left, over the block, times the rows.
fn compute_many_output_series_row_per_time(
    rows: &DMatrix<f64>,
    table: &DMatrix<f64>,
    starts: &DMatrix<f64>,
    alive: &[usize],
    waves: &[HarmonicOutput],
    (length, step_s, count): (usize, f64, usize),
) -> DMatrix<f64> {
    let (outputs, n) = rows.shape();
    let first = 2 * waves.len();
    let cosines = keep_first_columns_and_append_waves(table, 0, waves, step_s);
    // Waves first, then modes, the slowest to die out first, so that what is left is a leading part.
    let mut transposed = DMatrix::zeros(first + n, outputs);
    transposed.rows_mut(first, n).copy_from(&rows.transpose());
    for (w, wave) in waves.iter().enumerate() {
        for (i, amplitude) in wave.amplitudes.iter().enumerate() {
            transposed[(2 * w, i)] = amplitude.re;
            transposed[(2 * w + 1, i)] = -amplitude.im;
        }
    }
    let mut scalar = DMatrix::zeros(length, first + n);
    let mut out = DMatrix::zeros(count, outputs);
    let (from_q, from_v) = table.as_slice().split_at(length * n);
    for a in 0..starts.ncols() {
        for (w, wave) in waves.iter().enumerate() {
            // Re(u e^(j w t)) = Re u cos - Im u sin of the time since t = 0.
            let start = unit_phasor_at_index(wave.omega_rad_s, step_s, a * length);
            for b in 0..length {
                let value = start * Complex64::new(cosines[(b, 2 * w)], -cosines[(b, 2 * w + 1)]);
                scalar[(b, 2 * w)] = value.re;
                scalar[(b, 2 * w + 1)] = value.im;
            }
        }
        let left = alive.iter().rposition(|until| *until > a).map_or(0, |last| last + 1);
        let modes = &mut scalar.as_mut_slice()[length * first..];
        for (mode, column) in modes.chunks_exact_mut(length).enumerate().take(left) {
            let (q, v) = (starts[(mode, a)], starts[(n + mode, a)]);
            let range = mode * length..(mode + 1) * length;
            for ((s, f), g) in column.iter_mut().zip(&from_q[range.clone()]).zip(&from_v[range]) {
                *s = q * f + v * g;
            }
        }
        if first + left == 0 {
            // Nothing drives it and all has died out: the rest stays zero.
            break;
        }
        let (at, size) = (a * length, length.min(count - a * length));
        out.rows_mut(at, size).gemm(
            1.0,
            &scalar.view((0, 0), (size, first + left)),
            &transposed.rows(0, first + left),
            0.0,
        );
    }
    out
}
