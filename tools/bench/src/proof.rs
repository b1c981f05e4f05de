//! (f): what the bound costs beside the answer, and how far it is above the error; beside the levels as they were.

use crate::before;
use crate::clock::{compute_median, run_and_time_s};
use crate::environment::Environment;
use crate::error::Error;
use crate::problem::{MAX_HZ, Problem};
use crate::table::{Table, format_relative_error, format_three_digits, format_time};
use era_model::model::{Accuracy, PanelModel, compute_modes_with_error_bounds};
use era_model::response::sweep::{AccelerationSweep, SurfaceShapes};
use era_model::response::{
    compute_acceleration_curves_per_newton, compute_acceleration_curves_per_newton_with_error_bounds,
    compute_acceleration_sweep_per_newton_with_error_bounds,
};
use era_model::scene::random::random_scene_text;
use era_model::scene::{Scene, SurfaceKind, equidistant_numbers};
use num_complex::Complex64;

/// Random scenes.
const SCENES: u64 = 30;
/// Their seed.
const SEED: u64 = 11;
/// Highest frequency that random scenes are asked about, in Hz.
const BAND_HZ: f64 = 400.0;
/// Errors below this are rounding's.
const ROUNDING: f64 = 1e-9;
/// Acceleration, relative to that of the whole surface under the same force, that counts as none: as `era response` has it.
const NOTHING: f64 = 1e-6;
/// How much tighter the solution is that stands for the exact one.
const EXACT: f64 = 1e-2;

/// Measures what the bound costs: the table of the sweep of the starting plate with and without its bound.
///
/// # Errors
/// [`Error::Model`], [`Error::Curves`], [`Error::Response`].
pub fn build_table_of_error_bound_cost(environment: &Environment, problem: &Problem) -> Result<Table, Error> {
    let runs = if environment.quick { 3 } else { 15 };
    let columns =
        ["tolerance", "answer alone", "with its bound", "ratio", "levels as they were", "ratio", "bound", "bound then"];
    let mut table = Table::new("(f) The price of proof: sweep of the starting plate", &columns);
    let points = (problem.x_m.as_slice(), problem.y_m.as_slice());
    for tolerance in [1e-2, 1e-3] {
        let accuracy = Accuracy::from_tolerance(tolerance)?;
        let (mut alone, mut proven, mut then) = (Vec::new(), Vec::new(), Vec::new());
        let mut bounds = (f64::NAN, f64::NAN);
        for _ in 0..runs {
            let (found, elapsed_s) = run_and_time_s(|| {
                compute_acceleration_sweep_per_newton_with_error_bounds::<f32>(
                    &problem.scene,
                    accuracy,
                    points,
                    &problem.frequencies_hz,
                )
            })?;
            proven.push(elapsed_s);
            bounds.0 = found.bounds.iter().map(|bound| bound.limit_if_known().unwrap_or(f64::NAN)).fold(0.0, f64::max);
            let fineness = found.model.fineness();
            let (one, elapsed_s) = run_and_time_s(|| -> Result<_, Error> {
                compute_acceleration_sweep(problem, &PanelModel::build_with_fineness(&problem.scene, fineness)?)
            })?;
            drop(one);
            alone.push(elapsed_s);
            let (old, elapsed_s) = run_and_time_s(|| {
                before::refine_with_former_error_bounds(
                    &problem.scene,
                    accuracy,
                    MAX_HZ,
                    true,
                    |model| compute_acceleration_sweep(problem, model),
                    compute_largest_relative_difference_of_each_actuator,
                )
            })?;
            then.push(elapsed_s);
            bounds.1 = old.bounds.iter().copied().fold(0.0, f64::max);
        }
        let (alone, proven, then) = (compute_median(alone), compute_median(proven), compute_median(then));
        table.add_row([
            format_relative_error(tolerance),
            format_time(alone),
            format_time(proven),
            format_three_digits(proven / alone),
            format_time(then),
            format_three_digits(then / alone),
            format_relative_error(bounds.0),
            format_relative_error(bounds.1),
        ]);
    }
    table.above.push(format!(
        "The sweep has a loss factor of 0.005, {} frequencies from 50 to {MAX_HZ} Hz, {} points and two actuators, in \
         single precision. \"Answer alone\" is the time from the scene to all values on one mesh only: the mesh that \
         gave the answer. \"With its bound\" is the time of all meshes. \"Levels as they were\" is the time of the \
         sequence of meshes of an earlier version. Each ratio is the time before it divided by the time of the answer \
         alone. Times are medians of {runs} runs.",
        problem.frequencies_hz.len(),
        problem.count_points()
    ));
    Ok(table)
}

