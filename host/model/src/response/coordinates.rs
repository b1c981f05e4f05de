//! The reduced model's coordinates at a frequency: (Lambda - w^2 + j S + j w C) q = B.

use super::ResponseError;
use super::elimination::ComplexEquations;
use crate::model::ReducedModel;
use crate::model::damping::StructuredDamping;
use nalgebra::{DMatrix, DVector};
use num_complex::Complex64;

/// Part of the matrix's scale below which a pivot counts as zero: an undamped panel at its resonance.
const SINGULAR: f64 = 1e-12;
/// Modal force, relative to the largest, below which a resonance is not excited.
const NOT_EXCITED: f64 = 1e-9;
/// Part of its scale below which a diagonal entry is too small to divide by: of the 16 digits the couplings' formula
/// loses as many as this has, where all damping comes from couplings.
const TOO_SMALL: f64 = 1e-5;

/// Solves for one panel's coordinates at any frequency.
///
/// With few couplings the matrix is a diagonal D plus U Z U', U the couplings' shapes, Z their impedances; then
/// q = D^-1 (B - U y) with (1 + Z U' D^-1 U) y = Z U' D^-1 B (Woodbury): n r^2 operations instead of n^3. The products of
/// shapes that U' D^-1 U and U' D^-1 B are sums of are kept.
#[derive(Clone, Debug)]
pub struct CoordinateSolver<'a> {
    model: &'a ReducedModel,
    low_rank: Option<LowRankSolver<'a>>,
}

#[derive(Clone, Debug)]
struct LowRankSolver<'a> {
    structured: &'a StructuredDamping,
    /// Couplings r.
    rank: usize,
    /// For each coordinate the products of its couplings' shapes in pairs (k <= l), then of couplings and actuators.
    products: Vec<f64>,
    /// Length of a coordinate's part of `products`.
    width: usize,
}

impl<'a> CoordinateSolver<'a> {
    /// What can be prepared before any frequency is known.
    #[must_use]
    pub fn new(model: &'a ReducedModel) -> Self {
        let n = model.count_coordinates();
        // With as many couplings as that the full matrix is cheaper.
        let low_rank = model.structured.as_ref().filter(|structured| 2 * structured.couplings.len() < n);
        Self { model, low_rank: low_rank.map(|structured| LowRankSolver::new(structured, &model.force)) }
    }

    /// Displacement coordinates for 1 N at each actuator alone.
    ///
    /// # Errors
    /// [`ResponseError::Unbounded`].
    pub fn solve_coordinates_per_newton_at(&self, frequency_hz: f64) -> Result<Vec<DVector<Complex64>>, ResponseError> {
        let (n, p) = (self.model.count_coordinates(), self.model.count_actuators());
        let (mut re, mut im) = (vec![0.0; n * p], vec![0.0; n * p]);
        self.solve_coordinates_per_newton_into(frequency_hz, &mut re, &mut im)?;
        let entry = |at: usize| Complex64::new(re[at], im[at]);
        Ok((0..p).map(|actuator| DVector::from_fn(n, |i, _| entry(actuator * n + i))).collect())
    }

    /// Solves for the coordinates at a frequency into `re` and `im`, each of length p n, actuator by actuator.
    ///
    /// # Errors
    /// [`ResponseError::Unbounded`].
    pub(super) fn solve_coordinates_per_newton_into(
        &self,
        frequency_hz: f64,
        re: &mut [f64],
        im: &mut [f64],
    ) -> Result<(), ResponseError> {
        let omega = std::f64::consts::TAU * frequency_hz;
        if let Some(low_rank) = &self.low_rank
            && low_rank.write_coordinates_per_newton_by_woodbury_if_possible(self.model, omega, re, im).is_some()
        {
            return Ok(());
        }
        for (at, z) in solve_coordinates_per_newton_with_full_matrix(self.model, frequency_hz)?.iter().enumerate() {
            (re[at], im[at]) = (z.re, z.im);
        }
        Ok(())
    }
}

