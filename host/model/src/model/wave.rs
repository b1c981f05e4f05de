//! Z^2 log Z, which point forces on plates that are stiffer along one axis are sums of ([`super::orthotropic`]).

use num_complex::Complex64;

/// The function Re(factor Z^2 log Z) with Z = root |n| + j t.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LogWave {
    /// Times it.
    pub factor: Complex64,
    /// How fast it dies out across an edge, over its waves along the edge.
    pub root: Complex64,
}

impl LogWave {
    /// The value and the derivatives w_n, w_t, w_nn, w_nt, w_tt at a point.
    pub(super) fn evaluate_wave_and_derivatives(&self, n: f64, t: f64) -> [f64; 6] {
        let Self { factor, root } = *self;
        let z = root * n.abs() + Complex64::new(0.0, t);
        let log = z.ln();
        let (first, second) = (factor * z * (2.0 * log + 1.0), factor * (2.0 * log + 3.0));
        let sign = if n < 0.0 { -1.0 } else { 1.0 };
        [
            (factor * z * z * log).re,
            sign * (root * first).re,
            -first.im,
            (root * root * second).re,
            -sign * (root * second).im,
            -second.re,
        ]
    }

    /// The wave with t reversed.
    pub(super) fn reverse_edge_direction(self) -> Self {
        Self { factor: self.factor.conj(), root: self.root.conj() }
    }
}
