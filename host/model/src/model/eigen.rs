//! Modes by shift-invert block Lanczos.
//!
//! The operator (K + s M)^-1 M with s > 0 (a negative shift) is symmetric in the M inner product and exists whatever holds
//! the panel. Blocks find eigenvalues of a multiplicity up to the block's width for certain; every new vector is
//! orthogonalised against all others twice.

use super::ModelError;
use super::columns::{BasisColumns, LANES};
use super::sparse::{CholeskyFactor, SparseSymmetricMatrix};
use crate::stop::StopRequest;
use nalgebra::{DMatrix, DVector, SymmetricEigen};

/// Vectors in a block: symmetric panels have pairs, equal ERAs on them up to four equal modes.
const BLOCK: usize = LANES;
/// Part of its length that a vector has to keep beside the others of its block; of one that loses more, what was left along the
/// space before has grown too much against it.
const KEPT: f64 = 0.1;
/// Order of a dense eigenproblem from which on faer's solver is the faster one; below, nalgebra's starts sooner.
const LARGE: usize = 100;
/// Relative residual of a Ritz pair of the inverted operator at which it counts as converged; the eigenvalue is then right
/// to about its square.
const CONVERGED: f64 = 1e-9;
/// Part of its former length below which a vector counts as lying in the space already found.
const EXHAUSTED: f64 = 1e-10;
/// Most vectors.
const MOST_VECTORS: usize = 2500;

/// Modes of K v = lambda M v.
#[derive(Clone, Debug)]
pub struct Modes {
    /// Squared angular frequencies in rad^2/s^2, ascending.
    pub lambda: Vec<f64>,
    /// M-orthonormal shapes, one column each.
    pub vectors: DMatrix<f64>,
}

/// What the iteration works with.
#[derive(Clone, Copy, Debug)]
pub struct ShiftInvertOperator<'a> {
    /// Factors of K + shift M.
    pub factor: &'a CholeskyFactor,
    /// M.
    pub mass: &'a SparseSymmetricMatrix,
    /// In rad^2/s^2, positive.
    pub shift: f64,
}

/// All modes up to `lambda_max`, ascending, those `known` already (M-orthonormal, whatever their size) among them.
///
/// # Errors
/// [`ModelError::NotConverged`].
pub fn extend_known_modes_up_to(
    operator: ShiftInvertOperator<'_>,
    known: &Modes,
    lambda_max: f64,
) -> Result<Modes, ModelError> {
    let n = operator.mass.dimension();
    let most = n.saturating_sub(known.lambda.len()).min(MOST_VECTORS);
    let mut space = LanczosSpace::new(operator, known, n);
    if most == 0 {
        return Ok(Modes { lambda: known.lambda.clone(), vectors: known.vectors.clone() });
    }
    let start = operator.factor.solve_for_columns(&operator.mass.multiply_columns(&pseudo_random_start_block(n)));
    let nothing = DMatrix::zeros(0, start.ncols());
    let mut block = space.orthonormalise_block_against_found_space(start, &nothing);
    let theta_min = 1.0 / (lambda_max + operator.shift);
    let mut next_check = 4 * BLOCK;
    let stop = StopRequest::current_request_of_thread();
    loop {
        if stop.is_stop_requested_or_deadline_over() {
            return Err(ModelError::Stopped);
        }
        let next = space.add_block_and_compute_next(&block);
        let size = space.vectors.len();
        let ended = next.vectors.ncols() == 0 || size >= most;
        if ended || size >= next_check {
            let eigen = DenseEigenpairs::from_symmetric_matrix_if_converged(&space.projected)
                .ok_or_else(|| ModelError::Factorisation { reason: "projected eigenproblem".to_owned() })?;
            // Twice as many vectors as modes is the least that was seen to do; a check costs as much as dozens of them.
            let found = eigen.values.iter().filter(|theta| **theta >= theta_min).count();
            next_check = (size + (size / 8).max(2 * BLOCK)).max(2 * found + 2 * BLOCK);
            // In all of the space nothing is left to converge to.
            let is_whole = next.vectors.ncols() == 0 || size >= n - known.lambda.len();
            if ended && is_whole
                || are_ritz_values_down_to_converged_and_one_is_below(&eigen, &next.coupling, theta_min)
            {
                return Ok(space.merge_known_and_found_modes_up_to(&eigen, known, lambda_max));
            }
            if ended {
                let max_hz = lambda_max.sqrt() / std::f64::consts::TAU;
                return Err(ModelError::NotConverged { max_hz, vectors: size });
            }
        }
        block = next;
    }
}

