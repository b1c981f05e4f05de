//! The response of one actuator at one frequency.

use crate::physics::charging::PeriodicCharging;
use crate::physics::limits::{Electrodes, Limit};
use crate::scene::MAX_ACTUATORS;
use nalgebra::DVector;
use num_complex::Complex64;
use serde::{Deserialize, Serialize};

/// How much stronger the widest pulse must be to be worth a candidate of its own.
const WORTH: f64 = 1.01;

/// One way to drive the electrodes of an actuator at one frequency: a pulse width with the harmonics, the travel and
/// the force limit that come with it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct PulseOption {
    /// Part of its half period for which an electrode is on.
    pub pulse_width: f64,
    /// Mean over the surface of |acceleration|^2 by the odd harmonics that come with 1 N of the fundamental, in
    /// (m/s^2/N)^2.
    pub harmonics: f64,
    /// The same as it is felt: each harmonic's times the square of [`crate::perception::felt_weight_relative_to_reference_hz`].
    pub felt_harmonics: f64,
    /// Square of the voltage per N of the fundamental, in V^2/N.
    pub square_volts_per_n: f64,
    /// Mean stiffness that the electrodes take off the spring per N of the fundamental, in N/m/N.
    pub softening_n_per_m_per_n: f64,
    /// Most travel of every actuator's mass that comes with 1 N of the fundamental, in m/N: the moduli of fundamental,
    /// harmonics and what switching on adds.
    pub travel_m_per_n: [f64; MAX_ACTUATORS],
    /// Most amplitude of the force's fundamental in N.
    pub max_force_n: f64,
    /// What sets it.
    pub limit: Limit,
}

impl PulseOption {
    /// The same with another pulse width of these electrodes at this frequency; what harmonics move and the limit stay.
    #[must_use]
    pub(crate) fn with_pulse_width_keeping_max_force(
        self,
        electrodes: &Electrodes,
        frequency_hz: f64,
        pulse_width: f64,
    ) -> Self {
        Self {
            pulse_width,
            square_volts_per_n: 1.0 / electrodes.harmonic_force_n_per_v2(1, frequency_hz, pulse_width),
            softening_n_per_m_per_n: electrodes.mean_softening_n_per_m_per_n(frequency_hz, pulse_width),
            ..self
        }
    }
}

/// Odd harmonics whose travel is known: 3, 5 and 7.
pub const HARMONICS: [f64; 3] = [3.0, 5.0, 7.0];

/// The response of one actuator at one frequency, per newton of force amplitude.
#[derive(Clone, Debug)]
pub struct Entry {
    /// Voltage of this actuator's electrodes under windows of this frequency.
    pub charging: PeriodicCharging,
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
    pub widths: [PulseOption; 2],
    /// Most force amplitude in N, of any width.
    pub max_force_n: f64,
    /// What sets it.
    pub limit: Limit,
}

impl Entry {
    /// The widest pulse if it gives noticeably more force, otherwise the quiet one.
    #[must_use]
    pub fn widest_pulse_if_noticeably_stronger_else_quiet(&self) -> &PulseOption {
        choose_widest_pulse_if_noticeably_stronger(&self.widths)
    }

    /// The strongest pulse if `wants_strongest`, otherwise the quiet one.
    #[must_use]
    pub fn select_pulse(&self, wants_strongest: bool) -> &PulseOption {
        if wants_strongest { self.widest_pulse_if_noticeably_stronger_else_quiet() } else { &self.widths[0] }
    }
}

/// The widest of the two pulses if its force limit is noticeably higher, otherwise the quiet one.
pub(super) fn choose_widest_pulse_if_noticeably_stronger([quiet, widest]: &[PulseOption; 2]) -> &PulseOption {
    if widest.max_force_n > WORTH * quiet.max_force_n { widest } else { quiet }
}

/// Response at a point: the sum of mode shape times coordinate.
#[must_use]
#[inline(always)]
pub fn acceleration_at_point_from_coordinates(shape: &DVector<f64>, acceleration: &DVector<Complex64>) -> Complex64 {
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
