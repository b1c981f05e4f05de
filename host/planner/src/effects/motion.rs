//! What a point does while drives play their envelopes, from the panel's poles: no equation is stepped in time.

use crate::physics::charging::PeriodicCharging;
use crate::physics::rise::{PanelPoles, TransientResponse};
use crate::transient::panel::SwitchedForce;
use nalgebra::DVector;
use num_complex::Complex64;
use std::f64::consts::{FRAC_PI_2, TAU};

/// Highest harmonic that is counted, in Hz: beyond the skin's band nothing is felt.
const HIGHEST_HZ: f64 = 1000.0;

/// One drive at full level.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Channel {
    /// Index of the actuator.
    pub actuator: usize,
    /// In Hz.
    pub frequency_hz: f64,
    /// Fraction of its half period for which an electrode is on at full level.
    pub pulse_width: f64,
    /// Voltage of its electrodes under windows.
    pub charging: PeriodicCharging,
}

impl Channel {
    /// Length of a period in s.
    #[must_use]
    pub fn period_s(&self) -> f64 {
        1.0 / self.frequency_hz
    }

    /// The `harmonic`-th harmonic of its force, 1 N: windows lie in the middle of half periods, and the first is that of A,
    /// so that at a boundary the fundamental is a sine at zero. Behind resistors it is late by the lag that it has at full level.
    fn unit_harmonic_force(&self, harmonic: u32) -> SwitchedForce {
        let n = f64::from(harmonic);
        let lag_rad = self.full_level_harmonic_phase_rad(n);
        SwitchedForce {
            actuator: self.actuator,
            frequency_hz: n * self.frequency_hz,
            force_n: 1.0,
            phase_rad: (-n * FRAC_PI_2 + lag_rad).rem_euclid(TAU),
        }
    }

    /// Phase of that harmonic at full level relative to its windows in rad; 0 where electrodes charge at once, and the sign is the
    /// amplitude's.
    fn full_level_harmonic_phase_rad(&self, harmonic: f64) -> f64 {
        if self.charging.is_instant() {
            0.0
        } else {
            self.charging.force_harmonic_phasor_per_n_at_rail_voltage(harmonic, self.pulse_width).arg()
        }
    }

    /// Pulse width with which the board makes a level: sin(pi w'/2) = level sin(pi w/2).
    #[must_use]
    pub fn pulse_width_of_level(&self, level: f64) -> f64 {
        (level.abs().min(1.0) * (FRAC_PI_2 * self.pulse_width).sin()).asin() / FRAC_PI_2
    }

    /// The part of its full force that the fundamental has at a level, -1 to 1. Behind resistors narrow windows make less than their level.
    #[must_use]
    pub fn force_fraction_of_level(&self, level: f64) -> f64 {
        if self.charging.is_instant() {
            return level;
        }
        let force =
            |pulse_width: f64| self.charging.force_harmonic_phasor_per_n_at_rail_voltage(1.0, pulse_width).norm();
        level.signum() * force(self.pulse_width_of_level(level)) / force(self.pulse_width)
    }

    /// The level whose fundamental has this part of the full force, -1 to 1.
    #[must_use]
    pub fn level_for_force_fraction(&self, force_fraction: f64) -> f64 {
        if self.charging.is_instant() {
            return force_fraction;
        }
        let pulse_width = self.charging.find_pulse_width_for_force_fraction(self.pulse_width, force_fraction.abs());
        let half = |pulse_width: f64| (FRAC_PI_2 * pulse_width).sin();
        force_fraction.signum() * half(pulse_width) / half(self.pulse_width)
    }

    /// Size of that harmonic at `level`, relative to the fundamental at full level: the board makes a level by a narrower
    /// window, sin(pi w'/2) = level sin(pi w/2), and 1/n sin(n pi w'/2) is what its harmonics have. Behind resistors its phase changes with
    /// the level: relative to that at full level.
    fn harmonic_phasor_relative_to_full_fundamental(&self, harmonic: u32, level: f64) -> Complex64 {
        if !self.charging.is_instant() {
            let n = f64::from(harmonic);
            let own = self.charging.force_harmonic_phasor_per_n_at_rail_voltage(n, self.pulse_width_of_level(level));
            let turned = own * Complex64::cis(-self.full_level_harmonic_phase_rad(n));
            return turned
                * (level.signum()
                    / self.charging.force_harmonic_phasor_per_n_at_rail_voltage(1.0, self.pulse_width).norm());
        }
        let full = (FRAC_PI_2 * self.pulse_width).sin();
        let half = (level.abs().min(1.0) * full).asin();
        let n = f64::from(harmonic);
        Complex64::from(level.signum() * (n * half).sin() / (n * full))
    }
}

