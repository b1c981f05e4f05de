//! Drives that stay within the limits under moving masses, and are quiet where they have to be.

use crate::STANDARD_GRAVITY;
use crate::chosen::{Chosen, peak};
use crate::motion::safe::Settled;
use crate::table::PlanTable;
use crate::wish::quiet::{NO_PEAK, QuietResult, QuietZones};
use nalgebra::DVector;

/// Scalings after the forces in moving gaps are known; one is enough where they are proportional to the voltage squared.
const MOST_SCALINGS: usize = 4;

impl PlanTable {
    /// Makes drives safe, and quiet where they have to be.
    pub(crate) fn settled_quietly(
        &self,
        zones: &QuietZones,
        drives: &mut [Chosen],
    ) -> Option<(Settled, Vec<QuietResult>)> {
        let mut settled = self.settled(drives)?;
        let mut peaks = self.peaks_in(zones, drives, &settled);
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
            let again = self.settled(drives)?;
            let limited = settled.limited.or(again.limited);
            let scale = settled.scale * part * again.scale;
            settled = again;
            (settled.scale, settled.limited, settled.is_quieted) = (scale, limited, true);
            peaks = self.peaks_in(zones, drives, &settled);
        }
        if zones.areas.is_empty() {
            return Some((settled, Vec::new()));
        }
        let harmonics = self.harmonics(drives, &settled);
        let results = zones.areas.iter().zip(peaks).map(|(area, peak)| QuietResult {
            x_m: area.quiet.x_m,
            y_m: self.y_m(area.quiet.y_m),
            radius_m: area.quiet.radius_m,
            at_most_g: area.quiet.at_most_g,
            peak_g: peak / STANDARD_GRAVITY,
            harmonics_g: harmonics.most_g(area.points.iter()),
        });
        Some((settled, results.collect()))
    }

    /// Largest peak in each zone in m/s^2, at rest and settled.
    fn peaks_in(&self, zones: &QuietZones, drives: &[Chosen], settled: &Settled) -> Vec<f64> {
        if zones.areas.is_empty() {
            return Vec::new();
        }
        // The same motion that the target's softened peak is of.
        let closer = self.among_harmonics(drives, settled);
        let settled = closer.as_ref().unwrap_or(settled);
        let at = |shape: &DVector<f64>| peak(drives, shape).max(self.settled_peak(drives, settled, shape));
        zones.areas.iter().map(|area| area.points.iter().map(at).fold(0.0, f64::max)).collect()
    }
}
