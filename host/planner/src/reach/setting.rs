//! What is commanded: one setting of all actuators, made safe as plans are, and what it does.

use super::measure::Measure;
use crate::chosen_drive::Chosen;
use crate::drive::Drive;
use crate::motion::settle::settle_drives;
use crate::table::{Part, PlanTable, Width};
use nalgebra::{DMatrix, DVector};
use num_complex::Complex64;

/// An actuator with a force in N at a frequency of the grid, with its strongest pulse width.
#[must_use]
pub fn part(table: &PlanTable, actuator: usize, frequency: usize, force: Complex64) -> Part {
    let pulse_width = width(table, actuator, frequency).pulse_width;
    let voltage_v = match table.electrodes.get(actuator) {
        Some(electrodes) if force.norm() > 0.0 => electrodes.voltage_for(force.norm(), pulse_width),
        _ => 0.0,
    };
    let drive = Drive {
        actuator: table.scene.actuators.get(actuator).map_or_else(String::new, |actuator| actuator.id.clone()),
        frequency_hz: table.frequencies_hz.get(frequency).copied().unwrap_or_default(),
        force_n: force.norm(),
        phase_rad: if force.norm() > 0.0 { force.arg() } else { 0.0 },
        voltage_v,
        pulse_width,
    };
    Part { drive, frequency }
}

fn width(table: &PlanTable, actuator: usize, frequency: usize) -> Width {
    table.entry(actuator, frequency).map_or_else(Width::default, |entry| *entry.strong())
}

/// Scales forces down until the nonlinear motion, as of every plan, keeps all limits, and sets the
/// voltages and pulse widths that the rails have then. The part of the forces that is left; `None` if none is safe.
#[must_use]
pub fn command(table: &PlanTable, setting: &mut [Part]) -> Option<f64> {
    let mut drives: Vec<Chosen> = setting
        .iter()
        .enumerate()
        .map(|(i, part)| Chosen {
            frequency_hz: part.drive.frequency_hz,
            on_grid: Some(part.frequency),
            row: table.entries_at(part.frequency),
            width: width(table, i, part.frequency),
            force_n: part.drive.force_n,
            phase_rad: part.drive.phase_rad,
        })
        .collect();
    let settled = settle_drives(table, &mut drives)?;
    for ((part, drive), applied) in setting.iter_mut().zip(&drives).zip(&settled.applied) {
        part.drive.force_n = drive.force_n;
        part.drive.voltage_v = applied.voltage_v;
        part.drive.pulse_width = applied.pulse_width;
    }
    Some(settled.scale)
}

/// Acceleration in the model's coordinates of all that a setting does at the frequency of `part`; `None` where an actuator
/// before it has the same.
pub(crate) fn together(table: &PlanTable, setting: &[Part], part: usize) -> Option<DVector<Complex64>> {
    let frequency = setting.get(part)?.frequency;
    if setting.iter().take(part).any(|before| before.frequency == frequency) {
        return None;
    }
    let mut coordinates = DVector::<Complex64>::zeros(table.model.count_coordinates());
    for (actuator, part) in setting.iter().enumerate().filter(|(_, part)| part.frequency == frequency) {
        if let Some(entry) = table.entry(actuator, frequency) {
            coordinates += &entry.acceleration * Complex64::from_polar(part.drive.force_n, part.drive.phase_rad);
        }
    }
    Some(coordinates)
}

/// Peaks of a setting at points with these mode shapes (points x n): phasors of one frequency add, peaks of distinct ones do
/// (equation 23).
pub(crate) fn peaks(table: &PlanTable, shapes: &DMatrix<f64>, setting: &[Part], measure: Measure) -> Vec<f64> {
    let mut sum = vec![0.0; shapes.nrows()];
    for (number, part) in setting.iter().enumerate() {
        let Some(coordinates) = together(table, setting, number) else { continue };
        let weight = measure.weight(part.drive.frequency_hz);
        let (re, im) = (shapes * coordinates.map(|z| z.re), shapes * coordinates.map(|z| z.im));
        for ((sum, re), im) in sum.iter_mut().zip(re.iter()).zip(im.iter()) {
            *sum += re.hypot(*im) * weight;
        }
    }
    sum
}
