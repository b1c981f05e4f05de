//! `era sweep`: the response at every point of a grid.

use super::args_panel::Sweep as Options;
use super::cost::Cost;
use super::panel::{
    check_has_actuators, list_frequencies_hz, tell_model_scope_and_mesh_accuracy_if_explaining,
    tell_why_bound_is_missing_or_largest_exceeds_tolerance, warn_if_too_thick_for_thin_plate_theory,
};
use super::progress::run_telling_expected_cost_and_showing_progress;
use super::{CommandResult, Failure, print_json, print_text_after_queued_log};
use crate::maps::npy;
use crate::model::{Bound, BoundedAnswer};
use crate::response::sweep::{AccelerationSweep, Arithmetic};
use crate::response::{MOST_SWEEP_VALUES, SINGLE_DOES, compute_acceleration_sweep_per_newton_with_error_bounds};
use crate::scene::Scene;
use serde_json::json;
use std::fmt::Write as _;
use std::io::Write;
use std::time::Instant;

/// A number with its bytes for a file.
trait StoredNumber: Arithmetic + Into<f64> {
    /// NumPy's name of the complex type.
    const TYPE: &'static str;
    fn write_le_bytes(self, file: &mut (impl Write + ?Sized)) -> std::io::Result<()>;
}

impl StoredNumber for f32 {
    const TYPE: &'static str = "<c8";
    fn write_le_bytes(self, file: &mut (impl Write + ?Sized)) -> std::io::Result<()> {
        file.write_all(&self.to_le_bytes())
    }
}

impl StoredNumber for f64 {
    const TYPE: &'static str = "<c16";
    fn write_le_bytes(self, file: &mut (impl Write + ?Sized)) -> std::io::Result<()> {
        file.write_all(&self.to_le_bytes())
    }
}

pub fn run_sweep(options: &Options) -> CommandResult {
    if options.panel.accuracy_from_time_limit_or_options(options.time)?.relative_tolerance_or_tightest() >= SINGLE_DOES
    {
        compute_sweep_print_summary_and_write_file_if_asked::<f32>(options)
    } else {
        compute_sweep_print_summary_and_write_file_if_asked::<f64>(options)
    }
}

fn compute_sweep_print_summary_and_write_file_if_asked<T: StoredNumber>(options: &Options) -> CommandResult {
    let started = Instant::now();
    let scene = options.panel.load_scene()?;
    let frequencies_hz = list_frequencies_hz(&options.band)?;
    if options.band.from <= 0.0 {
        let from = options.band.from;
        return Err(Failure::usage_error(format!("--from is {from}, but must be above 0 Hz")));
    }
    let accuracy = options.panel.accuracy_from_time_limit_or_options(options.time)?;
    let (x_m, y_m) = scene.surface_grid_lines_or_bar_axis_line_m(options.grid);
    refuse_too_many_sweep_values(&scene, x_m.len() * y_m.len(), frequencies_hz.len())?;
    check_has_actuators(&scene)?;
    warn_if_too_thick_for_thin_plate_theory(&scene, options.band.to);
    let size = (frequencies_hz.len(), x_m.len() * y_m.len());
    let cost = Cost::estimate_for_responses_unless_time_limited(&scene, accuracy, options.band.to, size)?;
    let found = run_telling_expected_cost_and_showing_progress("computing the responses", cost, || {
        compute_acceleration_sweep_per_newton_with_error_bounds::<T>(&scene, accuracy, (&x_m, &y_m), &frequencies_hz)
    })?;
    let elapsed_ms = started.elapsed().as_secs_f64() * 1e3;
    tell_model_scope_and_mesh_accuracy_if_explaining(&options.panel, &scene, accuracy, &found.steps);
    tell_why_bound_is_missing_or_largest_exceeds_tolerance(&found.bounds, accuracy);
    if let Some(path) = &options.npy {
        let shape = [frequencies_hz.len(), scene.actuators.len(), y_m.len(), x_m.len()];
        let values = found.answer.re.iter().zip(&found.answer.im);
        npy::write_npy_array(path, T::TYPE, &shape, |file| {
            values.into_iter().try_for_each(|(re, im)| re.write_le_bytes(file).and_then(|()| im.write_le_bytes(file)))
        })
        .and_then(|()| {
            npy::write_npy_axis_files_beside_array(
                path,
                &[("frequency_hz", &frequencies_hz), ("y_m", &y_m), ("x_m", &x_m)],
            )
        })
        .map_err(|error| Failure::runtime_error(format!("cannot write {}: {error}", path.display())))?;
    }
    let layout = scene.layout();
    let points = y_m.iter().flat_map(|y| x_m.iter().map(move |x| (*x, *y)));
    let there: Vec<bool> = points.map(|(x, y)| layout.layer_at_unless_cut_out(x, y).is_some()).collect();
    let extremes: Vec<_> = (0..scene.actuators.len())
        .map(|actuator| {
            Extremes::find_points_with_largest_and_smallest_peak_over_frequencies(
                &found.answer,
                &there,
                actuator,
                frequencies_hz.len(),
            )
        })
        .collect();
    let place = |point: usize| (x_m[point % x_m.len()] * 1e3, y_m[point / x_m.len()] * 1e3);
    if options.json {
        let mut answer = summarize_sweep_as_json(&scene, &found, &extremes, &frequencies_hz, place, elapsed_ms);
        answer["tolerance"] = json!(accuracy.tolerance_unless_time_limit_given());
        answer["tolerance_met"] = json!(Bound::all_meet_tolerance_if_given_and_decidable(&found.bounds, accuracy));
        return print_json(&answer);
    }
    let mut text = format!(
        "{}: {} unknowns, {} points, {} frequencies, computed in {elapsed_ms:.0} ms",
        scene.name,
        found.model.count_unknowns(),
        found.answer.points,
        frequencies_hz.len()
    );
    for ((actuator, extremes), bound) in scene.actuators.iter().zip(&extremes).zip(&found.bounds) {
        let error = bound.limit_if_known().map_or_else(
            || String::from("no bound of the model error is known"),
            |bound| {
                format!(
                    "the model error at each point is at most {bound:.0e} times the largest acceleration at this \
                    point over all frequencies"
                )
            },
        );
        let ((x, y), (u, v)) = (place(extremes.most.point), place(extremes.least.point));
        let _ = write!(
            text,
            "\n{}: {error}\n  largest peak: {:.3} m/s^2 per N at {x:.1}, {y:.1} mm and {} Hz\n  \
             smallest peak: {:.3} m/s^2 per N at {u:.1}, {v:.1} mm and {} Hz",
            actuator.id,
            extremes.most.value,
            frequencies_hz[extremes.most.frequency],
            extremes.least.value,
            frequencies_hz[extremes.least.frequency],
        );
    }
    print_text_after_queued_log(&text)
}

