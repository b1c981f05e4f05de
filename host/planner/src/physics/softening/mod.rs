//! The steady motion of actuators whose force depends on where their masses are.
//!
//! An electrode pulls with eps0 S V^2 / (2 (g - x)^2), x the travel towards it. The planner's forces are those at x = 0;
//! this is what becomes of them as the masses move: the electrodes soften the springs (by as much as the mean square of
//! the voltage says), the softening pulsates at twice the frequency of the windows, which turns a motion at the drive's own
//! frequency against its force's phase, and what is odd in x beyond that makes it all grow with the amplitude.
//!
//! The motion is sought as a sum of sines, one per [`Line`]. Of an actuator's own lines, whose phase to its windows is
//! known, the force is integrated over the windows as it is (Gauss-Legendre, with the square of
//! the voltage where electrodes charge through resistors); sines at the frequencies of other actuators
//! have no fixed phase to them and enter by their moments, up to the seventh order. That is a describing function of
//! several inputs (Gelb and Vander Velde, Multiple-Input Describing Functions, 1968), solved by Newton's method. What is
//! left out: motion at sums and differences of frequencies (2 f1 - f2), and a phase between lines of different actuators
//! that happen to coincide.

mod describe;
mod ramp;
#[cfg(test)]
mod tests;

use crate::model::ReducedModel;
use crate::physics::limits::{Electrodes, Limit};
use crate::physics::{PerPair, Phasors};
use crate::scene::{Actuator, ChargingTimes, MAX_ACTUATORS};
use describe::{ForceDescription, PulseWindows};
use nalgebra::{DVector, SMatrix, SVector};
use num_complex::Complex64;
pub use ramp::{NearPole, TimeResponse, find_largest_travel_while_rails_rise_m};

/// Of a line's forces: real and imaginary part for each actuator.
const UNKNOWNS: usize = 2 * MAX_ACTUATORS;
/// Harmonics of a drive that may have a line: the first, third and fifth.
pub const HARMONICS: usize = 3;
/// Most lines: every actuator at its own frequency, with all harmonics.
pub const MAX_LINES: usize = HARMONICS * MAX_ACTUATORS;
/// Part of the gap up to which a motion is followed. The series in the motion of others has 1 % left of it there, and the
/// limit of a third ([`Electrodes::first_violated_limit_if_any`]) lies far within.
const FOLLOWED: f64 = 0.5;
/// Change of the forces, relative to the largest, that counts as none.
const CONVERGED: f64 = 1e-6;
/// The same on the way to it.
const ON_THE_WAY: f64 = 1e-2;
/// Most steps of Newton's method; four or five are usual.
const MOST_STEPS: usize = 12;
/// Part of the gap beyond which the motion is followed from no voltage on, so that of several motions that are possible
/// (a softening spring bends its resonance over) the one is found that a soft start leads to.
const FROM_REST: f64 = 0.2;
/// Steps in V^2 on that way.
const RAMP: u32 = 8;

/// An ERA's electrodes as what makes a force.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Transducer {
    /// Force of 1 V on one electrode with the mass at rest, in N/V^2: eps0 S / (2 g^2).
    pub newtons_per_volt_squared: f64,
    /// Air gap on each side in m; infinite for a force that does not depend on the travel.
    pub gap_m: f64,
    /// Softening that the model's springs already have (the scene's `bias_voltage_v`), in N/m: it is added back, so that
    /// it is not counted twice.
    pub counted_n_per_m: f64,
    /// How its electrodes charge and discharge.
    pub charging: ChargingTimes,
}

impl Transducer {
    /// Of an actuator of a scene.
    #[must_use]
    pub fn from_actuator(actuator: &Actuator) -> Self {
        Self {
            newtons_per_volt_squared: Electrodes::from_actuator(actuator).force_at_rest_n_per_v2(),
            gap_m: actuator.air_gap_m,
            counted_n_per_m: actuator.softening_n_per_m(),
            charging: actuator.charging,
        }
    }

