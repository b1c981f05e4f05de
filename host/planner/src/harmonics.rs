//! What the odd harmonics of the square-edged forces move, up to the highest frequency that is felt.

use super::chosen::Chosen;
use super::safe::Settled;
use super::table::{PlanTable, at_point, harmonic_part};
use super::{HIGHEST_FELT_HZ, STANDARD_GRAVITY};
use crate::response::Solver;
use nalgebra::DVector;
use num_complex::Complex64;
use std::f64::consts::TAU;

/// The harmonics of all drives of a plan, each with its frequency in Hz and the modal coordinates of its acceleration in m/s^2.
#[derive(Clone, Debug, Default)]
pub struct Harmonics(Vec<(f64, DVector<Complex64>)>);

impl PlanTable {
    /// The harmonics of drives that have been made safe.
    pub(super) fn harmonics(&self, drives: &[Chosen], settled: &Settled) -> Harmonics {
        let solver = Solver::new(&self.model);
        let mut found = Vec::new();
        for (i, drive) in drives.iter().enumerate().filter(|(_, drive)| drive.force_n > 0.0) {
            let numbers = (1..).map(|k| f64::from(2 * k + 1));
            for n in numbers.take_while(|n| n * drive.frequency_hz <= HIGHEST_FELT_HZ) {
                let hz = n * drive.frequency_hz;
                // An unbounded one is a resonance without damping, which an edge of finite length does not meet.
                let Ok(mut coordinates) = solver.coordinates(hz) else { continue };
                if i < coordinates.len() {
                    let part = harmonic_part(n, settled.applied[i].pulse_width).abs();
                    let omega = TAU * hz;
                    found
                        .push((hz, coordinates.swap_remove(i) * Complex64::from(omega * omega * part * drive.force_n)));
                }
            }
        }
        Harmonics(found)
    }
}

impl Harmonics {
    /// Frequencies in Hz and peaks in m/s^2 at the point with mode shapes `shape`: their sum is how much higher than the
    /// fundamentals' the whole waveform can be.
    pub(super) fn peaks(&self, shape: &DVector<f64>) -> impl Iterator<Item = (f64, f64)> {
        self.0.iter().map(|(hz, acceleration)| (*hz, at_point(shape, acceleration).norm()))
    }

    /// Largest sum of peaks at some points, in g.
    pub(super) fn most_g<'a>(&self, points: impl Iterator<Item = &'a DVector<f64>>) -> f64 {
        let sum = |shape| self.peaks(shape).map(|(_, peak)| peak).sum::<f64>();
        points.map(sum).fold(0.0, f64::max) / STANDARD_GRAVITY
    }
}
