//! Plans with one setting for the whole surface, which leaves no dead zone.

use crate::choose::allocate::{Allocation, Duals};
use crate::choose::candidates::Formulation;
use crate::choose::refine::Selection;
use crate::chosen_drive::Chosen;
use crate::reach::max_min;
use crate::reach::max_min::whole_surface_setting;
use crate::request::PlanError;
use crate::scene::MAX_ACTUATORS;
use crate::table::{PlanTable, Region, at_point};

/// The drives that leave no dead zone, scaled to what the target asks for.
pub(crate) fn select_reach_drives(
    table: &PlanTable,
    formulation: &Formulation<'_>,
    zone: Option<Region>,
    wanted: &[f64],
) -> Result<Selection, PlanError> {
    let within = zone.map(|zone| max_min::everywhere(table, Some(zone)));
    let found = within.as_ref().map_or_else(|| whole_surface_setting(table), Option::as_ref);
    let (setting, gap) = found.ok_or(PlanError::NoFrequencies)?;
    let mut drives = Vec::with_capacity(setting.len());
    let mut peak = 0.0;
    for (i, part) in setting.iter().enumerate() {
        let row = table.entries_at(part.frequency);
        let entry = row.get(i).ok_or(PlanError::NoFrequencies)?;
        let width = *entry.pulse(part.drive.force_n > entry.widths[0].max_force_n);
        if let Some(shape) = formulation.zone.targets.first() {
            peak += at_point(shape, &entry.acceleration).norm() * part.drive.force_n;
        }
        drives.push(Chosen {
            frequency_hz: part.drive.frequency_hz,
            on_grid: Some(part.frequency),
            row,
            width,
            force_n: part.drive.force_n,
            phase_rad: 0.0,
        });
    }
    let wanted = wanted.first().copied().unwrap_or(0.0);
    let scale = if peak > wanted { wanted / peak } else { 1.0 };
    let mut forces_n = [0.0; MAX_ACTUATORS];
    for (force, drive) in forces_n.iter_mut().zip(&mut drives) {
        drive.force_n *= scale;
        *force = drive.force_n;
    }
    let met = if wanted > 0.0 { (peak / wanted).min(1.0) } else { 1.0 };
    let allocation = Allocation { forces_n, met, cost: 0.0, duals: Duals::default() };
    Ok(Selection { drives, allocation, active: Vec::new(), gap: *gap })
}
