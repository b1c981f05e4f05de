//! The limits of drives that were not chosen with dual variables of the limits: with phases, or for the whole surface.

use crate::choose::refine::Selection;
use crate::chosen_drive::groups;
use crate::physics::limits::Limit;
use crate::plan::limitation::{Limitation, add};
use crate::table::PlanTable;
use num_complex::Complex64;

/// Part of a limit that counts as reached: what finds these drives comes as near as that, not to the last digit.
const REACHED_PART: f64 = 0.95;

/// Limits that drives come near to. `scale` is what safety left of the forces.
pub(crate) fn find_nearly_reached_limits(table: &PlanTable, selection: &Selection, scale: f64) -> Vec<Limitation> {
    let mut found = Vec::new();
    let drives = &selection.drives;
    let forces: Vec<_> =
        drives.iter().map(|drive| (drive.width, drive.force_n / scale.max(f64::MIN_POSITIVE))).collect();
    for (i, (width, force_n)) in forces.iter().enumerate() {
        if *force_n > 0.0 && *force_n >= width.max_force_n * REACHED_PART {
            add(&mut found, Limitation::of(table, width.limit, i));
        }
        // Drives of one frequency as phasors.
        let travel: f64 = groups(drives)
            .map(|group| {
                let own = group.iter().filter_map(|j| {
                    let phasor = Complex64::from_polar(forces[*j].1, drives[*j].phase_rad);
                    Some(drives[*j].row.get(*j)?.travel[i] * phasor)
                });
                own.sum::<Complex64>().norm()
            })
            .sum();
        if table.electrodes.get(i).is_some_and(|electrodes| travel >= REACHED_PART * electrodes.most_travel_m()) {
            add(&mut found, Limitation::of(table, Limit::Travel, i));
        }
    }
    for row in table.limits.used(&forces, REACHED_PART) {
        if let Some((actuator, limit)) = table.limits.name(row) {
            add(&mut found, Limitation::of(table, limit, actuator));
        }
    }
    found
}
