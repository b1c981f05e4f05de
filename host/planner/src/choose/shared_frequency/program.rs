//! The convex problem at one frequency, in units of its own.

use super::small::hermitian_eigenvalues_and_eigenvectors;
use super::unlimited::UnlimitedEfficiency;
use super::{PerPair, Phasors, TargetField, ZERO, actuator_indices_in_mask};
use crate::scene::MAX_ACTUATORS;
use num_complex::Complex64;

/// What a limit of 1 may be exceeded by: the rounding of what is exactly at it.
pub(super) const ROUNDING: f64 = 1e-12;

/// Units of peak in m/s^2 and of energy in (m/s^2)^2.
#[derive(Clone, Copy, Debug)]
pub(super) struct Units {
    pub(super) peak: f64,
    pub(super) energy: f64,
}

/// Phasors are in parts of each actuator's own limit, x_i = u_i / U_i, travel in parts of its limit.
#[derive(Clone, Copy, Debug)]
pub(super) struct Program {
    /// Actuators that can be driven, as a mask.
    pub(super) used: u8,
    /// Peak: Re(sum gain_i x_i), as the phase of all together is free.
    pub(super) gain: Phasors,
    /// Energy: x^H energy x.
    pub(super) energy: PerPair,
    /// Travel of i: |sum_j travel_ij x_j|.
    pub(super) travel: PerPair,
}

impl Program {
    pub(super) fn new(field: &TargetField<'_>, unlimited: &UnlimitedEfficiency, k: usize, units: Units) -> Self {
        let mut program = Self {
            used: unlimited.usable,
            gain: [ZERO; MAX_ACTUATORS],
            energy: [[ZERO; MAX_ACTUATORS]; MAX_ACTUATORS],
            travel: [[ZERO; MAX_ACTUATORS]; MAX_ACTUATORS],
        };
        let force = &field.max_force_n[k];
        for i in program.drivable_actuators() {
            program.gain[i] = field.gain[k][i] * (force[i] / units.peak);
            for row in 0..field.actuators {
                program.travel[row][i] = field.travel[k][row][i] * (force[i] / field.max_travel_m[row]);
            }
            let scale = |j: usize| force[i] * force[j] / units.energy;
            program.energy[i][i] = (field.energy[k][i][i].re * (1.0 + unlimited.ridge) * scale(i)).into();
            for j in program.drivable_actuators().take_while(|j| *j < i) {
                let entry = field.energy[k][i][j] * scale(j);
                (program.energy[i][j], program.energy[j][i]) = (entry, entry.conj());
            }
        }
        program
    }

    /// The actuators that can be driven.
    pub(super) fn drivable_actuators(&self) -> impl Iterator<Item = usize> + use<> {
        actuator_indices_in_mask(self.used)
    }

    /// Re(sum gain_i x_i).
    pub(super) fn real_part_of_peak_at_target(&self, x: &Phasors) -> f64 {
        self.drivable_actuators().map(|i| (self.gain[i] * x[i]).re).sum()
    }

    /// energy x.
    pub(super) fn multiply_by_energy_matrix(&self, x: &Phasors) -> Phasors {
        std::array::from_fn(|i| multiply_row_by_phasors(&self.energy[i], x))
    }

    /// x^H energy x.
    pub(super) fn energy_of_phasors(&self, x: &Phasors) -> f64 {
        self.multiply_by_energy_matrix(x).iter().zip(x).map(|(ex, x)| (x.conj() * ex).re).sum()
    }

    /// Most peak there would be without limits on travel.
    pub(super) fn max_peak_without_travel_limits(&self) -> f64 {
        self.drivable_actuators().map(|i| self.gain[i].norm()).sum()
    }

    /// Whether actuator `actuator` can get to the limit of its travel at all.
    pub(super) fn can_reach_travel_limit(&self, actuator: usize) -> bool {
        self.travel[actuator].iter().map(|entry| entry.norm()).sum::<f64>() > 1.0 + ROUNDING
    }

    /// Whether the limits hold.
    pub(super) fn is_within_force_and_travel_limits(&self, x: &Phasors) -> bool {
        let travels = self.travel.iter().map(|row| multiply_row_by_phasors(row, x));
        x.iter().copied().chain(travels).all(|z| z.norm() <= 1.0 + ROUNDING)
    }

    /// The same problem in eigenvectors of the energy, which is diagonal then, and the eigenvectors (columns). Forces are
    /// limited in the old unknowns only.
    pub(super) fn diagonalize_energy_and_get_eigenvectors(&self) -> (Self, PerPair) {
        let (energies, turn) = hermitian_eigenvalues_and_eigenvectors(&self.energy);
        let turned = |row: &Phasors| -> Phasors {
            std::array::from_fn(|n| (0..MAX_ACTUATORS).map(|i| row[i] * turn[i][n]).sum())
        };
        let mut energy = [[ZERO; MAX_ACTUATORS]; MAX_ACTUATORS];
        for (i, value) in energies.iter().enumerate() {
            energy[i][i] = value.max(0.0).into();
        }
        (Self { gain: turned(&self.gain), energy, travel: self.travel.map(|row| turned(&row)), ..*self }, turn)
    }

    /// energy^-1 conj(gain) by Cholesky's method: the direction of the best phasors without limits. Its peak is its energy.
    pub(super) fn optimal_direction_without_limits(&self) -> Phasors {
        let (mut factor, mut x) = (self.energy, self.gain.map(|gain| gain.conj()));
        for i in self.drivable_actuators() {
            for j in self.drivable_actuators().take_while(|j| *j <= i) {
                let mut entry = factor[i][j];
                for l in self.drivable_actuators().take_while(|l| *l < j) {
                    entry -= factor[i][l] * factor[j][l].conj();
                }
                factor[i][j] =
                    if i == j { entry.re.max(f64::MIN_POSITIVE).sqrt().into() } else { entry / factor[j][j].re };
            }
            for j in self.drivable_actuators().take_while(|j| *j < i) {
                let done = factor[i][j] * x[j];
                x[i] -= done;
            }
            x[i] /= factor[i][i].re;
        }
        for i in (0..MAX_ACTUATORS).rev().filter(|i| self.used >> i & 1 == 1) {
            for j in self.drivable_actuators().filter(|j| *j > i) {
                let done = factor[j][i].conj() * x[j];
                x[i] -= done;
            }
            x[i] /= factor[i][i].re;
        }
        x
    }
}

/// Sum of row_j x_j.
pub(super) fn multiply_row_by_phasors(row: &Phasors, x: &Phasors) -> Complex64 {
    row.iter().zip(x).map(|(entry, x)| entry * x).sum()
}