    /// A force of `newtons_per_volt_squared` that does not depend on the travel.
    #[must_use]
    pub const fn with_fixed_force(newtons_per_volt_squared: f64) -> Self {
        let charging = ChargingTimes { rise_s: 0.0, hold_s: 0.0, fall_s: 0.0 };
        Self { newtons_per_volt_squared, gap_m: f64::INFINITY, counted_n_per_m: 0.0, charging }
    }
}

/// How an actuator is driven.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Excitation {
    /// Number of its frequency. Actuators with the same number have a common one, with a phase that counts.
    pub frequency: usize,
    /// That frequency in Hz.
    pub frequency_hz: f64,
    /// Voltage in V.
    pub voltage_v: f64,
    /// Part of its half period for which an electrode is on, 0 to 1.
    pub pulse_width: f64,
    /// Phase of the windows in rad: a window of electrode A has its middle at w t + phase = 0.
    pub phase_rad: f64,
}

/// A frequency at which there is motion.
#[derive(Clone, Copy, Debug)]
pub struct Line {
    /// Number of the drives' frequency, as in [`Excitation::frequency`].
    pub frequency: usize,
    /// Multiple of it: 1, 3 or 5.
    pub harmonic: u32,
    /// Travel per force in m/N, of the model (softened by what is `counted` only).
    pub receptance: PerPair,
}

/// The steady motion.
#[derive(Clone, Copy, Debug)]
pub struct Motion {
    /// Phasors of the whole force on each actuator in N, line by line: what a linear model has to be driven with.
    pub force_n: [Phasors; MAX_LINES],
    /// Phasors of each actuator's travel in m, line by line.
    pub travel_m: [Phasors; MAX_LINES],
    /// Half the phasor, at twice an actuator's frequency, of what its electrodes take off its spring, in N/m: motion X at
    /// another frequency makes forces of this times X at 2 f + f', and times the conjugate of X at 2 f - f'. These are not
    /// among the lines.
    pub pulsating_n_per_m: Phasors,
    /// Mean over time of what each actuator's electrodes take off its spring, in N/m, beyond what is `counted`.
    pub softening_n_per_m: [f64; MAX_ACTUATORS],
    /// Most that each actuator's mass can be away from its middle, in m: the sum of the moduli.
    pub largest_m: [f64; MAX_ACTUATORS],
}

/// Why there is no steady motion to tell.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum MotionError {
    /// It would go further than half the gap.
    #[error("the mass of actuator {actuator} (counted from 0) would move by more than {FOLLOWED} times its air gap")]
    Travel {
        /// Which, counted from 0.
        actuator: usize,
    },
    /// The electrodes take more off a spring, or feed more into a resonance, than there is: any motion grows.
    #[error("the pull of the electrodes reduces the stiffness of the springs so far that a resonance becomes unstable")]
    Unstable,
    /// Not the numbers of actuators, drives and lines that belong together.
    #[error(
        "{actuators} actuators, {excitations} drives and {lines} frequencies of motion were given, but there must be \
         one drive per actuator, at most {MAX_ACTUATORS} actuators and at most {MAX_LINES} frequencies of motion; \
         each frequency of motion must be harmonic 1, 3 or 5 of a drive, and harmonic 1 of every drive with a voltage \
         must be among them"
    )]
    Shape {
        /// As given.
        actuators: usize,
        /// As given.
        excitations: usize,
        /// As given.
        lines: usize,
    },
}

impl Motion {
    /// None at all.
    pub const REST: Self = Self {
        force_n: [[Complex64::ZERO; MAX_ACTUATORS]; MAX_LINES],
        travel_m: [[Complex64::ZERO; MAX_ACTUATORS]; MAX_LINES],
        pulsating_n_per_m: [Complex64::ZERO; MAX_ACTUATORS],
        softening_n_per_m: [0.0; MAX_ACTUATORS],
        largest_m: [0.0; MAX_ACTUATORS],
    };

