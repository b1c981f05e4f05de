//! Why a plan is what it is: `era plan --explain`.

use crate::planner::explain::{Explanation, LEAST_HARMONICS_DB};
use std::fmt::Write;

/// The text.
#[must_use]
pub fn format_explanation(explanation: &Explanation) -> String {
    let mut text = String::from("candidates: the best frequencies of each actuator, as if only this actuator vibrated");
    for candidates in &explanation.candidates {
        for frequency in &candidates.frequencies {
            let chosen = if frequency.chosen { "  <- chosen, or next to the chosen frequency" } else { "" };
            let _ = write!(
                text,
                "\n  {:12} {:7.2} Hz  contrast {:5.1} dB  reaches {:8.3} g, limited by {}{chosen}",
                candidates.actuator, frequency.frequency_hz, frequency.contrast_db, frequency.reach_g, frequency.limit
            );
        }
    }
    let _ = write!(
        text,
        "\npulse widths, compared at one voltage: force; harmonics up to 1 kHz relative to the fundamentals, averaged over the surface (\"none\": below {LEAST_HARMONICS_DB} dB)"
    );
    for width in &explanation.pulse_widths {
        let harmonics = width.harmonics_db.map_or_else(|| String::from("none"), |db| format!("{db:.1} dB"));
        let _ = write!(text, "\n  {:.3}  force {:.3}  harmonics {harmonics}", width.pulse_width, width.force);
    }
    text.push_str("\nalternatives: peak at the target, contrast and power");
    for other in &explanation.alternatives {
        let _ = write!(
            text,
            "\n  {:44} {:8.3} g  contrast {:5.1} dB  {:8.2} mW",
            other.change, other.target_peak_g, other.contrast_db, other.power_mw
        );
        if let Some(limit) = &other.limited_by {
            let _ = write!(text, "  limited by {limit}");
        }
        if let Some(weakest_g) = other.weakest_g {
            let _ = write!(
                text,
                "\n  {:44} the same actuator settings for a touch at any place: the weakest place of the surface gets \
                 {weakest_g:.3} g, the target gets the peak in the line above",
                ""
            );
        }
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::Accuracy;
    use crate::model::levels::ReducedLevels;
    use crate::planner::{PlanTable, Request, TableOptions, Target};
    use crate::scene::{EXAMPLE_BAR, Scene};

    #[test]
    fn everything_asked_for_is_reported() {
        let scene = Scene::parse("bar", EXAMPLE_BAR).unwrap();
        let options = TableOptions::for_preview();
        let levels = ReducedLevels::build(&scene, Accuracy::FAST, options.to_hz).unwrap();
        let table = PlanTable::from_levels(&scene, levels, options).unwrap();
        let request = Request::for_touch(&[Target { x_m: 0.06, y_m: 0.0, intensity_g: Some(0.3) }]);
        let explanation = crate::planner::explain::explain_plan(&table, &request).unwrap();
        assert_eq!(explanation.candidates.len(), 2);
        for candidates in &explanation.candidates {
            assert_eq!(candidates.frequencies.iter().filter(|frequency| frequency.chosen).count().min(1), 1);
        }
        let two_thirds = &explanation.pulse_widths[1];
        assert!(two_thirds.harmonics_db < explanation.pulse_widths[0].harmonics_db, "{:?}", explanation.pulse_widths);
        // No alternative for contrast has more of it than this plan at the same peak, but with phases or one more actuator.
        let own = &explanation.alternatives[0];
        assert!((own.target_peak_g - 0.3).abs() < 1e-6);
        let of = |name: &str| explanation.alternatives.iter().find(|other| other.change.contains(name)).unwrap();
        assert!(of("power").power_mw < own.power_mw && of("power").contrast_db < own.contrast_db + 1e-9);
        assert!(of("one more").target_peak_g > 0.299);
        let text = format_explanation(&explanation);
        for piece in [
            "candidates",
            "pulse widths",
            "objective reach",
            "weakest place of the surface",
            "phases",
            "one more actuator like left",
            "<- chosen",
        ] {
            assert!(text.contains(piece), "{piece} is not in {text}");
        }
    }
}
