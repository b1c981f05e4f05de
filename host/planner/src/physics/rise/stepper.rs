//! Displacements and velocities in time under forces that depend on them, pole by pole.

use super::{PanelPoles, RIGID_RAD_S};
use nalgebra::DVector;
use num_complex::Complex64;

/// Part of what a pole begins its free motion with at which it counts as still.
const DECAYED_TO: f64 = 1e-9;

/// Displacements of some rows of the model (travels of actuators, say) and velocities of others, step by step from rest under forces of the
/// actuators that are constant over each step: z' = s z + (x2 . b) F for every pole, exactly over a step. The displacement of a row is
/// the sum of (row . x2) z / s, as x1 is W x2 / s, and its velocity that of (row . x2) z. What does not ring follows its force at once, with no
/// velocity.
#[derive(Clone, Debug)]
pub struct Stepper {
    actuators: usize,
    rows: usize,
    poles: Vec<Complex64>,
    /// e^(s h).
    turn: Vec<Complex64>,
    /// (e^(s h) - 1) / s times x2 . b, pole by pole.
    input: Vec<Complex64>,
    /// What a state adds to each row, twice for a pair, pole by pole.
    output: Vec<Complex64>,
    /// Displacement at once, rows x actuators, in m/N; of a row of velocities what its velocity does not have.
    at_once: Vec<f64>,
    /// Rows of displacements, which come before those of velocities.
    displaced: usize,
    state: Vec<Complex64>,
}

impl PanelPoles {
    /// A stepper at rest, for `displacement_rows` over the model's coordinates. Rigid motions are left out.
    #[must_use]
    pub fn build_stepper(&self, displacement_rows: &[DVector<f64>], step_s: f64) -> Stepper {
        self.build_stepper_with_velocities(displacement_rows, &[], step_s)
    }

    /// The same with the velocities of `velocity_rows` after the displacements. Of the displacements, rigid motions are left out.
    #[must_use]
    pub fn build_stepper_with_velocities(
        &self,
        displacement_rows: &[DVector<f64>],
        velocity_rows: &[DVector<f64>],
        step_s: f64,
    ) -> Stepper {
        let actuators = self.force.ncols();
        let rows = displacement_rows.len() + velocity_rows.len();
        let project = |row: &DVector<f64>| (self.re.tr_mul(row), self.im.tr_mul(row));
        let displaced: Vec<_> = displacement_rows.iter().map(project).collect();
        let moved: Vec<_> = velocity_rows.iter().map(project).collect();
        let at = |(re, im): &(DVector<f64>, DVector<f64>), k: usize| Complex64::new(re[k], im[k]);
        let weight = |s: &Complex64| if s.im > 0.0 { 2.0 } else { 1.0 };
        let mut stepper = Stepper {
            actuators,
            rows,
            poles: Vec::new(),
            turn: Vec::new(),
            input: Vec::new(),
            output: Vec::new(),
            at_once: vec![0.0; rows * actuators],
            displaced: displaced.len(),
            state: Vec::new(),
        };
        for (k, s) in self.poles.iter().enumerate() {
            let is_rigid = s.norm() <= 10.0 * RIGID_RAD_S;
            if is_rigid && velocity_rows.is_empty() {
                continue;
            }
            if k < self.poles_below_highest_hz {
                let turn = (s * step_s).exp();
                // Of a motion that hardly turns the difference to 1 has no digits left.
                let gained = if is_rigid { Complex64::from(step_s) } else { (turn - 1.0) / s };
                stepper.poles.push(*s);
                stepper.turn.push(turn);
                stepper.input.extend((0..actuators).map(|j| gained * self.force[(k, j)]));
                let displacement = |row| if is_rigid { Complex64::ZERO } else { at(row, k) / s * weight(s) };
                stepper.output.extend(displaced.iter().map(displacement));
                stepper.output.extend(moved.iter().map(|row| at(row, k) * weight(s)));
            } else {
                for (row, projected) in displaced.iter().chain(&moved).enumerate() {
                    for j in 0..actuators {
                        stepper.at_once[row * actuators + j] -=
                            (at(projected, k) * self.force[(k, j)] / (s * s)).re * weight(s);
                    }
                }
            }
        }
        stepper.state = vec![Complex64::ZERO; stepper.turn.len()];
        stepper
    }
}