/// A channel's force harmonics at one point.
#[derive(Clone, Debug)]
pub struct ChannelResponse {
    channel: Channel,
    harmonics: Vec<(u32, TransientResponse)>,
    /// Behind resistors, of the same harmonics a quarter of a turn earlier; empty otherwise.
    quadrature: Vec<TransientResponse>,
}

impl ChannelResponse {
    /// Acceleration where `shape` holds the mode shapes; `None` at an undamped resonance.
    #[must_use]
    pub fn new(rise: &PanelPoles, shape: &DVector<f64>, channel: Channel) -> Option<Self> {
        let orders: Vec<u32> =
            (1..).step_by(2).take_while(|n| *n == 1 || f64::from(*n) * channel.frequency_hz <= HIGHEST_HZ).collect();
        let drives: Vec<SwitchedForce> = orders.iter().map(|n| channel.unit_harmonic_force(*n)).collect();
        let earlier = |drive: &SwitchedForce| SwitchedForce { phase_rad: drive.phase_rad + FRAC_PI_2, ..*drive };
        let quadrature = if channel.charging.is_instant() {
            Vec::new()
        } else {
            let drives: Vec<SwitchedForce> = drives.iter().map(earlier).collect();
            rise.transient_response_per_n_of_each_drive_if_finite(shape, &drives)?
        };
        let harmonics =
            orders.into_iter().zip(rise.transient_response_per_n_of_each_drive_if_finite(shape, &drives)?).collect();
        Some(Self { channel, harmonics, quadrature })
    }

    /// The fundamental alone.
    #[must_use]
    pub fn fundamental_response(&self) -> Option<&TransientResponse> {
        self.harmonics.first().map(|(_, ringing)| ringing)
    }

    /// Acceleration in m/s^2 per N of the fundamental at full level, at times 0, `step_s`, ..., for `levels` period by
    /// period and none after them.
    #[must_use]
    pub fn sample_acceleration_per_n(&self, levels: &[f64], step_s: f64, count: usize) -> Vec<f64> {
        let mut out = vec![0.0; count];
        let phasors = |n: u32| -> Vec<Complex64> {
            levels.iter().map(|level| self.channel.harmonic_phasor_relative_to_full_fundamental(n, *level)).collect()
        };
        let mut waves: Vec<HarmonicWave<'_>> = Vec::new();
        for (k, (n, ringing)) in self.harmonics.iter().enumerate() {
            let phasors = phasors(*n);
            waves.push(HarmonicWave::new(ringing, phasors.iter().map(|z| z.re).collect(), step_s));
            // Re((a + j b) e^(j w t)) = a cos(w t) + b cos(w t + pi/2).
            if let Some(earlier) = self.quadrature.get(k) {
                waves.push(HarmonicWave::new(earlier, phasors.iter().map(|z| z.im).collect(), step_s));
            }
        }
        add_waves_and_ringing_of_level_steps(&mut waves, self.channel.period_s(), step_s, &mut out);
        out
    }
}

/// A harmonic with its strength in every period.
struct HarmonicWave<'a> {
    ringing: &'a TransientResponse,
    parts: Vec<f64>,
    /// Strength now, and phasor of the steady motion at strength 1.
    level: f64,
    carrier: Complex64,
    carrier_turn: Complex64,
}

impl<'a> HarmonicWave<'a> {
    fn new(ringing: &'a TransientResponse, parts: Vec<f64>, step_s: f64) -> Self {
        let carrier_turn = Complex64::from_polar(1.0, ringing.omega_rad_s * step_s);
        Self { ringing, parts, level: 0.0, carrier: ringing.steady, carrier_turn }
    }
}

