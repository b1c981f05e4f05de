//! The poles of a panel with what each adds to the motion of one point.

use super::{PanelPoles, RIGID_RAD_S};
use nalgebra::DVector;
use num_complex::Complex64;
use std::f64::consts::TAU;

/// Least decay rate of a pole in 1/s: a motion that rings on has no response at its own frequency, and none that fits a record of a second.
const LEAST_DECAY_PER_S: f64 = 0.5;

/// Poles s of a panel and, for every actuator, the residues g of the velocity at some points per newton: the sum over the poles of g / (s' - s),
/// with the conjugate of each complex pair.
#[derive(Clone, Debug)]
pub struct PointResidues {
    poles: Vec<Complex64>,
    /// (Points x actuators) x poles.
    residues: Vec<Vec<Complex64>>,
}

impl PanelPoles {
    /// The residues at the point (or travel) whose mode shapes are `shape`.
    #[must_use]
    pub fn residues_at_shape(&self, shape: &DVector<f64>) -> PointResidues {
        self.residues_at_shapes(std::slice::from_ref(shape))
    }

    /// The residues at several points: of all actuators at the first, then of all at the second, and so on.
    #[must_use]
    pub fn residues_at_shapes(&self, shapes: &[DVector<f64>]) -> PointResidues {
        let list_residues = |shape: &DVector<f64>| -> Vec<Vec<Complex64>> {
            let (re, im) = (self.re.tr_mul(shape), self.im.tr_mul(shape));
            let residue = |actuator: usize, k: usize| Complex64::new(re[k], im[k]) * self.force[(k, actuator)];
            (0..self.force.ncols()).map(|j| (0..self.poles.len()).map(|k| residue(j, k)).collect()).collect()
        };
        PointResidues { poles: self.poles.clone(), residues: shapes.iter().flat_map(list_residues).collect() }
    }
}

impl PointResidues {
    /// Accelerations in m/s^2 per N at 1, 2, ... `to_hz` Hz, (points x actuators) x frequencies. Each pole is moved by the factor that
    /// `pole_factor` gives for its modulus in Hz, as a panel has it whose stiffness is off, and decays at 0.5 1/s or faster.
    #[must_use]
    pub fn accelerations_per_n_by_point_and_actuator_from_1_hz_poles_scaled(
        &self,
        to_hz: u32,
        pole_factor: impl Fn(f64) -> f64,
    ) -> Vec<Vec<Complex64>> {
        let frequencies_rad_s: Vec<f64> = (1..=to_hz).map(|hz| TAU * f64::from(hz)).collect();
        let mut sums = vec![vec![Complex64::ZERO; frequencies_rad_s.len()]; self.residues.len()];
        let mut inverse = vec![Complex64::ZERO; frequencies_rad_s.len()];
        for (k, s) in self.poles.iter().enumerate() {
            let s = s * pole_factor(s.norm() / TAU);
            let is_pair = s.im > 0.0;
            let s = if is_pair { Complex64::new(s.re.min(-LEAST_DECAY_PER_S), s.im) } else { s };
            // g / (jw - s) and, of a pair, its conjugate's: (2 Re(g) jw - 2 Re(g s*)) / (|s|^2 - w^2 - 2 Re(s) jw).
            for (inverse, w) in inverse.iter_mut().zip(&frequencies_rad_s) {
                let divisor = if is_pair {
                    Complex64::new(s.norm_sqr() - w * w, -2.0 * s.re * w)
                } else {
                    Complex64::new(-s.re, w - s.im)
                };
                *inverse = divisor.inv();
            }
            for (sums, residues) in sums.iter_mut().zip(&self.residues) {
                let Some(g) = residues.get(k) else { continue };
                let (real, per_w) = if is_pair {
                    (Complex64::from(-2.0 * (g * s.conj()).re), Complex64::new(0.0, 2.0 * g.re))
                } else {
                    (*g, Complex64::ZERO)
                };
                for ((sum, inverse), w) in sums.iter_mut().zip(&inverse).zip(&frequencies_rad_s) {
                    *sum += (real + per_w * w) * inverse;
                }
            }
        }
        for sums in &mut sums {
            sums.iter_mut().zip(&frequencies_rad_s).for_each(|(sum, w)| *sum *= Complex64::new(0.0, *w));
        }
        sums
    }

    /// Moduli in Hz of the poles that vibrate, ascending.
    pub fn vibrating_pole_frequencies_hz(&self) -> impl Iterator<Item = f64> {
        self.poles.iter().map(|s| s.norm()).filter(|w| *w > 10.0 * RIGID_RAD_S).map(|w| w / TAU)
    }
}
