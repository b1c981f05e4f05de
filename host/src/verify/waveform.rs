//! The acceleration that a plan's drives make at a point, harmonics of the square-edged forces included, from the
//! frequency domain alone: no equation is stepped in time.

use crate::device::convert::SiDrive;
use crate::device::sim::low_pass;
use crate::model::ReducedModel;
use crate::planner::limits::Electrodes;
use crate::response::{self, ResponseError};
use nalgebra::DVector;
use num_complex::Complex64;
use std::f64::consts::{FRAC_PI_2, TAU};

/// Highest harmonic frequency that is counted, in Hz. The accelerometer's low-pass leaves 1/16 of what lies at twice its
/// corner, which a resonance can make up for, and 1/256 of what lies at four times.
const HIGHEST_HZ: f64 = 4000.0;

/// The acceleration at one point through the accelerometer's low-pass, as a sum of sines.
#[derive(Clone, Debug)]
pub struct Waveform {
    drives: Vec<Harmonics>,
    /// Modal coordinates of the steady motion at time zero.
    pub displacement: DVector<f64>,
    /// Their rates.
    pub velocity: DVector<f64>,
}

/// One drive's part: the sum over k of the real part of `phasors[k]` e^{j (2k + 1) (w t + phase)}, in m/s^2.
#[derive(Clone, Debug)]
struct Harmonics {
    frequency_hz: f64,
    phase_rad: f64,
    phasors: Vec<Complex64>,
}

impl Waveform {
    /// The steady motion under `drives` (as achieved by the board's registers), which started together at time zero, each
    /// at its own phase. `shape` holds the mode shapes at the point, `electrodes` those of every channel.
    ///
    /// # Errors
    /// [`ResponseError`] at a harmonic that meets the resonance of an undamped mode.
    pub fn new(
        model: &ReducedModel,
        electrodes: &[Electrodes],
        shape: &DVector<f64>,
        drives: &[SiDrive],
    ) -> Result<Self, ResponseError> {
        let mut all = Vec::with_capacity(drives.len());
        let (mut displacement, mut velocity) = (DVector::zeros(model.order()), DVector::zeros(model.order()));
        for drive in drives {
            let channel = usize::from(drive.channel);
            let Some(electrodes) = electrodes.get(channel) else { continue };
            let mut phasors = Vec::new();
            for n in (1..).step_by(2) {
                let frequency_hz = f64::from(n) * drive.frequency_hz;
                if n > 1 && frequency_hz > HIGHEST_HZ {
                    break;
                }
                let amplitude = signed_harmonic(electrodes, n, drive.pulse_width) * drive.voltage_v * drive.voltage_v;
                let omega = TAU * frequency_hz;
                let coordinates = response::modal_coordinates(model, frequency_hz)?;
                let Some(q) = coordinates.get(channel) else { break };
                phasors.push(response::dot(shape, q) * -omega * omega * amplitude * low_pass(frequency_hz));
                let start = Complex64::from_polar(amplitude, f64::from(n) * drive.phase_rad);
                displacement += q.map(|q| (q * start).re);
                velocity += q.map(|q| (Complex64::I * omega * q * start).re);
            }
            all.push(Harmonics { frequency_hz: drive.frequency_hz, phase_rad: drive.phase_rad, phasors });
        }
        Ok(Self { drives: all, displacement, velocity })
    }

    /// Acceleration in m/s^2, `time_s` after the drives' start.
    #[must_use]
    pub fn at(&self, time_s: f64) -> f64 {
        self.drives.iter().map(|drive| drive.at(time_s)).sum()
    }

    /// Largest magnitude in m/s^2 over `samples` times, `step_s` apart from `from_s` on. Harmonics of different drives
    /// that coincide (the third of 60 Hz and the first of 180 Hz) add as phasors, and a beat that takes longer than the
    /// window is seen in it only as far as the window goes, as in a measurement.
    #[must_use]
    #[allow(clippy::cast_precision_loss, reason = "sample numbers")]
    pub fn peak(&self, from_s: f64, step_s: f64, samples: usize) -> f64 {
        (0..samples).map(|i| self.at(from_s + i as f64 * step_s).abs()).fold(0.0, f64::max)
    }
}

impl Harmonics {
    /// Horner's scheme in e^{2 j angle}: one sine and cosine for all harmonics.
    fn at(&self, time_s: f64) -> f64 {
        let angle = TAU * (self.frequency_hz * time_s).fract() + self.phase_rad;
        let first = Complex64::from_polar(1.0, angle);
        let square = first * first;
        let sum = self.phasors.iter().rev().fold(Complex64::ZERO, |sum, phasor| sum * square + phasor);
        (sum * first).re
    }
}

/// With its sign: windows centred on the half periods have harmonics of 4/(n pi) sin(n pi w/2).
fn signed_harmonic(electrodes: &Electrodes, n: u32, pulse_width: f64) -> f64 {
    let sign = (f64::from(n) * FRAC_PI_2 * pulse_width).sin().signum();
    sign * electrodes.harmonic_per_volt_squared(n, pulse_width)
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::PI;

    fn of(drives: Vec<Harmonics>) -> Waveform {
        Waveform { drives, displacement: DVector::zeros(0), velocity: DVector::zeros(0) }
    }

    fn harmonics(frequency_hz: f64, phase_rad: f64, phasors: &[f64]) -> Harmonics {
        Harmonics { frequency_hz, phase_rad, phasors: phasors.iter().map(|re| Complex64::from(*re)).collect() }
    }

    #[test]
    fn coinciding_harmonics_add_as_phasors() {
        // The third harmonic of 60 Hz against the first of 180 Hz, which starts half a turn later: nothing is left of it.
        let waveform = of(vec![harmonics(60.0, 0.0, &[1.0, 0.5]), harmonics(180.0, PI, &[0.5])]);
        assert!((waveform.peak(0.0, 25e-6, 40_000) - 1.0).abs() < 1e-12);
        let alone = of(vec![harmonics(60.0, 0.0, &[1.0, 0.5])]);
        assert!((alone.peak(0.0, 25e-6, 40_000) - 1.5).abs() < 1e-12);
    }

    #[test]
    fn a_long_beat_is_seen_as_far_as_the_window_goes() {
        // A beat of 0.1 Hz that starts in opposition: nothing at first, twice the amplitude after 5 s.
        let waveform = of(vec![harmonics(200.0, 0.0, &[1.0]), harmonics(200.1, PI, &[1.0])]);
        let early = waveform.peak(0.0, 25e-6, 4_000);
        assert!(early < 2.0 * (PI * 0.1 * 0.1).sin() + 1e-9, "{early}");
        assert!(waveform.peak(4.95, 25e-6, 4_000) > 1.999);
    }
}