impl Stepper {
    /// One step under `forces_n`, one per actuator; displacements in m and velocities in m/s at its end into `motion`, one per row.
    pub fn advance_one_step(&mut self, forces_n: &[f64], motion: &mut [f64]) {
        for (row, motion) in motion.iter_mut().enumerate().take(self.rows) {
            *motion = if row < self.displaced {
                self.displacement_of_row_by_instantly_following_poles_m(row, forces_n)
            } else {
                0.0
            };
        }
        let inputs = self.input.chunks_exact(self.actuators.max(1));
        let outputs = self.output.chunks_exact(self.rows.max(1));
        for ((z, turn), (input, output)) in self.state.iter_mut().zip(&self.turn).zip(inputs.zip(outputs)) {
            *z *= turn;
            for (input, force) in input.iter().zip(forces_n) {
                *z += input * force;
            }
            for (motion, per_z) in motion.iter_mut().zip(output) {
                *motion += per_z.re * z.re - per_z.im * z.im;
            }
        }
    }

    /// Displacement in m of a row, also of one of velocities, by what follows forces at once.
    #[must_use]
    pub fn displacement_of_row_by_instantly_following_poles_m(&self, row: usize, forces_n: &[f64]) -> f64 {
        let at_once = self.at_once.get(row * self.actuators..(row + 1) * self.actuators).unwrap_or(&[]);
        at_once.iter().zip(forces_n).map(|(per_n, force)| per_n * force).sum()
    }

    /// Samples one row of the free motion that follows, every `step_s` from one step after now on; the stepper stays where it is. The part of a pole ends
    /// when 1e-9 of its first amplitude is left.
    #[must_use]
    pub fn sample_free_motion_of_row(&self, row: usize, step_s: f64, count: usize) -> Vec<f64> {
        let mut samples = vec![0.0; count];
        let outputs = self.output.chunks_exact(self.rows.max(1));
        for ((z, s), output) in self.state.iter().zip(&self.poles).zip(outputs) {
            let Some(per_z) = output.get(row) else { continue };
            // Four samples at a time, which do not wait for each other.
            let turn = (s * step_s).exp();
            let ends_after = DECAYED_TO.ln() / (s.re * step_s);
            #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "`as` saturates")]
            let lasting = if ends_after > 0.0 { (ends_after as usize).min(count) } else { count };
            let mut motion = [1, 2, 3, 4].map(|steps| per_z * z * turn.powi(steps));
            let turn_four = turn.powi(4);
            for samples in samples.get_mut(..lasting).into_iter().flat_map(|lasting| lasting.chunks_mut(4)) {
                for (sample, motion) in samples.iter_mut().zip(&mut motion) {
                    *sample += motion.re;
                    *motion *= turn_four;
                }
            }
        }
        samples
    }

    /// Bound of each displacement in the free motion that follows, over all phases of the poles, in m (or m/s).
    #[must_use]
    pub fn bound_free_motion_of_each_row(&self) -> Vec<f64> {
        let mut bounds = vec![0.0; self.rows];
        let outputs = self.output.chunks_exact(self.rows.max(1));
        for (z, output) in self.state.iter().zip(outputs) {
            bounds.iter_mut().zip(output).for_each(|(bound, per_z)| *bound += (per_z * z).norm());
        }
        bounds
    }

    /// Amplitude of each pole that vibrates, in the order of [`super::SwitchOnModel::list_decay_rate_and_travel_of_each_pole`]. Rigid motions,
    /// whose drift is no vibration, are left out.
    #[must_use]
    pub fn list_vibrating_poles_with_their_amplitudes(&self) -> Vec<(Complex64, f64)> {
        let poles = self.poles.iter().zip(&self.state).filter(|(s, _)| s.norm() > 10.0 * RIGID_RAD_S);
        poles.map(|(s, z)| (*s, z.norm())).collect()
    }
}
