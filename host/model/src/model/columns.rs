//! An iteration's basis: many long columns, multiplied with a few vectors at a time.
//!
//! Such products read the whole basis for four flops a number, so that reading is what they cost: every number is read once
//! for all vectors of a block, whose values at one place lie side by side. (nalgebra's products of these sizes read it once
//! for each, and took three quarters of the time of an iteration for 400 modes.)

use crate::kernel;
use nalgebra::DMatrix;
use pulp::Arch;

/// Vectors that are taken together.
pub(super) const LANES: usize = 4;
/// Columns of the basis that are taken together: their sums stay in registers.
const TOGETHER: usize = 4;

/// Columns of one length.
#[derive(Clone, Debug)]
pub(super) struct BasisColumns {
    rows: usize,
    /// Column by column.
    values: Vec<f64>,
}

/// The values of up to [`LANES`] vectors at each place.
type Lanes = [f64; LANES];

impl BasisColumns {
    /// None yet, of this length.
    pub(super) fn new(rows: usize) -> Self {
        Self { rows, values: Vec::new() }
    }

    /// How many there are.
    pub(super) fn len(&self) -> usize {
        self.values.len().checked_div(self.rows).unwrap_or(0)
    }

    /// Appends the columns of a matrix.
    pub(super) fn append_columns(&mut self, columns: &DMatrix<f64>) {
        self.values.extend_from_slice(columns.as_slice());
    }

    /// Inner products of every column with every vector: V' X.
    pub(super) fn inner_products_with(&self, vectors: &DMatrix<f64>) -> DMatrix<f64> {
        let mut out = DMatrix::zeros(self.len(), vectors.ncols());
        for first in (0..vectors.ncols()).step_by(LANES) {
            let lanes = interleave_columns(vectors, first);
            let mut sums = vec![[0.0; LANES]; self.len()];
            Arch::new().dispatch(InnerProducts(&self.values, &lanes, &mut sums));
            for (mut column, lane) in out.columns_range_mut(first..).column_iter_mut().zip(0..LANES) {
                column.iter_mut().zip(&sums).for_each(|(out, sum)| *out = sum[lane]);
            }
        }
        out
    }

    /// Subtracts combinations of the columns from vectors: X - V C into X.
    pub(super) fn subtract_combinations_from(&self, vectors: &mut DMatrix<f64>, coefficients: &DMatrix<f64>) {
        for first in (0..vectors.ncols()).step_by(LANES) {
            let mut lanes = interleave_columns(vectors, first);
            let coefficients = interleave_columns(coefficients, first);
            Arch::new().dispatch(Subtract(&self.values, &coefficients, &mut lanes));
            for (mut column, lane) in vectors.columns_range_mut(first..).column_iter_mut().zip(0..LANES) {
                column.iter_mut().zip(&lanes).for_each(|(out, value)| *out = value[lane]);
            }
        }
    }

    /// Combinations of the columns: V C.
    pub(super) fn combine_columns(&self, coefficients: &DMatrix<f64>) -> DMatrix<f64> {
        nalgebra::DMatrixView::from_slice(&self.values, self.rows, self.len()) * coefficients
    }
}

/// Up to [`LANES`] columns from `first_column` on, the values of one row side by side.
fn interleave_columns(vectors: &DMatrix<f64>, first_column: usize) -> Vec<Lanes> {
    let mut out = vec![[0.0; LANES]; vectors.nrows()];
    for (column, lane) in vectors.columns_range(first_column..).column_iter().zip(0..LANES) {
        out.iter_mut().zip(column.iter()).for_each(|(out, value)| out[lane] = *value);
    }
    out
}

kernel!(InnerProducts<'a>(values: &'a [f64], vectors: &'a [Lanes], out: &'a mut [Lanes]) -> () = compute_inner_products_into);

/// Sets `out[c]` to the sum over places of `values[c]` times `vectors`.
#[inline(always)]
fn compute_inner_products_into(values: &[f64], vectors: &[Lanes], out: &mut [Lanes]) {
    let rows = vectors.len().max(1);
    for (columns, out) in values.chunks(TOGETHER * rows).zip(out.chunks_mut(TOGETHER)) {
        let mut sums = [[0.0; LANES]; TOGETHER];
        let column = |k: usize| columns.get(k * rows..(k + 1) * rows).unwrap_or(&[]);
        if out.len() == TOGETHER {
            let [a, b, c, d] = [column(0), column(1), column(2), column(3)];
            for ((((x, a), b), c), d) in vectors.iter().zip(a).zip(b).zip(c).zip(d) {
                for lane in 0..LANES {
                    sums[0][lane] += a * x[lane];
                    sums[1][lane] += b * x[lane];
                    sums[2][lane] += c * x[lane];
                    sums[3][lane] += d * x[lane];
                }
            }
        } else {
            for (k, sums) in sums.iter_mut().enumerate() {
                for (x, a) in vectors.iter().zip(column(k)) {
                    sums.iter_mut().zip(x).for_each(|(sum, x)| *sum += a * x);
                }
            }
        }
        out.iter_mut().zip(sums).for_each(|(out, sums)| *out = sums);
    }
}

kernel!(Subtract<'a>(values: &'a [f64], coefficients: &'a [Lanes], vectors: &'a mut [Lanes]) -> () = subtract_weighted_columns);

/// `vectors` -= the sum over columns of `values[c]` times `coefficients[c]`.
#[inline(always)]
fn subtract_weighted_columns(values: &[f64], coefficients: &[Lanes], vectors: &mut [Lanes]) {
    let rows = vectors.len().max(1);
    for (columns, by) in values.chunks(TOGETHER * rows).zip(coefficients.chunks(TOGETHER)) {
        let column = |k: usize| columns.get(k * rows..(k + 1) * rows).unwrap_or(&[]);
        if let [p, q, r, s] = by {
            let [a, b, c, d] = [column(0), column(1), column(2), column(3)];
            for ((((x, a), b), c), d) in vectors.iter_mut().zip(a).zip(b).zip(c).zip(d) {
                for lane in 0..LANES {
                    x[lane] -= a * p[lane] + b * q[lane] + c * r[lane] + d * s[lane];
                }
            }
        } else {
            for (k, by) in by.iter().enumerate() {
                for (x, a) in vectors.iter_mut().zip(column(k)) {
                    x.iter_mut().zip(by).for_each(|(x, by)| *x -= a * by);
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Against nalgebra's, for numbers of columns and vectors that do and do not fill a group.
    #[test]
    fn products_are_those_of_matrices() {
        for (rows, columns, width) in [(7, 1, 1), (10, 4, 4), (23, 9, 3), (12, 6, 6)] {
            let basis = DMatrix::from_fn(rows, columns, |i, j| ((3 * i + 7 * j) % 11) as f64 - 5.0);
            let vectors = DMatrix::from_fn(rows, width, |i, j| ((5 * i + 2 * j) % 13) as f64 - 6.0);
            let mut tall = BasisColumns::new(rows);
            basis
                .column_iter()
                .for_each(|column| tall.append_columns(&DMatrix::from_column_slice(rows, 1, column.as_slice())));
            let inner = tall.inner_products_with(&vectors);
            assert_eq!(inner, basis.tr_mul(&vectors));
            let mut rest = vectors.clone();
            tall.subtract_combinations_from(&mut rest, &inner);
            assert_eq!(rest, &vectors - &basis * &inner);
            assert_eq!(tall.combine_columns(&inner), &basis * &inner);
        }
    }
}
