//! Prediction against simulation, point by point.

use super::args::Verify;
use super::panel::plan_table;
use super::progress::with_progress;
use super::{Failure, Outcome, print_json, print_text};
use crate::planner::Target;
use crate::verify::{Comparison, VerifyError, compare_all, spread_points_over};
use serde_json::json;
use std::fmt::Write;

/// Most points: a day of simulation.
const MOST_POINTS: u32 = 100_000;

pub fn run_verify(options: &Verify) -> Outcome {
    if !(1..=MOST_POINTS).contains(&options.points) {
        return Err(Failure::Usage(format!(
            "--points {} is not in the allowed range 1 to {MOST_POINTS}",
            options.points
        )));
    }
    if options.limit.is_nan() || options.limit < 0.0 {
        return Err(Failure::Usage(format!("--limit {} is not in the allowed range 0 and up", options.limit)));
    }
    // Before anything is simulated; a point's own message would name no option.
    if !options.intensity_g.is_finite() || options.intensity_g < 0.0 {
        return Err(Failure::Usage(format!(
            "--intensity-g {} is not in the allowed range: a finite number, 0 and up",
            options.intensity_g
        )));
    }
    let scene = options.panel.load()?;
    let table = plan_table(&options.panel, options.keep, &scene)?;
    let target = |(x_m, y_m)| Target { x_m, y_m, intensity_g: Some(options.intensity_g) };
    let targets: Vec<Target> = spread_points_over(&scene, options.points).into_iter().map(target).collect();
    let results = with_progress("simulating", || compare_all(&table, &targets)).map_err(|error| match error {
        VerifyError::Plan(error) => error.into(),
        error => Failure::failed(error),
    })?;
    let worst = results.iter().map(|c| c.difference.abs().max(c.band_difference.abs())).fold(0.0, f64::max);
    if options.json {
        print_json(&json!({"scene": scene.name, "points": results, "largest_difference": worst}))?;
    } else {
        print_text(&format_comparisons(&scene.name, &results, worst))?;
    }
    if worst <= options.limit {
        return Ok(());
    }
    Err(Failure::Failed(format!(
        "the largest difference is {:.2} %, more than the {:.2} % allowed",
        worst * 100.0,
        options.limit * 100.0
    )))
}

fn format_comparisons(name: &str, results: &[Comparison], worst: f64) -> String {
    let mut text = format!(
        "{name}: peak acceleration at the target in g, predicted (frequency domain) and simulated (time domain)\n\
         \x20             drives                     fundamentals (eq. 23)     from linear  whole waveform to 1 kHz\n\
         \x20 x mm   y mm  Hz                       predicted simulated  diff   diff         predicted simulated  diff"
    );
    for c in results {
        let drives = c.drives.iter().map(|drive| format!("{:.0}", drive.frequency_hz)).collect::<Vec<_>>().join(" + ");
        let _ = write!(
            text,
            "\n{:6.1} {:6.1}  {drives:24} {:9.4} {:9.4} {:+5.2} % {:+5.2} %   {:9.4} {:9.4} {:+5.2} %",
            c.x_mm,
            c.y_mm,
            c.predicted_g,
            c.simulated_g,
            c.difference * 100.0,
            c.linear_difference * 100.0,
            c.predicted_band_g,
            c.simulated_band_g,
            c.band_difference * 100.0
        );
    }
    let _ = write!(text, "\nlargest difference {:.2} %", worst * 100.0);
    text
}
