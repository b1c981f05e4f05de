//! Plans with one setting for the whole surface, so that there is no dead zone.

use crate::choose::allocate::{Allocation, DualVariables};
use crate::choose::candidates::Formulation;
use crate::choose::refine::Selection;
use crate::chosen_drive::ChosenDrive;
use crate::reach::max_min;
use crate::reach::max_min::get_or_compute_surface_max_min_setting_and_relative_gap;
use crate::request::PlanError;
use crate::scene::MAX_ACTUATORS;
use crate::table::{PlanTable, Region, acceleration_at_point_from_coordinates};

/// The drives of that setting, scaled down to what the target asks for.
pub(crate) fn select_surface_or_region_max_min_drives_scaled_down_to_first_target(
    table: &PlanTable,
    formulation: &Formulation<'_>,
    region: Option<Region>,
    wanted_m_per_s2: &[f64],
) -> Result<Selection, PlanError> {
    let within =
        region.map(|region| max_min::max_min_setting_and_relative_gap_if_spacing_can_be_kept(table, Some(region)));
    let found =
        within.as_ref().map_or_else(|| get_or_compute_surface_max_min_setting_and_relative_gap(table), Option::as_ref);
    let (setting, gap) = found.ok_or(PlanError::NoFrequencies)?;
    let mut drives = Vec::with_capacity(setting.len());
    let mut peak = 0.0;
    for (i, part) in setting.iter().enumerate() {
        let row = table.entries_of_all_actuators_at_index(part.frequency);
        let entry = row.get(i).ok_or(PlanError::NoFrequencies)?;
        let width = *entry.select_pulse(part.drive.force_n > entry.widths[0].max_force_n);
        if let Some(shape) = formulation.zone.targets.first() {
            peak += acceleration_at_point_from_coordinates(shape, &entry.acceleration).norm() * part.drive.force_n;
        }
        drives.push(ChosenDrive {
            frequency_hz: part.drive.frequency_hz,
            on_grid: Some(part.frequency),
            row,
            width,
            force_n: part.drive.force_n,
            force_phase_rad: 0.0,
        });
    }
    let wanted_m_per_s2 = wanted_m_per_s2.first().copied().unwrap_or(0.0);
    let scale = if peak > wanted_m_per_s2 { wanted_m_per_s2 / peak } else { 1.0 };
    let mut forces_n = [0.0; MAX_ACTUATORS];
    for (force, drive) in forces_n.iter_mut().zip(&mut drives) {
        drive.force_n *= scale;
        *force = drive.force_n;
    }
    let met = if wanted_m_per_s2 > 0.0 { (peak / wanted_m_per_s2).min(1.0) } else { 1.0 };
    let allocation = Allocation { forces_n, met, cost: 0.0, duals: DualVariables::default() };
    Ok(Selection { drives, allocation, active: Vec::new(), gap: *gap })
}
