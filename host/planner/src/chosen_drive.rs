//! Drives as the search has chosen them, with what they do.

use crate::response::{SineComponent, compute_peak_of_sines};
use crate::table::{Entry, Width, at_point};
use nalgebra::DVector;
use num_complex::Complex64;
use std::sync::Arc;

/// Odd harmonics of a drive that another's frequency may meet within the grid. The fifth has a fifth of the fundamental's
/// force, the seventh a seventh; the third, which most plans do without, a third.
const MEETING: [f64; 3] = [3.0, 5.0, 7.0];
/// A harmonic and a drive nearer than this beat once in two seconds, the longest burst that a board drives unasked.
const SLOWEST_BEAT_HZ: f64 = 0.5;

/// An actuator's drive.
#[derive(Clone, Debug)]
pub struct Chosen {
    /// In Hz.
    pub frequency_hz: f64,
    /// Its index, if it is on the grid.
    pub on_grid: Option<usize>,
    /// What every actuator does at this frequency.
    pub row: Vec<Entry>,
    /// Pulse width and its limits.
    pub width: Width,
    /// Amplitude of the force's fundamental in N.
    pub force_n: f64,
    /// Phase of the force in rad.
    pub phase_rad: f64,
}

/// A plan's drives with their responses, made once and kept with the plan.
#[derive(Clone, Debug)]
pub struct MadeOf(pub(crate) Arc<[Chosen]>);

/// Plans with the same drives are the same: the responses follow from them.
impl PartialEq for MadeOf {
    fn eq(&self, _: &Self) -> bool {
        true
    }
}

/// Whether one frequency is an odd harmonic of the other, or so near to one that the beat is slower than [`SLOWEST_BEAT_HZ`].
pub(super) fn meets(a_hz: f64, b_hz: f64) -> bool {
    let (low, high) = (a_hz.min(b_hz), a_hz.max(b_hz));
    MEETING.iter().any(|n| (n * low - high).abs() <= SLOWEST_BEAT_HZ)
}

/// Drives of equal frequencies, as lists of their numbers.
pub(super) fn groups(drives: &[Chosen]) -> impl Iterator<Item = Vec<usize>> + '_ {
    let is_first = |i: &usize| drives[..*i].iter().all(|other| other.frequency_hz != drives[*i].frequency_hz);
    (0..drives.len())
        .filter(is_first)
        .map(|i| (i..drives.len()).filter(|j| drives[*j].frequency_hz == drives[i].frequency_hz).collect())
}

/// Equation 23 at a point: distinct frequencies add, equal ones as phasors, in m/s^2.
pub(super) fn peak(drives: &[Chosen], shape: &DVector<f64>) -> f64 {
    let component = |(i, drive): (usize, &Chosen)| {
        let force = Complex64::from_polar(drive.force_n, drive.phase_rad);
        let response = drive.row.get(i).map(|entry| at_point(shape, &entry.acceleration));
        SineComponent { frequency_hz: drive.frequency_hz, phasor: response.unwrap_or_default() * force }
    };
    compute_peak_of_sines(&drives.iter().enumerate().map(component).collect::<Vec<_>>())
}
