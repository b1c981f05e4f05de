//! Plans with one frequency for all actuators, and phases.

use super::{PerPair, Phasors, TargetField, find_least_energy_or_largest_peak_phasors};
use crate::MOST_CONDITION;
use crate::choose::allocate::{Allocation, DualVariables};
use crate::choose::candidates::Formulation;
use crate::choose::refine::Selection;
use crate::chosen_drive::ChosenDrive;
use crate::request::PlanError;
use crate::scene::MAX_ACTUATORS;
use crate::table::{PlanTable, PulseOption, acceleration_at_point_from_coordinates};
use num_complex::Complex64;

/// Part of a wish that is met.
const MET_BY_PHASORS: f64 = 1.0 - 1e-9;
/// Times as much that stronger pulses have to reach to be taken: their harmonics move the panel more.
const MORE: f64 = 1.0 + 1e-3;

/// The drives for one target with the least energy elsewhere, all at one frequency.
pub(crate) fn choose_drives_at_one_shared_frequency(
    table: &PlanTable,
    formulation: &Formulation<'_>,
    wanted_m_per_s2: &[f64],
) -> Result<Selection, PlanError> {
    let wanted_m_per_s2 = wanted_m_per_s2.first().copied().unwrap_or(0.0);
    // All with their quieter pulses, or, if that does not reach, all with their stronger ones; harmonics are those of the
    // pulses taken.
    let best = |strong: bool| {
        let data = FieldData::new(table, formulation, strong);
        find_least_energy_or_largest_peak_phasors(&data.to_target_field(table), wanted_m_per_s2)
            .ok_or(PlanError::NoFrequencies)
    };
    let (mut found, mut strong) = (best(false)?, false);
    if found.reached < wanted_m_per_s2 * MET_BY_PHASORS {
        let stronger = best(true)?;
        if stronger.reached > found.reached * MORE {
            (found, strong) = (stronger, true);
        }
    }
    let row = table.entries_of_all_actuators_at_index(found.frequency);
    let drive = |(i, force): (usize, &Complex64)| ChosenDrive {
        frequency_hz: table.frequencies_hz[found.frequency],
        on_grid: Some(found.frequency),
        width: row.get(i).map_or_else(PulseOption::default, |entry| *entry.select_pulse(strong)),
        row: row.clone(),
        force_n: force.norm(),
        force_phase_rad: if force.norm() > 0.0 { force.arg() } else { 0.0 },
    };
    let met = if wanted_m_per_s2 > 0.0 { (found.reached / wanted_m_per_s2).min(1.0) } else { 1.0 };
    let forces_n = found.forces_n.map(Complex64::norm);
    Ok(Selection {
        drives: found.forces_n.iter().take(table.entries.len()).enumerate().map(drive).collect(),
        allocation: Allocation { forces_n, met, cost: found.energy, duals: DualVariables::default() },
        active: Vec::new(),
        gap: if found.proven_gap > 1e-8 { found.proven_gap } else { 0.0 },
    })
}

/// The field at a target.
struct FieldData {
    gain: Vec<Phasors>,
    energy: Vec<PerPair>,
    max_force_n: Vec<[f64; MAX_ACTUATORS]>,
    travel: Vec<PerPair>,
}

impl FieldData {
    /// With each entry's quiet pulse or its strong one.
    fn new(table: &PlanTable, formulation: &Formulation<'_>, strong: bool) -> Self {
        let (p, f) = (table.entries.len().min(MAX_ACTUATORS), table.frequencies_hz.len());
        let mut data = Self {
            gain: vec![[Complex64::ZERO; MAX_ACTUATORS]; f],
            energy: vec![[[Complex64::ZERO; MAX_ACTUATORS]; MAX_ACTUATORS]; f],
            max_force_n: vec![[0.0; MAX_ACTUATORS]; f],
            travel: vec![[[Complex64::ZERO; MAX_ACTUATORS]; MAX_ACTUATORS]; f],
        };
        let over_all = table.mean_products_over_surface_at_each_frequency();
        for k in 0..f {
            let entries: Option<Vec<_>> = (0..p).map(|i| table.entry(i, k)).collect();
            let (Some(entries), Some(over_all)) = (entries, over_all.get(k)) else { continue };
            let near = formulation
                .zone
                .mean_products_over_zone(&entries.iter().map(|entry| &entry.acceleration).collect::<Vec<_>>());
            let part = formulation.zone.part;
            for (i, entry) in entries.iter().enumerate() {
                if let Some(shape) = formulation.zone.targets.first() {
                    data.gain[k][i] = acceleration_at_point_from_coordinates(shape, &entry.acceleration);
                }
                data.max_force_n[k][i] = entry.select_pulse(strong).max_force_n;
                for j in 0..p {
                    data.energy[k][i][j] = (over_all[i][j] - near[i][j] * part) / (1.0 - part);
                    data.travel[k][j][i] = entry.travel[j];
                }
                // Harmonics of different actuators are not in step with each other's fundamentals; they add to each one's own.
                let floor = MOST_CONDITION * over_all[i][i].re;
                data.energy[k][i][i] += entry.select_pulse(strong).harmonics + floor;
            }
        }
        data
    }

    fn to_target_field<'a>(&'a self, table: &'a PlanTable) -> TargetField<'a> {
        let mut max_travel_m = [f64::INFINITY; MAX_ACTUATORS];
        max_travel_m.iter_mut().zip(&table.electrodes).for_each(|(most, electrodes)| *most = electrodes.max_travel_m());
        TargetField {
            frequencies_hz: &table.frequencies_hz,
            actuators: table.entries.len().min(MAX_ACTUATORS),
            gain: &self.gain,
            energy: &self.energy,
            max_force_n: &self.max_force_n,
            travel: &self.travel,
            max_travel_m,
        }
    }
}
