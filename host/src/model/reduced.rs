//! The reduced model: modes, and residual shapes for what the modes left out.
//!
//! The basis is all modes up to a multiple of the highest frequency, and for every load b two residual shapes: with the
//! modes taken out of the load, Z1 = (K + s M)^-1 b and Z2 = (K + s M)^-1 M Z1. Galerkin projection onto it is exact for
//! static loads at the shift, and its error elsewhere falls as the fourth power of (omega^2 + s) / (lambda_next + s). The
//! projected K + s M is computed from the loads, never from a product with K, so that springs of 1e18 N/m cancel nothing;
//! and the modes are taken out before a solution, not after it, as of the second shape they are (lambda_next / s)^2.

use super::assembly::Assembled;
use super::damping::{Damping, Structured};
use super::eigen::{Modes, Operator};
use super::grid::{Derivative, Grid, SparseVector};
use super::panel::row_times;
use nalgebra::{DMatrix, DVector, SymmetricEigen};
use num_complex::Complex64;
use std::sync::Arc;

/// Part of its length below which a residual shape adds nothing to those before it. The products know it to 1e-8 or so.
const DEPENDENT: f64 = 1e-6;

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
    pub structured: Option<Structured>,
    /// B in kg^-1/2, n x p: 1 N at each actuator.
    pub force: DMatrix<f64>,
    /// Travel of each actuator's mass relative to its electrodes, p x n.
    pub(super) travel: DMatrix<f64>,
    pub(super) grid: Arc<Grid>,
    /// n x unknowns, so that what a point of one cell takes of them lies in few pieces.
    pub(super) shapes: Arc<DMatrix<f64>>,
}

impl ReducedModel {
    pub(super) fn new(lambda: Vec<f64>, vectors: DMatrix<f64>, damping: Damping, assembled: &Assembled) -> Self {
        let rows = |of: &dyn Fn(usize) -> SparseVector| {
            let mut out = DMatrix::zeros(assembled.actuators.len(), vectors.ncols());
            for (i, mut row) in out.row_iter_mut().enumerate() {
                row.copy_from(&row_times(&of(i), &vectors));
            }
            out
        };
        let force = rows(&|i| assembled.actuators[i].force.clone()).transpose();
        let travel = rows(&|i| assembled.actuators[i].travel.clone());
        Self {
            lambda: DVector::from_vec(lambda),
            structural: damping.structural,
            viscous: damping.viscous,
            structured: damping.structured,
            force,
            travel,
            grid: Arc::new(assembled.grid.clone()),
            shapes: Arc::new(vectors.transpose()),
        }
    }

    /// Number of coordinates n.
    #[must_use]
    pub fn order(&self) -> usize {
        self.lambda.len()
    }

    /// The model over some of its coordinates: for those that nothing couples to the others.
    #[must_use]
    pub fn restricted_to(&self, coordinates: &[usize]) -> Self {
        Self {
            lambda: self.lambda.select_rows(coordinates),
            structural: self.structural.select_rows(coordinates).select_columns(coordinates),
            viscous: self.viscous.select_rows(coordinates).select_columns(coordinates),
            structured: self.structured.as_ref().map(|structured| structured.restricted_to(coordinates)),
            force: self.force.select_rows(coordinates),
            travel: self.travel.select_columns(coordinates),
            grid: Arc::clone(&self.grid),
            shapes: Arc::new(self.shapes.select_rows(coordinates)),
        }
    }

    /// Number of actuators p.
    #[must_use]
    pub fn actuators(&self) -> usize {
        self.force.ncols()
    }

    /// Unknowns of the mesh behind it.
    #[must_use]
    pub fn dofs(&self) -> usize {
        self.shapes.ncols()
    }

    /// Bytes that its matrices take.
    #[must_use]
    pub fn bytes(&self) -> usize {
        let matrices = [&self.structural, &self.viscous, &self.force, &self.travel, &*self.shapes];
        size_of::<f64>() * (self.lambda.len() + matrices.iter().map(|matrix| matrix.len()).sum::<usize>())
    }

    /// The shapes' deflections at a point of the surface (m), length n: w = shape . q.
    #[must_use]
    pub fn shape_at(&self, x_m: f64, y_m: f64) -> DVector<f64> {
        let mut out = DVector::zeros(self.order());
        self.add_shape(x_m, y_m, out.as_mut_slice());
        out
    }

    /// The shapes' deflections at the points of a grid (m), row by row with x first: points x n.
    #[must_use]
    pub fn shapes_on(&self, x_m: &[f64], y_m: &[f64]) -> DMatrix<f64> {
        // A point per column first, which then lies in one piece.
        let n = self.order();
        let mut out = DMatrix::zeros(n, x_m.len() * y_m.len());
        let points = y_m.iter().flat_map(|y| x_m.iter().map(move |x| (*x, *y)));
        for ((x, y), at) in points.zip(out.as_mut_slice().chunks_exact_mut(n.max(1))) {
            self.add_shape(x, y, at);
        }
        out.transpose()
    }

