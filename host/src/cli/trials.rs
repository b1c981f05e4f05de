//! Prediction against simulation on random scenes.

use super::args::Verify;
use super::progress::with_progress;
use super::{Failure, Outcome, print_json, print_text};
use crate::verify::Comparison;
use crate::verify::trials::{ALLOWED, Options, Outcome as Tried, Trial, try_scene, within};
use rayon::prelude::*;
use serde_json::json;
use std::collections::BTreeMap;
use std::fmt::Write;
use std::time::Instant;

/// Most scenes and touches: a day of simulation.
const MOST: u64 = 100_000;
/// Part of all touches that has to be within what is allowed.
const ENOUGH: f64 = 0.95;

pub fn run(options: &Verify, scenes: u64) -> Outcome {
    for (option, value) in [("--scenes", scenes), ("--touches", u64::from(options.touches))] {
        if !(1..=MOST).contains(&value) {
            return Err(Failure::Usage(format!("{option} {value} is not in the allowed range 1 to {MOST}")));
        }
    }
    let started = Instant::now();
    let trying = Options { seed: options.seed, touches: options.touches, accuracy: options.panel.accuracy()? };
    let pool = rayon::ThreadPoolBuilder::new().num_threads(options.jobs.unwrap_or(0).into()).build();
    let pool = pool.map_err(Failure::failed)?;
    let all = || (0..scenes).into_par_iter().map(|scene| try_scene(&trying, scene).map_err(|error| (scene, error)));
    let trials: Vec<Trial> = with_progress("simulating", || pool.install(|| all().collect::<Result<Vec<_>, _>>()))
        .map_err(|(scene, error)| Failure::Failed(format!("random scene {scene}: {error}")))?
        .into_iter()
        .flatten()
        .collect();
    let compared: Vec<&Comparison> = trials.iter().filter_map(Trial::comparison).collect();
    let good = compared.iter().filter(|comparison| within(comparison)).count();
    if options.json {
        print_json(&json!({"seed": options.seed, "within": good, "compared": compared.len(), "trials": trials}))?;
    } else {
        let mut text = report(&trials, &compared, good);
        let _ = write!(text, "\n{:.0} s", started.elapsed().as_secs_f64());
        print_text(&text)?;
    }
    let part = part_of(good, compared.len());
    if part >= ENOUGH {
        return Ok(());
    }
    Err(Failure::Failed(format!("{:.1} % are within, fewer than {:.0} %", part * 100.0, ENOUGH * 100.0)))
}

#[allow(clippy::cast_precision_loss, reason = "small counts")]
fn part_of(some: usize, all: usize) -> f64 {
    if all == 0 { 0.0 } else { some as f64 / all as f64 }
}

fn report(trials: &[Trial], compared: &[&Comparison], good: usize) -> String {
    let mut text = format!(
        "{} touches. Compared: the sum of the amplitudes at the drives' frequencies (equation 23), fitted to the record of the\n\
         simulated device, from the predicted one. Allowed: the plan's error bound and {:.0} %.\n\
         within what is allowed  {good} of {} compared ({:.1} %)\n\
         difference, % of the prediction       median     90 %     95 %     99 %  largest",
        trials.len(),
        ALLOWED * 100.0,
        compared.len(),
        part_of(good, compared.len()) * 100.0
    );
    let mut row = |name: &str, figures: Vec<f64>| {
        let _ = write!(text, "\n{name:36}");
        for part in [0.5, 0.9, 0.95, 0.99, 1.0] {
            let _ = write!(text, " {:8.3}", quantile(&figures, part) * 100.0);
        }
    };
    let of = |figure: &dyn Fn(&Comparison) -> Option<f64>| -> Vec<f64> {
        compared.iter().filter_map(|comparison| figure(comparison)).map(f64::abs).collect()
    };
    row("  with softening", of(&|c| Some(c.difference)));
    row("  and the damping it has in time", of(&|c| Some(c.causal_difference.unwrap_or(c.difference))));
    row("  linear (the plan's target_peak_g)", of(&|c| Some(c.linear_difference)));
    row("  whole waveform, with softening", of(&|c| Some(c.band_difference)));
    row("error bound", of(&|c| c.error_bound));
    row("travel, % of the gap, predicted", of(&|c| Some(c.predicted_travel())));
    row("  simulated, switching on included", of(&|c| Some(c.simulated_travel())));
    let mut reasons = BTreeMap::<&str, usize>::new();
    for trial in trials {
        if let Tried::NotCompared { reason } = &trial.outcome {
            *reasons.entry(reason).or_default() += 1;
        }
    }
    for (reason, count) in reasons {
        let _ = write!(text, "\nnot compared: {count}, {reason}");
    }
    for trial in trials {
        let (Some(c), Some(reason)) = (trial.comparison(), trial.outlier()) else { continue };
        let drives: Vec<String> = c
            .drives
            .iter()
            .map(|drive| format!("{} {:.0} Hz {:.0} V", drive.actuator, drive.frequency_hz, drive.voltage_v))
            .collect();
        let _ = write!(
            text,
            "\noutlier: scene {} at ({:.1}, {:.1}) mm, {:.3} g asked for: predicted {:.4} g, simulated {:.4} g, {:+.2} %\n\
             \x20 drives {}\n  reason {reason}",
            trial.scene,
            c.x_mm,
            c.y_mm,
            trial.intensity_g,
            c.predicted_g,
            c.simulated_g,
            c.difference * 100.0,
            drives.join(", ")
        );
    }
    text
}

#[allow(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    clippy::cast_precision_loss,
    reason = "a place in a list"
)]
fn quantile(figures: &[f64], part: f64) -> f64 {
    let mut sorted = figures.to_vec();
    sorted.sort_by(f64::total_cmp);
    let at = (part * sorted.len() as f64).ceil() as usize;
    sorted.get(at.max(1) - 1).copied().unwrap_or(f64::NAN)
}
