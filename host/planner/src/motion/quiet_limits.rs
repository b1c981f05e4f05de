//! Drives that keep the limits under moving masses and in quiet zones.

use crate::STANDARD_GRAVITY;
use crate::chosen_drive::{ChosenDrive, fundamental_acceleration_peak_at_point_m_per_s2};
use crate::motion::driven_panel::SettledMotion;
use crate::motion::harmonics::compute_drive_harmonics_on_finest_model;
use crate::motion::settle::{
    derate_drives_until_safe_and_settle_if_possible, settled_peak_acceleration_at_point_m_per_s2,
};
use crate::motion::strong_softening::solve_motion_with_harmonics_if_pulses_are_narrow;
use crate::request::quiet_zones::{NO_PEAK, QuietResult, QuietZones};
use crate::request::y_or_bar_axis_y_m;
use crate::table::PlanTable;
use nalgebra::DVector;

/// Scalings after the forces in moving gaps are known; one is enough where they are proportional to the voltage squared.
const MOST_SCALINGS: usize = 4;

/// Derates drives until they are safe and keep the limits of the quiet zones; returns the motion and the peaks in the
/// zones. `None` if they are safe at no scale.
pub(crate) fn derate_drives_to_safety_and_quiet_limits_if_possible(
    table: &PlanTable,
    zones: &QuietZones,
    drives: &mut [ChosenDrive],
) -> Option<(SettledMotion, Vec<QuietResult>)> {
    let mut settled = derate_drives_until_safe_and_settle_if_possible(table, drives)?;
    let mut peaks = find_largest_peak_in_each_quiet_zone_m_per_s2(table, zones, drives, &settled);
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
        let again = derate_drives_until_safe_and_settle_if_possible(table, drives)?;
        let limited = settled.limited.or(again.limited);
        let scale = settled.scale * part * again.scale;
        settled = again;
        (settled.scale, settled.limited, settled.is_quieted) = (scale, limited, true);
        peaks = find_largest_peak_in_each_quiet_zone_m_per_s2(table, zones, drives, &settled);
    }
    if zones.areas.is_empty() {
        return Some((settled, Vec::new()));
    }
    let harmonics = compute_drive_harmonics_on_finest_model(table, drives, &settled);
    let results = zones.areas.iter().zip(peaks).map(|(area, peak)| QuietResult {
        x_m: area.quiet.x_m,
        y_m: y_or_bar_axis_y_m(table, area.quiet.y_m),
        radius_m: area.quiet.radius_m,
        at_most_g: area.quiet.at_most_g,
        peak_g: peak / STANDARD_GRAVITY,
        harmonics_g: harmonics.max_harmonic_peak_sum_over_points_g(area.points.iter()),
    });
    Some((settled, results.collect()))
}

/// Largest peak in each zone in m/s^2, of masses at rest and of the steady motion.
fn find_largest_peak_in_each_quiet_zone_m_per_s2(
    table: &PlanTable,
    zones: &QuietZones,
    drives: &[ChosenDrive],
    settled: &SettledMotion,
) -> Vec<f64> {
    if zones.areas.is_empty() {
        return Vec::new();
    }
    // The same motion that the target's softened peak is of.
    let closer = solve_motion_with_harmonics_if_pulses_are_narrow(table, drives, settled);
    let settled = closer.as_ref().unwrap_or(settled);
    let at = |shape: &DVector<f64>| {
        fundamental_acceleration_peak_at_point_m_per_s2(drives, shape)
            .max(settled_peak_acceleration_at_point_m_per_s2(drives, settled, shape))
    };
    zones.areas.iter().map(|area| area.points.iter().map(at).fold(0.0, f64::max)).collect()
}