/// Deterministic pseudo-random vectors (the 64-bit mix of Steele et al., "SplitMix"): the same scene gives the same bits.
fn pseudo_random_start_block(row_count: usize) -> DMatrix<f64> {
    let mut state = 0x9E37_79B9_7F4A_7C15_u64;
    DMatrix::from_fn(row_count, BLOCK, |_, _| {
        state = state.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut z = state;
        z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        #[expect(clippy::cast_precision_loss, reason = "53 random bits are wanted")]
        let unit = ((z ^ (z >> 31)) >> 11) as f64 / (1_u64 << 53) as f64;
        unit - 0.5
    })
}

/// Whether every Ritz value down to `theta_min` is settled, and there is one below it: nothing is missing in between.
#[expect(clippy::cast_precision_loss, reason = "a few thousand vectors at most")]
fn are_ritz_values_down_to_converged_and_one_is_below(
    eigen: &DenseEigenpairs,
    coupling: &DMatrix<f64>,
    theta_min: f64,
) -> bool {
    let size = eigen.values.len();
    let tail = coupling.ncols();
    // The dense eigenproblem is right to the rounding of its largest value: the residual of a small one gets no smaller than that.
    let rounding = f64::EPSILON * eigen.values.amax() * size as f64;
    let mut below = false;
    for i in 0..size {
        let theta = eigen.values[i];
        if theta < theta_min {
            below = true;
            continue;
        }
        let last = eigen.vectors.view((size - tail, i), (tail, 1));
        if (coupling * last).norm() > (CONVERGED * theta).max(rounding) {
            return false;
        }
    }
    below
}

/// Eigenvalues and vectors of a dense symmetric matrix, in any order.
pub(super) struct DenseEigenpairs {
    pub values: DVector<f64>,
    pub vectors: DMatrix<f64>,
}

impl DenseEigenpairs {
    /// Decomposes a symmetric matrix; `None` if the iteration does not end.
    pub fn from_symmetric_matrix_if_converged(matrix: &DMatrix<f64>) -> Option<Self> {
        let n = matrix.nrows();
        if n == 0 {
            return Some(Self { values: DVector::zeros(0), vectors: DMatrix::zeros(0, 0) });
        }
        if n < LARGE {
            let SymmetricEigen { eigenvalues, eigenvectors } = SymmetricEigen::new(matrix.clone());
            return Some(Self { values: eigenvalues, vectors: eigenvectors });
        }
        let eigen =
            faer::MatRef::from_column_major_slice(matrix.as_slice(), n, n).self_adjoint_eigen(faer::Side::Lower);
        let eigen = eigen.ok()?;
        let values = DVector::from_iterator(n, eigen.S().column_vector().iter().copied());
        let vectors = DMatrix::from_fn(n, n, |i, j| eigen.U()[(i, j)]);
        (values.iter().all(|value| value.is_finite())).then_some(Self { values, vectors })
    }
}

/// M-orthonormal vectors Q, M Q, and R with block = Q R + what lies in the space before.
struct LanczosBlock {
    vectors: DMatrix<f64>,
    mass: DMatrix<f64>,
    coupling: DMatrix<f64>,
}

impl LanczosBlock {
    /// Takes these vectors out of the one that becomes column `j` of the block; `mass` follows by linearity.
    fn orthogonalise_column_and_record_coupling(
        &mut self,
        vector: &mut DMatrix<f64>,
        mass: &mut DMatrix<f64>,
        j: usize,
    ) {
        let inner = self.mass.tr_mul(vector);
        vector.gemm(-1.0, &self.vectors, &inner, 1.0);
        mass.gemm(-1.0, &self.mass, &inner, 1.0);
        for (i, value) in inner.iter().enumerate() {
            self.coupling[(i, j)] += value;
        }
    }
}