/// Displacement coordinates q for 1 N at each actuator alone, at one frequency.
///
/// # Errors
/// [`ResponseError::Unbounded`].
pub fn solve_coordinates_per_newton_at_frequency(
    model: &ReducedModel,
    frequency_hz: f64,
) -> Result<Vec<DVector<Complex64>>, ResponseError> {
    CoordinateSolver::new(model).solve_coordinates_per_newton_at(frequency_hz)
}

impl<'a> LowRankSolver<'a> {
    fn new(structured: &'a StructuredDamping, force: &DMatrix<f64>) -> Self {
        let rank = structured.couplings.len();
        let width = rank * (rank + 1) / 2 + rank * force.ncols();
        let mut products = Vec::with_capacity(width * force.nrows());
        let shape = |k: usize, i: usize| structured.couplings[k].shape[i];
        for i in 0..force.nrows() {
            products.extend((0..rank).flat_map(|k| (0..=k).map(move |l| shape(k, i) * shape(l, i))));
            products.extend((0..force.ncols()).flat_map(|j| (0..rank).map(move |k| shape(k, i) * force[(i, j)])));
        }
        Self { structured, rank, products, width }
    }

    /// Solves by Woodbury's formula; `None` where the full matrix has to be used.
    fn write_coordinates_per_newton_by_woodbury_if_possible(
        &self,
        model: &ReducedModel,
        omega: f64,
        re: &mut [f64],
        im: &mut [f64],
    ) -> Option<()> {
        let (n, r, p) = (model.count_coordinates(), self.rank, model.count_actuators());
        // D^-1, in the first column of the result for now.
        let mut inverse = vec![Complex64::ZERO; n];
        for (i, inverse) in inverse.iter_mut().enumerate() {
            let lambda = model.lambda[i];
            let loss = self.structured.structural[i] + omega * self.structured.viscous[i];
            let entry = Complex64::new(lambda - omega * omega, loss);
            let size = entry.norm_sqr();
            if size < (TOO_SMALL * (lambda + omega * omega)).powi(2) || size == 0.0 {
                return None;
            }
            *inverse = entry.conj() / size;
        }
        let (mut sums_re, mut sums_im) = (vec![0.0; self.width], vec![0.0; self.width]);
        for (products, inverse) in self.products.chunks_exact(self.width.max(1)).zip(&inverse) {
            for ((product, re), im) in products.iter().zip(&mut sums_re).zip(&mut sums_im) {
                *re += product * inverse.re;
                *im += product * inverse.im;
            }
        }
        let sum = |at: usize| Complex64::new(sums_re[at], sums_im[at]);
        // Rows of 1 + Z G over 1 + |Z_k| |G_kk|: of the size of one for dashpots from none to ones that hold the point.
        let mut equations = ComplexEquations::new(r, p);
        for (k, coupling) in self.structured.couplings.iter().enumerate() {
            let impedance = Complex64::new(0.0, coupling.structural + omega * coupling.viscous);
            let scale = 1.0 / (1.0 + impedance.im.abs() * sum(k * (k + 1) / 2 + k).norm());
            for l in 0..r {
                let (high, low) = (k.max(l), k.min(l));
                let entry = impedance * sum(high * (high + 1) / 2 + low) * scale;
                equations.set_coefficient_or_right_side(k, l, entry.re + if k == l { scale } else { 0.0 }, entry.im);
            }
            for j in 0..p {
                let entry = impedance * sum(r * (r + 1) / 2 + j * r + k) * scale;
                equations.set_coefficient_or_right_side(k, r + j, entry.re, entry.im);
            }
        }
        equations.solve_and_return_least_pivot_unless_singular().filter(|pivot| *pivot >= TOO_SMALL)?;
        for j in 0..p {
            let (re, im) = (&mut re[j * n..(j + 1) * n], &mut im[j * n..(j + 1) * n]);
            re.copy_from_slice(model.force.column(j).as_slice());
            im.fill(0.0);
            for (k, coupling) in self.structured.couplings.iter().enumerate() {
                let (y_re, y_im) = equations.solved_unknown(k, j);
                for ((shape, re), im) in coupling.shape.iter().zip(&mut *re).zip(&mut *im) {
                    *re -= shape * y_re;
                    *im -= shape * y_im;
                }
            }
            for ((re, im), inverse) in re.iter_mut().zip(im).zip(&inverse) {
                (*re, *im) = (*re * inverse.re - *im * inverse.im, *re * inverse.im + *im * inverse.re);
            }
        }
        Some(())
    }
}

