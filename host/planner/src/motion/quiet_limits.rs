//! Drives that stay within the limits under moving masses, and are quiet where they have to be.

use crate::STANDARD_GRAVITY;
use crate::chosen_drive::{Chosen, peak};
use crate::motion::driven_panel::Settled;
use crate::motion::harmonics::compute_drive_harmonics;
use crate::motion::settle::{settle_drives, settled_peak_m_per_s2};
use crate::motion::strong_softening::settle_with_harmonics;
use crate::request::quiet_zones::{NO_PEAK, QuietResult, QuietZones};
use crate::request::surface_y_m;
use crate::table::PlanTable;
use nalgebra::DVector;

/// Scalings after the forces in moving gaps are known; one is enough where they are proportional to the voltage squared.
const MOST_SCALINGS: usize = 4;

/// Makes drives safe, and quiet where they have to be.
pub(crate) fn settle_within_quiet_zones(
    table: &PlanTable,
    zones: &QuietZones,
    drives: &mut [Chosen],
) -> Option<(Settled, Vec<QuietResult>)> {
    let mut settled = settle_drives(table, drives)?;
    let mut peaks = find_zone_peaks(table, zones, drives, &settled);
    for _ in 0..MOST_SCALINGS {
        let parts = zones.areas.iter().zip(&peaks).map(|(area, peak)| {
            let allowed = area.quiet.at_most_g * STANDARD_GRAVITY;
            if *peak > allowed.max(NO_PEAK) { allowed / peak } else { 1.0 }
        });
        let part = parts.fold(1.0, f64::min);
        if part >= 1.0 {
            break;
        }
        drives.iter_mut().for_each(|drive| drive.force_n *= part);
        let again = settle_drives(table, drives)?;
        let limited = settled.limited.or(again.limited);
        let scale = settled.scale * part * again.scale;
        settled = again;
        (settled.scale, settled.limited, settled.is_quieted) = (scale, limited, true);
        peaks = find_zone_peaks(table, zones, drives, &settled);
    }
    if zones.areas.is_empty() {
        return Some((settled, Vec::new()));
    }
    let harmonics = compute_drive_harmonics(table, drives, &settled);
    let results = zones.areas.iter().zip(peaks).map(|(area, peak)| QuietResult {
        x_m: area.quiet.x_m,
        y_m: surface_y_m(table, area.quiet.y_m),
        radius_m: area.quiet.radius_m,
        at_most_g: area.quiet.at_most_g,
        peak_g: peak / STANDARD_GRAVITY,
        harmonics_g: harmonics.most_g(area.points.iter()),
    });
    Some((settled, results.collect()))
}

/// Largest peak in each zone in m/s^2, at rest and settled.
fn find_zone_peaks(table: &PlanTable, zones: &QuietZones, drives: &[Chosen], settled: &Settled) -> Vec<f64> {
    if zones.areas.is_empty() {
        return Vec::new();
    }
    // The same motion that the target's softened peak is of.
    let closer = settle_with_harmonics(table, drives, settled);
    let settled = closer.as_ref().unwrap_or(settled);
    let at = |shape: &DVector<f64>| peak(drives, shape).max(settled_peak_m_per_s2(drives, settled, shape));
    zones.areas.iter().map(|area| area.points.iter().map(at).fold(0.0, f64::max)).collect()
}