    /// The same motion with forces and travels times `factor`, a first guess of what another voltage makes of it.
    fn with_forces_and_travels_scaled_by(&self, factor: f64) -> Self {
        let scaled = |vectors: &[Phasors; MAX_LINES]| vectors.map(|vector| vector.map(|z| z * factor));
        Self { force_n: scaled(&self.force_n), travel_m: scaled(&self.travel_m), ..*self }
    }
}

/// The steady motion of `actuators` under `excitations` (one each) on `lines`.
///
/// # Errors
/// [`MotionError`].
pub fn solve_steady_motion(
    actuators: &[Transducer],
    excitations: &[Excitation],
    lines: &[Line],
) -> Result<Motion, MotionError> {
    let problem = ClosingGaps::new(actuators, excitations, lines)?;
    let mut motion = Motion::REST;
    let at_once = problem.solve_by_newton(&mut motion, 1.0, CONVERGED);
    let small = |(actuator, largest): (&Transducer, &f64)| *largest <= FROM_REST * actuator.gap_m;
    if at_once.is_ok() && actuators.iter().zip(&motion.largest_m).all(small) {
        return Ok(motion);
    }
    motion = Motion::REST;
    for step in 1..RAMP {
        problem.solve_by_newton(&mut motion, f64::from(step) / f64::from(RAMP), ON_THE_WAY)?;
    }
    problem.solve_by_newton(&mut motion, 1.0, CONVERGED)?;
    Ok(motion)
}

/// The same for voltages whose squares are `voltage_square_ratio` times those of the motion `known`: it is followed from there, as a slow
/// start would, if the step is as small as those that [`solve_steady_motion`] takes.
///
/// # Errors
/// [`MotionError`].
pub fn solve_steady_motion_starting_from_scaled_known_motion(
    actuators: &[Transducer],
    excitations: &[Excitation],
    lines: &[Line],
    known: &Motion,
    voltage_square_ratio: f64,
) -> Result<Motion, MotionError> {
    let problem = ClosingGaps::new(actuators, excitations, lines)?;
    let mut motion = known.with_forces_and_travels_scaled_by(voltage_square_ratio);
    problem.solve_by_newton(&mut motion, 1.0, CONVERGED)?;
    Ok(motion)
}

struct ClosingGaps<'a> {
    actuators: &'a [Transducer],
    excitations: &'a [Excitation],
    lines: &'a [Line],
    windows: [PulseWindows; MAX_ACTUATORS],
}

impl<'a> ClosingGaps<'a> {
    fn new(actuators: &'a [Transducer], excitations: &'a [Excitation], lines: &'a [Line]) -> Result<Self, MotionError> {
        let complete = excitations.iter().all(|excitation| {
            let own = |line: &Line| line.frequency == excitation.frequency && line.harmonic == 1;
            excitation.voltage_v == 0.0 || lines.iter().any(own)
        });
        let odd =
            lines.iter().all(|line| describe::array_index_of_first_third_or_fifth_harmonic(line.harmonic).is_some());
        if !complete
            || !odd
            || actuators.len() > MAX_ACTUATORS
            || actuators.len() != excitations.len()
            || lines.len() > MAX_LINES
        {
            let (actuators, excitations, lines) = (actuators.len(), excitations.len(), lines.len());
            return Err(MotionError::Shape { actuators, excitations, lines });
        }
        let mut windows = [PulseWindows::NONE; MAX_ACTUATORS];
        for ((windows, excitation), actuator) in windows.iter_mut().zip(excitations).zip(actuators) {
            *windows = PulseWindows::new(excitation, actuator.charging);
        }
        Ok(Self { actuators, excitations, lines, windows })
    }