/// Solves for the coordinates at a frequency with the full matrix: n x p.
fn solve_coordinates_per_newton_with_full_matrix(
    model: &ReducedModel,
    frequency_hz: f64,
) -> Result<DMatrix<Complex64>, ResponseError> {
    let n = model.count_coordinates();
    let omega = std::f64::consts::TAU * frequency_hz;
    // Rows and columns divided by the square root of this have entries of the size of one, whatever springs there are.
    let scale = model.lambda.map(|lambda| 1.0 / (lambda + omega * omega).max(f64::MIN_POSITIVE).sqrt());
    let matrix = DMatrix::from_fn(n, n, |i, j| {
        let stiffness = if i == j { model.lambda[i] - omega * omega } else { 0.0 };
        Complex64::new(stiffness, model.structural[(i, j)] + omega * model.viscous[(i, j)]) * scale[i] * scale[j]
    });
    let force = DMatrix::from_fn(n, model.count_actuators(), |i, j| Complex64::from(model.force[(i, j)] * scale[i]));
    let unbounded = |mode: usize| ResponseError::Unbounded {
        frequency_hz,
        resonance_hz: model.lambda[mode].sqrt() / std::f64::consts::TAU,
    };
    let mut solution = force.clone();
    if matrix.iter().enumerate().all(|(k, z)| k % (n + 1) == 0 || *z == Complex64::ZERO) {
        // No damping couples the modes: each for itself, so that one at resonance that nothing excites stays at rest.
        let largest = force.iter().map(|z| z.norm()).fold(0.0, f64::max);
        for i in 0..n {
            let singular = matrix[(i, i)].norm() < SINGULAR;
            for j in 0..solution.ncols() {
                if !singular {
                    solution[(i, j)] /= matrix[(i, i)];
                } else if force[(i, j)].norm() > NOT_EXCITED * largest {
                    return Err(unbounded(i));
                } else {
                    solution[(i, j)] = Complex64::ZERO;
                }
            }
        }
    } else {
        let mut equations = ComplexEquations::new(n, force.ncols());
        for (at, entry) in matrix.iter().enumerate() {
            equations.set_coefficient_or_right_side(at % n, at / n, entry.re, entry.im);
        }
        for (at, entry) in force.iter().enumerate() {
            equations.set_coefficient_or_right_side(at % n, n + at / n, entry.re, entry.im);
        }
        let least = equations.solve_and_return_least_pivot_unless_singular();
        let (solved, pivot) = (least.is_some(), least.unwrap_or(0.0));
        for (at, out) in solution.iter_mut().enumerate() {
            let (re, im) = equations.solved_unknown(at % n, at / n);
            *out = Complex64::new(re, im);
        }
        let response = solution.iter().map(|z| z.norm()).fold(0.0, f64::max);
        let load = force.iter().map(|z| z.norm()).fold(f64::MIN_POSITIVE, f64::max);
        if !solved || !response.is_finite() || pivot < SINGULAR && response > 1e-3 / SINGULAR * load {
            let nearest = (0..n)
                .min_by(|a, b| {
                    let distance = |i: usize| (model.lambda[i] - omega * omega).abs();
                    distance(*a).total_cmp(&distance(*b))
                })
                .unwrap_or(0);
            return Err(unbounded(nearest));
        }
    }
    for (mut row, scale) in solution.row_iter_mut().zip(&scale) {
        row *= Complex64::from(*scale);
    }
    Ok(solution)
}
