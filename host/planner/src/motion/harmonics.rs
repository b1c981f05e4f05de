//! What the odd harmonics of the square-edged forces move, up to the highest frequency that is felt.

use crate::chosen_drive::{ChosenDrive, window_phase_of_each_drive_keeping_relative_force_phases_rad};
use crate::model::ReducedModel;
use crate::motion::driven_panel::SettledMotion;
use crate::response::CoordinateSolver;
use crate::table::{PlanTable, acceleration_at_point_from_coordinates};
use crate::{HIGHEST_FELT_HZ, STANDARD_GRAVITY};
use nalgebra::DVector;
use num_complex::Complex64;
use std::f64::consts::TAU;

/// The harmonics of all drives of a plan, each with its frequency in Hz and the modal coordinates of its acceleration in m/s^2.
#[derive(Clone, Debug, Default)]
pub struct DriveHarmonics(Vec<(f64, DVector<Complex64>)>);

/// The harmonics of drives that have been made safe.
pub(crate) fn compute_drive_harmonics_on_finest_model(
    table: &PlanTable,
    drives: &[ChosenDrive],
    settled: &SettledMotion,
) -> DriveHarmonics {
    compute_harmonics_on_model(&table.model, drives, settled)
}

/// The harmonics of drives on one of the models.
pub(super) fn compute_harmonics_on_model(
    model: &ReducedModel,
    drives: &[ChosenDrive],
    settled: &SettledMotion,
) -> DriveHarmonics {
    let solver = CoordinateSolver::new(model);
    let window_phases = window_phase_of_each_drive_keeping_relative_force_phases_rad(drives, &settled.applied);
    let mut found = Vec::new();
    for (i, drive) in drives.iter().enumerate().filter(|(_, drive)| drive.force_n > 0.0) {
        let numbers = (1..).map(|k| f64::from(2 * k + 1));
        for n in numbers.take_while(|n| n * drive.frequency_hz <= HIGHEST_FELT_HZ) {
            let hz = n * drive.frequency_hz;
            // An unbounded one is a resonance without damping, which an edge of finite length does not meet.
            let Ok(mut coordinates) = solver.solve_coordinates_per_newton_at(hz) else { continue };
            if let (true, Some(own), Some(phase_rad)) = (i < coordinates.len(), drive.row.get(i), window_phases.get(i))
            {
                // Where windows are late by an angle, their n-th harmonic is by n times that (acceleration is -w^2 q).
                let part =
                    own.charging.force_harmonic_phasor_over_fundamental_amplitude(n, settled.applied[i].pulse_width);
                let omega = TAU * hz;
                let force = Complex64::from_polar(omega * omega * drive.force_n, n * phase_rad) * -part;
                found.push((hz, coordinates.swap_remove(i) * force));
            }
        }
    }
    DriveHarmonics(found)
}

impl DriveHarmonics {
    /// The highest of them; 0 without any.
    pub(super) fn highest_harmonic_or_0_hz(&self) -> f64 {
        self.0.iter().map(|(hz, _)| *hz).fold(0.0, f64::max)
    }

    /// Frequencies in Hz and phasors in m/s^2 at the point with mode shapes `shape`, drive by drive.
    pub(super) fn harmonic_hz_and_phasors_at_point(&self, shape: &DVector<f64>) -> Vec<(f64, Complex64)> {
        self.0
            .iter()
            .map(|(hz, acceleration)| (*hz, acceleration_at_point_from_coordinates(shape, acceleration)))
            .collect()
    }

    /// The same of drives at one frequency together.
    pub(super) fn hz_and_phasors_summed_by_frequency_at_point(&self, shape: &DVector<f64>) -> Vec<(f64, Complex64)> {
        let mut sums: Vec<(f64, Complex64)> = Vec::new();
        for (hz, phasor) in self.harmonic_hz_and_phasors_at_point(shape) {
            match sums.iter_mut().find(|(known, _)| *known == hz) {
                Some((_, sum)) => *sum += phasor,
                None => sums.push((hz, phasor)),
            }
        }
        sums
    }

    /// Frequencies in Hz and peaks in m/s^2 at the point with mode shapes `shape`, drive by drive: their sum is how much higher
    /// than the fundamentals' the whole waveform can be at most.
    pub(crate) fn harmonic_hz_and_peaks_at_point(&self, shape: &DVector<f64>) -> impl Iterator<Item = (f64, f64)> {
        self.0
            .iter()
            .map(|(hz, acceleration)| (*hz, acceleration_at_point_from_coordinates(shape, acceleration).norm()))
    }

    /// Largest sum of peaks at some points, in g.
    pub(crate) fn max_harmonic_peak_sum_over_points_g<'a>(
        &self,
        points: impl Iterator<Item = &'a DVector<f64>>,
    ) -> f64 {
        let sum = |shape| self.harmonic_hz_and_peaks_at_point(shape).map(|(_, peak)| peak).sum::<f64>();
        points.map(sum).fold(0.0, f64::max) / STANDARD_GRAVITY
    }
}