fn compute_acceleration_sweep(problem: &Problem, model: &PanelModel) -> Result<AccelerationSweep<f32>, Error> {
    let reduced = model.reduce_with_residual_shapes_of_actuators_damping_and_points(MAX_HZ, &[])?;
    let shapes = SurfaceShapes::<f32>::new(&problem.scene, &reduced, &problem.x_m, &problem.y_m);
    Ok(shapes.compute_accelerations_per_newton_at_all_points(&problem.frequencies_hz)?)
}

/// The largest difference at any point, relative to the peak at this point, for each actuator.
fn compute_largest_relative_difference_of_each_actuator(
    coarse: &AccelerationSweep<f32>,
    fine: &AccelerationSweep<f32>,
) -> Vec<f64> {
    let frequencies = fine.re.len() / (fine.actuators * fine.points).max(1);
    (0..fine.actuators)
        .map(|actuator| {
            let mut curves = vec![(0.0_f64, 0.0_f64); fine.points];
            for frequency in 0..frequencies {
                let values = fine
                    .accelerations_per_newton_of_all_points(frequency, actuator)
                    .zip(coarse.accelerations_per_newton_of_all_points(frequency, actuator));
                for ((difference, peak), (fine, coarse)) in curves.iter_mut().zip(values) {
                    *difference = difference.max((fine - coarse).norm_sqr());
                    *peak = peak.max(fine.norm_sqr());
                }
            }
            curves.iter().map(|(difference, peak)| (difference / peak).sqrt()).fold(0.0, f64::max)
        })
        .collect()
}

/// Bounds over errors, and how many were below their error.
#[derive(Default)]
struct BoundOverErrorStatistics {
    ratios: Vec<f64>,
    below: usize,
    missing: usize,
    levels: usize,
}

impl BoundOverErrorStatistics {
    /// `exact_bound` is the bound of what stands for the exact answer.
    fn add_bound_and_error(&mut self, bound: f64, error: f64, exact_bound: f64) {
        if !bound.is_finite() {
            self.missing += 1;
        } else if error > ROUNDING {
            self.below += usize::from(error > bound + exact_bound);
            self.ratios.push(bound / error);
        }
    }

    fn add_row_to_table(self, quantity: &str, levels: &str, table: &mut Table) {
        table.add_row([
            quantity.into(),
            levels.into(),
            self.ratios.len().to_string(),
            self.below.to_string(),
            self.missing.to_string(),
            self.levels.to_string(),
            format_three_digits(compute_median(self.ratios)),
        ]);
    }
}

/// Measures the bound over the error on random scenes: the table of the bounds now and as they were.
///
/// # Errors
/// [`Error::Parse`], [`Error::Model`], [`Error::Curves`], [`Error::Response`].
pub fn build_table_of_bound_over_error(environment: &Environment) -> Result<Table, Error> {
    let scenes = if environment.quick { SCENES / 6 } else { SCENES };
    let columns =
        ["what", "levels", "compared", "bounds below the error", "no bound", "levels asked", "bound / error, median"];
    let mut table = Table::new("(f) Bound over error on random scenes", &columns);
    let mut all: [BoundOverErrorStatistics; 4] = Default::default();
    let frequencies = equidistant_numbers(4.0, BAND_HZ, 100);
    for number in 0..scenes {
        let scene = Scene::parse("random", &random_scene_text(SEED, number))?;
        let tolerance = [1e-2, 1e-3, 1e-4][usize::try_from(number % 3).unwrap_or(0)];
        let (accuracy, exact_accuracy) =
            (Accuracy::from_tolerance(tolerance)?, Accuracy::from_tolerance(EXACT * tolerance)?);
        add_bounds_and_errors_of_mode_frequencies(&scene, accuracy, exact_accuracy, &mut all)?;
        add_bounds_and_errors_of_responses(&scene, accuracy, exact_accuracy, &frequencies, &mut all)?;
    }
    let names =
        [("frequencies", "now"), ("frequencies", "as they were"), ("responses", "now"), ("responses", "as they were")];
    for ((quantity, levels), found) in names.into_iter().zip(all) {
        found.add_row_to_table(quantity, levels, &mut table);
    }
    table.above.push(format!(
        "There are {scenes} random scenes (`host/model/src/scene/random.rs`, seed {SEED}), computed up to {BAND_HZ} \
         Hz. The tolerances are 1e-2, 1e-3 and 1e-4 in turn. The error is the difference from this program's more \
         accurate answer, at a hundredth of the tolerance. The more accurate answer has a small bound of its own. A bound \
         counts as below the error only if it is below the error by more than this small bound. Errors below \
         {ROUNDING:e} are rounding errors and are left out."
    ));
    Ok(table)
}

