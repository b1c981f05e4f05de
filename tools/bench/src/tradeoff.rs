//! (a): what accuracy costs.

use crate::case::{CaseOutcome, POINT_M, list_response_frequencies_hz, run_case_in_child_process};
use crate::clock::compute_median;
use crate::environment::Environment;
use crate::error::Error;
use crate::own::{NEXT, TIGHTEST};
use crate::problem::{MAX_HZ, Problem, compute_acceleration_curves_on_mesh, make_lightly_damped_plate_toml};
use crate::references::{ReferencePanel, list_reference_panels};
use crate::table::{Table, format_bytes, format_relative_error, format_three_digits, format_time};
use num_complex::Complex64;
use std::path::Path;

/// The tolerances.
const TOLERANCES: [f64; 8] = [1e-1, 1e-2, 1e-3, 1e-4, 1e-5, 1e-6, 1e-7, 1e-8];

/// What an answer to one tolerance takes, and how exact it is.
#[derive(Clone, Copy, Debug)]
pub struct TimeErrorAndBound {
    /// Median in s.
    pub time_s: f64,
    /// Of what was computed.
    pub error: f64,
    /// What the program said of it; NaN if it said nothing.
    pub bound: f64,
}

fn choose_run_count(environment: &Environment) -> usize {
    if environment.quick { 1 } else { 5 }
}

fn list_tolerances(environment: &Environment) -> Vec<f64> {
    TOLERANCES.iter().copied().step_by(if environment.quick { 2 } else { 1 }).collect()
}

/// Several runs of one case: the last's outcome with the median of the times.
fn run_case_repeatedly_with_median_time(
    environment: &Environment,
    kind: &str,
    scene: &Path,
    tolerance: f64,
    max_hz: f64,
) -> Result<CaseOutcome, Error> {
    let options = [("--tolerance", tolerance.to_string()), ("--max-hz", max_hz.to_string())];
    let mut all = Vec::new();
    for _ in 0..choose_run_count(environment) {
        all.push(run_case_in_child_process(environment, kind, scene, &options)?);
    }
    let time = compute_median(all.iter().map(|outcome| outcome.elapsed_s).collect());
    Ok(CaseOutcome { elapsed_s: time, ..all.pop().unwrap_or_default() })
}

/// The largest bound; NaN if one is missing.
fn find_largest_bound_or_nan_if_any_missing(bounds: &[Option<f64>]) -> f64 {
    bounds
        .iter()
        .map(|bound| bound.unwrap_or(f64::NAN))
        .fold(0.0, |a, b| if a.is_nan() || b.is_nan() { f64::NAN } else { a.max(b) })
}

/// Responses of the starting plate at a point.
///
/// # Errors
/// Those of the cases, [`Error::File`].
pub fn build_table_and_plot_points_of_responses(
    environment: &Environment,
    problem: &Problem,
) -> Result<(Table, Vec<TimeErrorAndBound>), Error> {
    let columns = [
        "tolerance",
        "time",
        "peak memory",
        "order",
        "unknowns",
        "coordinates",
        "meshes",
        "true error",
        "bound",
        "bound / error",
    ];
    let mut table = Table::new("(a) What accuracy costs: responses", &columns);
    let frequencies_hz = list_response_frequencies_hz(MAX_HZ);
    let tightest = compute_acceleration_curves_on_mesh(&problem.scene, TIGHTEST, &frequencies_hz, &[POINT_M])?;
    let next = compute_acceleration_curves_on_mesh(&problem.scene, NEXT, &frequencies_hz, &[POINT_M])?;
    let uncertainty = tightest.compute_largest_relative_error(|curve, f| next.values[curve * next.count + f]);
    let scene = environment.scratch.join("plate.toml");
    std::fs::write(&scene, make_lightly_damped_plate_toml()?).map_err(Error::file_error(&scene))?;
    let mut points = Vec::new();
    for tolerance in list_tolerances(environment) {
        let outcome = run_case_repeatedly_with_median_time(environment, "response", &scene, tolerance, MAX_HZ)?;
        let count = frequencies_hz.len();
        let error = tightest.compute_largest_relative_error(|curve, f| {
            let (re, im) = outcome.curves[curve * count + f];
            Complex64::new(re, im)
        });
        let bound = find_largest_bound_or_nan_if_any_missing(&outcome.bounds);
        table.add_row([
            format_relative_error(tolerance),
            format_time(outcome.elapsed_s),
            format_bytes(outcome.peak_bytes),
            outcome.order.to_string(),
            outcome.unknowns.to_string(),
            outcome.coordinates.to_string(),
            outcome.levels.to_string(),
            format_relative_error(error),
            format_relative_error(bound),
            format_three_digits(bound / error),
        ]);
        points.push(TimeErrorAndBound { time_s: outcome.elapsed_s, error, bound });
    }
    table.above.push(format!(
        "The scene is the starting plate with a loss factor of 0.005. The program computes the acceleration at {}, {} \
         mm for 1 N at each of two actuators, and the bound, at {} frequencies from 50 to 1000 Hz. \"Time\" is for all \
         meshes of the sequence, from the scene to the answer, in a separate process. The error is the difference from \
         the most accurate answer, relative to the peak of the curve. The most accurate answer has elements of order \
         {} and cells of {} mm. With elements of the next lower order, the answer differs by {}.",
        POINT_M.0 * 1e3,
        POINT_M.1 * 1e3,
        frequencies_hz.len(),
        TIGHTEST.order,
        TIGHTEST.cell_m * 1e3,
        format_relative_error(uncertainty)
    ));
    Ok((table, points))
}