    fn add_shape(&self, x_m: f64, y_m: f64, out: &mut [f64]) {
        let n = self.order();
        for (unknown, value) in self.grid.row_at(x_m, y_m, Derivative::Value) {
            let shapes = &self.shapes.as_slice()[unknown * n..(unknown + 1) * n];
            for (out, shape) in out.iter_mut().zip(shapes) {
                *out += value * shape;
            }
        }
    }

    /// What gives an actuator's travel for the model's coordinates.
    #[must_use]
    pub fn travel_row(&self, actuator: usize) -> DVector<f64> {
        self.travel.row(actuator).transpose()
    }

    /// Travel of an actuator's mass relative to its electrodes, for given coordinates.
    #[must_use]
    pub fn travel(&self, actuator: usize, coordinates: &DVector<Complex64>) -> Complex64 {
        self.travel.row(actuator).iter().zip(coordinates.iter()).map(|(row, q)| q * *row).sum()
    }
}

/// Squared frequencies and shapes of the basis for `loads`.
pub(super) fn basis(operator: Operator<'_>, modes: &Modes, loads: &[SparseVector]) -> (Vec<f64>, DMatrix<f64>) {
    let n = operator.mass.order();
    let mut load = DMatrix::zeros(n, loads.len());
    for (mut column, sparse) in load.column_iter_mut().zip(loads) {
        for (index, value) in sparse {
            column[*index] += *value;
        }
    }
    let mass_modes = operator.mass.times(&modes.vectors);
    // A load without what it does to the modes, and a shape without the modes in it.
    let load_beside = |load: DMatrix<f64>| &load - &mass_modes * modes.vectors.tr_mul(&load);
    let shape_beside = |shape: DMatrix<f64>| &shape - &modes.vectors * mass_modes.tr_mul(&shape);
    let first_load = load_beside(load_beside(load));
    let first = shape_beside(operator.factor.solve(&first_load));
    let second_load = load_beside(operator.mass.times(&first));
    let second = shape_beside(operator.factor.solve(&second_load));
    // F and Y with (K + s M) Y = F, every column of Y of length one.
    let (mut f, mut y) = (beside(&first_load, &second_load), beside(&first, &second));
    let mass_y = operator.mass.times(&y);
    for j in 0..y.ncols() {
        let length = y.column(j).dot(&mass_y.column(j)).max(0.0).sqrt();
        let scale = if length > 0.0 { 1.0 / length } else { 0.0 };
        f.column_mut(j).scale_mut(scale);
        y.column_mut(j).scale_mut(scale);
    }
    let transform = orthonormaliser(&y.tr_mul(&operator.mass.times(&y)));
    if transform.ncols() == 0 {
        // No load, or only such as push against what cannot move.
        return (modes.lambda.clone(), modes.vectors.clone());
    }
    let reduced = transform.tr_mul(&(y.tr_mul(&f) * &transform));
    let eigen = SymmetricEigen::new(0.5 * (&reduced + reduced.transpose()));
    let mut order: Vec<usize> =
        (0..eigen.eigenvalues.len()).filter(|i| eigen.eigenvalues[*i] > operator.shift).collect();
    order.sort_by(|a, b| eigen.eigenvalues[*a].total_cmp(&eigen.eigenvalues[*b]));
    let shapes = &y * (transform * eigen.eigenvectors.select_columns(&order));
    let mut lambda = modes.lambda.clone();
    lambda.extend(order.iter().map(|i| eigen.eigenvalues[*i] - operator.shift));
    (lambda, beside(&modes.vectors, &shapes))
}

fn beside(left: &DMatrix<f64>, right: &DMatrix<f64>) -> DMatrix<f64> {
    let mut all = DMatrix::zeros(left.nrows(), left.ncols() + right.ncols());
    all.columns_mut(0, left.ncols()).copy_from(left);
    all.columns_mut(left.ncols(), right.ncols()).copy_from(right);
    all
}

/// T such that the columns of V T are orthonormal, for V with the products `gram` and columns of length one, dropping
/// those that depend on others: modified Gram-Schmidt with the transformation recorded.
fn orthonormaliser(gram: &DMatrix<f64>) -> DMatrix<f64> {
    let width = gram.ncols();
    let mut transform = DMatrix::zeros(width, 0);
    for j in 0..width {
        let mut column = DVector::zeros(width);
        column[j] = gram[(j, j)];
        for _ in 0..2 {
            let inner: DVector<f64> = transform.tr_mul(&(gram * &column));
            column -= &transform * inner;
        }
        let length = column.dot(&(gram * &column)).max(0.0).sqrt();
        if length > DEPENDENT {
            let at = transform.ncols();
            transform = transform.resize_horizontally(at + 1, 0.0);
            transform.set_column(at, &(column / length));
        }
    }
    transform
}
