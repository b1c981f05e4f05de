//! Prediction against simulation on random scenes.

use super::args::Verify;
use super::progress::with_progress;
use super::{Failure, Outcome, print_json, print_text};
use crate::verify::Comparison;
use crate::verify::trials::{
    ALLOWED, LARGEST_BOUND, Options, Outcome as Tried, SAME, Trial, TrialError, Verdict, goes_too_far, try_scene,
    verdict,
};
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
    let found: Vec<Result<Vec<Trial>, (u64, TrialError)>> =
        with_progress("simulating", || pool.install(|| all().collect()));
    let (mut trials, mut without) = (Vec::new(), Vec::new());
    for scene in found {
        match scene {
            Ok(touches) => trials.extend(touches),
            Err((scene, error)) => without.push(format!("scene {scene}: {error}")),
        }
    }
    let counted = Counted::of(&trials);
    if options.json {
        let answer = json!({
            "seed": options.seed, "within": counted.within.len(), "compared": counted.all(),
            "bound_too_large": counted.apart.len(), "without_trials": without, "trials": trials,
        });
        print_json(&answer)?;
    } else {
        let mut text = report(&trials, &counted);
        without.iter().for_each(|line| {
            let _ = write!(text, "\nno touches on {line}");
        });
        let _ = write!(text, "\n{:.0} s", started.elapsed().as_secs_f64());
        print_text(&text)?;
    }
    let too_far = trials.iter().filter_map(Trial::comparison).filter(|c| goes_too_far(c)).count();
    if too_far > 0 {
        return Err(Failure::Failed(format!("{too_far} touches take a mass beyond a third of its gap")));
    }
    let part = part_of(counted.within.len(), counted.all());
    if part >= ENOUGH {
        return Ok(());
    }
    Err(Failure::Failed(format!("{:.1} % are within, fewer than {:.0} %", part * 100.0, ENOUGH * 100.0)))
}

/// The touches by how they count.
struct Counted<'a> {
    within: Vec<&'a Comparison>,
    outside: Vec<&'a Comparison>,
    /// Whose error bound is too large to prove anything.
    apart: Vec<&'a Comparison>,
    /// Plans that cannot be.
    failed: usize,
}

impl<'a> Counted<'a> {
    fn of(trials: &'a [Trial]) -> Self {
        let of = |wanted: Verdict| -> Vec<&'a Comparison> {
            trials.iter().filter_map(Trial::comparison).filter(|c| verdict(c) == wanted).collect()
        };
        let failed = trials.iter().filter(|trial| matches!(trial.outcome, Tried::Failed { .. })).count();
        Self { within: of(Verdict::Within), outside: of(Verdict::Outside), apart: of(Verdict::BoundTooLarge), failed }
    }

    /// Those of which a part has to be within.
    fn all(&self) -> usize {
        self.within.len() + self.outside.len() + self.failed
    }
}

#[expect(clippy::cast_precision_loss, reason = "small counts")]
fn part_of(some: usize, all: usize) -> f64 {
    if all == 0 { 0.0 } else { some as f64 / all as f64 }
}

