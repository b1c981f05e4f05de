//! Drives as forces on the panel: voltages and pulse widths, the steady motion that they make in closing gaps, and which limit it breaks.

use crate::chosen_drive::{
    ChosenDrive, VoltageAndPulseWidth, window_phase_of_each_drive_keeping_relative_force_phases_rad,
};
use crate::physics::limits::Limit;
use crate::physics::softening::{Excitation, Line, MAX_LINES, Motion, MotionError, Transducer, solve_steady_motion};
use crate::scene::MAX_ACTUATORS;
use crate::table::{HARMONICS, PlanTable, bound_travel_by_harmonics_above_fundamental_m_per_n};
use era_shared::supply::rail_index_of_channel;
use num_complex::Complex64;

/// Simulated travel over the averaged motion's, at most: 1.002 was seen on random panels.
pub(crate) const UNMODELLED_TRAVEL: f64 = 1.01;

/// The steady motion of safe drives, and the scale by which their forces were derated.
#[derive(Clone, Copy, Debug)]
pub struct SettledMotion {
    /// Voltages and pulse widths.
    pub applied: [VoltageAndPulseWidth; MAX_ACTUATORS],
    /// The fundamentals' steady motion.
    pub motion: Motion,
    /// Frequencies of its lines.
    pub(crate) frequency_of_line: [usize; MAX_LINES],
    /// Number of lines.
    pub(crate) lines: usize,
    /// By which all forces were scaled.
    pub scale: f64,
    /// What made that necessary.
    pub limited: Option<(usize, Limit)>,
    /// Whether a quiet zone did.
    pub is_quieted: bool,
}

/// The actuators' forces on the panel under given voltages.
pub(crate) struct DrivenPanel {
    transducers: [Transducer; MAX_ACTUATORS],
    excitations: [Excitation; MAX_ACTUATORS],
    actuators: usize,
    /// The fundamentals'.
    pub lines: Vec<Line>,
    /// Of each line the first drive at its frequency.
    pub leaders: Vec<usize>,
}

impl DrivenPanel {
    /// The steady motion under these voltages.
    pub(crate) fn solve_steady_motion(&self) -> Result<Motion, MotionError> {
        solve_steady_motion(self.transducers(), self.excitations(), &self.lines)
    }

    pub(crate) fn transducers(&self) -> &[Transducer] {
        &self.transducers[..self.actuators]
    }

    pub(crate) fn excitations(&self) -> &[Excitation] {
        &self.excitations[..self.actuators]
    }
}

/// Travel in m that the first few of [`HARMONICS`] add at most, in gaps at rest, for forces times `force_scale`.
pub(crate) fn bound_harmonic_travel_of_each_mass_in_gaps_at_rest_m(
    drives: &[ChosenDrive],
    applied: &[VoltageAndPulseWidth; MAX_ACTUATORS],
    force_scale: f64,
    first_odd_harmonic_numbers: &[f64],
) -> [f64; MAX_ACTUATORS] {
    let mut sums = [0.0; MAX_ACTUATORS];
    for (j, (drive, applied)) in drives.iter().zip(applied).enumerate() {
        let Some(entry) = drive.row.get(j) else { continue };
        let own = bound_travel_by_harmonics_above_fundamental_m_per_n(
            entry,
            applied.pulse_width,
            first_odd_harmonic_numbers.len(),
        );
        sums.iter_mut().zip(own).for_each(|(sum, own)| *sum += own * drive.force_n * force_scale);
    }
    sums
}