/// Modes of panels with known frequencies.
///
/// # Errors
/// Those of the cases, [`Error::File`].
pub fn build_table_and_plot_points_of_mode_frequencies(
    environment: &Environment,
) -> Result<(Table, Vec<TimeErrorAndBound>), Error> {
    let columns = [
        "tolerance",
        "time",
        "peak memory",
        "unknowns",
        "largest error",
        "its panel",
        "largest bound",
        "bound / error, median",
        "bounds below the error",
    ];
    let mut table = Table::new("(a) What accuracy costs: frequencies against known ones", &columns);
    let references = list_reference_panels();
    let mut scenes = Vec::new();
    for (k, reference) in references.iter().enumerate() {
        let scene = environment.scratch.join(format!("reference-{k}.toml"));
        std::fs::write(&scene, &reference.scene).map_err(Error::file_error(&scene))?;
        scenes.push(scene);
    }
    let mut points = Vec::new();
    for tolerance in list_tolerances(environment) {
        let (mut time_s, mut peak, mut unknowns) = (0.0, 0.0_f64, 0);
        let (mut worst, mut panel, mut bound, mut ratios, mut below) = (0.0, "", 0.0_f64, Vec::new(), 0);
        let mut modes = 0;
        for (reference, scene) in references.iter().zip(&scenes) {
            let highest = reference.frequencies_hz.last().copied().unwrap_or(1.0);
            let outcome = run_case_repeatedly_with_median_time(environment, "modes", scene, tolerance, 1.01 * highest)?;
            time_s += outcome.elapsed_s;
            peak = peak.max(outcome.peak_bytes);
            unknowns = unknowns.max(outcome.unknowns);
            for (error, own_bound) in list_errors_and_bounds_of_known_modes(reference, &outcome) {
                if error > worst {
                    (worst, panel) = (error, reference.name);
                }
                bound = if own_bound.is_nan() { f64::NAN } else { bound.max(own_bound) };
                modes += 1;
                if error > 2.0 * KNOWN_TO {
                    ratios.push(own_bound / error);
                }
                below += usize::from(own_bound < error - KNOWN_TO);
            }
        }
        table.add_row([
            format_relative_error(tolerance),
            format_time(time_s),
            format_bytes(peak),
            unknowns.to_string(),
            format_relative_error(worst),
            String::from(panel),
            format_relative_error(bound),
            if ratios.is_empty() { String::from("-") } else { format_three_digits(compute_median(ratios)) },
            format!("{below} of {modes}"),
        ]);
        points.push(TimeErrorAndBound { time_s, error: worst, bound });
    }
    let names: Vec<_> = references.iter().map(|reference| reference.name).collect();
    table.above.push(format!(
        "The {} panels are: {}. \"Time\" is for all panels together. For unknowns and memory, the table has the \
         largest value of all panels. The references have nine or ten digits, so errors below {KNOWN_TO:.0e} cannot be \
         measured.",
        names.len(),
        names.join("; ")
    ));
    Ok((table, points))
}

/// What the references are known to, relatively.
const KNOWN_TO: f64 = 1e-9;

/// Errors and bounds of the elastic modes that are known.
fn list_errors_and_bounds_of_known_modes(reference: &ReferencePanel, outcome: &CaseOutcome) -> Vec<(f64, f64)> {
    let elastic = outcome.frequencies_hz.iter().zip(&outcome.bounds).filter(|(hz, _)| **hz > 0.0);
    reference
        .frequencies_hz
        .iter()
        .zip(elastic)
        .map(|(known, (found, bound))| ((found / known - 1.0).abs(), bound.unwrap_or(f64::NAN)))
        .collect()
}