fn add_bounds_and_errors_of_mode_frequencies(
    scene: &Scene,
    accuracy: Accuracy,
    exact_accuracy: Accuracy,
    all: &mut [BoundOverErrorStatistics; 4],
) -> Result<(), Error> {
    let (found, exact) = (
        compute_modes_with_error_bounds(scene, accuracy, BAND_HZ)?,
        compute_modes_with_error_bounds(scene, exact_accuracy, BAND_HZ)?,
    );
    let old = before::refine_with_former_error_bounds(
        scene,
        accuracy,
        BAND_HZ,
        false,
        |model| {
            Ok(model
                .compute_mode_frequencies_and_poles(1.3 * BAND_HZ)?
                .into_iter()
                .map(|mode| mode.frequency_hz)
                .collect::<Vec<_>>())
        },
        |coarse, fine| {
            let pairs = fine.iter().enumerate().take_while(|(_, hz)| **hz <= BAND_HZ);
            pairs
                .map(|(k, hz)| match coarse.get(k) {
                    _ if *hz == 0.0 => 0.0,
                    Some(coarse) => (coarse / hz - 1.0).abs(),
                    None => f64::INFINITY,
                })
                .collect()
        },
    )?;
    all[0].levels += found.steps.len();
    all[1].levels += old.levels;
    for (k, exact_mode) in exact.answer.iter().enumerate().filter(|(_, mode)| mode.frequency_hz > 0.0) {
        let own = exact.bounds[k].limit_if_known().unwrap_or(f64::INFINITY);
        let error = |hz: f64| (hz / exact_mode.frequency_hz - 1.0).abs();
        if let (Some(mode), Some(bound)) = (found.answer.get(k), found.bounds.get(k)) {
            all[0].add_bound_and_error(bound.limit_if_known().unwrap_or(f64::INFINITY), error(mode.frequency_hz), own);
        }
        if let (Some(hz), Some(bound)) = (old.answer.get(k), old.bounds.get(k)) {
            all[1].add_bound_and_error(*bound, error(*hz), own);
        }
    }
    Ok(())
}

fn add_bounds_and_errors_of_responses(
    scene: &Scene,
    accuracy: Accuracy,
    exact_accuracy: Accuracy,
    frequencies: &[f64],
    all: &mut [BoundOverErrorStatistics; 4],
) -> Result<(), Error> {
    let across = if scene.surface.kind == SurfaceKind::Bar { 0.5 } else { 0.47 };
    let point_m = (0.31 * scene.surface.length_m, across * scene.surface.width_m);
    let found = compute_acceleration_curves_per_newton_with_error_bounds(scene, accuracy, point_m, frequencies)?;
    let exact = compute_acceleration_curves_per_newton_with_error_bounds(scene, exact_accuracy, point_m, frequencies)?;
    // What counts as no acceleration, of a force on an edge that does not move.
    let nothing = NOTHING / scene.surface_mass_with_air_kg();
    let difference = |a: &[Complex64], b: &[Complex64]| {
        let peak = b.iter().map(|z| z.norm()).fold(nothing, f64::max);
        a.iter().zip(b).map(|(a, b)| (a - b).norm()).fold(0.0, f64::max) / peak
    };
    let old = before::refine_with_former_error_bounds(
        scene,
        accuracy,
        BAND_HZ,
        true,
        |model| {
            let reduced = model.reduce_with_residual_shapes_of_actuators_damping_and_points(BAND_HZ, &[point_m])?;
            Ok(compute_acceleration_curves_per_newton(
                &reduced,
                &reduced.shape_deflections_at(point_m.0, point_m.1),
                frequencies,
            )?)
        },
        |coarse, fine| coarse.iter().zip(fine).map(|(coarse, fine)| difference(coarse, fine)).collect(),
    )?;
    all[2].levels += found.steps.len();
    all[3].levels += old.levels;
    for (k, exact_curve) in exact.answer.iter().enumerate() {
        let Some(own) = exact.bounds[k].limit_if_known() else { continue };
        let error = |curve: &[Complex64]| difference(curve, exact_curve);
        all[2].add_bound_and_error(
            found.bounds[k].limit_if_known().unwrap_or(f64::INFINITY),
            error(&found.answer[k]),
            own,
        );
        all[3].add_bound_and_error(old.bounds[k], error(&old.answer[k]), own);
    }
    Ok(())
}
