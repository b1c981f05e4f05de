//! The limits of drives that were not chosen with dual variables of the limits: those with phases, or for the whole
//! surface.

use crate::choose::refine::Selection;
use crate::chosen_drive::group_drive_indices_by_frequency;
use crate::physics::limits::Limit;
use crate::plan::limitation::{Limitation, add_limitation_if_new};
use crate::table::PlanTable;
use num_complex::Complex64;

/// Part of a limit that counts as reached: what finds these drives comes as near as that, not to the last digit.
const REACHED_FRACTION: f64 = 0.95;

/// The limits that drives come close to. `derating` is the fraction of the forces that safety has left.
pub(crate) fn find_limits_nearly_reached_before_derating(
    table: &PlanTable,
    selection: &Selection,
    derating: f64,
) -> Vec<Limitation> {
    let mut found = Vec::new();
    let drives = &selection.drives;
    let forces: Vec<_> =
        drives.iter().map(|drive| (drive.width, drive.force_n / derating.max(f64::MIN_POSITIVE))).collect();
    for (i, (width, force_n)) in forces.iter().enumerate() {
        if *force_n > 0.0 && *force_n >= width.max_force_n * REACHED_FRACTION {
            add_limitation_if_new(&mut found, Limitation::for_actuator(table, width.limit, i));
        }
        // Drives of one frequency as phasors.
        let travel: f64 = group_drive_indices_by_frequency(drives)
            .map(|group| {
                let own = group.iter().filter_map(|j| {
                    let phasor = Complex64::from_polar(forces[*j].1, drives[*j].force_phase_rad);
                    Some(drives[*j].row.get(*j)?.travel[i] * phasor)
                });
                own.sum::<Complex64>().norm()
            })
            .sum();
        if table.electrodes.get(i).is_some_and(|electrodes| travel >= REACHED_FRACTION * electrodes.max_travel_m()) {
            add_limitation_if_new(&mut found, Limitation::for_actuator(table, Limit::Travel, i));
        }
    }
    for row in table.limits.find_limit_rows_used_above_fraction(&forces, REACHED_FRACTION) {
        if let Some((actuator, limit)) = table.limits.actuator_and_limit_of_row_if_in_range(row) {
            add_limitation_if_new(&mut found, Limitation::for_actuator(table, limit, actuator));
        }
    }
    found
}
