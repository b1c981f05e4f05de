//! `era effect`: an effect as the board would play it, and what the panel would do.

use super::args::{At, Keep, Panel, Rhythm};
use super::headings::TOUCH;
use super::panel::{bounds_of, target, tell_plan, touched_table};
use super::{Failure, Outcome, print_json, print_text};
use crate::effects::{self, DesignError, EffectRequest, Intensity, NamedEffect, design, intensity, plan_with};
use crate::model::Bound;
use crate::planner::Request;
use crate::planner::rise::RiseTimes;
use clap::Args;
use serde_json::json;
use std::fmt::Write;
use std::time::Instant;

/// An effect to design.
#[derive(Clone, Debug, Args)]
pub struct EffectOptions {
    #[command(flatten)]
    pub panel: Panel,
    #[command(flatten)]
    pub keep: Keep,
    #[command(flatten)]
    pub at: At,
    /// The same in dB above the threshold of feeling
    #[arg(long, value_name = "DB", allow_negative_numbers = true, conflicts_with = "intensity_g", help_heading = TOUCH)]
    pub intensity_db: Option<f64>,
    /// Which effect
    #[arg(value_name = "NAME", required_unless_present = "effect", conflicts_with = "effect")]
    pub name: Option<NamedEffect>,
    /// The same as an option
    #[arg(long, value_name = "NAME", hide_possible_values = true)]
    pub effect: Option<NamedEffect>,
    /// Duration in ms
    #[arg(long, value_name = "T", allow_negative_numbers = true)]
    pub duration_ms: Option<f64>,
    #[command(flatten)]
    pub rhythm: Rhythm,
    /// Print JSON
    #[arg(long)]
    pub json: bool,
}

pub fn run_effect(options: &EffectOptions) -> Outcome {
    let scene = options.panel.load()?;
    let effect = options.name.or(options.effect).ok_or_else(|| Failure::usage("no effect is named"))?;
    let request = EffectRequest {
        effect,
        duration_ms: options.duration_ms,
        count: options.rhythm.count,
        period_ms: options.rhythm.period_ms,
    };
    request.envelope().map_err(Failure::usage)?;
    let target = target(&scene, &options.at)?;
    let table = touched_table(&options.panel, options.keep, &scene, &[(target.x_m, target.y_m)])?;
    let rise = RiseTimes::prepare(&table.model).ok_or(DesignError::Unbounded).map_err(Failure::failed)?;
    let wanted = options.at.intensity_g.map(Intensity::G).or(options.intensity_db.map(Intensity::AboveThresholdDb));
    let plan = plan_with(&table, || Some(&rise), &Request::touch(&[target]), wanted)?;
    let started = Instant::now();
    let design = design(&table, &rise, &plan, request).map_err(Failure::failed)?;
    let elapsed_ms = started.elapsed().as_secs_f64() * 1e3;
    let shape = intensity::shape_of(&table, target.x_m, target.y_m);
    let drives = intensity::forces(&table, &plan);
    let accuracy = options.panel.accuracy()?;
    tell_plan(&[&plan], accuracy, options.panel.explain);
    let (timing, level_db) = (rise.times(&shape, &drives), intensity::level_db(&rise, &shape, &drives));
    if options.json {
        let mut answer = json!(effects::view::EffectView::new(&design));
        answer["elapsed_ms"] = json!(elapsed_ms);
        answer["plan"] = json!(plan);
        answer["tolerance"] = json!(accuracy.relative_tolerance());
        answer["tolerance_met"] = json!(Bound::all_meet_accuracy(&bounds_of(&[&plan]), accuracy));
        answer["plan_timing"] = json!(timing);
        // The same as the daemon says it.
        answer["times"] = json!(crate::planner::report::compute_times(&table, &plan));
        answer["plan_level_db"] = json!(level_db);
        return print_json(&answer);
    }
    let predicted = design.predicted;
    let mut text = format!("{} at {:.1} mm, {:.1} mm", effect.name(), 1e3 * plan.target_m[0], 1e3 * plan.target_m[1]);
    for designed in &design.drives {
        let drive = &designed.drive;
        let _ = write!(
            text,
            "\n  {:12} {:7.2} Hz  {:7.1} V  {:.4} N  {}",
            drive.actuator,
            drive.frequency_hz,
            drive.voltage_v,
            drive.force_n,
            effects::view::text(designed)
        );
    }
    let _ = write!(
        text,
        "\npeak {:.3} g ({:.3} to {:.3} g as the drives' cycles fall together) {:.1} ms after the start",
        predicted.peak_g, predicted.peak_least_g, predicted.peak_most_g, predicted.peak_at_ms
    );
    let ms = |time: Option<f64>| {
        time.map_or_else(|| "more than 300 ms after the end".to_owned(), |ms| format!("{ms:.1} ms"))
    };
    let _ = write!(
        text,
        "\nresidual vibration after the end {:.1} % of the peak, below a tenth from {} on",
        1e2 * predicted.residual,
        ms(predicted.quiet_ms)
    );
    if let Some(unbraked) = predicted.quiet_unbraked_ms {
        let _ = write!(text, " (without the brake {})", ms(Some(unbraked)));
    }
    let _ = write!(text, "\ndesigned in {elapsed_ms:.1} ms");
    if let Some(limit) = &design.limited_by {
        let _ = write!(text, "\nlimited by {limit}");
    }
    print_text(&text)
}
