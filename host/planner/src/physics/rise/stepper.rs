//! Displacements in time under forces that depend on them, pole by pole.

use super::{RIGID_RAD_S, RiseTimes};
use nalgebra::DVector;
use num_complex::Complex64;

/// Displacements of some rows of the model (travels of actuators, say), step by step from rest under forces of the
/// actuators that are constant over each step: z' = s z + (x2 . b) F for every pole, exactly over a step, and displacement
/// the sum of (row . x2) z / s, as x1 is W x2 / s. What does not ring follows its force at once.
#[derive(Clone, Debug)]
pub struct Stepper {
    actuators: usize,
    rows: usize,
    /// e^(s h).
    turn: Vec<Complex64>,
    /// (e^(s h) - 1) / s times x2 . b, pole by pole.
    input: Vec<Complex64>,
    /// (row . x2) / s, twice for a pair, pole by pole.
    output: Vec<Complex64>,
    /// Displacement at once, rows x actuators, in m/N.
    at_once: Vec<f64>,
    state: Vec<Complex64>,
}

impl RiseTimes {
    /// A stepper at rest, for `rows` over the model's coordinates. Rigid motions are left out.
    #[must_use]
    pub fn stepper(&self, rows: &[DVector<f64>], step_s: f64) -> Stepper {
        let actuators = self.force.ncols();
        let seen: Vec<(DVector<f64>, DVector<f64>)> =
            rows.iter().map(|row| (self.re.tr_mul(row), self.im.tr_mul(row))).collect();
        let at = |row: usize, k: usize| Complex64::new(seen[row].0[k], seen[row].1[k]);
        let weight = |s: &Complex64| if s.im > 0.0 { 2.0 } else { 1.0 };
        let mut stepper = Stepper {
            actuators,
            rows: rows.len(),
            turn: Vec::new(),
            input: Vec::new(),
            output: Vec::new(),
            at_once: vec![0.0; rows.len() * actuators],
            state: Vec::new(),
        };
        for (k, s) in self.poles.iter().enumerate().filter(|(_, s)| s.norm() > 10.0 * RIGID_RAD_S) {
            if k < self.ringing {
                let turn = (s * step_s).exp();
                stepper.turn.push(turn);
                stepper.input.extend((0..actuators).map(|j| (turn - 1.0) / s * self.force[(k, j)]));
                stepper.output.extend((0..rows.len()).map(|row| at(row, k) / s * weight(s)));
            } else {
                for row in 0..rows.len() {
                    for j in 0..actuators {
                        stepper.at_once[row * actuators + j] -=
                            (at(row, k) * self.force[(k, j)] / (s * s)).re * weight(s);
                    }
                }
            }
        }
        stepper.state = vec![Complex64::ZERO; stepper.turn.len()];
        stepper
    }
}

impl Stepper {
    /// One step under `forces_n`, one per actuator; the displacements at its end into `out`, one per row, in m.
    pub fn step(&mut self, forces_n: &[f64], out: &mut [f64]) {
        for (row, out) in out.iter_mut().enumerate().take(self.rows) {
            let at_once = &self.at_once[row * self.actuators..(row + 1) * self.actuators];
            *out = at_once.iter().zip(forces_n).map(|(per_n, force)| per_n * force).sum();
        }
        let inputs = self.input.chunks_exact(self.actuators.max(1));
        let outputs = self.output.chunks_exact(self.rows.max(1));
        for ((z, turn), (input, output)) in self.state.iter_mut().zip(&self.turn).zip(inputs.zip(outputs)) {
            *z *= turn;
            for (input, force) in input.iter().zip(forces_n) {
                *z += input * force;
            }
            for (out, per_z) in out.iter_mut().zip(output) {
                *out += per_z.re * z.re - per_z.im * z.im;
            }
        }
    }
}
