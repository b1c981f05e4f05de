//! What one actuator does at one frequency.

use crate::physics::limits::Limit;
use crate::scene::MAX_ACTUATORS;
use nalgebra::DVector;
use num_complex::Complex64;
use serde::{Deserialize, Serialize};

/// How much stronger the widest pulse must be to be worth a candidate of its own.
const WORTH: f64 = 1.01;

/// How an actuator's electrodes may be driven at one frequency.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Width {
    /// Part of its half period for which an electrode is on.
    pub pulse_width: f64,
    /// Mean over the surface of |acceleration|^2 by the odd harmonics that come with 1 N of the fundamental, in
    /// (m/s^2/N)^2.
    pub harmonics: f64,
    /// The same as it is felt: each harmonic's times the square of [`crate::perception::weight`].
    pub felt_harmonics: f64,
    /// Most travel of every actuator's mass that comes with 1 N of the fundamental, in m/N: the moduli of fundamental,
    /// harmonics and what switching on adds.
    pub travel_m_per_n: [f64; MAX_ACTUATORS],
    /// Most amplitude of the force's fundamental in N.
    pub max_force_n: f64,
    /// What sets it.
    pub limit: Limit,
}

/// Odd harmonics whose travel is known: 3, 5 and 7.
pub const HARMONICS: [f64; 3] = [3.0, 5.0, 7.0];

/// One actuator at one frequency, for 1 N of force amplitude.
#[derive(Clone, Debug)]
pub struct Entry {
    /// Modal coordinates of the acceleration in m/s^2/N: the response at a point is the dot product with the mode shapes
    /// there.
    pub acceleration: DVector<Complex64>,
    /// Mean over the surface of |acceleration|^2, in (m/s^2/N)^2.
    pub mean_square: f64,
    /// Mean over the surface of |acceleration|, in m/s^2/N.
    pub mean: f64,
    /// No point of the surface has a larger |acceleration|^2.
    pub most_square: f64,
    /// Nowhere is its slope along the surface larger, in m/s^2/N per m; 0 off the grid, where it is not known.
    pub steepest: f64,
    /// Travel of every actuator's mass relative to its electrodes in m/N.
    pub travel: [Complex64; MAX_ACTUATORS],
    /// |travel| of every actuator in m/N at each of [`HARMONICS`].
    pub harmonic_travel: [[f64; MAX_ACTUATORS]; HARMONICS.len()],
    /// What switching on adds to the travel of every actuator at most, in m/N, when the rail rises to the voltage of the most
    /// force.
    pub overshoot: [f64; MAX_ACTUATORS],
    /// That voltage in V.
    pub onset_v: f64,
    /// Pulse widths to choose from: of those that drop harmonics the one whose harmonics move the panel least, and the widest.
    pub widths: [Width; 2],
    /// Most force amplitude in N, of any width.
    pub max_force_n: f64,
    /// What sets it.
    pub limit: Limit,
}

impl Entry {
    /// The widest pulse where it gives more force, otherwise the quiet one.
    #[must_use]
    pub fn strong(&self) -> &Width {
        stronger(&self.widths)
    }

    /// The quiet pulse, or the strong one.
    #[must_use]
    pub fn pulse(&self, is_strong: bool) -> &Width {
        if is_strong { self.strong() } else { &self.widths[0] }
    }
}

/// The stronger of an entry's two pulses where it is worth a candidate of its own, otherwise the quiet one.
pub(super) fn stronger([quiet, widest]: &[Width; 2]) -> &Width {
    if widest.max_force_n > WORTH * quiet.max_force_n { widest } else { quiet }
}

/// Response at a point: the sum of shape times coordinate.
#[must_use]
#[inline(always)]
pub fn at_point(shape: &DVector<f64>, acceleration: &DVector<Complex64>) -> Complex64 {
    // Four sums each, so that no addition waits for the one before, in blocks of a size that the compiler knows.
    const WIDE: usize = 4;
    let (mut re, mut im) = ([0.0; WIDE], [0.0; WIDE]);
    let (shapes, last_shapes) = shape.as_slice().as_chunks::<WIDE>();
    let (coordinates, last) = acceleration.as_slice().as_chunks::<WIDE>();
    for (shapes, coordinates) in shapes.iter().zip(coordinates) {
        for k in 0..WIDE {
            re[k] += coordinates[k].re * shapes[k];
            im[k] += coordinates[k].im * shapes[k];
        }
    }
    for (k, (shape, coordinate)) in last_shapes.iter().zip(last).enumerate() {
        re[k] += coordinate.re * shape;
        im[k] += coordinate.im * shape;
    }
    Complex64::new(re.iter().sum(), im.iter().sum())
}