fn report(trials: &[Trial], counted: &Counted<'_>) -> String {
    let judged: Vec<&Comparison> = counted.within.iter().chain(&counted.outside).copied().collect();
    let compared: Vec<&Comparison> = judged.iter().chain(&counted.apart).copied().collect();
    let passing = |difference: &dyn Fn(&Comparison) -> f64, among: &[&Comparison], with_bound: bool| {
        let allowed = |c: &Comparison| ALLOWED + if with_bound { c.error_bound.unwrap_or(0.0) } else { 0.0 };
        among.iter().filter(|c| difference(c).abs() <= allowed(c)).count()
    };
    let linear = passing(&|c| c.linear_difference, &judged, true);
    let mut text = format!(
        "{} touches. Compared: the sum of the amplitudes at the drives' frequencies (equation 23), fitted to the record of the\n\
         simulated device, with the plan's own figure for it. Allowed: the plan's error bound and {:.0} %.\n\
         within what is allowed of softened_peak_g  {} of {} ({:.1} %)\n\
         within {:.0} % without any bound             {} of them\n\
         within what is allowed of target_peak_g    {linear} of them ({:.1} %): forces of masses at rest\n\
         plan's softened_peak_g more than {:.1} % from the one worked out here: {} of {}\n\
         target_peak_g more than {:.1} % from it: {}",
        trials.len(),
        ALLOWED * 100.0,
        counted.within.len(),
        counted.all(),
        part_of(counted.within.len(), counted.all()) * 100.0,
        ALLOWED * 100.0,
        passing(&|c| c.difference, &judged, false),
        part_of(linear, counted.all()) * 100.0,
        SAME * 100.0,
        compared.iter().filter(|c| c.plan_difference.abs() > SAME).count(),
        compared.len(),
        SAME * 100.0,
        compared.iter().filter(|c| (c.linear_g / c.achieved_g - 1.0).abs() > SAME).count(),
    );
    if !counted.apart.is_empty() {
        let _ = write!(
            text,
            "\ncounted apart: {}, whose error bound is above {:.0} % and proves nothing; {} of them within {:.0} % all the same",
            counted.apart.len(),
            LARGEST_BOUND * 100.0,
            passing(&|c| c.difference, &counted.apart, false),
            ALLOWED * 100.0,
        );
    }
    figures(&mut text, &judged);
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
        let place = format!(
            "scene {} at ({:.1}, {:.1}) mm, {:.3} g asked for",
            trial.scene, trial.x_mm, trial.y_mm, trial.intensity_g
        );
        match (&trial.outcome, trial.comparison()) {
            (Tried::NoPlan { reason }, _) => {
                let _ = write!(text, "\nno plan: {place}: {reason}");
            }
            (Tried::Failed { reason }, _) => {
                let _ = write!(text, "\nfailed: {place}: {reason}");
            }
            (_, Some(c)) if trial.outlier().is_some() => outlier(&mut text, &place, c, trial.outlier()),
            _ => {}
        }
    }
    text
}

fn figures(text: &mut String, compared: &[&Comparison]) {
    text.push_str("\ndifference, % of the prediction       median     90 %     95 %     99 %  largest");
    let mut row = |name: &str, figure: &dyn Fn(&Comparison) -> Option<f64>| {
        let figures: Vec<f64> = compared.iter().filter_map(|c| figure(c)).map(f64::abs).collect();
        let _ = write!(text, "\n{name:36}");
        for part in [0.5, 0.9, 0.95, 0.99, 1.0] {
            let _ = write!(text, " {:8.3}", quantile(&figures, part) * 100.0);
        }
    };
    row("  the plan's softened_peak_g", &|c| Some(c.difference));
    row("  with harmonics, rounded", &|c| Some(c.achieved_difference));
    row("  and the damping it has in time", &|c| Some(c.causal_difference));
    row("  the plan's target_peak_g, linear", &|c| Some(c.linear_difference));
    row("  whole waveform, with softening", &|c| Some(c.band_difference));
    row("plan's softened from worked out", &|c| Some(c.plan_difference));
    row("error bound", &|c| c.error_bound);
    row("travel, % of the gap, predicted", &|c| Some(c.predicted_travel()));
    row("  simulated, switching on included", &|c| Some(c.simulated_travel()));
}

fn outlier(text: &mut String, place: &str, c: &Comparison, reason: Option<&str>) {
    let drives: Vec<String> = c
        .drives
        .iter()
        .map(|drive| format!("{} {:.1} Hz {:.0} V", drive.actuator, drive.frequency_hz, drive.voltage_v))
        .collect();
    let _ = write!(
        text,
        "\noutlier: {place}: planned {:.3e} g, simulated {:.3e} g, {:+.2} %, error bound {:.2} %\n  drives {}\n\
         \x20 worked out, each with one thing more: rounded {:.3e}, harmonics {:.3e}, damping in time {:.3e}, modes in time {:.3e} g\n\
         \x20 reason {}",
        c.predicted_g,
        c.simulated_g,
        c.difference * 100.0,
        c.error_bound.unwrap_or(0.0) * 100.0,
        drives.join(", "),
        c.rounded_g,
        c.achieved_g,
        c.causal_g,
        c.kept_g,
        reason.unwrap_or_default()
    );
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
