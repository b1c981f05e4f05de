//! Sparse symmetric matrices and their Cholesky factorisation (by faer, sequential: its parallel dense product has an
//! open wrong-result report, and the matrices here are small).

use super::ModelError;
use faer::linalg::solvers::Solve;
use faer::sparse::linalg::solvers::Llt;
use faer::sparse::{SparseColMat, Triplet};
use faer::{MatMut, Side};
use nalgebra::{DMatrix, DVector};

/// Non-zero entries of a vector over the free unknowns.
pub type SparseVector = Vec<(usize, f64)>;

/// Columns that a product is made with at once: a block of the iteration's vectors.
const LANES: usize = 4;

/// Relative residual, row by row, above which a factorisation is not believed. Good ones give 1e-14 on regular meshes and
/// 1e-9 in the thinnest cells' rows of strongly graded ones; a failed one gives 1 or infinity.
const RESIDUAL_LIMIT: f64 = 1e-6;

/// Entries of a matrix under assembly; entries at one place add up.
#[derive(Clone, Debug, Default)]
pub struct Entries(Vec<Triplet<usize, usize, f64>>);

impl Entries {
    /// Adds `value` at a place.
    pub fn add(&mut self, row: usize, column: usize, value: f64) {
        if value != 0.0 {
            self.0.push(Triplet::new(row, column, value));
        }
    }

    /// Adds `scale` times the outer product of a sparse vector with itself.
    pub fn add_outer(&mut self, vector: &[(usize, f64)], scale: f64) {
        for (row, a) in vector {
            for (column, b) in vector {
                self.add(*row, *column, a * b * scale);
            }
        }
    }

    /// All entries: row, column, value.
    pub fn iter(&self) -> impl Iterator<Item = (usize, usize, f64)> {
        self.0.iter().map(|entry| (entry.row, entry.col, entry.val))
    }

    /// Adds all of `other`, scaled.
    pub fn add_all(&mut self, other: &Entries, scale: f64) {
        self.0.extend(other.0.iter().map(|entry| Triplet::new(entry.row, entry.col, entry.val * scale)));
    }

    /// The matrix, `n` x `n`.
    ///
    /// # Errors
    /// [`ModelError::Factorisation`] if an entry lies outside it.
    pub fn build(&self, n: usize) -> Result<Symmetric, ModelError> {
        let matrix = SparseColMat::try_new_from_triplets(n, n, &self.0)
            .map_err(|error| ModelError::Factorisation { reason: format!("assembly: {error:?}") })?;
        Ok(Symmetric { matrix })
    }
}

/// A sparse symmetric matrix with both triangles stored.
#[derive(Clone, Debug)]
pub struct Symmetric {
    matrix: SparseColMat<usize, f64>,
}

impl Symmetric {
    /// Rows and columns.
    #[must_use]
    pub fn order(&self) -> usize {
        self.matrix.nrows()
    }

    /// All entries, for assembling sums of matrices.
    #[must_use]
    pub fn entries(&self) -> Entries {
        let (starts, rows, values) = (self.matrix.col_ptr(), self.matrix.row_idx(), self.matrix.val());
        let mut entries = Entries::default();
        for column in 0..self.order() {
            for place in starts[column]..starts[column + 1] {
                entries.add(rows[place], column, values[place]);
            }
        }
        entries
    }

    /// The product with each column of `vectors` (order x any).
    #[must_use]
    pub fn times(&self, vectors: &DMatrix<f64>) -> DMatrix<f64> {
        let mut out = DMatrix::zeros(self.order(), vectors.ncols());
        for first in (0..vectors.ncols()).step_by(LANES) {
            self.times_lanes(vectors, first, &mut out);
        }
        out
    }

    /// The product with up to [`LANES`] columns at once: every entry is read once for all of them, and as rows are columns
    /// here each result is a sum that stays in registers.
    fn times_lanes(&self, vectors: &DMatrix<f64>, first: usize, out: &mut DMatrix<f64>) {
        let lanes = first..vectors.ncols().min(first + LANES);
        let mut inputs = vec![[0.0; LANES]; self.order()];
        for (lane, column) in lanes.clone().enumerate() {
            for (input, value) in inputs.iter_mut().zip(vectors.column(column).iter()) {
                input[lane] = *value;
            }
        }
        let (starts, rows, values) = (self.matrix.col_ptr(), self.matrix.row_idx(), self.matrix.val());
        for (row, range) in starts.windows(2).map(|at| at[0]..at[1]).enumerate() {
            let mut sum = [0.0; LANES];
            for (other, value) in rows[range.clone()].iter().zip(&values[range]) {
                for (sum, input) in sum.iter_mut().zip(&inputs[*other]) {
                    *sum += value * input;
                }
            }
            for (lane, column) in lanes.clone().enumerate() {
                out[(row, column)] = sum[lane];
            }
        }
    }

