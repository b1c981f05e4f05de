//! The reduced model: modes, and residual shapes for what the modes left out.
//!
//! The basis is all modes up to a multiple of the highest frequency, and for every load b two residual shapes or more: with the
//! modes taken out of the load, Z1 = (K + s M)^-1 b, Z2 = (K + s M)^-1 M Z1 and so on. Galerkin projection onto it is exact for
//! static loads at the shift, and its error elsewhere falls as the fourth power of (omega^2 + s) / (lambda_next + s). The
//! projected K + s M is computed from the loads, never from a product with K, so that springs of 1e18 N/m cancel nothing;
//! and the modes are taken out before a solution, not after it, as of the second shape they are (lambda_next / s)^2.

use super::assembly::AttachedVectors;
use super::damping::{DampingMatrices, StructuredDamping};
use super::eigen::{Modes, ShiftInvertOperator};
use super::grid::{DeflectionDerivative, Grid};
use super::sparse::{SparseVector, multiply_row_with_matrix};
use nalgebra::{DMatrix, DVector, SymmetricEigen};
use num_complex::Complex64;
use std::sync::Arc;

/// Part of its length below which a residual shape adds nothing to those before it.
const DEPENDENT: f64 = 1e-6;
/// Part of its length below which a load is a sum of others: well above rounding, well below what points that are not taken for
/// one differ by.
const SAME_LOAD: f64 = 1e-10;

/// A panel in a few dozen mass-normalised coordinates: q'' + C q' + (Lambda + j S) q = B f.
#[derive(Clone, Debug)]
pub struct ReducedModel {
    /// Squared angular frequencies Lambda in rad^2/s^2, length n, ascending; exactly 0 for rigid motions.
    pub lambda: DVector<f64>,
    /// Hysteretic damping S in rad^2/s^2, n x n, loss factor included.
    pub structural: DMatrix<f64>,
    /// Viscous damping C in rad/s, n x n.
    pub viscous: DMatrix<f64>,
    /// S and C as a diagonal and a few couplings, where they are that.
    pub structured: Option<StructuredDamping>,
    /// B in kg^-1/2, n x p: 1 N at each actuator.
    pub force: DMatrix<f64>,
    /// Travel of each actuator's mass relative to its electrodes, p x n.
    pub(super) travel: DMatrix<f64>,
    pub(super) grid: Arc<Grid>,
    /// n x unknowns, so that what a point of one cell takes of them lies in few pieces.
    pub(super) shapes: Arc<DMatrix<f64>>,
    /// What single points move in addition to their cells' functions.
    pub(super) local: Vec<LocalMotion>,
}

/// The deflection of a point under a force on it, as far as the functions of its cell miss it.
#[derive(Clone, Debug)]
pub(super) struct LocalMotion {
    /// In m.
    point_m: (f64, f64),
    /// Of every coordinate, length n.
    deflections: DVector<f64>,
}

impl ReducedModel {
    pub(super) fn new(
        lambda: Vec<f64>,
        vectors: DMatrix<f64>,
        damping: DampingMatrices,
        attached: &AttachedVectors,
        grid: Arc<Grid>,
    ) -> Self {
        let rows = |of: &dyn Fn(usize) -> SparseVector| {
            let mut out = DMatrix::zeros(attached.actuators.len(), vectors.ncols());
            for (i, mut row) in out.row_iter_mut().enumerate() {
                row.copy_from(&multiply_row_with_matrix(&of(i), &vectors));
            }
            out
        };
        let force = rows(&|i| attached.actuators[i].force.clone()).transpose();
        let travel = rows(&|i| attached.actuators[i].travel.clone());
        Self {
            lambda: DVector::from_vec(lambda),
            structural: damping.structural,
            viscous: damping.viscous,
            structured: damping.structured,
            force,
            travel,
            grid,
            shapes: Arc::new(vectors.transpose()),
            local: Vec::new(),
        }
    }

    /// Adds a deflection (length n) of a point of the surface (m) to what the mesh's functions have there.
    pub(super) fn add_deflection_missed_by_mesh_at_point(&mut self, point_m: (f64, f64), deflections: DVector<f64>) {
        self.local.push(LocalMotion { point_m, deflections });
    }

    /// Number of coordinates n.
    #[must_use]
    pub fn count_coordinates(&self) -> usize {
        self.lambda.len()
    }

