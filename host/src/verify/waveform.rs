//! The acceleration that a plan's drives make at a point, from the frequency domain alone: no equation is stepped in time.

use super::VerifyError;
use crate::device::sim::low_pass_response;
use crate::model::ReducedModel;
use crate::planner::Phasors;
use crate::planner::charging::PeriodicCharging;
use crate::planner::drive::SiDrive;
use crate::planner::softening::{Excitation, Line, Motion, Transducer, compute_travel_receptance, solve_steady_motion};
use crate::response::{self, CoordinateSolver};
use crate::scene::MAX_ACTUATORS;
use nalgebra::DVector;
use num_complex::Complex64;
use std::f64::consts::{FRAC_2_PI, FRAC_PI_2, PI, TAU};

/// Highest harmonic frequency that is counted, in Hz. The accelerometer's low-pass leaves 1/16 of what lies at twice its
/// corner, which a resonance can make up for, and 1/256 of what lies at four times.
const HIGHEST_HZ: f64 = 4000.0;
/// Highest harmonic that moves the masses far enough for the electrodes to notice.
pub const HIGHEST_LINE: u32 = 5;
/// Points of the quadrature over a window: of the 99th harmonic, 40 Hz to 4 kHz, 15 in a period. Of electrodes behind resistors as many over
/// each piece of their voltage's course.
const WINDOW_POINTS: u32 = 500;
/// Lowest sum or difference of frequencies that is counted, in Hz.
const LOWEST_HZ: f64 = 1.0;
/// Drives are of one frequency if they are nearer than this, in Hz.
const SAME_HZ: f64 = 1e-9;
/// Lines nearer than this, in Hz, are one to a record of 1 s: their phases go less than a fifth of a turn apart in it.
const TOGETHER_HZ: f64 = 0.2;
/// Half the main lobe of the window through which a record is looked at, and some: what is further from a drive's frequency
/// adds nothing to its amplitude.
const BESIDE_HZ: f64 = 8.0;

/// The acceleration at one point, as a sum of sines.
#[derive(Clone, Debug)]
pub struct Waveform {
    tones: Vec<Tone>,
    /// Frequencies in Hz and phasors in m/s^2, through the low-pass, at sums and differences of the drives' frequencies.
    combinations: Vec<(f64, Complex64)>,
    /// Modal coordinates of the steady motion at time zero.
    pub displacement: DVector<f64>,
    /// Their rates.
    pub velocity: DVector<f64>,
    /// The actuators' steady motion.
    pub motion: Motion,
}

/// One frequency's part.
#[derive(Clone, Debug)]
struct Tone {
    frequency_hz: f64,
    /// Amplitude of the acceleration at this frequency in m/s^2, without any low-pass.
    fundamental: f64,
    /// Through the low-pass: the sum over k of the real part of `phasors[k]` e^{j (2k + 1) w t}, in m/s^2.
    phasors: Vec<Complex64>,
}

/// What moves under some drives, at their frequencies and odd harmonics.
struct SteadyMotion {
    frequencies_hz: Vec<f64>,
    excitations: Vec<Excitation>,
    /// Number of the frequency, harmonic, modal coordinates per force, forces.
    parts: Vec<(usize, u32, Vec<DVector<Complex64>>, Phasors)>,
    lines: Vec<Line>,
    motion: Motion,
}

impl SteadyMotion {
    /// Harmonics up to `highest`, and no further than [`HIGHEST_HZ`].
    fn new(
        solver: &CoordinateSolver<'_>,
        model: &ReducedModel,
        actuators: &[Transducer],
        drives: &[SiDrive],
        highest: u32,
    ) -> Result<Self, VerifyError> {
        let mut frequencies_hz: Vec<f64> = Vec::new();
        let mut excitations =
            vec![
                Excitation { frequency: 0, frequency_hz: 0.0, voltage_v: 0.0, pulse_width: 0.0, phase_rad: 0.0 };
                actuators.len()
            ];
        for drive in drives {
            let Some(excitation) = excitations.get_mut(usize::from(drive.channel)) else { continue };
            let known = frequencies_hz.iter().position(|known| (known - drive.frequency_hz).abs() < SAME_HZ);
            let frequency = known.unwrap_or_else(|| {
                frequencies_hz.push(drive.frequency_hz);
                frequencies_hz.len() - 1
            });
            let SiDrive { frequency_hz, voltage_v, pulse_width, phase_rad, .. } = *drive;
            *excitation = Excitation { frequency, frequency_hz, voltage_v, pulse_width, phase_rad };
        }
        let (mut parts, mut lines) = (Vec::new(), Vec::new());
        for (frequency, base_hz) in frequencies_hz.iter().enumerate() {
            let counts = |n: &u32| *n == 1 || *n <= highest && f64::from(*n) * base_hz <= HIGHEST_HZ;
            for harmonic in (1..).step_by(2).take_while(counts) {
                let coordinates = solver.solve_coordinates_per_newton_at(f64::from(harmonic) * base_hz)?;
                if harmonic <= HIGHEST_LINE {
                    let receptance = compute_travel_receptance(model, &coordinates);
                    lines.push(Line { frequency, harmonic, receptance });
                }
                parts.push((frequency, harmonic, coordinates, [Complex64::ZERO; MAX_ACTUATORS]));
            }
        }
        let motion = solve_steady_motion(actuators, &excitations, &lines)?;
        for (frequency, harmonic, _, forces) in &mut parts {
            let line = lines.iter().position(|line| line.frequency == *frequency && line.harmonic == *harmonic);
            *forces = match line.and_then(|line| motion.force_n.get(line)) {
                Some(forces) => *forces,
                None => forces_of_high_harmonic(actuators, &excitations, &lines, &motion, *frequency, *harmonic),
            };
        }
        Ok(Self { frequencies_hz, excitations, parts, lines, motion })
    }