    /// Factors the matrix, which must be positive definite, and checks the factors on a vector.
    ///
    /// # Errors
    /// [`ModelError::Factorisation`].
    pub fn factor(&self) -> Result<Factor, ModelError> {
        let failed = |reason: String| ModelError::Factorisation { reason };
        let llt = self.matrix.sp_cholesky(Side::Lower).map_err(|error| failed(format!("{error:?}")))?;
        let factor = Factor { llt, spring: None };
        // Positive and negative, of one size: touches every row and cancels in none.
        let n = self.order();
        let trial = DMatrix::from_fn(n, 1, |i, _| if i % 3 == 0 { -1.0 } else { 1.0 + 1e-3 * (i % 7) as f64 });
        let solution = factor.solve(&trial);
        let back = self.times(&solution);
        let scale = self.row_sums(&solution);
        let worst = (0..n).map(|i| (back[i] - trial[i]).abs() / (scale[i] + 1.0)).fold(0.0, f64::max);
        if worst.is_finite() && worst < RESIDUAL_LIMIT {
            return Ok(factor);
        }
        Err(failed(format!("relative residual {worst:e}")))
    }

    /// |A| |x|: what each row's product is summed from.
    fn row_sums(&self, vector: &DMatrix<f64>) -> Vec<f64> {
        let mut sums = vec![0.0; self.order()];
        let (starts, rows, values) = (self.matrix.col_ptr(), self.matrix.row_idx(), self.matrix.val());
        for (column, x) in vector.iter().enumerate() {
            let range = starts[column]..starts[column + 1];
            for (row, value) in rows[range.clone()].iter().zip(&values[range]) {
                sums[*row] += (value * x).abs();
            }
        }
        sums
    }
}

/// A sparse row times a matrix.
pub(super) fn row_times(row: &[(usize, f64)], matrix: &DMatrix<f64>) -> nalgebra::RowDVector<f64> {
    let mut out = nalgebra::RowDVector::zeros(matrix.ncols());
    for (index, value) in row {
        out += matrix.row(*index) * *value;
    }
    out
}

/// A Cholesky factorisation, of a matrix that may have a spring on a sum of all unknowns beside what is sparse.
#[derive(Clone, Debug)]
pub struct Factor {
    llt: Llt<usize, f64>,
    spring: Option<Spring>,
}

/// k v v' beside a factored A: (A + k v v')^-1 = A^-1 - z (k / (1 + k v' z)) z' with A z = v (Sherman and Morrison).
#[derive(Clone, Debug)]
struct Spring {
    vector: SparseVector,
    /// z.
    solution: DVector<f64>,
    /// k / (1 + k v' z).
    part: f64,
}

impl Factor {
    /// The same, of a matrix of this order, with a spring of this stiffness on vector . unknowns.
    #[must_use]
    pub fn with_spring(self, order: usize, vector: &SparseVector, stiffness: f64) -> Self {
        let mut right = DMatrix::zeros(order, 1);
        vector.iter().for_each(|(unknown, value)| right[(*unknown, 0)] += value);
        let solution = self.solve(&right).column(0).into_owned();
        let own: f64 = vector.iter().map(|(unknown, value)| value * solution[*unknown]).sum();
        let spring = Spring { vector: vector.clone(), part: stiffness / (1.0 + stiffness * own), solution };
        Self { spring: Some(spring), ..self }
    }

    /// The solution for each column of `right` (order x any).
    #[must_use]
    pub fn solve(&self, right: &DMatrix<f64>) -> DMatrix<f64> {
        let mut out = right.clone();
        let (rows, columns) = out.shape();
        self.llt.solve_in_place(MatMut::from_column_major_slice_mut(out.as_mut_slice(), rows, columns));
        if let Some(Spring { vector, solution, part }) = &self.spring {
            let pulls = row_times(vector, &out) * *part;
            out -= solution * pulls;
        }
        out
    }
}
