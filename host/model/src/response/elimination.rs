//! Gaussian elimination with complex numbers, real and imaginary parts apart: rows are then sums of real rows, which vector
//! instructions add several numbers at a time.

use crate::kernel;
use pulp::Arch;

/// n equations with p right sides, row by row: each row has its n coefficients and its p right sides.
#[derive(Clone, Debug)]
pub(super) struct ComplexEquations {
    n: usize,
    width: usize,
    re: Vec<f64>,
    im: Vec<f64>,
}

impl ComplexEquations {
    /// All zero.
    pub(super) fn new(n: usize, p: usize) -> Self {
        let width = n + p;
        Self { n, width, re: vec![0.0; n * width], im: vec![0.0; n * width] }
    }

    /// Sets a coefficient; columns from n on are right sides.
    pub(super) fn set_coefficient_or_right_side(&mut self, row: usize, column: usize, re: f64, im: f64) {
        let at = row * self.width + column;
        (self.re[at], self.im[at]) = (re, im);
    }

    /// Real and imaginary part of an unknown for a right side, once the equations are solved.
    pub(super) fn solved_unknown(&self, row: usize, right_side_index: usize) -> (f64, f64) {
        let at = row * self.width + self.n + right_side_index;
        (self.re[at], self.im[at])
    }

    /// Solves them, with row pivoting; the right sides become the solutions. The least modulus of a pivot, or `None` where one
    /// is zero or no number.
    pub(super) fn solve_and_return_least_pivot_unless_singular(&mut self) -> Option<f64> {
        // With the vector instructions that the machine has.
        Arch::new().dispatch(Eliminate(self))
    }
}

kernel!(Eliminate<'a>(equations: &'a mut ComplexEquations) -> Option<f64> = solve_equations_returning_least_pivot);

#[inline(always)]
fn solve_equations_returning_least_pivot(equations: &mut ComplexEquations) -> Option<f64> {
    let ComplexEquations { n, width, re, im } = equations;
    let (n, width) = (*n, *width);
    let mut least = f64::INFINITY;
    for column in 0..n {
        let size = |row: usize| {
            let at = row * width + column;
            re[at] * re[at] + im[at] * im[at]
        };
        let pivot = (column..n).max_by(|a, b| size(*a).total_cmp(&size(*b)))?;
        let square = size(pivot);
        // A NaN is no pivot either.
        if square.is_nan() || square == 0.0 {
            return None;
        }
        least = least.min(square.sqrt());
        if pivot != column {
            for values in [&mut *re, &mut *im] {
                let (above, below) = values.split_at_mut(pivot * width);
                above[column * width..(column + 1) * width].swap_with_slice(&mut below[..width]);
            }
        }
        let at = column * width + column;
        let (inverse_re, inverse_im) = (re[at] / square, -im[at] / square);
        let (re_above, re_below) = re.split_at_mut((column + 1) * width);
        let (im_above, im_below) = im.split_at_mut((column + 1) * width);
        let (re_above, im_above) = (&re_above[at + 1..], &im_above[at + 1..]);
        for (re, im) in re_below.chunks_exact_mut(width).zip(im_below.chunks_exact_mut(width)) {
            let (a, b) = (re[column], im[column]);
            let (a, b) = (a * inverse_re - b * inverse_im, a * inverse_im + b * inverse_re);
            let here = re[column + 1..].iter_mut().zip(&mut im[column + 1..]);
            for ((re, im), (re_above, im_above)) in here.zip(re_above.iter().zip(im_above)) {
                *re -= a * re_above - b * im_above;
                *im -= a * im_above + b * re_above;
            }
        }
    }
    for row in (0..n).rev() {
        let at = row * width;
        let square = re[at + row] * re[at + row] + im[at + row] * im[at + row];
        let (inverse_re, inverse_im) = (re[at + row] / square, -im[at + row] / square);
        for side in n..width {
            let (mut a, mut b) = (re[at + side], im[at + side]);
            for known in row + 1..n {
                let (x, y) = (re[known * width + side], im[known * width + side]);
                a -= re[at + known] * x - im[at + known] * y;
                b -= re[at + known] * y + im[at + known] * x;
            }
            re[at + side] = a * inverse_re - b * inverse_im;
            im[at + side] = a * inverse_im + b * inverse_re;
        }
    }
    Some(least)
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::DMatrix;
    use num_complex::Complex64;

    /// Against nalgebra's LU, with a zero where the first pivot would be.
    #[test]
    fn solutions_are_those_of_lu() {
        for (n, p) in [(1, 1), (2, 3), (7, 2), (20, 1)] {
            let entry = |i: usize, j: usize| {
                let size = if i == j && i > 0 { 3.0 } else { 0.0 };
                let zero = if i == 0 && j == 0 && n > 1 { 0.0 } else { 1.0 };
                Complex64::new(size + ((3 * i + 5 * j) % 7) as f64, ((2 * i + j) % 5) as f64 - 2.0) * zero
            };
            let matrix = DMatrix::from_fn(n, n, entry);
            let right = DMatrix::from_fn(n, p, |i, j| entry(i + 1, j + 2));
            let mut equations = ComplexEquations::new(n, p);
            for i in 0..n {
                (0..n)
                    .for_each(|j| equations.set_coefficient_or_right_side(i, j, matrix[(i, j)].re, matrix[(i, j)].im));
                (0..p).for_each(|j| {
                    equations.set_coefficient_or_right_side(i, n + j, right[(i, j)].re, right[(i, j)].im)
                });
            }
            let lu = matrix.lu();
            let expected = lu.solve(&right).unwrap();
            // Pivots depend on their order, their product does not: the least is at most their geometric mean.
            let mean = lu.determinant().norm().powf(1.0 / n as f64);
            let least = equations.solve_and_return_least_pivot_unless_singular().unwrap();
            assert!(
                least > 0.0 && least < mean * (1.0 + 1e-9) && (n > 1 || least > mean * (1.0 - 1e-9)),
                "{least} {mean}"
            );
            for i in 0..n {
                for j in 0..p {
                    let (re, im) = equations.solved_unknown(i, j);
                    assert!((Complex64::new(re, im) - expected[(i, j)]).norm() < 1e-11, "{n} {i} {j}");
                }
            }
        }
        let mut diagonal = ComplexEquations::new(3, 1);
        [3.0, 0.25, 2.0]
            .into_iter()
            .enumerate()
            .for_each(|(i, value)| diagonal.set_coefficient_or_right_side(i, i, 0.0, value));
        assert_eq!(diagonal.solve_and_return_least_pivot_unless_singular(), Some(0.25));
        assert!(ComplexEquations::new(3, 1).solve_and_return_least_pivot_unless_singular().is_none());
    }
}
