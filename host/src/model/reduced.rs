//! The reduced model: modes, and residual shapes for what the modes left out.
//!
//! The basis is all modes up to a multiple of the highest frequency, and for every load b the two shapes
//! Z1 = (K + s M)^-1 b and Z2 = (K + s M)^-1 M Z1, made orthogonal to the modes. Galerkin projection onto it is exact for
//! static loads at the shift, and its error elsewhere falls as the square of omega^2 / lambda_next. The projected
//! K + s M is computed from the loads, never from a product with K, so that springs of 1e18 N/m cancel nothing.

use super::assembly::{Assembled, Grid, SparseVector};
use super::eigen::{Modes, Operator};
use super::panel::{Damping, row_times};
use nalgebra::{DMatrix, DVector, SymmetricEigen};
use num_complex::Complex64;
use std::sync::Arc;

/// Part of its former length below which a residual shape adds nothing.
const DEPENDENT: f64 = 1e-7;

/// A panel in a few dozen mass-normalised coordinates: q'' + C q' + (Lambda + j S) q = B f.
#[derive(Clone, Debug)]
pub struct ReducedModel {
    /// Squared angular frequencies Lambda in rad^2/s^2, length n, ascending; exactly 0 for rigid motions.
    pub lambda: DVector<f64>,
    /// Hysteretic damping S in rad^2/s^2, n x n, loss factor included.
    pub structural: DMatrix<f64>,
    /// Viscous damping C in rad/s, n x n.
    pub viscous: DMatrix<f64>,
    /// B in kg^-1/2, n x p: 1 N at each actuator.
    pub force: DMatrix<f64>,
    /// Travel of each actuator's mass relative to its electrodes, p x n.
    travel: DMatrix<f64>,
    grid: Arc<Grid>,
    shapes: Arc<DMatrix<f64>>,
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
            force,
            travel,
            grid: Arc::new(assembled.grid.clone()),
            shapes: Arc::new(vectors),
        }
    }

    /// Number of coordinates n.
    #[must_use]
    pub fn order(&self) -> usize {
        self.lambda.len()
    }

    /// Number of actuators p.
    #[must_use]
    pub fn actuators(&self) -> usize {
        self.force.ncols()
    }

    /// Unknowns of the mesh behind it.
    #[must_use]
    pub fn dofs(&self) -> usize {
        self.shapes.nrows()
    }

    /// The shapes' deflections at a point of the surface (m), length n: w = shape . q.
    #[must_use]
    pub fn shape_at(&self, x_m: f64, y_m: f64) -> DVector<f64> {
        row_times(&self.grid.deflection_at(x_m, y_m), &self.shapes).transpose()
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
    // F and Y with (K + s M) Y = F.
    let first = operator.factor.solve(&load);
    let mass_first = operator.mass.times(&first);
    let second = operator.factor.solve(&mass_first);
    let (f, y) = (beside(&load, &mass_first), beside(&first, &second));
    // What of it the modes do not have already.
    let mass_modes = operator.mass.times(&modes.vectors);
    let rest = &y - &modes.vectors * mass_modes.tr_mul(&y);
    let rest = &rest - &modes.vectors * mass_modes.tr_mul(&rest);
    let known = modes.vectors.tr_mul(&f);
    let mut weighted = known.clone();
    for (mut row, lambda) in weighted.row_iter_mut().zip(&modes.lambda) {
        row /= lambda + operator.shift;
    }
    let stiffness = y.tr_mul(&f) - known.tr_mul(&weighted);

    let transform = orthonormaliser(&rest, &operator.mass.times(&rest), &y, &operator.mass.times(&y));
    let reduced = transform.tr_mul(&(&stiffness * &transform));
    let eigen = SymmetricEigen::new(0.5 * (&reduced + reduced.transpose()));
    let mut order: Vec<usize> =
        (0..eigen.eigenvalues.len()).filter(|i| eigen.eigenvalues[*i] > operator.shift).collect();
    order.sort_by(|a, b| eigen.eigenvalues[*a].total_cmp(&eigen.eigenvalues[*b]));
    let shapes = &rest * (transform * eigen.eigenvectors.select_columns(&order));
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

/// T such that the columns of V T are M-orthonormal, dropping those that depend on others or are rounding: modified
/// Gram-Schmidt on V with the transformation recorded.
fn orthonormaliser(
    v: &DMatrix<f64>,
    mass_v: &DMatrix<f64>,
    whole: &DMatrix<f64>,
    mass_whole: &DMatrix<f64>,
) -> DMatrix<f64> {
    let width = v.ncols();
    let gram = v.tr_mul(mass_v);
    let mut transform = DMatrix::zeros(width, 0);
    for j in 0..width {
        let original = whole.column(j).dot(&mass_whole.column(j)).max(0.0).sqrt();
        let mut column = DVector::zeros(width);
        column[j] = 1.0;
        for _ in 0..2 {
            let inner: DVector<f64> = transform.tr_mul(&(&gram * &column));
            column -= &transform * inner;
        }
        let length = column.dot(&(&gram * &column)).max(0.0).sqrt();
        if length > DEPENDENT * original && length > 0.0 {
            let at = transform.ncols();
            transform = transform.resize_horizontally(at + 1, 0.0);
            transform.set_column(at, &(column / length));
        }
    }
    transform
}
