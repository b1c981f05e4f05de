//! Shape functions of one cell along one direction, and the matrices that beams and plates are made of.
//!
//! A cell of length h and order p has p + 1 functions: the four cubics of Hermite, which carry value and slope at its two
//! ends, and p - 3 bubbles, twice-integrated Legendre polynomials, whose value and slope vanish at both ends. Their second
//! derivatives are orthogonal, so a bar's stiffness does not couple them. Slopes are stored times a length of their own
//! node ("scaled slopes"), so that all unknowns have the size of displacements and strongly graded meshes keep a good
//! condition. Spaces of lower order are contained in those of higher: frequencies fall as p rises.
//!
//! Across a strip that is one cell wide and free at both borders the four cubics are written otherwise: 1, t, and two that bend.
//! A strip of 10 m by 1 mm bends 1e16 times more easily along than across; with values and slopes at its borders as unknowns
//! every entry of K has the stiffness across in it, to whose rounding all bending along is lost. With functions of which two
//! do not bend at all it is in the rows of the other two alone.

use nalgebra::DMatrix;

/// Lowest order: the cubics alone.
pub const LOWEST_ORDER: usize = 3;
/// Highest order: beyond it rounding in the bubbles' values shows before their accuracy does.
pub const HIGHEST_ORDER: usize = 15;

/// The functions of a cell of unit length, and their integrals.
#[derive(Clone, Debug)]
pub struct CellElement {
    order: usize,
    cubics: CubicForm,
    unit: CellMatrices,
}

/// How an element's first four functions are written.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum CubicForm {
    /// Value and slope at either end.
    Ends,
    /// A straight one, an inclined one, and two that bend.
    Straight,
}

/// The one-dimensional matrices of a cell, (p + 1) x (p + 1): over value and slope at the left end, the same at the right
/// one, and the bubbles.
#[derive(Clone, Debug)]
pub struct CellMatrices {
    /// Integral of N_i N_j.
    pub mass: DMatrix<f64>,
    /// Integral of N_i' N_j'.
    pub slope: DMatrix<f64>,
    /// Integral of N_i'' N_j''.
    pub bend: DMatrix<f64>,
    /// Integral of N_i'' N_j.
    pub mixed: DMatrix<f64>,
}

impl CellElement {
    /// Functions of order `order`, kept between [`LOWEST_ORDER`] and [`HIGHEST_ORDER`].
    #[must_use]
    pub fn new(order: usize) -> Self {
        Self::from_order_and_cubics(order, CubicForm::Ends)
    }

    /// The same functions of a cell that has no neighbours and whose ends are free: 1 and 2 t - 1 in place of value and slope at
    /// the left end, and two that vanish at both ends in place of those at the right one.
    #[must_use]
    pub fn new_with_two_rigid_body_functions_for_single_free_cell(order: usize) -> Self {
        Self::from_order_and_cubics(order, CubicForm::Straight)
    }

    fn from_order_and_cubics(order: usize, cubics: CubicForm) -> Self {
        let order = order.clamp(LOWEST_ORDER, HIGHEST_ORDER);
        let n = order + 1;
        let zero = || DMatrix::zeros(n, n);
        let mut unit = CellMatrices { mass: zero(), slope: zero(), bend: zero(), mixed: zero() };
        // p + 1 points integrate degree 2 p + 1; the products have 2 p.
        for (at, weight) in gauss_legendre_rule_on_unit_interval(n) {
            let [value, first, second] = evaluate_shape_functions(order, cubics, at);
            for i in 0..n {
                for j in 0..n {
                    unit.mass[(i, j)] += weight * value[i] * value[j];
                    unit.slope[(i, j)] += weight * first[i] * first[j];
                    unit.bend[(i, j)] += weight * second[i] * second[j];
                    unit.mixed[(i, j)] += weight * second[i] * value[j];
                }
            }
        }
        for matrix in [&mut unit.mass, &mut unit.slope, &mut unit.bend, &mut unit.mixed] {
            // Entries that are zero by symmetry or orthogonality cost fill when they are rounding instead.
            let size = matrix.amax();
            matrix.iter_mut().filter(|entry| entry.abs() < 1e-14 * size).for_each(|entry| *entry = 0.0);
        }
        Self { order, cubics, unit }
    }

    /// The order p.
    #[must_use]
    pub fn element_order(&self) -> usize {
        self.order
    }

