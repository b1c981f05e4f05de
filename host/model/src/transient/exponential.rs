//! The matrix exponential: Taylor polynomial in Paterson and Stockmeyer's form, scaled and squared.
//!
//! No linear system is solved, as Padé's form needs: all work is in matrix products. Higham, Functions of Matrices, SIAM
//! 2008, chapter 10; for Taylor polynomials Bader, Blanes and Casas, Mathematics 7 (2019) 1174.

use nalgebra::DMatrix;

/// Norm up to which degree 9 leaves a remainder of 6e-17: x^10 / 10! at 0.1 is 3e-17.
const NORM_9: f64 = 0.1;
/// The same for degree 16: x^17 / 17! at 0.8 is 6e-17.
const NORM_16: f64 = 0.8;
/// Most squarings: a norm of 1e18 or so, beyond which the result is zero or infinite anyway.
const MOST_SQUARINGS: i32 = 60;

/// The exponential of a square matrix.
pub fn matrix_exponential(matrix: &DMatrix<f64>) -> DMatrix<f64> {
    let norm = largest_column_sum_of_magnitudes(matrix);
    if norm <= NORM_9 {
        return evaluate_exponential_taylor(matrix, 9, 3);
    }
    let squarings = count_squarings(norm);
    let mut result = evaluate_exponential_taylor(&(matrix * 0.5_f64.powi(squarings)), 16, 4);
    for _ in 0..squarings {
        result = &result * &result;
    }
    result
}

/// Matrix products that [`matrix_exponential`] makes for a matrix of this norm.
pub fn count_matrix_products_of_matrix_exponential(norm: f64) -> f64 {
    if norm <= NORM_9 { 4.0 } else { 6.0 + f64::from(count_squarings(norm)) }
}

/// Number of squarings for a matrix of this norm.
#[expect(clippy::cast_possible_truncation, reason = "clamped to the range from 0 to MOST_SQUARINGS")]
fn count_squarings(norm: f64) -> i32 {
    (norm / NORM_16).log2().ceil().clamp(0.0, f64::from(MOST_SQUARINGS)) as i32
}

/// The largest sum of magnitudes in a column (the 1-norm).
pub fn largest_column_sum_of_magnitudes(matrix: &DMatrix<f64>) -> f64 {
    matrix.column_iter().map(|column| column.iter().map(|x| x.abs()).sum::<f64>()).fold(0.0, f64::max)
}

/// Sum of matrix^k / k! up to `degree`, a multiple of `stride`, with powers up to `stride` and Horner's rule in the last.
fn evaluate_exponential_taylor(matrix: &DMatrix<f64>, degree: usize, stride: usize) -> DMatrix<f64> {
    let n = matrix.nrows();
    let mut coefficients = vec![1.0; degree + 1];
    for k in 1..=degree {
        #[expect(clippy::cast_precision_loss, reason = "at most 16")]
        let k_real = k as f64;
        coefficients[k] = coefficients[k - 1] / k_real;
    }
    let mut powers = vec![matrix.clone()];
    while powers.len() < stride {
        powers.push(&powers[powers.len() - 1] * matrix);
    }
    let add_group = |sum: &mut DMatrix<f64>, first: usize| {
        for i in 0..n {
            sum[(i, i)] += coefficients[first];
        }
        for (k, power) in powers.iter().enumerate().take(stride - 1) {
            let factor = coefficients[first + k + 1];
            sum.zip_apply(power, |s, p| *s += factor * p);
        }
    };
    let mut sum = &powers[stride - 1] * coefficients[degree];
    add_group(&mut sum, degree - stride);
    for group in (0..degree / stride - 1).rev() {
        sum = &sum * &powers[stride - 1];
        add_group(&mut sum, group * stride);
    }
    sum
}