    /// Forces at sums and differences of frequencies, in Hz and N: the spring of an actuator that is driven at f pulsates at
    /// 2 f, and what moves it at f' is felt at 2 f + f' and 2 f - f' too. Of first order, for the fundamentals of the others.
    fn list_forces_at_sums_and_differences(&self) -> Vec<(f64, usize, Complex64)> {
        let mut all = Vec::new();
        for (l, line) in self.lines.iter().enumerate().filter(|(_, line)| line.harmonic == 1) {
            for (i, excitation) in self.excitations.iter().enumerate() {
                let (Some(own_hz), Some(other_hz)) =
                    (self.frequencies_hz.get(excitation.frequency), self.frequencies_hz.get(line.frequency))
                else {
                    continue;
                };
                if excitation.frequency == line.frequency || excitation.voltage_v == 0.0 {
                    continue;
                }
                let (slope, travel) = (self.motion.pulsating_n_per_m[i], self.motion.travel_m[l][i]);
                let (below_hz, below) = (2.0 * own_hz - other_hz, slope * travel.conj());
                all.push((2.0 * own_hz + other_hz, i, slope * travel));
                all.push((below_hz.abs(), i, if below_hz < 0.0 { below.conj() } else { below }));
            }
        }
        all.retain(|(hz, ..)| *hz > LOWEST_HZ && *hz <= HIGHEST_HZ);
        all
    }
}

/// Equation 23 in m/s^2 at the point with the mode shapes `shape`, of the steady motion under `drives` with the electrodes'
/// softening, the motion of harmonics up to the number `highest` (1 to [`HIGHEST_LINE`]) included.
///
/// # Errors
/// As [`Waveform::new`].
pub fn compute_sum_of_fundamentals_m_per_s2(
    model: &ReducedModel,
    actuators: &[Transducer],
    shape: &DVector<f64>,
    drives: &[SiDrive],
    highest: u32,
) -> Result<f64, VerifyError> {
    let steady = SteadyMotion::new(&CoordinateSolver::new(model), model, actuators, drives, highest)?;
    let mut sum = 0.0;
    for (frequency, _, coordinates, forces) in steady.parts.iter().filter(|(_, harmonic, ..)| *harmonic == 1) {
        let omega = TAU * steady.frequencies_hz.get(*frequency).copied().unwrap_or_default();
        let phasor: Complex64 = coordinates
            .iter()
            .zip(forces)
            .map(|(q, force)| response::multiply_shape_with_coordinates(shape, q) * force)
            .sum();
        sum += omega * omega * phasor.norm();
    }
    Ok(sum)
}