    /// The matrices of a cell of length `cell_length` whose end slopes are stored times `scale[0]` and `scale[1]`.
    #[must_use]
    pub fn cell_matrices(&self, cell_length: f64, scale: [f64; 2]) -> CellMatrices {
        let to_unit: Vec<f64> =
            (0..=self.order).map(|i| self.factor_from_cell_to_unit_cell_coefficient(i, cell_length, scale)).collect();
        let make = |table: &DMatrix<f64>, factor: f64| {
            DMatrix::from_fn(table.nrows(), table.ncols(), |i, j| table[(i, j)] * factor * to_unit[i] * to_unit[j])
        };
        CellMatrices {
            mass: make(&self.unit.mass, cell_length),
            slope: make(&self.unit.slope, 1.0 / cell_length),
            bend: make(&self.unit.bend, 1.0 / (cell_length * cell_length * cell_length)),
            mixed: make(&self.unit.mixed, 1.0 / cell_length),
        }
    }

    /// Values, first and second derivatives (per metre) of the functions at `t` in 0..=1 of such a cell.
    #[must_use]
    pub fn values_and_derivatives_at(&self, t: f64, cell_length: f64, scale: [f64; 2]) -> [Vec<f64>; 3] {
        let mut all = evaluate_shape_functions(self.order, self.cubics, t);
        let mut per_length = 1.0;
        for derivative in &mut all {
            derivative.iter_mut().enumerate().for_each(|(i, value)| {
                *value *= per_length * self.factor_from_cell_to_unit_cell_coefficient(i, cell_length, scale)
            });
            per_length /= cell_length;
        }
        all
    }

    /// A function's coefficient in the unit cell for one of the real cell: slopes are stored times `scale`, there times h.
    fn factor_from_cell_to_unit_cell_coefficient(&self, function: usize, cell_length: f64, scale: [f64; 2]) -> f64 {
        match (self.cubics, function) {
            (CubicForm::Ends, 1) => cell_length / scale[0],
            (CubicForm::Ends, 3) => cell_length / scale[1],
            _ => 1.0,
        }
    }
}

/// Values, first and second derivatives of all functions at `t` of the unit cell.
fn evaluate_shape_functions(order: usize, cubics: CubicForm, t: f64) -> [Vec<f64>; 3] {
    let u = 1.0 - t;
    let first_four = match cubics {
        CubicForm::Ends => [
            [u * u * (1.0 + 2.0 * t), t * u * u, t * t * (3.0 - 2.0 * t), -t * t * u],
            [-6.0 * t * u, u * (1.0 - 3.0 * t), 6.0 * t * u, t * (3.0 * t - 2.0)],
            [12.0 * t - 6.0, 6.0 * t - 4.0, 6.0 - 12.0 * t, 6.0 * t - 2.0],
        ],
        CubicForm::Straight => [
            [1.0, t - u, -2.0 * t * u, -2.0 * t * u * (t - u)],
            [0.0, 2.0, 2.0 * (t - u), 2.0 * (1.0 - 6.0 * t * u)],
            [0.0, 0.0, 4.0, 12.0 * (t - u)],
        ],
    };
    let [mut value, mut first, mut second] = first_four.map(|four| {
        let mut all = Vec::with_capacity(order + 1);
        all.extend(four);
        all
    });
    // With x = 2 t - 1 and j = 2, 3, ...: the second integral of P_j, its first, and P_j itself.
    let p = evaluate_legendre_polynomials(order, 2.0 * t - 1.0);
    for m in 4..=order {
        let j = m - 2;
        let k = j as f64;
        let twice = p[j + 2] / ((2.0 * k + 1.0) * (2.0 * k + 3.0)) - 2.0 * p[j] / ((2.0 * k - 1.0) * (2.0 * k + 3.0))
            + p[j - 2] / ((2.0 * k - 1.0) * (2.0 * k + 1.0));
        let once = (p[j + 1] - p[j - 1]) / (2.0 * k + 1.0);
        // d/dt = 2 d/dx. Scaled to the bending energy 12 of a Hermite deflection: the integral of P_j^2 over t is
        // 1 / (2 j + 1), and the second derivative is 4 P_j.
        let scale = (12.0 * (2.0 * k + 1.0)).sqrt() / 4.0;
        // Zero at the ends, not what rounding makes of it: stiff springs would see it.
        value.push(if t == 0.0 || t == 1.0 { 0.0 } else { scale * twice });
        first.push(scale * 2.0 * once);
        second.push(scale * 4.0 * p[j]);
    }
    [value, first, second]
}

/// P_0 .. P_n at x, by their three-term recurrence.
fn evaluate_legendre_polynomials(highest_order: usize, x: f64) -> Vec<f64> {
    let mut p = Vec::with_capacity(highest_order + 1);
    p.extend([1.0, x]);
    for k in 1..highest_order {
        let kf = k as f64;
        let next = ((2.0 * kf + 1.0) * x * p[k] - kf * p[k - 1]) / (kf + 1.0);
        p.push(next);
    }
    p
}