    /// Improves `motion` until it is steady, to `tolerance`, under `voltage_square_fraction` of the voltages' squares.
    fn solve_by_newton(
        &self,
        motion: &mut Motion,
        voltage_square_fraction: f64,
        tolerance: f64,
    ) -> Result<(), MotionError> {
        for _ in 0..MOST_STEPS {
            let mut descriptions = [ForceDescription::NONE; MAX_ACTUATORS];
            for (i, description) in descriptions.iter_mut().enumerate().take(self.actuators.len()) {
                *description = self
                    .compute_force_and_slopes_on_actuator_unless_travel_too_far(i, motion, voltage_square_fraction)
                    .ok_or(MotionError::Travel { actuator: i })?;
            }
            let (mut change, mut largest) = (0.0_f64, 0.0_f64);
            for (l, line) in self.lines.iter().enumerate() {
                let step = self.solve_newton_change_of_forces_on_line_if_stable_n(l, line, &descriptions, motion)?;
                for (force, step) in motion.force_n[l].iter_mut().zip(&step) {
                    *force += step;
                    change = change.max(step.norm_sqr());
                    largest = largest.max(force.norm_sqr());
                }
                motion.travel_m[l] =
                    multiply_matrix_by_vector(&line.receptance, &motion.force_n[l], self.actuators.len());
            }
            if change <= tolerance * tolerance * largest {
                motion.pulsating_n_per_m = descriptions.map(|description| description.pulsating_slope[0]);
                motion.softening_n_per_m = descriptions.map(|description| description.mean_slope);
                for (i, largest) in motion.largest_m.iter_mut().enumerate() {
                    *largest =
                        motion.travel_m.iter().take(self.lines.len()).map(|travel| travel[i].norm_sqr().sqrt()).sum();
                }
                return Ok(());
            }
        }
        Err(MotionError::Unstable)
    }

    /// The force that the motion makes on actuator `actuator`, and how it changes with the motion; `None` beyond [`FOLLOWED`].
    fn compute_force_and_slopes_on_actuator_unless_travel_too_far(
        &self,
        actuator: usize,
        motion: &Motion,
        voltage_square_fraction: f64,
    ) -> Option<ForceDescription> {
        let (transducer, excitation) = (&self.actuators[actuator], &self.excitations[actuator]);
        let per_gap = 1.0 / transducer.gap_m;
        let travel = |l: usize| motion.travel_m[l][actuator] * per_gap;
        if (0..self.lines.len()).map(|l| travel(l).norm_sqr().sqrt()).sum::<f64>() > FOLLOWED {
            return None;
        }
        let newtons =
            voltage_square_fraction * transducer.newtons_per_volt_squared * excitation.voltage_v * excitation.voltage_v;
        let mut description = self.windows[actuator].compute_force_phasors_and_slopes_of_moving_electrodes(
            excitation.frequency,
            self.lines,
            travel,
        );
        description.scale_force_and_slopes(newtons, newtons * per_gap);
        for l in 0..self.lines.len() {
            description.force[l] -= motion.travel_m[l][actuator] * transducer.counted_n_per_m;
        }
        description.mean_slope -= transducer.counted_n_per_m;
        Some(description)
    }

