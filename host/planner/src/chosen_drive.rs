//! Drives as the search has chosen them, with the responses of the table at their frequencies.

use crate::response::{SineComponent, peak_of_sines_merging_equal_frequencies};
use crate::scene::MAX_ACTUATORS;
use crate::table::{Entry, PulseOption, acceleration_at_point_from_coordinates};
use nalgebra::DVector;
use num_complex::Complex64;
use std::sync::Arc;

/// Odd harmonics of a drive that another's frequency may meet within the grid. The fifth has a fifth of the fundamental's
/// force, the seventh a seventh; the third, which most plans do without, a third.
const MEETING: [f64; 3] = [3.0, 5.0, 7.0];
/// A harmonic and a drive nearer than this beat once in two seconds, the longest burst that a board drives unasked.
const SLOWEST_BEAT_HZ: f64 = 0.5;

/// A chosen drive of one actuator.
#[derive(Clone, Debug)]
pub struct ChosenDrive {
    /// In Hz.
    pub frequency_hz: f64,
    /// Its index, if it is on the grid.
    pub on_grid: Option<usize>,
    /// What every actuator does at this frequency.
    pub row: Vec<Entry>,
    /// Pulse width and its limits.
    pub width: PulseOption,
    /// Amplitude of the force's fundamental in N.
    pub force_n: f64,
    /// Phase of the force in rad.
    pub force_phase_rad: f64,
}

/// Voltage and pulse width of one drive.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct VoltageAndPulseWidth {
    /// Of the electrodes, which is the rail's, in V; 0 at rest.
    pub voltage_v: f64,
    /// Part of its half period for which an electrode is on.
    pub pulse_width: f64,
}

/// The drives of a plan with their responses, computed once and kept with the plan.
#[derive(Clone, Debug)]
pub struct PlanDrives(pub(crate) Arc<[ChosenDrive]>);

/// Plans with the same drives are the same: the responses follow from them.
impl PartialEq for PlanDrives {
    fn eq(&self, _: &Self) -> bool {
        true
    }
}

/// Whether one frequency is an odd harmonic of the other, or so near that the beat is slower than
/// [`SLOWEST_BEAT_HZ`].
pub(super) fn is_one_near_3rd_5th_or_7th_harmonic_of_other(a_hz: f64, b_hz: f64) -> bool {
    let (low, high) = (a_hz.min(b_hz), a_hz.max(b_hz));
    MEETING.iter().any(|n| (n * low - high).abs() <= SLOWEST_BEAT_HZ)
}

/// The indices of the drives, grouped by equal frequency.
pub(super) fn group_drive_indices_by_frequency(drives: &[ChosenDrive]) -> impl Iterator<Item = Vec<usize>> + '_ {
    let is_first = |i: &usize| drives[..*i].iter().all(|other| other.frequency_hz != drives[*i].frequency_hz);
    (0..drives.len())
        .filter(is_first)
        .map(|i| (i..drives.len()).filter(|j| drives[*j].frequency_hz == drives[i].frequency_hz).collect())
}

/// Phase in rad of the force's fundamental of the drive of `actuator` relative to its windows: 0 or negative.
pub(super) fn force_phase_relative_to_windows_rad(drive: &ChosenDrive, actuator: usize, pulse_width: f64) -> f64 {
    drive.row.get(actuator).map_or(0.0, |own| own.charging.force_phase_relative_to_windows_rad(pulse_width))
}

/// Phases of the windows in rad that give the drives' forces their phases. The force of electrodes behind resistors is late by an angle that
/// depends on the pulse width. Time counts so that the first drive of each frequency has its windows where its force would be without
/// resistors: alone at its frequency a drive keeps the phase 0. The others keep their forces' phases relative to it.
pub(super) fn window_phase_of_each_drive_keeping_relative_force_phases_rad(
    drives: &[ChosenDrive],
    applied: &[VoltageAndPulseWidth; MAX_ACTUATORS],
) -> [f64; MAX_ACTUATORS] {
    let behind = |i: usize| {
        applied.get(i).map_or(0.0, |own| force_phase_relative_to_windows_rad(&drives[i], i, own.pulse_width))
    };
    let mut phases = [0.0; MAX_ACTUATORS];
    for group in group_drive_indices_by_frequency(drives) {
        for i in &group {
            if let Some(phase) = phases.get_mut(*i) {
                *phase = drives[*i].force_phase_rad - (behind(*i) - behind(group[0]));
            }
        }
    }
    phases
}

/// Peak acceleration in m/s^2 at a point by equation 23: peaks of distinct frequencies add, drives of equal frequency
/// add as phasors.
pub(super) fn fundamental_acceleration_peak_at_point_m_per_s2(drives: &[ChosenDrive], shape: &DVector<f64>) -> f64 {
    let component = |(i, drive): (usize, &ChosenDrive)| {
        let force = Complex64::from_polar(drive.force_n, drive.force_phase_rad);
        let response = drive.row.get(i).map(|entry| acceleration_at_point_from_coordinates(shape, &entry.acceleration));
        SineComponent { frequency_hz: drive.frequency_hz, phasor: response.unwrap_or_default() * force }
    };
    peak_of_sines_merging_equal_frequencies(&drives.iter().enumerate().map(component).collect::<Vec<_>>())
}
