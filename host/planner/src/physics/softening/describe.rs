//! The force of moving electrodes, as a describing function: phasors of a motion in, phasors of the force out.
//!
//! In parts of the gap, with u the motion that the windows know the phase of and v the rest, an electrode's force is
//! (1 - u - v)^-2 = sum of (n + 1) v^n / (1 - u)^(n + 2). Half a period on, electrode B sees the mirror image of what A
//! sees, so that integrals over A's windows, twice, are all there is. Electrodes behind resistors pull for longer than their windows, and with
//! the square of a voltage that rises and falls: it is a part of the weights, and both may pull at once.

use super::{Excitation, HARMONICS, Line, MAX_LINES};
use crate::model::shape::gauss_legendre_rule_on_unit_interval;
use crate::physics::charging::PeriodicCharging;
use crate::scene::ChargingTimes;
use era_model::kernel;
use num_complex::Complex64;
use pulp::Arch;
use std::f64::consts::{FRAC_PI_2, TAU};
use std::sync::LazyLock;

/// Points of the Gauss-Legendre rule over a window.
const NODES: usize = 12;
/// Most points: of electrodes behind resistors as many over the rise, the plateau and the fall of the voltage.
const MOST_NODES: usize = 3 * NODES;
/// Points that are summed up at once.
const LANES: usize = 4;
/// Its points, 0 to 1, and weights, that add up to 1; the later half comes first, the earlier one mirrors it.
static GAUSS: LazyLock<Vec<(f64, f64)>> = LazyLock::new(|| gauss_legendre_rule_on_unit_interval(NODES));

/// Place of a harmonic that may have a line, in arrays over [`HARMONICS`].
pub const fn array_index_of_first_third_or_fifth_harmonic(harmonic: u32) -> Option<usize> {
    match harmonic {
        1 => Some(0),
        3 => Some(1),
        5 => Some(2),
        _ => None,
    }
}

/// What a motion makes of a force of 1 N at rest; slopes per part of the gap. With [`ForceDescription::scale_force_and_slopes`], in N and N/m.
#[derive(Clone, Copy, Debug)]
pub struct ForceDescription {
    /// The force's phasors, line by line.
    pub force: [Complex64; MAX_LINES],
    /// Mean over time of the force's slope: what is taken off the spring.
    pub mean_slope: f64,
    /// Half the phasor of the slope's pulsation at twice each harmonic: what the conjugate of a phasor comes back with; 0
    /// beyond the last harmonic that has a line.
    pub pulsating_slope: [Complex64; HARMONICS],
}

impl ForceDescription {
    pub const NONE: Self =
        Self { force: [Complex64::ZERO; MAX_LINES], mean_slope: 0.0, pulsating_slope: [Complex64::ZERO; HARMONICS] };

    pub fn scale_force_and_slopes(&mut self, force: f64, slope: f64) {
        self.force.iter_mut().for_each(|phasor| *phasor *= force);
        self.mean_slope *= slope;
        self.pulsating_slope.iter_mut().for_each(|phasor| *phasor *= slope);
    }
}

/// A value at each point of the rule.
type AtNodes = [f64; MOST_NODES];

/// A window of electrode A as points of a quadrature.
#[derive(Clone, Copy, Debug)]
pub struct PulseWindows {
    /// Whether there are [`MOST_NODES`] points, not [`NODES`].
    has_most_nodes: bool,
    /// Weights of means over half a period, with the square of the voltage: they add up to the pulse width where electrodes charge at once.
    weights: AtNodes,
    /// Cosine and sine of n angle for harmonics n = 1, 3, 5, the angle from the window's middle.
    turns: [[AtNodes; 2]; HARMONICS],
    /// e^{j n phase} of the windows.
    phase: [Complex64; HARMONICS],
}

impl PulseWindows {
    pub const NONE: Self = Self {
        has_most_nodes: false,
        weights: [0.0; MOST_NODES],
        turns: [[[1.0; MOST_NODES], [0.0; MOST_NODES]]; HARMONICS],
        phase: [Complex64::ONE; HARMONICS],
    };

