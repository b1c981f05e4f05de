//! Cubic Hermite functions on one cell, and the matrices that beams and plates are made of.
//!
//! A cell of length h has four unknowns: value and slope at its two ends. Slopes are stored times a length of their own
//! node ("scaled slopes"), so that all unknowns have the size of displacements and strongly graded meshes keep a good
//! condition.

/// A 4 x 4 matrix over (w0, s0 w0', w1, s1 w1').
pub type Matrix4 = [[f64; 4]; 4];

/// The one-dimensional matrices of a cell.
#[derive(Clone, Copy, Debug)]
pub struct CellMatrices {
    /// Integral of N_i N_j.
    pub mass: Matrix4,
    /// Integral of N_i' N_j'.
    pub slope: Matrix4,
    /// Integral of N_i'' N_j''.
    pub bend: Matrix4,
    /// Integral of N_i'' N_j.
    pub mixed: Matrix4,
}

const MASS: Matrix4 =
    [[156.0, 22.0, 54.0, -13.0], [22.0, 4.0, 13.0, -3.0], [54.0, 13.0, 156.0, -22.0], [-13.0, -3.0, -22.0, 4.0]];
const SLOPE: Matrix4 =
    [[36.0, 3.0, -36.0, 3.0], [3.0, 4.0, -3.0, -1.0], [-36.0, -3.0, 36.0, -3.0], [3.0, -1.0, -3.0, 4.0]];
const BEND: Matrix4 =
    [[12.0, 6.0, -12.0, 6.0], [6.0, 4.0, -6.0, 2.0], [-12.0, -6.0, 12.0, -6.0], [6.0, 2.0, -6.0, 4.0]];
/// By parts: N_i'' N_j = [N_i' N_j] - N_i' N_j'; the boundary term touches two entries.
const MIXED: Matrix4 =
    [[-36.0, -3.0, 36.0, -3.0], [-33.0, -4.0, 3.0, 1.0], [36.0, 3.0, -36.0, 3.0], [-3.0, 1.0, 33.0, -4.0]];

/// The matrices of a cell of length `h` whose end slopes are stored times `scale[0]` and `scale[1]`.
#[must_use]
pub fn cell_matrices(h: f64, scale: [f64; 2]) -> CellMatrices {
    // The tables above are for slopes times h.
    let to_unit = [1.0, h / scale[0], 1.0, h / scale[1]];
    let make = |table: &Matrix4, factor: f64| {
        let mut out = [[0.0; 4]; 4];
        for (i, row) in out.iter_mut().enumerate() {
            for (j, entry) in row.iter_mut().enumerate() {
                *entry = table[i][j] * factor * to_unit[i] * to_unit[j];
            }
        }
        out
    };
    CellMatrices {
        mass: make(&MASS, h / 420.0),
        slope: make(&SLOPE, 1.0 / (30.0 * h)),
        bend: make(&BEND, 1.0 / (h * h * h)),
        mixed: make(&MIXED, 1.0 / (30.0 * h)),
    }
}

/// Values of the four functions at `t` in 0..=1 of a cell.
#[must_use]
pub fn values(t: f64, h: f64, scale: [f64; 2]) -> [f64; 4] {
    let u = 1.0 - t;
    [u * u * (1.0 + 2.0 * t), t * u * u * h / scale[0], t * t * (3.0 - 2.0 * t), -t * t * u * h / scale[1]]
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Every entry against Gauss-Legendre quadrature of the functions (8 points integrate degree 15 exactly).
    #[test]
    fn matrices_are_the_integrals() {
        const POINTS: [(f64, f64); 4] = [
            (0.183_434_642_495_649_8, 0.362_683_783_378_362),
            (0.525_532_409_916_329, 0.313_706_645_877_887_3),
            (0.796_666_477_413_626_7, 0.222_381_034_453_374_5),
            (0.960_289_856_497_536_3, 0.101_228_536_290_376_3),
        ];
        let (h, scale) = (0.37, [0.5, 0.21]);
        let first = |t: f64| {
            let (a, b) = (h / scale[0], h / scale[1]);
            [6.0 * t * (t - 1.0), (1.0 - t) * (1.0 - 3.0 * t) * a, 6.0 * t * (1.0 - t), t * (3.0 * t - 2.0) * b]
                .map(|d| d / h)
        };
        let second = |t: f64| {
            let (a, b) = (h / scale[0], h / scale[1]);
            [12.0 * t - 6.0, (6.0 * t - 4.0) * a, 6.0 - 12.0 * t, (6.0 * t - 2.0) * b].map(|d| d / (h * h))
        };
        let matrices = cell_matrices(h, scale);
        for i in 0..4 {
            for j in 0..4 {
                let mut sums = [0.0; 4];
                for (x, weight) in POINTS {
                    for t in [0.5 * (1.0 - x), 0.5 * (1.0 + x)] {
                        let (n, d, dd) = (values(t, h, scale), first(t), second(t));
                        let terms = [n[i] * n[j], d[i] * d[j], dd[i] * dd[j], dd[i] * n[j]];
                        sums.iter_mut().zip(terms).for_each(|(sum, term)| *sum += 0.5 * h * weight * term);
                    }
                }
                let found = [matrices.mass, matrices.slope, matrices.bend, matrices.mixed].map(|m| m[i][j]);
                for (found, expected) in found.iter().zip(sums) {
                    assert!(
                        (found - expected).abs() < 1e-12 * expected.abs().max(1.0),
                        "({i},{j}): {found} {expected}"
                    );
                }
            }
        }
    }
}
