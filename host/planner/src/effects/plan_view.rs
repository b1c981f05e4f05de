//! A plan as it is told while an effect of it is played: with the effect's own figures in the place of the even motion's.

use super::design::EffectDesign;
use crate::Plan;
use crate::reports::report::Times;

impl EffectDesign {
    /// `plan`, the one that this effect was designed for, with what the effect does: its drives at full level, its limits, and its peaks at all
    /// targets. What is not worked out for effects (the mean elsewhere, the level above the threshold, quiet zones, the peak with masses that
    /// move) is that of the plan's even motion times [`Self::peak_as_fraction_of_steady_peak`]. The bound on the even motion's peak is none on the effect's:
    /// `error_bound` is `None`.
    #[must_use]
    pub fn plan_with_drives_and_predictions_of_effect(&self, plan: &Plan) -> Plan {
        let part = self.peak_as_fraction_of_steady_peak(plan);
        let mut played = plan.clone();
        // A click of single windows has no drives of its own: those of the place's plan stay.
        if !self.drives.is_empty() {
            played.drives = self.drives.iter().map(|designed| designed.drive.clone()).collect();
        }
        (played.limits, played.limited_by) = (self.limits.clone(), self.limited_by.clone());
        played.error_bound = None;
        let predicted = &mut played.predicted;
        predicted.target_peak_g = self.predicted.peak_g;
        predicted.mean_elsewhere_g *= part;
        predicted.softened_peak_g *= part;
        predicted.above_threshold_db =
            predicted.above_threshold_db.filter(|_| part > 0.0).map(|db| db + 20.0 * part.log10());
        for (target, peak_g) in played.targets.iter_mut().zip(&self.peaks_g) {
            target.peak_g = *peak_g;
        }
        for zone in &mut played.quiet {
            zone.peak_g *= part;
            zone.harmonics_g *= part;
        }
        played
    }

    /// The effect's peak at the first target over that of the plan's even motion: 1 where nothing moves.
    #[must_use]
    pub fn peak_as_fraction_of_steady_peak(&self, plan: &Plan) -> f64 {
        let even_g = plan.predicted.target_peak_g;
        if even_g > 0.0 { self.predicted.peak_g / even_g } else { 1.0 }
    }

    /// When the first target has its peak, counted from the effect's start, and when it is below a tenth of it, from the effect's end.
    #[must_use]
    pub fn peak_time_from_start_and_decay_time_from_end_at_first_target(&self) -> Times {
        Times {
            reaches_90_ms: (self.predicted.peak_g > 0.0).then_some(self.predicted.peak_at_ms),
            decays_to_10_ms: self.predicted.quiet_ms.map(|quiet_ms| (quiet_ms - self.length_ms).max(0.0)),
        }
    }
}