    pub fn new(excitation: &Excitation, times: ChargingTimes) -> Self {
        let mut windows = Self::NONE;
        windows.phase = unit_phasors_of_first_third_and_fifth_harmonic(excitation.phase_rad);
        let width = excitation.pulse_width.clamp(0.0, 1.0);
        if times.is_instant() || excitation.voltage_v == 0.0 || width == 0.0 {
            windows.fill_quadrature_points_of_rectangular_window(width);
        } else {
            windows.fill_quadrature_points_of_resistor_charged_window(excitation.frequency_hz, width, times);
        }
        windows
    }

    fn fill_quadrature_points_of_resistor_charged_window(
        &mut self,
        frequency_hz: f64,
        width: f64,
        times: ChargingTimes,
    ) {
        self.has_most_nodes = true;
        let course = PeriodicCharging::new(times, frequency_hz).voltage_course(width);
        let points = course
            .begin_and_length_of_rise_plateau_and_fall_s()
            .into_iter()
            .flat_map(|piece| GAUSS.iter().map(move |point| (piece, *point)));
        for (place, ((from_s, length_s), (node, weight))) in points.enumerate().take(MOST_NODES) {
            let at_s = from_s + node * length_s;
            self.weights[place] = 2.0 * frequency_hz * length_s * weight * course.fraction_at(at_s).powi(2);
            let turns =
                unit_phasors_of_first_third_and_fifth_harmonic(TAU * frequency_hz * (at_s - 0.5 * course.window_s()));
            for ([cos, sin], turn) in self.turns.iter_mut().zip(turns) {
                (cos[place], sin[place]) = (turn.re, turn.im);
            }
        }
    }

    fn fill_quadrature_points_of_rectangular_window(&mut self, width: f64) {
        for (i, (node, weight)) in GAUSS.iter().take(NODES / 2).enumerate() {
            let turns = unit_phasors_of_first_third_and_fifth_harmonic(FRAC_PI_2 * width * (2.0 * node - 1.0));
            for ([cos, sin], turn) in self.turns.iter_mut().zip(turns) {
                (cos[2 * i], sin[2 * i]) = (turn.re, turn.im);
                (cos[2 * i + 1], sin[2 * i + 1]) = (turn.re, -turn.im);
            }
            self.weights[2 * i] = width * weight;
            self.weights[2 * i + 1] = width * weight;
        }
    }

    /// The force of a motion with the phasors `travel` (in parts of the gap) on `lines`; those of the frequency `windows_frequency_index` are the
    /// windows' own.
    pub fn compute_force_phasors_and_slopes_of_moving_electrodes(
        &self,
        windows_frequency_index: usize,
        lines: &[Line],
        travel: impl Fn(usize) -> Complex64,
    ) -> ForceDescription {
        let mut own = [Complex64::ZERO; HARMONICS];
        let mut others = [0.0; MAX_LINES];
        // How many of the harmonics' sums are asked for: those up to the last with a line.
        let mut count = 0;
        for (l, line) in lines.iter().enumerate() {
            match array_index_of_first_third_or_fifth_harmonic(line.harmonic) {
                Some(h) if line.frequency == windows_frequency_index => {
                    own[h] = travel(l) * self.phase[h].conj();
                    count = count.max(h + 1);
                }
                _ => others[l] = travel(l).norm_sqr().sqrt(),
            }
        }
        let all = second_fourth_and_sixth_moment_of_sine_sum(&others, None);
        let sums = Arch::new().dispatch(Integrate(self, &own[..count], &all));
        let mut description = ForceDescription::NONE;
        description.mean_slope = sums.slope;
        for ((pulsating, slope_at), phase) in description.pulsating_slope.iter_mut().zip(sums.slope_at).zip(&self.phase)
        {
            *pulsating = slope_at * phase * phase;
        }
        for (l, line) in lines.iter().enumerate() {
            description.force[l] = match array_index_of_first_third_or_fifth_harmonic(line.harmonic) {
                // Twice the mean with the phase.
                Some(h) if line.frequency == windows_frequency_index => sums.force_at[h] * self.phase[h] * 2.0,
                _ if others[l] > 0.0 => {
                    let a = others[l];
                    travel(l) / a
                        * fundamental_amplitude_of_odd_polynomial(
                            &sums.odd,
                            a,
                            &second_fourth_and_sixth_moment_of_sine_sum(&others, Some(l)),
                        )
                }
                _ => Complex64::ZERO,
            };
        }
        description
    }
}

kernel!(Integrate<'a>(windows: &'a PulseWindows, own: &'a [Complex64], others: &'a [f64; 3]) -> Sums = integrate_force_and_slope_over_windows);

