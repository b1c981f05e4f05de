//! Output rows times the powers of a propagator times a state, at many times.
//!
//! Time index k = L a + b, b < L: with Z the states at the starts of all blocks and Y_i = (row_i, row_i E, row_i E^2, ...)
//! over one block, the series of output i is the L x A matrix Y_i Z, which in memory is in the order of time.

use nalgebra::{DMatrix, DVector};
use num_complex::Complex64;

/// Part of its first size below which what is left is dropped: far under one unit in the last place.
pub const DIED_OUT: f64 = 1e-20;
/// Longest block, a power of two: its table for 60 unknowns stays in the second-level cache.
const LONGEST: usize = 128;

/// A harmonic part of every output: Re(amplitude e^(j omega t)), one amplitude per output.
#[derive(Clone, Debug)]
pub struct HarmonicOutput {
    pub omega_rad_s: f64,
    pub amplitudes: Vec<Complex64>,
}

/// e^(j omega index step).
#[expect(clippy::cast_precision_loss, reason = "at most MOST_TIMES")]
pub fn unit_phasor_at_index(omega_rad_s: f64, step_s: f64, index: usize) -> Complex64 {
    Complex64::from_polar(1.0, omega_rad_s * (index as f64 * step_s))
}

/// A power of two such that a table of `outputs` rows and the block starts cost about the same.
pub fn choose_block_length(count: usize, outputs: usize) -> usize {
    let mut length = 4;
    while length < LONGEST && length * length * outputs < 2 * count {
        length *= 2;
    }
    length
}

/// Series (`count` x r) of rows E^k `state` plus waves, E the propagator over one step, `rows` r x S.
pub fn compute_series_with_harmonics_row_per_time(
    rows: &DMatrix<f64>,
    one_step: DMatrix<f64>,
    state: &DVector<f64>,
    waves: &[HarmonicOutput],
    step_s: f64,
    count: usize,
) -> DMatrix<f64> {
    let (outputs, size) = rows.shape();
    let length = choose_block_length(count, outputs);
    let blocks = count.div_ceil(length);
    let width = size + 2 * waves.len();
    // Row b r + i of the table: row_i E^b.
    let mut table = DMatrix::zeros(outputs * length, width);
    table.view_mut((0, 0), (outputs, size)).copy_from(rows);
    let mut propagate = one_step;
    let mut filled = 1;
    while filled < length {
        let next = table.view((0, 0), (filled * outputs, size)) * &propagate;
        table.view_mut((filled * outputs, 0), (filled * outputs, size)).copy_from(&next);
        propagate = &propagate * &propagate;
        filled *= 2;
    }
    let mut starts = DMatrix::zeros(width, blocks);
    compute_block_start_states(&propagate, state, &mut starts);
    for (w, wave) in waves.iter().enumerate() {
        let at = size + 2 * w;
        for b in 0..length {
            let turned = unit_phasor_at_index(wave.omega_rad_s, step_s, b);
            for (i, amplitude) in wave.amplitudes.iter().enumerate() {
                let value = amplitude * turned;
                table[(b * outputs + i, at)] = value.re;
                table[(b * outputs + i, at + 1)] = -value.im;
            }
        }
        for a in 0..blocks {
            let value = unit_phasor_at_index(wave.omega_rad_s, step_s, a * length);
            starts[(at, a)] = value.re;
            starts[(at + 1, a)] = value.im;
        }
    }
    let mut out = DMatrix::zeros(count, outputs);
    let mut padded = DMatrix::zeros(length, blocks);
    for i in 0..outputs {
        // A copy, as nalgebra's product of thin matrices reads beyond the end of a view with gaps between its rows.
        let rows_of_one = table.rows_with_step(i, length, outputs - 1).into_owned();
        padded.gemm(1.0, &rows_of_one, &starts, 0.0);
        out.column_mut(i).as_mut_slice().copy_from_slice(&padded.as_slice()[..count]);
    }
    out
}

/// E^(L a) `state` into the first rows of column a, by a product of matrices for many columns.
fn compute_block_start_states(propagate: &DMatrix<f64>, state: &DVector<f64>, starts: &mut DMatrix<f64>) {
    /// Columns from which five more squarings cost less than single products.
    const MANY: usize = 160;
    /// Columns per product then.
    const TOGETHER: usize = 32;
    let (size, blocks) = (state.len(), starts.ncols());
    let dead = DIED_OUT * state.norm();
    starts.view_mut((0, 0), (size, 1)).copy_from(state);
    let single = if blocks > MANY { TOGETHER } else { blocks };
    let mut now = state.clone();
    let mut next = now.clone();
    for a in 1..single {
        next.gemv(1.0, propagate, &now, 0.0);
        starts.view_mut((0, a), (size, 1)).copy_from(&next);
        std::mem::swap(&mut now, &mut next);
        if now.norm() <= dead {
            return;
        }
    }
    if single == blocks {
        return;
    }
    let mut power = propagate.clone();
    for _ in 0..TOGETHER.ilog2() {
        power = &power * &power;
    }
    let mut from = 0;
    while from + TOGETHER < blocks {
        let columns = TOGETHER.min(blocks - from - TOGETHER);
        let next = &power * starts.view((0, from), (size, columns));
        starts.view_mut((0, from + TOGETHER), (size, columns)).copy_from(&next);
        if next.norm() <= dead {
            return;
        }
        from += TOGETHER;
    }
}