/// Gauss-Legendre points and weights on 0..=1, by Newton's iteration from Tricomi's estimate.
pub fn gauss_legendre_rule_on_unit_interval(point_count: usize) -> Vec<(f64, f64)> {
    (0..point_count)
        .map(|i| {
            let mut x = (std::f64::consts::PI * (i as f64 + 0.75) / (point_count as f64 + 0.5)).cos();
            let mut derivative = 1.0;
            for _ in 0..8 {
                let p = evaluate_legendre_polynomials(point_count, x);
                derivative = point_count as f64 * (x * p[point_count] - p[point_count - 1]) / (x * x - 1.0);
                x -= p[point_count] / derivative;
            }
            (0.5 * (1.0 + x), 1.0 / ((1.0 - x * x) * derivative * derivative))
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The cubics' matrices are in every book.
    #[test]
    fn cubic_matrices_are_the_known_ones() {
        let h = 0.37;
        let matrices = CellElement::new(3).cell_matrices(h, [h, h]);
        let bend = [[12.0, 6.0, -12.0, 6.0], [6.0, 4.0, -6.0, 2.0], [-12.0, -6.0, 12.0, -6.0], [6.0, 2.0, -6.0, 4.0]];
        let mass = [
            [156.0, 22.0, 54.0, -13.0],
            [22.0, 4.0, 13.0, -3.0],
            [54.0, 13.0, 156.0, -22.0],
            [-13.0, -3.0, -22.0, 4.0],
        ];
        for i in 0..4 {
            for j in 0..4 {
                assert!((matrices.bend[(i, j)] * h.powi(3) - bend[i][j]).abs() < 1e-12);
                assert!((matrices.mass[(i, j)] * 420.0 / h - mass[i][j]).abs() < 1e-11);
            }
        }
    }

    #[test]
    fn bubbles_vanish_at_the_ends_with_their_slopes_and_do_not_couple_in_bending() {
        for t in [0.0, 1.0] {
            let [value, first, _] = evaluate_shape_functions(HIGHEST_ORDER, CubicForm::Ends, t);
            assert!(value[4..].iter().chain(&first[4..]).all(|x| x.abs() < 1e-13), "{t}");
        }
        let unit = CellElement::new(HIGHEST_ORDER).unit;
        for i in 0..=HIGHEST_ORDER {
            for j in 4..=HIGHEST_ORDER {
                assert!((unit.bend[(i, j)] - if i == j { 12.0 } else { 0.0 }).abs() < 1e-11, "{i} {j}");
            }
        }
    }

    /// Derivatives by differences, and by parts: N_i'' N_j = [N_i' N_j] - N_i' N_j'.
    #[test]
    fn derivatives_and_matrices_agree() {
        let order = 7;
        let step = 1e-5;
        for t in [0.13, 0.5, 0.82] {
            let [value, first, second] = evaluate_shape_functions(order, CubicForm::Ends, t);
            let ([above, ..], [below, ..]) = (
                evaluate_shape_functions(order, CubicForm::Ends, t + step),
                evaluate_shape_functions(order, CubicForm::Ends, t - step),
            );
            for i in 0..=order {
                assert!(((above[i] - below[i]) / (2.0 * step) - first[i]).abs() < 1e-7);
                assert!(((above[i] - 2.0 * value[i] + below[i]) / (step * step) - second[i]).abs() < 1e-3);
            }
        }
        let unit = CellElement::new(order).unit;
        let ends = [0.0, 1.0].map(|t| evaluate_shape_functions(order, CubicForm::Ends, t));
        for i in 0..=order {
            for j in 0..=order {
                let boundary = ends[1][1][i] * ends[1][0][j] - ends[0][1][i] * ends[0][0][j];
                assert!((unit.mixed[(i, j)] - boundary + unit.slope[(i, j)]).abs() < 1e-11, "{i} {j}");
            }
        }
    }

    /// The same polynomials, written so that two do not bend: values at any place follow from those at the ends.
    #[test]
    fn straight_functions_are_combinations_of_the_cubics() {
        let ends = [0.0, 1.0].map(|t| evaluate_shape_functions(5, CubicForm::Straight, t));
        for t in [0.0, 0.21, 0.5, 0.83, 1.0] {
            let (straight, cubic) =
                (evaluate_shape_functions(5, CubicForm::Straight, t), evaluate_shape_functions(5, CubicForm::Ends, t));
            for k in 0..4 {
                let [[at, slope, _], [at_end, slope_end, _]] = [&ends[0], &ends[1]];
                for (straight, cubic) in straight.iter().zip(&cubic) {
                    let combined =
                        at[k] * cubic[0] + slope[k] * cubic[1] + at_end[k] * cubic[2] + slope_end[k] * cubic[3];
                    assert!((straight[k] - combined).abs() < 1e-13, "{k} {t}: {} {combined}", straight[k]);
                }
                assert!(k > 1 || straight[2][k] == 0.0, "bends");
            }
            assert_eq!(straight[0][4..], cubic[0][4..]);
        }
    }
}