/// A value and where it is.
#[derive(Clone, Copy, Debug, Default)]
struct Extreme {
    value: f64,
    point: usize,
    frequency: usize,
}

/// Of the points' largest values over all frequencies, the most and the least.
#[derive(Clone, Copy, Debug, Default)]
struct Extremes {
    most: Extreme,
    least: Extreme,
}

impl Extremes {
    /// `is_on_surface` tells the points that no cut-out has taken.
    fn find_points_with_largest_and_smallest_peak_over_frequencies<T: StoredNumber>(
        sweep: &AccelerationSweep<T>,
        is_on_surface: &[bool],
        actuator: usize,
        frequencies: usize,
    ) -> Self {
        let mut peaks: Vec<Extreme> = (0..sweep.points).map(|point| Extreme { point, ..Extreme::default() }).collect();
        for frequency in 0..frequencies {
            for (peak, value) in peaks.iter_mut().zip(sweep.accelerations_per_newton_of_all_points(frequency, actuator))
            {
                if value.norm() > peak.value {
                    (peak.value, peak.frequency) = (value.norm(), frequency);
                }
            }
        }
        peaks.retain(|peak| is_on_surface[peak.point]);
        let by_value = |a: &Extreme, b: &Extreme| a.value.total_cmp(&b.value);
        Self {
            most: peaks.iter().copied().max_by(by_value).unwrap_or_default(),
            least: peaks.iter().copied().min_by(by_value).unwrap_or_default(),
        }
    }
}

fn summarize_sweep_as_json<T: StoredNumber>(
    scene: &Scene,
    found: &BoundedAnswer<AccelerationSweep<T>>,
    extremes: &[Extremes],
    frequencies_hz: &[f64],
    place: impl Fn(usize) -> (f64, f64),
    elapsed_ms: f64,
) -> serde_json::Value {
    let tell = |found: &Extreme| {
        let (x_mm, y_mm) = place(found.point);
        json!({
            "acceleration_m_per_s2_per_n": found.value, "x_mm": x_mm, "y_mm": y_mm,
            "frequency_hz": frequencies_hz[found.frequency],
        })
    };
    let actuators: Vec<_> = scene
        .actuators
        .iter()
        .zip(extremes)
        .zip(&found.bounds)
        .map(|((actuator, extremes), bound)| {
            json!({
                "id": actuator.id, "error_bound": bound.limit_if_known(), "most": tell(&extremes.most),
                "least_peak": tell(&extremes.least),
            })
        })
        .collect();
    json!({
        "dofs": found.model.count_unknowns(), "elapsed_ms": elapsed_ms, "points": found.answer.points,
        "frequencies": frequencies_hz.len(), "actuators": actuators,
    })
}

#[expect(clippy::cast_precision_loss, reason = "a size to be refused")]
fn refuse_too_many_sweep_values(scene: &Scene, points: usize, frequencies: usize) -> Result<(), Failure> {
    let values = points as f64 * frequencies as f64 * scene.actuators.len() as f64;
    if values <= MOST_SWEEP_VALUES {
        return Ok(());
    }
    Err(Failure::usage_error(format!(
        "--grid and --step: {points} points, {frequencies} frequencies and {} actuators give {values:.1e} values, but \
         at most {MOST_SWEEP_VALUES:.1e} are allowed",
        scene.actuators.len()
    )))
}
