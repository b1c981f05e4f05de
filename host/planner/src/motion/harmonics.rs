//! What the odd harmonics of the square-edged forces move, up to the highest frequency that is felt.

use crate::chosen_drive::Chosen;
use crate::model::ReducedModel;
use crate::motion::driven_panel::Settled;
use crate::response::CoordinateSolver;
use crate::table::{PlanTable, at_point, harmonic_part};
use crate::{HIGHEST_FELT_HZ, STANDARD_GRAVITY};
use nalgebra::DVector;
use num_complex::Complex64;
use std::f64::consts::TAU;

/// The harmonics of all drives of a plan, each with its frequency in Hz and the modal coordinates of its acceleration in m/s^2.
#[derive(Clone, Debug, Default)]
pub struct Harmonics(Vec<(f64, DVector<Complex64>)>);

/// The harmonics of drives that have been made safe.
pub(crate) fn compute_drive_harmonics(table: &PlanTable, drives: &[Chosen], settled: &Settled) -> Harmonics {
    harmonics_on(&table.model, drives, settled)
}

/// The harmonics of drives on one of the models.
pub(super) fn harmonics_on(model: &ReducedModel, drives: &[Chosen], settled: &Settled) -> Harmonics {
    let solver = CoordinateSolver::new(model);
    let mut found = Vec::new();
    for (i, drive) in drives.iter().enumerate().filter(|(_, drive)| drive.force_n > 0.0) {
        let numbers = (1..).map(|k| f64::from(2 * k + 1));
        for n in numbers.take_while(|n| n * drive.frequency_hz <= HIGHEST_FELT_HZ) {
            let hz = n * drive.frequency_hz;
            // An unbounded one is a resonance without damping, which an edge of finite length does not meet.
            let Ok(mut coordinates) = solver.solve_at_frequency(hz) else { continue };
            if i < coordinates.len() {
                // Windows lie at the drive's phase, so that its harmonic's is n times as large (acceleration is -w^2 q).
                let part = harmonic_part(n, settled.applied[i].pulse_width);
                let omega = TAU * hz;
                let force = Complex64::from_polar(omega * omega * drive.force_n, n * drive.phase_rad) * -part;
                found.push((hz, coordinates.swap_remove(i) * force));
            }
        }
    }
    Harmonics(found)
}

impl Harmonics {
    /// The highest of them; 0 without any.
    pub(super) fn highest_hz(&self) -> f64 {
        self.0.iter().map(|(hz, _)| *hz).fold(0.0, f64::max)
    }

    /// Frequencies in Hz and phasors in m/s^2 at the point with mode shapes `shape`, drive by drive.
    pub(super) fn phasors(&self, shape: &DVector<f64>) -> Vec<(f64, Complex64)> {
        self.0.iter().map(|(hz, acceleration)| (*hz, at_point(shape, acceleration))).collect()
    }

    /// The same of drives at one frequency together.
    pub(super) fn together(&self, shape: &DVector<f64>) -> Vec<(f64, Complex64)> {
        let mut sums: Vec<(f64, Complex64)> = Vec::new();
        for (hz, phasor) in self.phasors(shape) {
            match sums.iter_mut().find(|(known, _)| *known == hz) {
                Some((_, sum)) => *sum += phasor,
                None => sums.push((hz, phasor)),
            }
        }
        sums
    }

    /// Frequencies in Hz and peaks in m/s^2 at the point with mode shapes `shape`, drive by drive: their sum is how much higher
    /// than the fundamentals' the whole waveform can be at most.
    pub(crate) fn peaks(&self, shape: &DVector<f64>) -> impl Iterator<Item = (f64, f64)> {
        self.0.iter().map(|(hz, acceleration)| (*hz, at_point(shape, acceleration).norm()))
    }

    /// Largest sum of peaks at some points, in g.
    pub(crate) fn most_g<'a>(&self, points: impl Iterator<Item = &'a DVector<f64>>) -> f64 {
        let sum = |shape| self.peaks(shape).map(|(_, peak)| peak).sum::<f64>();
        points.map(sum).fold(0.0, f64::max) / STANDARD_GRAVITY
    }
}