/// Adds the motion under steps of a channel's strength. A change by d at the boundary t_i, where the drive's phase is that
/// of its start, adds d c e^(s (t - t_i)) to the free motion, which all harmonics share.
#[expect(clippy::cast_precision_loss, reason = "sample numbers")]
fn add_waves_and_ringing_of_level_steps(waves: &mut [HarmonicWave<'_>], period_s: f64, step_s: f64, out: &mut [f64]) {
    let Some(first) = waves.first() else { return };
    let poles: Vec<Complex64> = first.ringing.free.iter().map(|(s, _)| *s).collect();
    let turns: Vec<Complex64> = poles.iter().map(|s| (s * step_s).exp()).collect();
    let mut free = vec![Complex64::ZERO; poles.len()];
    let periods = first.parts.len();
    let mut next = 0_usize;
    for (i, out) in out.iter_mut().enumerate() {
        let time_s = i as f64 * step_s;
        while next <= periods && next as f64 * period_s <= time_s {
            let since_s = time_s - next as f64 * period_s;
            let mut changes: Vec<(f64, &TransientResponse)> = Vec::new();
            for wave in waves.iter_mut() {
                let now = wave.parts.get(next).copied().unwrap_or(0.0);
                if now != wave.level {
                    changes.push((now - wave.level, wave.ringing));
                    wave.level = now;
                }
            }
            if !changes.is_empty() {
                for (k, (free, s)) in free.iter_mut().zip(&poles).enumerate() {
                    let sum: Complex64 = changes.iter().map(|(change, ringing)| ringing.free[k].1 * *change).sum();
                    *free += sum * (s * since_s).exp();
                }
            }
            next += 1;
        }
        let ringing: f64 = free.iter().map(|z| z.re).sum();
        *out += ringing + waves.iter().map(|wave| wave.level * wave.carrier.re).sum::<f64>();
        free.iter_mut().zip(&turns).for_each(|(z, turn)| *z *= turn);
        waves.iter_mut().for_each(|wave| wave.carrier *= wave.carrier_turn);
    }
}

/// A channel's motion per N under `levels`, by its fundamental `ringing` of any quantity, and the step in s: from the start
/// until `after_s` after the end.
#[must_use]
#[allow(
    clippy::cast_precision_loss,
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "counts of samples"
)]
pub fn sample_motion_under_level_of_each_period_and_get_step_s(
    ringing: &TransientResponse,
    levels: &[f64],
    period_s: f64,
    after_end_s: f64,
) -> (Vec<f64>, f64) {
    /// Times per period: between two of them a sine rises by 1 - cos(pi/16) = 2 % at most.
    const TIMES: f64 = 16.0;
    let count = ((levels.len() as f64 + after_end_s.max(0.0) / period_s) * TIMES).ceil() as usize + 1;
    let (mut out, step_s) = (vec![0.0; count], period_s / TIMES);
    add_waves_and_ringing_of_level_steps(
        &mut [HarmonicWave::new(ringing, levels.to_vec(), step_s)],
        period_s,
        step_s,
        &mut out,
    );
    (out, step_s)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::ChargingTimes;

    /// What levels make behind the resistors of the board's stage at 200 Hz, as a program in Python that marches the voltage has it.
    #[test]
    fn levels_make_less_force_behind_resistors() {
        let times = ChargingTimes { rise_s: 116e-6, hold_s: 0.0, fall_s: 11.6e-6 };
        let channel = |times| Channel {
            actuator: 0,
            frequency_hz: 200.0,
            pulse_width: 2.0 / 3.0,
            charging: PeriodicCharging::new(times, 200.0),
        };
        let (own, ideal) = (channel(times), channel(ChargingTimes::default()));
        for (level, expected) in [(1.0, 1.0), (0.75, 0.700), (0.5, 0.416), (0.25, 0.148), (0.1, 0.025), (0.0, 0.0)] {
            let found = own.force_fraction_of_level(level);
            assert!((found - expected).abs() < 1e-3, "{level}: {found}");
            assert_eq!(own.force_fraction_of_level(-level), -found);
            assert!((own.level_for_force_fraction(found) - level).abs() < 1e-6, "{level}");
            assert_eq!((ideal.force_fraction_of_level(level), ideal.level_for_force_fraction(level)), (level, level));
            let phasor = own.harmonic_phasor_relative_to_full_fundamental(1, level);
            assert!((phasor.norm() - found).abs() < 1e-12, "{level}: {phasor} {found}");
            // Narrower windows are later by some degrees.
            assert!(phasor.im.abs() < 0.02 && (level == 1.0 || level == 0.0 || phasor.im != 0.0), "{level}: {phasor}");
        }
        let third = own.harmonic_phasor_relative_to_full_fundamental(3, 1.0);
        assert!((third.re - 0.119).abs() < 5e-4 && third.im.abs() < 1e-12, "{third}");
    }
}
