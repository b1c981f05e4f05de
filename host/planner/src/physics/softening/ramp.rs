//! The way from rest to the steady motion while the rails rise.
//!
//! Every line's motion is carried by the poles near its frequency, as phasors relative to the drive: z' = (s - jw) z + b F for
//! each pole s, travel the sum of a z, and F the force of [`super::settle`]'s describing functions for the travels as they are,
//! under the voltages as they are. That is the averaged motion (Krylov and Bogoliubov) of what [`super::settle`] finds the end
//! of: it tells how far masses go beyond it, and whether a softening spring's other motion is where they end.

use super::{
    ClosingGaps, Excitation, Line, MAX_LINES, Motion, MotionError, PerPair, Phasors, Transducer,
    multiply_matrix_by_vector,
};
use crate::scene::MAX_ACTUATORS;
use num_complex::Complex64;

/// Between two looks in s: poles up to 80 Hz beside a drive turn by half a radian.
const RAMP_STEP_S: f64 = 1e-3;
/// Longest time that is followed after the rails are up, in s.
const LONGEST_RAMP_S: f64 = 1.0;
/// Part of the steady travel that does not count as beyond it.
const NEARLY: f64 = 0.02;

/// A pole near a line.
#[derive(Clone, Copy, Debug)]
pub struct NearPole {
    /// s - jw, in 1/s.
    pub beat: Complex64,
    /// What a force on each actuator drives it by.
    pub input: Phasors,
    /// What it moves each actuator's mass by.
    pub output: Phasors,
}

/// A line's receptance in time.
#[derive(Clone, Debug)]
pub struct TimeResponse {
    /// What takes its time.
    pub near_poles: Vec<NearPole>,
    /// What follows at once, in m/N.
    pub at_once: PerPair,
}

/// Most that each actuator's mass is away from its middle in m while the rails rise, each over its `rise_s`, and until the
/// motion is `steady`.
///
/// # Errors
/// [`MotionError`], for motions that go beyond half the gap.
pub fn find_largest_travel_while_rails_rise_m(
    actuators: &[Transducer],
    excitations: &[Excitation],
    lines: &[Line],
    time_responses: &[TimeResponse],
    rise_s: &[f64; MAX_ACTUATORS],
    steady: &Motion,
) -> Result<[f64; MAX_ACTUATORS], MotionError> {
    let problem = ClosingGaps::new(actuators, excitations, lines)?;
    let p = actuators.len();
    let mut near_poles: Vec<Vec<PoleState>> = time_responses
        .iter()
        .zip(&steady.force_n)
        .map(|(line, forces)| line.near_poles.iter().map(|pole| PoleState::new(pole, forces)).collect())
        .collect();
    let longest_s = rise_s.iter().take(p).copied().fold(0.0, f64::max);
    let mut most = [0.0_f64; MAX_ACTUATORS];
    let mut motion = Motion::REST;
    let mut before = motion.travel_m;
    let mut time_s = 0.0;
    while time_s < longest_s + LONGEST_RAMP_S {
        // Forces of the middle of the step: travels go on as they have.
        let mut middle = motion;
        for (l, travel) in middle.travel_m.iter_mut().enumerate().take(lines.len()) {
            for (travel, before) in travel.iter_mut().zip(&before[l]) {
                *travel = 1.5 * *travel - 0.5 * before;
            }
        }
        before = motion.travel_m;
        let mut forces = [[Complex64::ZERO; MAX_ACTUATORS]; MAX_LINES];
        for i in 0..p {
            let up = ((time_s + 0.5 * RAMP_STEP_S) / rise_s[i]).min(1.0);
            let description = problem
                .compute_force_and_slopes_on_actuator_unless_travel_too_far(i, &middle, up * up)
                .ok_or(MotionError::Travel { actuator: i })?;
            forces.iter_mut().zip(&description.force).for_each(|(forces, force)| forces[i] = *force);
        }
        time_s += RAMP_STEP_S;
        // What is still to go matters from then on.
        let are_up = time_s > longest_s;
        let mut away = [0.0; MAX_ACTUATORS];
        for (l, line) in time_responses.iter().enumerate().take(lines.len()) {
            let mut travel = multiply_matrix_by_vector(&line.at_once, &forces[l], p);
            for (state, pole) in near_poles[l].iter_mut().zip(&line.near_poles) {
                state.advance_one_step(pole, &forces[l]);
                for (travel, output) in travel.iter_mut().zip(&pole.output).take(p) {
                    *travel += output * state.now;
                }
                if are_up {
                    let left = state.distance_to_steady_pole_state();
                    away.iter_mut().zip(&state.moved).for_each(|(away, moved)| *away += moved * left);
                }
            }
            motion.travel_m[l] = travel;
        }
        let mut is_there = are_up;
        for i in 0..p {
            let travel: f64 = motion.travel_m.iter().take(lines.len()).map(|travel| travel[i].norm_sqr().sqrt()).sum();
            most[i] = most[i].max(travel);
            let still = steady.largest_m[i] + away[i];
            is_there &= still <= most[i].max((1.0 + NEARLY) * steady.largest_m[i]);
        }
        if is_there {
            break;
        }
    }
    for (most, steady) in most.iter_mut().zip(&steady.largest_m).take(p) {
        *most = most.max(*steady);
    }
    Ok(most)
}

/// One pole on its way.
struct PoleState {
    now: Complex64,
    steady: Complex64,
    /// e^(beat h), and what a force that stays for a step adds.
    turn: Complex64,
    gain: Complex64,
    /// How far it moves each actuator's mass: the moduli of [`NearPole::output`].
    moved: [f64; MAX_ACTUATORS],
}

impl PoleState {
    fn new(pole: &NearPole, steady_n: &Phasors) -> Self {
        let turn = (pole.beat * RAMP_STEP_S).exp();
        let input: Complex64 = pole.input.iter().zip(steady_n).map(|(b, force)| b * force).sum();
        let (steady, gain) = (-input / pole.beat, (turn - 1.0) / pole.beat);
        Self { now: Complex64::ZERO, steady, turn, gain, moved: pole.output.map(|output| output.norm()) }
    }

    fn advance_one_step(&mut self, pole: &NearPole, forces: &Phasors) {
        let input: Complex64 = pole.input.iter().zip(forces).map(|(b, force)| b * force).sum();
        self.now = self.turn * self.now + self.gain * input;
    }

    /// How much is left to the steady motion.
    fn distance_to_steady_pole_state(&self) -> f64 {
        (self.now - self.steady).norm_sqr().sqrt()
    }
}