struct LanczosSpace<'a> {
    operator: ShiftInvertOperator<'a>,
    known: BasisColumns,
    mass_known: BasisColumns,
    vectors: BasisColumns,
    mass_vectors: BasisColumns,
    /// V' M (K + s M)^-1 M V.
    projected: DMatrix<f64>,
}

impl<'a> LanczosSpace<'a> {
    fn new(operator: ShiftInvertOperator<'a>, known: &Modes, n: usize) -> Self {
        let of = |matrix: &DMatrix<f64>| {
            let mut columns = BasisColumns::new(n);
            columns.append_columns(matrix);
            columns
        };
        Self {
            mass_known: of(&operator.mass.multiply_columns(&known.vectors)),
            known: of(&known.vectors),
            vectors: BasisColumns::new(n),
            mass_vectors: BasisColumns::new(n),
            projected: DMatrix::zeros(0, 0),
            operator,
        }
    }

    /// Adds an orthonormal block and returns the next one.
    fn add_block_and_compute_next(&mut self, block: &LanczosBlock) -> LanczosBlock {
        let (old, width) = (self.vectors.len(), block.vectors.ncols());
        self.vectors.append_columns(&block.vectors);
        self.mass_vectors.append_columns(&block.mass);
        let image = self.operator.factor.solve_for_columns(&block.mass);
        let column = self.mass_vectors.inner_products_with(&image);
        let mut projected = std::mem::take(&mut self.projected).resize(old + width, old + width, 0.0);
        for j in 0..width {
            for i in 0..old + width {
                projected[(i, old + j)] = column[(i, j)];
                projected[(old + j, i)] = column[(i, j)];
            }
        }
        self.projected = projected;
        self.orthonormalise_block_against_found_space(image, &column)
    }

    /// The part of `block` that is M-orthogonal to everything so far, made orthonormal; `inner` is what it has of the space.
    fn orthonormalise_block_against_found_space(&self, block: DMatrix<f64>, inner: &DMatrix<f64>) -> LanczosBlock {
        let mass = self.operator.mass.multiply_columns(&block);
        let lengths =
            (0..block.ncols()).map(|j| block.column(j).dot(&mass.column(j)).max(0.0).sqrt()).collect::<Vec<_>>();
        let mut rest = block;
        self.vectors.subtract_combinations_from(&mut rest, inner);
        self.subtract_known_modes(&mut rest);
        // Once more for what rounding of the long vectors has left in the short ones.
        self.subtract_known_modes_and_found_space(&mut rest);
        let (first, kept) = self.orthonormalise_block_dropping_exhausted_and_least_kept_fraction(&rest, &lengths);
        if kept >= KEPT {
            return first;
        }
        let mut rest = first.vectors;
        self.subtract_known_modes_and_found_space(&mut rest);
        let (again, _) =
            self.orthonormalise_block_dropping_exhausted_and_least_kept_fraction(&rest, &vec![1.0; rest.ncols()]);
        let coupling = &again.coupling * &first.coupling;
        LanczosBlock { coupling, ..again }
    }

    /// Makes vectors orthonormal among themselves, without those of which next to nothing of `lengths` is left; and the least
    /// part that one keeps beside the others.
    fn orthonormalise_block_dropping_exhausted_and_least_kept_fraction(
        &self,
        vectors: &DMatrix<f64>,
        lengths: &[f64],
    ) -> (LanczosBlock, f64) {
        let (rows, width) = vectors.shape();
        let mass = self.operator.mass.multiply_columns(vectors);
        let none = || DMatrix::zeros(rows, 0);
        let mut out = LanczosBlock { vectors: none(), mass: none(), coupling: DMatrix::zeros(0, width) };
        let mut kept = 1.0_f64;
        for (j, length) in lengths.iter().enumerate() {
            let mut vector = vectors.columns(j, 1).into_owned();
            let mut mass = mass.columns(j, 1).into_owned();
            let before = vector.dot(&mass).max(0.0).sqrt();
            for _ in 0..2 {
                out.orthogonalise_column_and_record_coupling(&mut vector, &mut mass, j);
            }
            let norm = vector.dot(&mass).max(0.0).sqrt();
            if norm <= EXHAUSTED * length || norm == 0.0 {
                continue;
            }
            kept = norm.min(kept * before) / before;
            let rows = out.coupling.nrows();
            out.coupling = out.coupling.resize_vertically(rows + 1, 0.0);
            out.coupling[(rows, j)] = norm;
            out.vectors = append_columns(out.vectors, &(vector / norm));
            out.mass = append_columns(out.mass, &(mass / norm));
        }
        (out, kept)
    }

