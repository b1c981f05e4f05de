//! The poles of a panel with what each adds to the motion of one point.

use super::{PanelPoles, RIGID_RAD_S};
use nalgebra::DVector;
use num_complex::Complex64;
use std::f64::consts::TAU;

/// Least decay rate of a pole in 1/s: a motion that rings on has no response at its own frequency, and none that fits a record of a second.
const LEAST_DECAY_PER_S: f64 = 0.5;

/// Poles s of a panel and, for every actuator, the residues g of the velocity at one point per newton: the sum over the poles of g / (s' - s),
/// with the conjugate of each complex pair.
#[derive(Clone, Debug)]
pub struct PointResidues {
    poles: Vec<Complex64>,
    /// Actuators x poles.
    residues: Vec<Vec<Complex64>>,
}

impl PanelPoles {
    /// The residues at the point (or travel) whose mode shapes are `shape`.
    #[must_use]
    pub fn residues_at_shape(&self, shape: &DVector<f64>) -> PointResidues {
        let (re, im) = (self.re.tr_mul(shape), self.im.tr_mul(shape));
        let residue = |actuator: usize, k: usize| Complex64::new(re[k], im[k]) * self.force[(k, actuator)];
        let poles = self.poles.len();
        let residues = (0..self.force.ncols()).map(|j| (0..poles).map(|k| residue(j, k)).collect()).collect();
        PointResidues { poles: self.poles.clone(), residues }
    }
}

impl PointResidues {
    /// Number of actuators.
    #[must_use]
    pub const fn count_actuators(&self) -> usize {
        self.residues.len()
    }

    /// Acceleration at the point in m/s^2 per N of an actuator, at a frequency above 0. Each pole is moved by the factor that `pole_factor`
    /// gives for its modulus in Hz, as a panel has it whose stiffness is off, and decays at 0.5 1/s or faster.
    #[must_use]
    pub fn acceleration_per_n(
        &self,
        actuator: usize,
        frequency_hz: f64,
        pole_factor: impl Fn(f64) -> f64,
    ) -> Complex64 {
        let jw = Complex64::new(0.0, TAU * frequency_hz);
        let add = |sum: Complex64, (s, g): (&Complex64, &Complex64)| {
            let s = s * pole_factor(s.norm() / TAU);
            let s = if s.im > 0.0 { Complex64::new(s.re.min(-LEAST_DECAY_PER_S), s.im) } else { s };
            let pair = if s.im > 0.0 { g.conj() / (jw - s.conj()) } else { Complex64::ZERO };
            sum + g / (jw - s) + pair
        };
        let residues = self.residues.get(actuator).map_or(&[][..], Vec::as_slice);
        jw * self.poles.iter().zip(residues).fold(Complex64::ZERO, add)
    }

    /// Moduli in Hz of the poles that vibrate, ascending.
    pub fn pole_frequencies_hz(&self) -> impl Iterator<Item = f64> {
        self.poles.iter().map(|s| s.norm()).filter(|w| *w > 10.0 * RIGID_RAD_S).map(|w| w / TAU)
    }
}
