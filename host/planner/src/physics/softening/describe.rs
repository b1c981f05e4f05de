//! The force of moving electrodes, as a describing function: phasors of a motion in, phasors of the force out.
//!
//! In parts of the gap, with u the motion that the windows know the phase of and v the rest, an electrode's force is
//! (1 - u - v)^-2 = sum of (n + 1) v^n / (1 - u)^(n + 2). Half a period on, electrode B sees the mirror image of what A
//! sees, so that integrals over A's windows, twice, are all there is.

use super::{Excitation, HARMONICS, Line, MAX_LINES};
use crate::model::shape::gauss_legendre_rule;
use era_model::kernel;
use num_complex::Complex64;
use pulp::Arch;
use std::f64::consts::FRAC_PI_2;
use std::sync::LazyLock;

/// Points of the Gauss-Legendre rule over a window.
const NODES: usize = 12;
/// Points that are summed up at once.
const LANES: usize = 4;
/// Its points, 0 to 1, and weights, that add up to 1; the later half comes first, the earlier one mirrors it.
static GAUSS: LazyLock<Vec<(f64, f64)>> = LazyLock::new(|| gauss_legendre_rule(NODES));

/// Place of a harmonic that may have a line, in arrays over [`HARMONICS`].
pub const fn index_of(harmonic: u32) -> Option<usize> {
    match harmonic {
        1 => Some(0),
        3 => Some(1),
        5 => Some(2),
        _ => None,
    }
}

/// What a motion makes of a force of 1 N at rest; slopes per part of the gap. With [`Description::scale`], in N and N/m.
#[derive(Clone, Copy, Debug)]
pub struct Description {
    /// The force's phasors, line by line.
    pub force: [Complex64; MAX_LINES],
    /// Mean over time of the force's slope: what is taken off the spring.
    pub mean_slope: f64,
    /// Half the phasor of the slope's pulsation at twice each harmonic: what the conjugate of a phasor comes back with; 0
    /// beyond the last harmonic that has a line.
    pub pulsating_slope: [Complex64; HARMONICS],
}

impl Description {
    pub const NONE: Self =
        Self { force: [Complex64::ZERO; MAX_LINES], mean_slope: 0.0, pulsating_slope: [Complex64::ZERO; HARMONICS] };

    pub fn scale(&mut self, force: f64, slope: f64) {
        self.force.iter_mut().for_each(|phasor| *phasor *= force);
        self.mean_slope *= slope;
        self.pulsating_slope.iter_mut().for_each(|phasor| *phasor *= slope);
    }
}

/// A value at each point of the rule.
type AtNodes = [f64; NODES];

/// A window of electrode A as points of a quadrature.
#[derive(Clone, Copy, Debug)]
pub struct Windows {
    /// Weights of means over half a period: they add up to the pulse width.
    weights: AtNodes,
    /// Cosine and sine of n angle for harmonics n = 1, 3, 5, the angle from the window's middle.
    turns: [[AtNodes; 2]; HARMONICS],
    /// e^{j n phase} of the windows.
    phase: [Complex64; HARMONICS],
}

impl Windows {
    pub const NONE: Self = Self {
        weights: [0.0; NODES],
        turns: [[[1.0; NODES], [0.0; NODES]]; HARMONICS],
        phase: [Complex64::ONE; HARMONICS],
    };

    pub fn new(excitation: &Excitation) -> Self {
        let mut windows = Self::NONE;
        let width = excitation.pulse_width.clamp(0.0, 1.0);
        for (i, (node, weight)) in GAUSS.iter().take(NODES / 2).enumerate() {
            let turns = harmonics(FRAC_PI_2 * width * (2.0 * node - 1.0));
            for ([cos, sin], turn) in windows.turns.iter_mut().zip(turns) {
                (cos[2 * i], sin[2 * i]) = (turn.re, turn.im);
                (cos[2 * i + 1], sin[2 * i + 1]) = (turn.re, -turn.im);
            }
            windows.weights[2 * i] = width * weight;
            windows.weights[2 * i + 1] = width * weight;
        }
        windows.phase = harmonics(excitation.phase_rad);
        windows
    }

    /// The force of a motion with the phasors `travel` (in parts of the gap) on `lines`; those of `frequency` are the
    /// windows' own.
    pub fn describe(&self, frequency: usize, lines: &[Line], travel: impl Fn(usize) -> Complex64) -> Description {
        let mut own = [Complex64::ZERO; HARMONICS];
        let mut others = [0.0; MAX_LINES];
        // How many of the harmonics' sums are asked for: those up to the last with a line.
        let mut count = 0;
        for (l, line) in lines.iter().enumerate() {
            match index_of(line.harmonic) {
                Some(h) if line.frequency == frequency => {
                    own[h] = travel(l) * self.phase[h].conj();
                    count = count.max(h + 1);
                }
                _ => others[l] = travel(l).norm_sqr().sqrt(),
            }
        }
        let all = moments(&others, None);
        let sums = Arch::new().dispatch(Integrate(self, &own[..count], &all));
        let mut description = Description::NONE;
        description.mean_slope = sums.slope;
        for ((pulsating, slope_at), phase) in description.pulsating_slope.iter_mut().zip(sums.slope_at).zip(&self.phase)
        {
            *pulsating = slope_at * phase * phase;
        }
        for (l, line) in lines.iter().enumerate() {
            description.force[l] = match index_of(line.harmonic) {
                // Twice the mean with the phase.
                Some(h) if line.frequency == frequency => sums.force_at[h] * self.phase[h] * 2.0,
                _ if others[l] > 0.0 => {
                    let a = others[l];
                    travel(l) / a * correlation(&sums.odd, a, &moments(&others, Some(l)))
                }
                _ => Complex64::ZERO,
            };
        }
        description
    }
}