impl Waveform {
    /// The steady motion under `drives` (as achieved by the board's registers), which started together at time zero, each
    /// at its own phase. `shape` holds the mode shapes at the point, `actuators` those of every channel. Softening by the
    /// electrodes is in all of its forces.
    ///
    /// # Errors
    /// [`VerifyError::Response`] at a harmonic that meets the resonance of an undamped mode, [`VerifyError::NotSafe`] if
    /// there is no steady motion.
    pub fn new(
        model: &ReducedModel,
        actuators: &[Transducer],
        shape: &DVector<f64>,
        drives: &[SiDrive],
    ) -> Result<Self, VerifyError> {
        let solver = CoordinateSolver::new(model);
        let steady = SteadyMotion::new(&solver, model, actuators, drives, u32::MAX)?;
        let mut tones: Vec<Tone> = steady
            .frequencies_hz
            .iter()
            .map(|frequency_hz| Tone { frequency_hz: *frequency_hz, fundamental: 0.0, phasors: Vec::new() })
            .collect();
        let (mut displacement, mut velocity) =
            (DVector::zeros(model.count_coordinates()), DVector::zeros(model.count_coordinates()));
        let mut move_by = |hz: f64, q: &DVector<Complex64>, force: Complex64| -> Complex64 {
            let omega = TAU * hz;
            displacement += q.map(|q| (q * force).re);
            velocity += q.map(|q| (Complex64::I * omega * q * force).re);
            response::multiply_shape_with_coordinates(shape, q) * -omega * omega * force
        };
        for (frequency, harmonic, coordinates, forces) in &steady.parts {
            let Some(tone) = tones.get_mut(*frequency) else { continue };
            let hz = f64::from(*harmonic) * tone.frequency_hz;
            let sum: Complex64 = coordinates.iter().zip(forces).map(|(q, force)| move_by(hz, q, *force)).sum();
            if *harmonic == 1 {
                tone.fundamental = sum.norm();
            }
            tone.phasors.push(sum * low_pass_response(hz));
        }
        let mut combinations = Vec::new();
        for (hz, actuator, force) in steady.list_forces_at_sums_and_differences() {
            if let Some(q) = solver.solve_coordinates_per_newton_at(hz)?.get(actuator) {
                combinations.push((hz, move_by(hz, q, force) * low_pass_response(hz)));
            }
        }
        Ok(Self { tones, combinations, displacement, velocity, motion: steady.motion })
    }

    /// The drives' distinct frequencies in Hz.
    #[must_use]
    pub fn frequencies_hz(&self) -> Vec<f64> {
        self.tones.iter().map(|tone| tone.frequency_hz).collect()
    }

    /// Sum of the amplitudes at the drives' frequencies (equation 23) in m/s^2.
    #[must_use]
    pub fn sum_of_fundamentals_m_per_s2(&self) -> f64 {
        self.tones.iter().map(|tone| tone.fundamental).sum()
    }

    /// What harmonics, and sums and differences of frequencies, have at the drives' own frequencies: the sum of the
    /// amplitudes in m/s^2, without any low-pass, of those that a record of 1 s cannot tell from a drive's, and the
    /// frequencies in Hz of those that are beside one.
    #[must_use]
    pub fn coinciding_amplitude_and_neighbour_frequencies_hz(&self) -> (f64, Vec<f64>) {
        let harmonics = self.tones.iter().flat_map(|tone| {
            let numbers = (3_u32..).step_by(2).map(f64::from);
            numbers.zip(tone.phasors.iter().skip(1)).map(|(n, phasor)| (n * tone.frequency_hz, phasor))
        });
        let all = harmonics.chain(self.combinations.iter().map(|(hz, phasor)| (*hz, phasor)));
        let (mut together, mut beside) = (0.0, Vec::<f64>::new());
        for (hz, phasor) in all {
            let from_a_drive = |tone: &Tone| (hz - tone.frequency_hz).abs();
            let nearest_hz = self.tones.iter().map(from_a_drive).fold(f64::INFINITY, f64::min);
            if nearest_hz < TOGETHER_HZ {
                together += phasor.norm() / low_pass_response(hz).norm();
            } else if nearest_hz < BESIDE_HZ && beside.iter().all(|other| (other - hz).abs() >= TOGETHER_HZ) {
                beside.push(hz);
            }
        }
        (together, beside)
    }

    /// Acceleration in m/s^2 through the accelerometer's low-pass, `time_s` after the drives' start.
    #[must_use]
    pub fn acceleration_at_m_per_s2(&self, time_s: f64) -> f64 {
        let tones: f64 = self.tones.iter().map(|tone| tone.acceleration_at_m_per_s2(time_s)).sum();
        let turn = |hz: f64| Complex64::cis(TAU * (hz * time_s).fract());
        tones + self.combinations.iter().map(|(hz, phasor)| (phasor * turn(*hz)).re).sum::<f64>()
    }

    /// Largest magnitude in m/s^2 over `samples` times, `step_s` apart from `from_s` on. Harmonics of different drives
    /// that coincide (the third of 60 Hz and the first of 180 Hz) add as phasors, and a beat that takes longer than the
    /// window is seen in it only as far as the window goes, as in a measurement.
    #[must_use]
    #[expect(clippy::cast_precision_loss, reason = "sample numbers")]
    pub fn peak_m_per_s2(&self, from_s: f64, step_s: f64, samples: usize) -> f64 {
        (0..samples).map(|i| self.acceleration_at_m_per_s2(from_s + i as f64 * step_s).abs()).fold(0.0, f64::max)
    }
}