    /// The model over some of its coordinates: for those that nothing couples to the others.
    #[must_use]
    pub fn restrict_to_coordinates(&self, coordinates: &[usize]) -> Self {
        Self {
            lambda: self.lambda.select_rows(coordinates),
            structural: self.structural.select_rows(coordinates).select_columns(coordinates),
            viscous: self.viscous.select_rows(coordinates).select_columns(coordinates),
            structured: self.structured.as_ref().map(|structured| structured.restrict_to_coordinates(coordinates)),
            force: self.force.select_rows(coordinates),
            travel: self.travel.select_columns(coordinates),
            grid: Arc::clone(&self.grid),
            shapes: Arc::new(self.shapes.select_rows(coordinates)),
            local: self.local.iter().map(|local| local.restrict_to_coordinates(coordinates)).collect(),
        }
    }

    /// Number of actuators p.
    #[must_use]
    pub fn count_actuators(&self) -> usize {
        self.force.ncols()
    }

    /// Number of unknowns of the mesh that it was made from.
    #[must_use]
    pub fn count_mesh_unknowns(&self) -> usize {
        self.shapes.ncols()
    }

    /// Size of its matrices in bytes.
    #[must_use]
    pub fn size_of_matrices_in_bytes(&self) -> usize {
        let matrices = [&self.structural, &self.viscous, &self.force, &self.travel, &*self.shapes];
        size_of::<f64>() * (self.lambda.len() + matrices.iter().map(|matrix| matrix.len()).sum::<usize>())
    }

    /// The shapes' deflections at a point of the surface (m), length n: w = shape . q.
    #[must_use]
    pub fn shape_deflections_at(&self, x_m: f64, y_m: f64) -> DVector<f64> {
        let mut out = DVector::zeros(self.count_coordinates());
        self.add_shape_deflections_at(x_m, y_m, out.as_mut_slice());
        out
    }

    /// The shapes' deflections at the points of a grid (m), row by row with x first: points x n.
    #[must_use]
    pub fn shape_deflections_on_grid(&self, x_m: &[f64], y_m: &[f64]) -> DMatrix<f64> {
        // A point per column first, which then lies in one piece.
        let n = self.count_coordinates();
        let mut out = DMatrix::zeros(n, x_m.len() * y_m.len());
        let points = y_m.iter().flat_map(|y| x_m.iter().map(move |x| (*x, *y)));
        for ((x, y), at) in points.zip(out.as_mut_slice().chunks_exact_mut(n.max(1))) {
            self.add_shape_deflections_at(x, y, at);
        }
        out.transpose()
    }

    fn add_shape_deflections_at(&self, x_m: f64, y_m: f64, out: &mut [f64]) {
        let n = self.count_coordinates();
        for (unknown, value) in self.grid.deflection_or_slope_row_at(x_m, y_m, DeflectionDerivative::Value) {
            let shapes = &self.shapes.as_slice()[unknown * n..(unknown + 1) * n];
            for (out, shape) in out.iter_mut().zip(shapes) {
                *out += value * shape;
            }
        }
        for local in self.local.iter().filter(|local| local.point_m == (x_m, y_m)) {
            for (out, deflection) in out.iter_mut().zip(local.deflections.iter()) {
                *out += deflection;
            }
        }
    }

    /// Row whose product with the coordinates is an actuator's travel.
    #[must_use]
    pub fn actuator_mass_travel_row(&self, actuator: usize) -> DVector<f64> {
        self.travel.row(actuator).transpose()
    }

    /// Travel of an actuator's mass relative to its electrodes, for given coordinates.
    #[must_use]
    pub fn actuator_mass_travel_against_electrodes(
        &self,
        actuator: usize,
        coordinates: &DVector<Complex64>,
    ) -> Complex64 {
        self.travel.row(actuator).iter().zip(coordinates.iter()).map(|(row, q)| q * *row).sum()
    }
}