kernel!(Integrate<'a>(windows: &'a Windows, own: &'a [Complex64], others: &'a [f64; 3]) -> Sums = integrate);

/// The sums for as many harmonics as `own` has.
#[inline(always)]
fn integrate(windows: &Windows, own: &[Complex64], others: &[f64; 3]) -> Sums {
    let mut sums = Sums::default();
    let [second, fourth, sixth] = *others;
    let mut u = [0.0; NODES];
    for (own, [cos, sin]) in own.iter().zip(&windows.turns) {
        for n in 0..NODES {
            u[n] += own.re * cos[n] - own.im * sin[n];
        }
    }
    let (mut force, mut slope) = ([0.0; NODES], [0.0; NODES]);
    let mut powers = [[0.0; NODES]; 4];
    for n in 0..NODES {
        let r = 1.0 / (1.0 - u[n]);
        let (r2, r3) = (r * r, r * r * r);
        let weight = windows.weights[n];
        force[n] = weight * r2 * (1.0 + r2 * (3.0 * second + r2 * (5.0 * fourth + r2 * 7.0 * sixth)));
        slope[n] = weight * r3 * (2.0 + r2 * (12.0 * second + r2 * (30.0 * fourth + r2 * 56.0 * sixth)));
        let mut power = weight * r3;
        for powers in &mut powers {
            powers[n] = power;
            power *= r2;
        }
    }
    sums.slope = sum(|n| slope[n]);
    let at = sums.force_at.iter_mut().zip(&mut sums.slope_at);
    for ((force_at, slope_at), [cos, sin]) in at.zip(&windows.turns).take(own.len()) {
        *force_at = Complex64::new(sum(|n| force[n] * cos[n]), -sum(|n| force[n] * sin[n]));
        let twice = |n: usize| cos[n] * cos[n] - sin[n] * sin[n];
        *slope_at = Complex64::new(sum(|n| slope[n] * twice(n)), -2.0 * sum(|n| slope[n] * (cos[n] * sin[n])));
    }
    for ((odd, factor), powers) in sums.odd.iter_mut().zip([2.0, 4.0, 6.0, 8.0]).zip(&powers) {
        *odd = factor * sum(|n| powers[n]);
    }
    sums
}

/// The sum over all points, several side by side.
#[inline(always)]
fn sum(of: impl Fn(usize) -> f64) -> f64 {
    let mut sums = [0.0; LANES];
    for from in (0..NODES).step_by(LANES) {
        for (lane, sum) in sums.iter_mut().enumerate() {
            *sum += of(from + lane);
        }
    }
    (sums[0] + sums[1]) + (sums[2] + sums[3])
}

/// Means over a period.
#[derive(Clone, Copy, Default)]
struct Sums {
    /// Of the force times e^{-j n angle}.
    force_at: [Complex64; HARMONICS],
    /// Of the slope.
    slope: f64,
    /// Of the slope times e^{-2 j n angle}.
    slope_at: [Complex64; HARMONICS],
    /// Of the series' coefficients of v, v^3, v^5, v^7.
    odd: [f64; 4],
}

fn harmonics(angle: f64) -> [Complex64; HARMONICS] {
    let first = Complex64::cis(angle);
    let square = first * first;
    let third = first * square;
    [first, third, third * square]
}

/// Second, fourth and sixth moment of a sum of sines with independent phases, without the one at `but`.
fn moments(amplitudes: &[f64; MAX_LINES], but: Option<usize>) -> [f64; 3] {
    let mut all = [0.0; 3];
    for (l, a) in amplitudes.iter().enumerate() {
        if *a == 0.0 || Some(l) == but {
            continue;
        }
        // Of one sine: (1/2, 3/8, 5/16) times its powers; of a sum: the binomial theorem.
        let square = a * a;
        let (one, two, three) = (0.5 * square, 0.375 * square * square, 0.3125 * square * square * square);
        let [second, fourth, sixth] = all;
        all = [second + one, fourth + 6.0 * second * one + two, sixth + 15.0 * (fourth * one + second * two) + three];
    }
    all
}

/// Phasor, along that of a sine of amplitude `a`, of the sum of odd[k] v^(2k + 1) for v that sine and others with the
/// moments `rest`: twice the mean of v^n cos, by the binomial theorem.
fn correlation(odd: &[f64; 4], a: f64, rest: &[f64; 3]) -> f64 {
    let [second, fourth, sixth] = *rest;
    let square = a * a;
    a * (odd[0]
        + odd[1] * (0.75 * square + 3.0 * second)
        + odd[2] * (square * (0.625 * square + 7.5 * second) + 5.0 * fourth)
        + odd[3] * (square * (square * (0.546_875 * square + 13.125 * second) + 26.25 * fourth) + 7.0 * sixth))
}