/// The sums for as many harmonics as `own_phasors` has.
#[inline(always)]
fn integrate_force_and_slope_over_windows(
    windows: &PulseWindows,
    own_phasors: &[Complex64],
    other_moments: &[f64; 3],
) -> Sums {
    // Two loops whose lengths the compiler knows.
    if windows.has_most_nodes {
        integrate_force_over_points::<MOST_NODES>(windows, own_phasors, other_moments)
    } else {
        integrate_force_over_points::<NODES>(windows, own_phasors, other_moments)
    }
}

/// The same over the first `COUNT` points.
#[inline(always)]
fn integrate_force_over_points<const COUNT: usize>(
    windows: &PulseWindows,
    own_phasors: &[Complex64],
    other_moments: &[f64; 3],
) -> Sums {
    let mut sums = Sums::default();
    let [second, fourth, sixth] = *other_moments;
    let mut u = [0.0; COUNT];
    for (phasor, [cos, sin]) in own_phasors.iter().zip(&windows.turns) {
        for n in 0..COUNT {
            u[n] += phasor.re * cos[n] - phasor.im * sin[n];
        }
    }
    let (mut force, mut slope) = ([0.0; COUNT], [0.0; COUNT]);
    let mut powers = [[0.0; COUNT]; 4];
    for n in 0..COUNT {
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
    sums.slope = sum_over_nodes::<COUNT>(|n| slope[n]);
    let at = sums.force_at.iter_mut().zip(&mut sums.slope_at);
    for ((force_at, slope_at), [cos, sin]) in at.zip(&windows.turns).take(own_phasors.len()) {
        *force_at = Complex64::new(
            sum_over_nodes::<COUNT>(|n| force[n] * cos[n]),
            -sum_over_nodes::<COUNT>(|n| force[n] * sin[n]),
        );
        let twice = |n: usize| cos[n] * cos[n] - sin[n] * sin[n];
        *slope_at = Complex64::new(
            sum_over_nodes::<COUNT>(|n| slope[n] * twice(n)),
            -2.0 * sum_over_nodes::<COUNT>(|n| slope[n] * (cos[n] * sin[n])),
        );
    }
    for ((odd, factor), powers) in sums.odd.iter_mut().zip([2.0, 4.0, 6.0, 8.0]).zip(&powers) {
        *odd = factor * sum_over_nodes::<COUNT>(|n| powers[n]);
    }
    sums
}

/// The sum over all points, several side by side.
#[inline(always)]
fn sum_over_nodes<const COUNT: usize>(of: impl Fn(usize) -> f64) -> f64 {
    let mut sums = [0.0; LANES];
    for from in (0..COUNT).step_by(LANES) {
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

fn unit_phasors_of_first_third_and_fifth_harmonic(angle: f64) -> [Complex64; HARMONICS] {
    let first = Complex64::cis(angle);
    let square = first * first;
    let third = first * square;
    [first, third, third * square]
}

/// Second, fourth and sixth moment of a sum of sines with independent phases, without the one at `excluded`.
fn second_fourth_and_sixth_moment_of_sine_sum(amplitudes: &[f64; MAX_LINES], excluded: Option<usize>) -> [f64; 3] {
    let mut all = [0.0; 3];
    for (l, a) in amplitudes.iter().enumerate() {
        if *a == 0.0 || Some(l) == excluded {
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

/// Phasor, along that of a sine of this amplitude, of the sum of odd_coefficients[k] v^(2k + 1) for v that sine and others with the
/// moments `other_moments`: twice the mean of v^n cos, by the binomial theorem.
fn fundamental_amplitude_of_odd_polynomial(
    odd_coefficients: &[f64; 4],
    amplitude: f64,
    other_moments: &[f64; 3],
) -> f64 {
    let [second, fourth, sixth] = *other_moments;
    let square = amplitude * amplitude;
    amplitude
        * (odd_coefficients[0]
            + odd_coefficients[1] * (0.75 * square + 3.0 * second)
            + odd_coefficients[2] * (square * (0.625 * square + 7.5 * second) + 5.0 * fourth)
            + odd_coefficients[3]
                * (square * (square * (0.546_875 * square + 13.125 * second) + 26.25 * fourth) + 7.0 * sixth))
}