/// Squared frequencies and shapes of the basis for `loads`, with `shapes_each` residual shapes for each of them.
pub(super) fn build_reduction_basis(
    operator: ShiftInvertOperator<'_>,
    modes: &Modes,
    loads: &[SparseVector],
    shapes_each: usize,
) -> (Vec<f64>, DMatrix<f64>) {
    let n = operator.mass.dimension();
    let mut load = DMatrix::zeros(n, loads.len());
    for (mut column, sparse) in load.column_iter_mut().zip(loads) {
        for (index, value) in sparse {
            column[*index] += *value;
        }
    }
    let load = drop_dependent_loads(&load);
    let mass_modes = operator.mass.multiply_columns(&modes.vectors);
    // A load without what it does to the modes, and a shape without the modes in it.
    let load_beside = |load: DMatrix<f64>| &load - &mass_modes * modes.vectors.tr_mul(&load);
    let shape_beside = |shape: DMatrix<f64>| &shape - &modes.vectors * mass_modes.tr_mul(&shape);
    // F and Y with (K + s M) Y = F, every column of Y of length one.
    let (mut f, mut y) = (DMatrix::zeros(n, 0), DMatrix::zeros(n, 0));
    let mut next = load_beside(load);
    for _ in 0..shapes_each {
        let load = load_beside(next);
        let shape = shape_beside(operator.factor.solve_for_columns(&load));
        next = operator.mass.multiply_columns(&shape);
        (f, y) = (join_columns(&f, &load), join_columns(&y, &shape));
    }
    // All three change together from here on, so that no product with K is needed.
    let mut mass_y = operator.mass.multiply_columns(&y);
    let kept = mass_orthonormalise_columns_and_list_kept(&mut y, [&mut mass_y, &mut f]);
    if kept.is_empty() {
        // No load, or only such as push against what cannot move.
        return (modes.lambda.clone(), modes.vectors.clone());
    }
    let (y, f) = (y.select_columns(&kept), f.select_columns(&kept));
    let reduced = y.tr_mul(&f);
    let eigen = SymmetricEigen::new(0.5 * (&reduced + reduced.transpose()));
    let mut order: Vec<usize> =
        (0..eigen.eigenvalues.len()).filter(|i| eigen.eigenvalues[*i] > operator.shift).collect();
    order.sort_by(|a, b| eigen.eigenvalues[*a].total_cmp(&eigen.eigenvalues[*b]));
    let shapes = &y * eigen.eigenvectors.select_columns(&order);
    let mut lambda = modes.lambda.clone();
    lambda.extend(order.iter().map(|i| eigen.eigenvalues[*i] - operator.shift));
    (lambda, join_columns(&modes.vectors, &shapes))
}

/// The columns of two matrices side by side.
fn join_columns(left: &DMatrix<f64>, right: &DMatrix<f64>) -> DMatrix<f64> {
    let mut all = DMatrix::zeros(left.nrows(), left.ncols() + right.ncols());
    all.columns_mut(0, left.ncols()).copy_from(left);
    all.columns_mut(left.ncols(), right.ncols()).copy_from(right);
    all
}

/// The loads without those that are sums of others, as are the forces of an ERA's drive, spring and masses. The shapes of such
/// differ by rounding alone, of which a free panel leaves more than [`DEPENDENT`].
fn drop_dependent_loads(loads: &DMatrix<f64>) -> DMatrix<f64> {
    let mut axes: Vec<DVector<f64>> = Vec::new();
    let mut kept = Vec::new();
    for (j, load) in loads.column_iter().enumerate() {
        let length = load.norm();
        if length == 0.0 {
            continue;
        }
        let mut rest = load / length;
        for _ in 0..2 {
            for axis in &axes {
                let inner = axis.dot(&rest);
                rest.axpy(-inner, axis, 1.0);
            }
        }
        let left = rest.norm();
        if left > SAME_LOAD {
            axes.push(rest / left);
            kept.push(j);
        }
    }
    loads.select_columns(&kept)
}

/// Makes the columns of Y orthonormal by M Y, and takes the same combinations of the columns of M Y and F; returns which are
/// left: those that depend on others are not. Modified Gram-Schmidt, each column twice.
///
/// On the columns themselves: from their products alone, lengths are known to the root of the rounding, which is a hundredth of
/// the least that is kept.
fn mass_orthonormalise_columns_and_list_kept(y: &mut DMatrix<f64>, [mass_y, f]: [&mut DMatrix<f64>; 2]) -> Vec<usize> {
    let mut kept: Vec<usize> = Vec::new();
    for j in 0..y.ncols() {
        let length = y.column(j).dot(&mass_y.column(j)).max(0.0).sqrt();
        if length == 0.0 {
            continue;
        }
        scale_column_of_each(&mut [y, mass_y, f], j, 1.0 / length);
        for _ in 0..2 {
            for k in &kept {
                let inner = mass_y.column(*k).dot(&y.column(j));
                for matrix in [&mut *y, &mut *mass_y, &mut *f] {
                    let (before, mut after) = matrix.columns_range_pair_mut(*k, j..=j);
                    after.column_mut(0).axpy(-inner, &before, 1.0);
                }
            }
        }
        let length = y.column(j).dot(&mass_y.column(j)).max(0.0).sqrt();
        if length > DEPENDENT {
            scale_column_of_each(&mut [y, mass_y, f], j, 1.0 / length);
            kept.push(j);
        }
    }
    kept
}

/// Multiplies the same column of several matrices by a factor.
fn scale_column_of_each(matrices: &mut [&mut DMatrix<f64>], column: usize, factor: f64) {
    for matrix in matrices {
        matrix.column_mut(column).scale_mut(factor);
    }
}

impl LocalMotion {
    fn restrict_to_coordinates(&self, coordinates: &[usize]) -> Self {
        Self { point_m: self.point_m, deflections: self.deflections.select_rows(coordinates) }
    }
}
