//! Prediction against simulation, point by point.

use super::args::Verify;
use super::panel::load_or_compute_plan_table;
use super::progress::run_with_progress;
use super::{CommandResult, Failure, print_json, print_text_after_queued_log};
use crate::planner::Target;
use crate::verify::{SimulationComparison, VerifyError, compare_plans_at_points_with_simulation, spread_points_over};
use serde_json::json;
use std::fmt::Write;

/// Most points: a day of simulation.
const MOST_POINTS: u32 = 100_000;

pub fn verify_plans_by_time_simulation_failing_above_limit(options: &Verify) -> CommandResult {
    if !(1..=MOST_POINTS).contains(&options.points) {
        return Err(Failure::Usage(format!("--points is {}, but must be 1 to {MOST_POINTS}", options.points)));
    }
    if options.limit.is_nan() || options.limit < 0.0 {
        return Err(Failure::Usage(format!("--limit is {}, but must be 0 or more", options.limit)));
    }
    // Before anything is simulated; a point's own message would name no option.
    if !options.intensity_g.is_finite() || options.intensity_g < 0.0 {
        return Err(Failure::Usage(format!(
            "--intensity-g is {}, but must be a finite number, 0 or more",
            options.intensity_g
        )));
    }
    let scene = options.panel.load_scene()?;
    let table = load_or_compute_plan_table(&options.panel, options.keep, &scene)?;
    let target = |(x_m, y_m)| Target { x_m, y_m, intensity_g: Some(options.intensity_g) };
    let targets: Vec<Target> = spread_points_over(&scene, options.points).into_iter().map(target).collect();
    let results = run_with_progress("simulating", || compare_plans_at_points_with_simulation(&table, &targets))
        .map_err(|error| match error {
            VerifyError::Plan(error) => error.into(),
            error => Failure::runtime_error(error),
        })?;
    let worst = results.iter().map(|c| c.difference.abs().max(c.band_difference.abs())).fold(0.0, f64::max);
    if options.json {
        print_json(&json!({"scene": scene.name, "points": results, "largest_difference": worst}))?;
    } else {
        print_text_after_queued_log(&format_predicted_and_simulated_peaks(&scene.name, &results, worst))?;
    }
    if worst <= options.limit {
        return Ok(());
    }
    Err(Failure::Failed(format!(
        "the largest difference is {:.2} %, but must be at most {:.2} % (--limit)",
        worst * 100.0,
        options.limit * 100.0
    )))
}

fn format_predicted_and_simulated_peaks(
    scene_name: &str,
    results: &[SimulationComparison],
    largest_difference: f64,
) -> String {
    let mut text = format!(
        "{scene_name}: peak acceleration at the target in g, predicted (frequency domain) and simulated (time domain)\n\
         \x20             drives                     fundamentals                         waveform up to 1 kHz\n\
         \x20 x mm   y mm  Hz                       predicted simulated  diff    linear    predicted simulated  diff"
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
    let _ = write!(
        text,
        "\ndiff: relative difference between the simulated peak and the predicted peak; linear: relative difference \
         between the simulated fundamentals and a peak that is predicted with the forces at the rest gaps\n\
         largest difference (the column \"linear\" is not counted): {:.2} %",
        largest_difference * 100.0
    );
    text
}