/// Checks the travel `travel_m` plus that of the harmonics against all limits; the error names the first actuator and
/// limit that is exceeded.
pub(crate) fn check_travel_with_harmonics_against_limits(
    table: &PlanTable,
    drives: &[ChosenDrive],
    settled: &SettledMotion,
    travel_m: &[f64; MAX_ACTUATORS],
) -> Result<(), (usize, Limit)> {
    let applied = &settled.applied;
    let harmonics = bound_harmonic_travel_of_each_mass_in_gaps_at_rest_m(drives, applied, settled.scale, &HARMONICS);
    for (i, electrodes) in table.electrodes.iter().enumerate().take(drives.len().min(MAX_ACTUATORS)) {
        let rail_v = applied.iter().enumerate().filter(|(j, _)| rail_index_of_channel(*j) == rail_index_of_channel(i));
        let rail_v = rail_v.map(|(_, applied)| applied.voltage_v).fold(0.0, f64::max);
        // To the last digits the voltage is the limit's own.
        let rail_v = rail_v * (1.0 - 1e-12);
        if let Some(limit) =
            electrodes.first_violated_limit_if_any(UNMODELLED_TRAVEL * travel_m[i] + harmonics[i], rail_v)
        {
            return Err((i, limit));
        }
    }
    Ok(())
}

/// The actuator and limit that an error is about. If the softening makes a resonance unstable, that is the actuator
/// that loses most of its stiffness.
pub(crate) fn find_actuator_of_motion_error_and_name_travel_as_limit(
    table: &PlanTable,
    error: MotionError,
    applied: &[VoltageAndPulseWidth; MAX_ACTUATORS],
) -> (usize, Limit) {
    let lost = |i: &usize| {
        let own = table.static_receptance[*i][*i];
        table
            .electrodes
            .get(*i)
            .map_or(0.0, |electrodes| own * electrodes.max_softening_n_per_m(applied[*i].voltage_v, 0.0))
    };
    let actuator = match error {
        MotionError::Travel { actuator } => Some(actuator),
        MotionError::Unstable | MotionError::Shape { .. } => {
            (0..table.electrodes.len().min(MAX_ACTUATORS)).max_by(|a, b| lost(a).total_cmp(&lost(b)))
        }
    };
    (actuator.unwrap_or(0), Limit::Travel)
}

/// The forces of the actuators on the panel under these voltages. Drives of equal frequency share a line.
pub(crate) fn build_driven_panel(
    table: &PlanTable,
    drives: &[ChosenDrive],
    applied: [VoltageAndPulseWidth; MAX_ACTUATORS],
) -> DrivenPanel {
    let p = drives.len().min(MAX_ACTUATORS);
    let mut frequency = [0; MAX_ACTUATORS];
    let mut leaders: Vec<usize> = Vec::with_capacity(p);
    for (i, drive) in drives.iter().enumerate().take(p) {
        let same = leaders.iter().position(|leader| drives[*leader].frequency_hz == drive.frequency_hz);
        frequency[i] = same.unwrap_or_else(|| {
            leaders.push(i);
            leaders.len() - 1
        });
    }
    let line = |(frequency, leader): (usize, &usize)| {
        let mut receptance = [[Complex64::ZERO; MAX_ACTUATORS]; MAX_ACTUATORS];
        for (column, entry) in drives[*leader].row.iter().enumerate().take(p) {
            for (row, travel) in receptance.iter_mut().zip(entry.travel) {
                row[column] = travel;
            }
        }
        Line { frequency, harmonic: 1, receptance }
    };
    let lines: Vec<Line> = leaders.iter().enumerate().map(line).collect();
    let mut transducers = [Transducer::with_fixed_force(0.0); MAX_ACTUATORS];
    let mut excitations =
        [Excitation { frequency: 0, frequency_hz: 0.0, voltage_v: 0.0, pulse_width: 0.5, phase_rad: 0.0 };
            MAX_ACTUATORS];
    let window_phases = window_phase_of_each_drive_keeping_relative_force_phases_rad(drives, &applied);
    for i in 0..p {
        transducers[i] = table.transducers.get(i).copied().unwrap_or(Transducer::with_fixed_force(0.0));
        let VoltageAndPulseWidth { voltage_v, pulse_width } = applied[i];
        let (frequency, frequency_hz) = (frequency[i], drives[i].frequency_hz);
        excitations[i] = Excitation { frequency, frequency_hz, voltage_v, pulse_width, phase_rad: window_phases[i] };
    }
    DrivenPanel { transducers, excitations, actuators: p, lines, leaders }
}
