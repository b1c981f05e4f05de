//! What a point does while drives play their envelopes, from the panel's poles: no equation is stepped in time.

use crate::physics::rise::{RiseTimes, TransientResponse};
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
    /// Part of its half period for which an electrode is on at full level.
    pub pulse_width: f64,
}

impl Channel {
    /// Length of a period in s.
    #[must_use]
    pub fn period_s(&self) -> f64 {
        1.0 / self.frequency_hz
    }

    /// The `harmonic`-th harmonic of its force, 1 N: windows lie in the middle of half periods, and the first is that of A,
    /// so that at a boundary the fundamental is a sine at zero.
    fn harmonic(&self, harmonic: u32) -> SwitchedForce {
        let n = f64::from(harmonic);
        SwitchedForce {
            actuator: self.actuator,
            frequency_hz: n * self.frequency_hz,
            force_n: 1.0,
            phase_rad: (-n * FRAC_PI_2).rem_euclid(TAU),
        }
    }

    /// Size of that harmonic at `level`, relative to the fundamental at full level: the board makes a level by a narrower
    /// window, sin(pi w'/2) = level sin(pi w/2), and 1/n sin(n pi w'/2) is what its harmonics have.
    fn part(&self, harmonic: u32, level: f64) -> f64 {
        let full = (FRAC_PI_2 * self.pulse_width).sin();
        let half = (level.abs().min(1.0) * full).asin();
        let n = f64::from(harmonic);
        level.signum() * (n * half).sin() / (n * full)
    }
}

/// A channel's force harmonics at one point.
#[derive(Clone, Debug)]
pub struct Response {
    channel: Channel,
    harmonics: Vec<(u32, TransientResponse)>,
}

impl Response {
    /// Acceleration where `shape` holds the mode shapes; `None` at an undamped resonance.
    #[must_use]
    pub fn new(rise: &RiseTimes, shape: &DVector<f64>, channel: Channel) -> Option<Self> {
        let orders: Vec<u32> =
            (1..).step_by(2).take_while(|n| *n == 1 || f64::from(*n) * channel.frequency_hz <= HIGHEST_HZ).collect();
        let drives: Vec<SwitchedForce> = orders.iter().map(|n| channel.harmonic(*n)).collect();
        let harmonics = orders.into_iter().zip(rise.ringings(shape, &drives)?).collect();
        Some(Self { channel, harmonics })
    }

    /// The fundamental alone.
    #[must_use]
    pub fn fundamental(&self) -> Option<&TransientResponse> {
        self.harmonics.first().map(|(_, ringing)| ringing)
    }

    /// The channel.
    #[must_use]
    pub fn channel(&self) -> Channel {
        self.channel
    }

    /// Acceleration in m/s^2 per N of the fundamental at full level, at times 0, `step_s`, ..., for `levels` period by
    /// period and none after them.
    #[must_use]
    pub fn samples(&self, levels: &[f64], step_s: f64, count: usize) -> Vec<f64> {
        let mut out = vec![0.0; count];
        let parts = |n: u32| levels.iter().map(|level| self.channel.part(n, *level)).collect();
        let mut waves: Vec<Wave<'_>> =
            self.harmonics.iter().map(|(n, ringing)| Wave::new(ringing, parts(*n), step_s)).collect();
        add_samples(&mut waves, self.channel.period_s(), step_s, &mut out);
        out
    }
}

/// A harmonic with its strength in every period.
struct Wave<'a> {
    ringing: &'a TransientResponse,
    parts: Vec<f64>,
    /// Strength now, and phasor of the steady motion at strength 1.
    level: f64,
    carrier: Complex64,
    carrier_turn: Complex64,
}

impl<'a> Wave<'a> {
    fn new(ringing: &'a TransientResponse, parts: Vec<f64>, step_s: f64) -> Self {
        let carrier_turn = Complex64::from_polar(1.0, ringing.omega_rad_s * step_s);
        Self { ringing, parts, level: 0.0, carrier: ringing.steady, carrier_turn }
    }
}

/// Adds the motion under steps of a channel's strength. A change by d at the boundary t_i, where the drive's phase is that
/// of its start, adds d c e^(s (t - t_i)) to the free motion, which all harmonics share.
#[expect(clippy::cast_precision_loss, reason = "sample numbers")]
fn add_samples(waves: &mut [Wave<'_>], period_s: f64, step_s: f64, out: &mut [f64]) {
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
pub fn samples_of(ringing: &TransientResponse, levels: &[f64], period_s: f64, after_s: f64) -> (Vec<f64>, f64) {
    /// Times per period: between two of them a sine rises by 1 - cos(pi/16) = 2 % at most.
    const TIMES: f64 = 16.0;
    let count = ((levels.len() as f64 + after_s.max(0.0) / period_s) * TIMES).ceil() as usize + 1;
    let (mut out, step_s) = (vec![0.0; count], period_s / TIMES);
    add_samples(&mut [Wave::new(ringing, levels.to_vec(), step_s)], period_s, step_s, &mut out);
    (out, step_s)
}