impl Tone {
    /// Horner's scheme in e^{2 j angle}: one sine and cosine for all harmonics.
    fn acceleration_at_m_per_s2(&self, time_s: f64) -> f64 {
        let first = Complex64::cis(TAU * (self.frequency_hz * time_s).fract());
        let square = first * first;
        let sum = self.phasors.iter().rev().fold(Complex64::ZERO, |sum, phasor| sum * square + phasor);
        (sum * first).re
    }
}

/// Forces of a harmonic beyond the lines: that of an actuator's own windows around its own motion, by the midpoint rule.
fn forces_of_high_harmonic(
    actuators: &[Transducer],
    excitations: &[Excitation],
    lines: &[Line],
    motion: &Motion,
    frequency: usize,
    harmonic: u32,
) -> Phasors {
    let n = f64::from(harmonic);
    let mut forces = [Complex64::ZERO; MAX_ACTUATORS];
    for (i, (actuator, excitation)) in actuators.iter().zip(excitations).enumerate() {
        if excitation.frequency != frequency {
            continue;
        }
        let newtons = actuator.newtons_per_volt_squared * excitation.voltage_v * excitation.voltage_v;
        let mut add_pull = |angle: f64, step: f64, square: f64| {
            let own = lines.iter().zip(&motion.travel_m).filter(|(line, _)| line.frequency == frequency);
            let travel_m: f64 = own
                .map(|(line, travel)| {
                    (travel[i] * Complex64::cis(f64::from(line.harmonic) * (angle - excitation.phase_rad))).re
                })
                .sum();
            let left = 1.0 - travel_m / actuator.gap_m;
            forces[i] += Complex64::cis(-n * (angle - excitation.phase_rad))
                * (square * newtons / (left * left) * FRAC_2_PI * step);
        };
        let middles = (0..WINDOW_POINTS).map(|k| f64::from(k) + 0.5);
        if actuator.charging.is_instant() || excitation.voltage_v == 0.0 {
            let step = PI * excitation.pulse_width / f64::from(WINDOW_POINTS);
            middles.for_each(|at| add_pull(at * step - FRAC_PI_2 * excitation.pulse_width, step, 1.0));
            continue;
        }
        let course =
            PeriodicCharging::new(actuator.charging, excitation.frequency_hz).voltage_course(excitation.pulse_width);
        let per_s = TAU * excitation.frequency_hz;
        for (from_s, length_s) in course.begin_and_length_of_rise_plateau_and_fall_s() {
            let step_s = length_s / f64::from(WINDOW_POINTS);
            for at in middles.clone() {
                let at_s = from_s + at * step_s;
                let angle = per_s * (at_s - 0.5 * course.window_s());
                add_pull(angle, per_s * step_s, course.fraction_at(at_s).powi(2));
            }
        }
    }
    forces
}

#[cfg(test)]
mod tests {
    use super::*;

    fn of(tones: Vec<Tone>) -> Waveform {
        let motion = solve_steady_motion(&[], &[], &[]).expect("nothing moves");
        Waveform {
            tones,
            combinations: Vec::new(),
            displacement: DVector::zeros(0),
            velocity: DVector::zeros(0),
            motion,
        }
    }

    fn tone(frequency_hz: f64, phase_rad: f64, phasors: &[f64]) -> Tone {
        let phasors = (1_i32..).step_by(2).zip(phasors);
        let phasors = phasors.map(|(n, a)| Complex64::from_polar(*a, f64::from(n) * phase_rad)).collect();
        Tone { frequency_hz, fundamental: 0.0, phasors }
    }

    #[test]
    fn coinciding_harmonics_add_as_phasors() {
        // The third harmonic of 60 Hz against the first of 180 Hz, which starts half a turn later: nothing is left of it.
        let waveform = of(vec![tone(60.0, 0.0, &[1.0, 0.5]), tone(180.0, PI, &[0.5])]);
        assert!((waveform.peak_m_per_s2(0.0, 25e-6, 40_000) - 1.0).abs() < 1e-12);
        let alone = of(vec![tone(60.0, 0.0, &[1.0, 0.5])]);
        assert!((alone.peak_m_per_s2(0.0, 25e-6, 40_000) - 1.5).abs() < 1e-12);
    }

    #[test]
    fn a_long_beat_is_seen_as_far_as_the_window_goes() {
        // A beat of 0.1 Hz that starts in opposition: nothing at first, twice the amplitude after 5 s.
        let waveform = of(vec![tone(200.0, 0.0, &[1.0]), tone(200.1, PI, &[1.0])]);
        let early = waveform.peak_m_per_s2(0.0, 25e-6, 4_000);
        assert!(early < 2.0 * (PI * 0.1 * 0.1).sin() + 1e-9, "{early}");
        assert!(waveform.peak_m_per_s2(4.95, 25e-6, 4_000) > 1.999);
    }
}
