//! The setting that is commanded: derated like a plan until it is safe, and the peaks that it makes.

use super::measure::Measure;
use crate::chosen_drive::{
    ChosenDrive, force_phase_relative_to_windows_rad, window_phase_of_each_drive_keeping_relative_force_phases_rad,
};
use crate::drive::Drive;
use crate::motion::settle::derate_drives_until_safe_and_settle_if_possible;
use crate::table::{ActuatorSetting, PlanTable, PulseOption};
use nalgebra::{DMatrix, DVector};
use num_complex::Complex64;

/// The setting of an actuator with a force in N at a frequency of the grid, with its strongest pulse width.
#[must_use]
pub fn build_setting_with_strongest_pulse(
    table: &PlanTable,
    actuator: usize,
    frequency_index: usize,
    force: Complex64,
) -> ActuatorSetting {
    let pulse_width = strongest_pulse_or_default(table, actuator, frequency_index).pulse_width;
    let frequency_hz = table.frequencies_hz.get(frequency_index).copied().unwrap_or_default();
    let voltage_v = match table.electrodes.get(actuator) {
        Some(electrodes) if force.norm() > 0.0 => {
            electrodes.voltage_for_force_v(force.norm(), frequency_hz, pulse_width)
        }
        _ => 0.0,
    };
    // Where its windows are is known once voltages and pulse widths are safe.
    let force_phase_rad = if force.norm() > 0.0 { force.arg() } else { 0.0 };
    let drive = Drive {
        actuator: table.scene.actuators.get(actuator).map_or_else(String::new, |actuator| actuator.id.clone()),
        frequency_hz,
        force_n: force.norm(),
        phase_rad: force_phase_rad,
        force_phase_rad,
        voltage_v,
        pulse_width,
    };
    ActuatorSetting { drive, frequency: frequency_index }
}

/// The strongest pulse option of an actuator at a frequency of the grid; the default without a response.
fn strongest_pulse_or_default(table: &PlanTable, actuator: usize, frequency_index: usize) -> PulseOption {
    table
        .entry(actuator, frequency_index)
        .map_or_else(PulseOption::default, |entry| *entry.widest_pulse_if_noticeably_stronger_else_quiet())
}

/// Scales the forces down until the nonlinear motion keeps all limits, like that of every plan, and sets the voltages
/// and pulse widths that the rails then have. Returns the fraction of the forces that remains; `None` if no fraction
/// is safe.
#[must_use]
pub fn derate_setting_to_safe_fraction_if_any(table: &PlanTable, setting: &mut [ActuatorSetting]) -> Option<f64> {
    let mut drives: Vec<ChosenDrive> = setting
        .iter()
        .enumerate()
        .map(|(i, part)| ChosenDrive {
            frequency_hz: part.drive.frequency_hz,
            on_grid: Some(part.frequency),
            row: table.entries_of_all_actuators_at_index(part.frequency),
            width: strongest_pulse_or_default(table, i, part.frequency),
            force_n: part.drive.force_n,
            force_phase_rad: part.drive.force_phase_rad,
        })
        .collect();
    let settled = derate_drives_until_safe_and_settle_if_possible(table, &mut drives)?;
    let window_phases = window_phase_of_each_drive_keeping_relative_force_phases_rad(&drives, &settled.applied);
    let safe = drives.iter().zip(&settled.applied).zip(window_phases).enumerate();
    for (part, (i, ((drive, applied), phase_rad))) in setting.iter_mut().zip(safe) {
        part.drive.force_n = drive.force_n;
        part.drive.voltage_v = applied.voltage_v;
        part.drive.pulse_width = applied.pulse_width;
        part.drive.phase_rad = phase_rad;
        part.drive.force_phase_rad = phase_rad + force_phase_relative_to_windows_rad(drive, i, applied.pulse_width);
    }
    Some(settled.scale)
}

/// Sum of the acceleration coordinates of all actuators at the frequency of actuator `first_user`; `None` if an earlier
/// actuator has the same frequency.
pub(crate) fn sum_acceleration_coordinates_at_frequency_if_first_used_by(
    table: &PlanTable,
    setting: &[ActuatorSetting],
    first_user: usize,
) -> Option<DVector<Complex64>> {
    let frequency = setting.get(first_user)?.frequency;
    if setting.iter().take(first_user).any(|before| before.frequency == frequency) {
        return None;
    }
    let mut coordinates = DVector::<Complex64>::zeros(table.model.count_coordinates());
    for (actuator, part) in setting.iter().enumerate().filter(|(_, part)| part.frequency == frequency) {
        if let Some(entry) = table.entry(actuator, frequency) {
            coordinates += &entry.acceleration * Complex64::from_polar(part.drive.force_n, part.drive.force_phase_rad);
        }
    }
    Some(coordinates)
}

/// Peaks of a setting at points with these mode shapes (points x n): phasors of equal frequencies add, peaks of
/// distinct ones add (equation 23).
pub(crate) fn compute_peak_of_setting_at_each_point(
    table: &PlanTable,
    shapes: &DMatrix<f64>,
    setting: &[ActuatorSetting],
    measure: Measure,
) -> Vec<f64> {
    let mut sum = vec![0.0; shapes.nrows()];
    for (number, part) in setting.iter().enumerate() {
        let Some(coordinates) = sum_acceleration_coordinates_at_frequency_if_first_used_by(table, setting, number)
        else {
            continue;
        };
        let weight = measure.weight_per_m_per_s2(part.drive.frequency_hz);
        let (re, im) = (shapes * coordinates.map(|z| z.re), shapes * coordinates.map(|z| z.im));
        for ((sum, re), im) in sum.iter_mut().zip(re.iter()).zip(im.iter()) {
            *sum += re.hypot(*im) * weight;
        }
    }
    sum
}