    /// Takes out of `vectors` what lies in the space found so far or is known.
    fn subtract_known_modes_and_found_space(&self, vectors: &mut DMatrix<f64>) {
        self.subtract_known_modes(vectors);
        self.vectors.subtract_combinations_from(vectors, &self.mass_vectors.inner_products_with(vectors));
    }

    /// Makes vectors M-orthogonal to the modes that are known already.
    fn subtract_known_modes(&self, vectors: &mut DMatrix<f64>) {
        self.known.subtract_combinations_from(vectors, &self.mass_known.inner_products_with(vectors));
    }

    /// The modes up to `lambda_max`: those known before and those found by the iteration, ascending.
    fn merge_known_and_found_modes_up_to(&self, eigen: &DenseEigenpairs, known: &Modes, lambda_max: f64) -> Modes {
        let lambda_of = |i: usize| 1.0 / eigen.values[i] - self.operator.shift;
        let found: Vec<usize> =
            (0..eigen.values.len()).filter(|i| eigen.values[*i] > 0.0 && lambda_of(*i) <= lambda_max).collect();
        let elastic = self.vectors.combine_columns(&eigen.vectors.select_columns(&found));
        // The shift loses digits of an eigenvalue far below it; it stays positive, as only rigid modes are zero.
        let found = found.iter().map(|i| lambda_of(*i).max(f64::MIN_POSITIVE));
        let all: Vec<f64> = known.lambda.iter().copied().chain(found).collect();
        let mut order: Vec<usize> = (0..all.len()).collect();
        order.sort_by(|a, b| all[*a].total_cmp(&all[*b]));
        Modes {
            lambda: order.iter().map(|i| all[*i]).collect(),
            vectors: append_columns(known.vectors.clone(), &elastic).select_columns(&order),
        }
    }
}

/// `left` with the columns of `right` behind its own.
fn append_columns(left: DMatrix<f64>, right: &DMatrix<f64>) -> DMatrix<f64> {
    let old = left.ncols();
    let mut all = left.resize_horizontally(old + right.ncols(), 0.0);
    all.columns_mut(old, right.ncols()).copy_from(right);
    all
}

#[cfg(test)]
mod tests {
    use super::super::sparse::MatrixEntries;
    use super::*;

    /// The thesis' example, equations (29) and (30): m = 18, 2 kg, k = 48, 6 N/m have eigenvalues 2 and 4 and modes
    /// (1/6, 1/2), (1/6, -1/2) up to sign.
    #[test]
    fn thesis_example_with_two_degrees_of_freedom() {
        let (mut k, mut m) = (MatrixEntries::default(), MatrixEntries::default());
        for (row, column, value) in [(0, 0, 54.0), (0, 1, -6.0), (1, 0, -6.0), (1, 1, 6.0)] {
            k.add_entry_without_its_transpose(row, column, value);
        }
        m.add_entry_without_its_transpose(0, 0, 18.0);
        m.add_entry_without_its_transpose(1, 1, 2.0);
        let shift = 3.0;
        let mut shifted = k.clone();
        shifted.add_scaled_entries(&m, shift);
        let (mass, factor) =
            (m.build_matrix(2).unwrap(), shifted.build_matrix(2).unwrap().factorise_and_check_residual().unwrap());
        let none = Modes { lambda: Vec::new(), vectors: DMatrix::zeros(2, 0) };
        let found = extend_known_modes_up_to(ShiftInvertOperator { factor: &factor, mass: &mass, shift }, &none, 100.0)
            .unwrap();
        assert!((found.lambda[0] - 2.0).abs() < 1e-12 && (found.lambda[1] - 4.0).abs() < 1e-12, "{:?}", found.lambda);
        for (j, sign) in [(0, 1.0), (1, -1.0)] {
            let shape = found.vectors.column(j);
            assert!((shape[0].abs() - 1.0 / 6.0).abs() < 1e-12 && (shape[1].abs() - 0.5).abs() < 1e-12);
            assert_eq!((shape[0] * shape[1]).signum(), sign);
        }
    }
}
