//! (a): what accuracy costs.

use crate::case::{Outcome, POINT_M, frequencies, in_child};
use crate::clock::median;
use crate::environment::Environment;
use crate::error::Error;
use crate::own::{NEXT, TIGHTEST};
use crate::problem::{MAX_HZ, Problem, curves, scene_text};
use crate::references::{Reference, references};
use crate::table::{Table, bytes, relative, seconds, three};
use num_complex::Complex64;
use std::path::Path;

/// The tolerances.
const TOLERANCES: [f64; 8] = [1e-1, 1e-2, 1e-3, 1e-4, 1e-5, 1e-6, 1e-7, 1e-8];

/// One tolerance.
#[derive(Clone, Copy, Debug)]
pub struct Point {
    /// Median in s.
    pub time_s: f64,
    /// Of what was computed.
    pub error: f64,
    /// What the program said of it; NaN if it said nothing.
    pub bound: f64,
}

fn runs(environment: &Environment) -> usize {
    if environment.quick { 1 } else { 5 }
}

fn tolerances(environment: &Environment) -> Vec<f64> {
    TOLERANCES.iter().copied().step_by(if environment.quick { 2 } else { 1 }).collect()
}

/// Several runs of one case: the last's outcome with the median of the times.
fn repeated(
    environment: &Environment,
    kind: &str,
    scene: &Path,
    tolerance: f64,
    max_hz: f64,
) -> Result<Outcome, Error> {
    let options = [("--tolerance", tolerance.to_string()), ("--max-hz", max_hz.to_string())];
    let mut all = Vec::new();
    for _ in 0..runs(environment) {
        all.push(in_child(environment, kind, scene, &options)?);
    }
    let time = median(all.iter().map(|outcome| outcome.elapsed_s).collect());
    Ok(Outcome { elapsed_s: time, ..all.pop().unwrap_or_default() })
}

/// The largest bound; NaN if one is missing.
fn largest(bounds: &[Option<f64>]) -> f64 {
    bounds
        .iter()
        .map(|bound| bound.unwrap_or(f64::NAN))
        .fold(0.0, |a, b| if a.is_nan() || b.is_nan() { f64::NAN } else { a.max(b) })
}

/// Responses of the starting plate at a point.
///
/// # Errors
/// Those of the cases, [`Error::File`].
pub fn responses(environment: &Environment, problem: &Problem) -> Result<(Table, Vec<Point>), Error> {
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
    let frequencies_hz = frequencies(MAX_HZ);
    let tightest = curves(&problem.scene, TIGHTEST, &frequencies_hz, &[POINT_M])?;
    let next = curves(&problem.scene, NEXT, &frequencies_hz, &[POINT_M])?;
    let uncertainty = tightest.error_of(|curve, f| next.values[curve * next.count + f]);
    let scene = environment.scratch.join("plate.toml");
    std::fs::write(&scene, scene_text()?).map_err(Error::file(&scene))?;
    let mut points = Vec::new();
    for tolerance in tolerances(environment) {
        let outcome = repeated(environment, "response", &scene, tolerance, MAX_HZ)?;
        let count = frequencies_hz.len();
        let error = tightest.error_of(|curve, f| {
            let (re, im) = outcome.curves[curve * count + f];
            Complex64::new(re, im)
        });
        let bound = largest(&outcome.bounds);
        table.row([
            relative(tolerance),
            seconds(outcome.elapsed_s),
            bytes(outcome.peak_bytes),
            outcome.order.to_string(),
            outcome.unknowns.to_string(),
            outcome.coordinates.to_string(),
            outcome.levels.to_string(),
            relative(error),
            relative(bound),
            three(bound / error),
        ]);
        points.push(Point { time_s: outcome.elapsed_s, error, bound });
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
        relative(uncertainty)
    ));
    Ok((table, points))
}

/// Modes of panels with known frequencies.
///
/// # Errors
/// Those of the cases, [`Error::File`].
pub fn modes(environment: &Environment) -> Result<(Table, Vec<Point>), Error> {
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
    let references = references();
    let mut scenes = Vec::new();
    for (k, reference) in references.iter().enumerate() {
        let scene = environment.scratch.join(format!("reference-{k}.toml"));
        std::fs::write(&scene, &reference.scene).map_err(Error::file(&scene))?;
        scenes.push(scene);
    }
    let mut points = Vec::new();
    for tolerance in tolerances(environment) {
        let (mut time_s, mut peak, mut unknowns) = (0.0, 0.0_f64, 0);
        let (mut worst, mut panel, mut bound, mut ratios, mut below) = (0.0, "", 0.0_f64, Vec::new(), 0);
        let mut modes = 0;
        for (reference, scene) in references.iter().zip(&scenes) {
            let highest = reference.frequencies_hz.last().copied().unwrap_or(1.0);
            let outcome = repeated(environment, "modes", scene, tolerance, 1.01 * highest)?;
            time_s += outcome.elapsed_s;
            peak = peak.max(outcome.peak_bytes);
            unknowns = unknowns.max(outcome.unknowns);
            for (error, own_bound) in errors(reference, &outcome) {
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
        table.row([
            relative(tolerance),
            seconds(time_s),
            bytes(peak),
            unknowns.to_string(),
            relative(worst),
            String::from(panel),
            relative(bound),
            if ratios.is_empty() { String::from("-") } else { three(median(ratios)) },
            format!("{below} of {modes}"),
        ]);
        points.push(Point { time_s, error: worst, bound });
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
fn errors(reference: &Reference, outcome: &Outcome) -> Vec<(f64, f64)> {
    let elastic = outcome.frequencies_hz.iter().zip(&outcome.bounds).filter(|(hz, _)| **hz > 0.0);
    reference
        .frequencies_hz
        .iter()
        .zip(elastic)
        .map(|(known, (found, bound))| ((found / known - 1.0).abs(), bound.unwrap_or(f64::NAN)))
        .collect()
}
