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
pub struct MatrixEntries(Vec<Triplet<usize, usize, f64>>);

impl MatrixEntries {
    /// Adds `value` at (row, column).
    pub fn add_entry_without_its_transpose(&mut self, row: usize, column: usize, value: f64) {
        if value != 0.0 {
            self.0.push(Triplet::new(row, column, value));
        }
    }

    /// Adds `scale` times the outer product of a sparse vector with itself.
    pub fn add_outer_product(&mut self, vector: &[(usize, f64)], scale: f64) {
        for (row, a) in vector {
            for (column, b) in vector {
                self.add_entry_without_its_transpose(*row, *column, a * b * scale);
            }
        }
    }

    /// All entries: row, column, value.
    pub fn iter(&self) -> impl Iterator<Item = (usize, usize, f64)> {
        self.0.iter().map(|entry| (entry.row, entry.col, entry.val))
    }

    /// Adds all entries of `other`, scaled.
    pub fn add_scaled_entries(&mut self, other: &MatrixEntries, scale: f64) {
        self.0.extend(other.0.iter().map(|entry| Triplet::new(entry.row, entry.col, entry.val * scale)));
    }

    /// The matrix, `dimension` x `dimension`.
    ///
    /// # Errors
    /// [`ModelError::Factorisation`] if an entry lies outside it.
    pub fn build_matrix(&self, dimension: usize) -> Result<SparseSymmetricMatrix, ModelError> {
        let matrix = SparseColMat::try_new_from_triplets(dimension, dimension, &self.0)
            .map_err(|error| ModelError::Factorisation { reason: format!("assembly: {error:?}") })?;
        Ok(SparseSymmetricMatrix { matrix })
    }
}

/// A sparse symmetric matrix with both triangles stored.
#[derive(Clone, Debug)]
pub struct SparseSymmetricMatrix {
    matrix: SparseColMat<usize, f64>,
}

impl SparseSymmetricMatrix {
    /// Number of rows, and of columns.
    #[must_use]
    pub fn dimension(&self) -> usize {
        self.matrix.nrows()
    }

    /// All entries, for assembling sums of matrices.
    #[must_use]
    pub fn to_entries(&self) -> MatrixEntries {
        let (starts, rows, values) = (self.matrix.col_ptr(), self.matrix.row_idx(), self.matrix.val());
        let mut entries = MatrixEntries::default();
        for column in 0..self.dimension() {
            for place in starts[column]..starts[column + 1] {
                entries.add_entry_without_its_transpose(rows[place], column, values[place]);
            }
        }
        entries
    }

    /// The product of the matrix with each column of `vectors`.
    #[must_use]
    pub fn multiply_columns(&self, vectors: &DMatrix<f64>) -> DMatrix<f64> {
        let mut out = DMatrix::zeros(self.dimension(), vectors.ncols());
        for first in (0..vectors.ncols()).step_by(LANES) {
            self.multiply_one_block_of_columns_into_same_columns(vectors, first, &mut out);
        }
        out
    }

    /// The product with up to [`LANES`] columns at once: every entry is read once for all of them, and as rows are columns
    /// here each result is a sum that stays in registers.
    fn multiply_one_block_of_columns_into_same_columns(
        &self,
        vectors: &DMatrix<f64>,
        first: usize,
        out: &mut DMatrix<f64>,
    ) {
        let lanes = first..vectors.ncols().min(first + LANES);
        let mut inputs = vec![[0.0; LANES]; self.dimension()];
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
    pub fn factorise_and_check_residual(&self) -> Result<CholeskyFactor, ModelError> {
        let failed = |reason: String| ModelError::Factorisation { reason };
        let llt = self.matrix.sp_cholesky(Side::Lower).map_err(|error| failed(format!("{error:?}")))?;
        let factor = CholeskyFactor { llt, spring: None };
        // Positive and negative, of one size: touches every row and cancels in none.
        let n = self.dimension();
        let trial = DMatrix::from_fn(n, 1, |i, _| if i % 3 == 0 { -1.0 } else { 1.0 + 1e-3 * (i % 7) as f64 });
        let solution = factor.solve_for_columns(&trial);
        let back = self.multiply_columns(&solution);
        let scale = self.multiply_magnitudes_of_matrix_and_vector(&solution);
        let worst = (0..n).map(|i| (back[i] - trial[i]).abs() / (scale[i] + 1.0)).fold(0.0, f64::max);
        if worst.is_finite() && worst < RESIDUAL_LIMIT {
            return Ok(factor);
        }
        Err(failed(format!("relative residual {worst:e}")))
    }

    /// What each row's product is summed from: |A| |x|.
    fn multiply_magnitudes_of_matrix_and_vector(&self, vector: &DMatrix<f64>) -> Vec<f64> {
        let mut sums = vec![0.0; self.dimension()];
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

/// The product of a sparse row with a matrix.
pub(super) fn multiply_row_with_matrix(row: &[(usize, f64)], matrix: &DMatrix<f64>) -> nalgebra::RowDVector<f64> {
    let mut out = nalgebra::RowDVector::zeros(matrix.ncols());
    for (index, value) in row {
        out += matrix.row(*index) * *value;
    }
    out
}

/// A Cholesky factorisation, of a matrix that may have a spring on a sum of all unknowns beside what is sparse.
#[derive(Clone, Debug)]
pub struct CholeskyFactor {
    llt: Llt<usize, f64>,
    spring: Option<RankOneSpring>,
}

/// k v v' beside a factored A: (A + k v v')^-1 = A^-1 - z (k / (1 + k v' z)) z' with A z = v (Sherman and Morrison).
#[derive(Clone, Debug)]
struct RankOneSpring {
    vector: SparseVector,
    /// z.
    solution: DVector<f64>,
    /// k / (1 + k v' z).
    part: f64,
}

impl CholeskyFactor {
    /// Adds a spring of this stiffness on (vector . unknowns) to the factored matrix of this order.
    #[must_use]
    pub fn add_rank_one_spring(self, dimension: usize, vector: &SparseVector, stiffness: f64) -> Self {
        let mut right = DMatrix::zeros(dimension, 1);
        vector.iter().for_each(|(unknown, value)| right[(*unknown, 0)] += value);
        let solution = self.solve_for_columns(&right).column(0).into_owned();
        let own: f64 = vector.iter().map(|(unknown, value)| value * solution[*unknown]).sum();
        let spring = RankOneSpring { vector: vector.clone(), part: stiffness / (1.0 + stiffness * own), solution };
        Self { spring: Some(spring), ..self }
    }

    /// Solves for each column of `right`.
    #[must_use]
    pub fn solve_for_columns(&self, right: &DMatrix<f64>) -> DMatrix<f64> {
        let mut out = right.clone();
        let (rows, columns) = out.shape();
        self.llt.solve_in_place(MatMut::from_column_major_slice_mut(out.as_mut_slice(), rows, columns));
        if let Some(RankOneSpring { vector, solution, part }) = &self.spring {
            let pulls = multiply_row_with_matrix(vector, &out) * *part;
            out -= solution * pulls;
        }
        out
    }
}