    /// Newton's step of the forces on a line: with X = G F, (1 - D G) dF = D(X) - F, where D dX has a part in the conjugate
    /// of dX for the actuators whose own line it is. Lines are taken one by one: what couples them is small.
    fn solve_newton_change_of_forces_on_line_if_stable_n(
        &self,
        line_index: usize,
        line: &Line,
        descriptions: &[ForceDescription; MAX_ACTUATORS],
        motion: &Motion,
    ) -> Result<Phasors, MotionError> {
        let p = self.actuators.len();
        // Real and imaginary part for each actuator; those that there are not stay 1 x = 0.
        let mut matrix = SMatrix::<f64, UNKNOWNS, UNKNOWNS>::identity();
        let mut right = SVector::<f64, UNKNOWNS>::zeros();
        for (i, (description, excitation)) in descriptions.iter().zip(self.excitations).enumerate() {
            let own = line.frequency == excitation.frequency;
            let direct = description.mean_slope;
            let mirrored = match describe::array_index_of_first_third_or_fifth_harmonic(line.harmonic) {
                Some(h) if own => description.pulsating_slope[h],
                _ => Complex64::ZERO,
            };
            for j in 0..p {
                let g = line.receptance[i][j];
                // d (direct + mirrored conj) (g dF_j) / d Re, d Im.
                let by_re = g * direct + mirrored * g.conj();
                let by_im = Complex64::I * g * direct + mirrored * (Complex64::I * g).conj();
                matrix[(2 * i, 2 * j)] -= by_re.re;
                matrix[(2 * i, 2 * j + 1)] -= by_im.re;
                matrix[(2 * i + 1, 2 * j)] -= by_re.im;
                matrix[(2 * i + 1, 2 * j + 1)] -= by_im.im;
            }
            let residual = description.force[line_index] - motion.force_n[line_index][i];
            (right[2 * i], right[2 * i + 1]) = (residual.re, residual.im);
        }
        let factors = matrix.lu();
        // At no voltage it is 1; it changes sign where a motion starts to grow by itself.
        // The sign alone: the product of pivots may overflow, or be lost, at a resonance.
        let sign_of = |pivot: &f64| if *pivot == 0.0 { 0.0 } else { pivot.signum() };
        let sign = factors.p().determinant::<f64>() * factors.u().diagonal().iter().map(sign_of).product::<f64>();
        if sign.is_nan() || sign <= 0.0 {
            return Err(MotionError::Unstable);
        }
        let solution = factors.solve(&right).ok_or(MotionError::Unstable)?;
        Ok(std::array::from_fn(|i| Complex64::new(solution[2 * i], solution[2 * i + 1])))
    }
}

/// Travel of every actuator per force on every one, from the modal coordinates of the displacement for 1 N on each alone
/// (as of [`crate::response::CoordinateSolver::solve_coordinates_per_newton_at`]), in m/N. Actuators beyond the most are left out.
#[must_use]
pub fn compute_travel_receptance(model: &ReducedModel, coordinates: &[DVector<Complex64>]) -> PerPair {
    let mut matrix = [[Complex64::ZERO; MAX_ACTUATORS]; MAX_ACTUATORS];
    for (i, row) in matrix.iter_mut().enumerate().take(model.count_actuators()) {
        for (entry, q) in row.iter_mut().zip(coordinates) {
            *entry = model.actuator_mass_travel_against_electrodes(i, q);
        }
    }
    matrix
}

/// How far the actuators' masses (row) yield to a steady force on each (column), in m/N, by the springs alone
/// ([`ReducedModel::steady_travel_in_gaps_or_infinity_if_driving_free_motion_m_per_n`]); infinite where the force drives a motion that nothing holds. Actuators beyond the most are left out.
#[must_use]
pub fn static_receptance_magnitude_or_infinity_m_per_n(model: &ReducedModel) -> [[f64; MAX_ACTUATORS]; MAX_ACTUATORS] {
    let travel = model.steady_travel_in_gaps_or_infinity_if_driving_free_motion_m_per_n();
    let entry = |i: usize, j: usize| travel.get((i, j)).map_or(0.0, |own| own.abs());
    std::array::from_fn(|i| std::array::from_fn(|j| entry(i, j)))
}

fn multiply_matrix_by_vector(matrix: &PerPair, vector: &Phasors, actuators: usize) -> Phasors {
    let mut out = [Complex64::ZERO; MAX_ACTUATORS];
    for (out, row) in out.iter_mut().zip(matrix).take(actuators) {
        *out = row.iter().zip(vector).take(actuators).map(|(g, f)| g * f).sum();
    }
    out
}

impl Electrodes {
    /// The first limit that a motion of up to `travel_m` at `voltage_v` breaks, if any: the voltage, a third of the gap or the stop,
    /// the breakdown of what is left of it under a press.
    #[must_use]
    pub fn first_violated_limit_if_any(&self, travel_m: f64, voltage_v: f64) -> Option<Limit> {
        if voltage_v > self.max_voltage_v {
            return Some(Limit::Voltage);
        }
        if travel_m > self.max_travel_m() {
            return Some(Limit::Travel);
        }
        (voltage_v > self.breakdown_voltage_of_remaining_gap_with_margin_v(travel_m)).then_some(Limit::Breakdown)
    }
}
