//! `era sweep`: the response at every point of a grid.

use super::args::Sweep as Options;
use super::cost::Cost;
use super::panel::{bound_text, frequencies, need_actuators, tell_missing, tell_steps, warn_if_thick};
use super::progress::with_cost;
use super::{Failure, Outcome, print_json, print_text};
use crate::model::{Bound, BoundedAnswer};
use crate::response::sweep::{AccelerationSweep, Arithmetic};
use crate::response::{MOST_SWEEP_VALUES, SINGLE_DOES, sweep_with_error_bounds};
use crate::scene::Scene;
use crate::study::npy;
use serde_json::json;
use std::fmt::Write as _;
use std::io::Write;
use std::time::Instant;

/// A number with its bytes for a file.
trait Stored: Arithmetic + Into<f64> {
    /// NumPy's name of the complex type.
    const TYPE: &'static str;
    fn write(self, file: &mut (impl Write + ?Sized)) -> std::io::Result<()>;
}

impl Stored for f32 {
    const TYPE: &'static str = "<c8";
    fn write(self, file: &mut (impl Write + ?Sized)) -> std::io::Result<()> {
        file.write_all(&self.to_le_bytes())
    }
}

impl Stored for f64 {
    const TYPE: &'static str = "<c16";
    fn write(self, file: &mut (impl Write + ?Sized)) -> std::io::Result<()> {
        file.write_all(&self.to_le_bytes())
    }
}

pub fn run_sweep(options: &Options) -> Outcome {
    if options.panel.accuracy_within(options.time)?.relative_tolerance() >= SINGLE_DOES {
        compute_sweep::<f32>(options)
    } else {
        compute_sweep::<f64>(options)
    }
}

fn compute_sweep<T: Stored>(options: &Options) -> Outcome {
    let started = Instant::now();
    let scene = options.panel.load()?;
    let frequencies_hz = frequencies(&options.band)?;
    if options.band.from <= 0.0 {
        let from = options.band.from;
        return Err(Failure::usage(format!("--from {from} is not in the allowed range above 0 Hz")));
    }
    let accuracy = options.panel.accuracy_within(options.time)?;
    let (x_m, y_m) = scene.grid_lines_m(options.grid);
    check_size(&scene, x_m.len() * y_m.len(), frequencies_hz.len())?;
    need_actuators(&scene)?;
    warn_if_thick(&scene, options.band.to);
    let size = (frequencies_hz.len(), x_m.len() * y_m.len());
    let cost = Cost::of_responses(&scene, accuracy, options.band.to, size)?;
    let found = with_cost("computing the responses", cost, || {
        sweep_with_error_bounds::<T>(&scene, accuracy, (&x_m, &y_m), &frequencies_hz)
    })?;
    let elapsed_ms = started.elapsed().as_secs_f64() * 1e3;
    tell_steps(&options.panel, &scene, accuracy, &found.steps);
    tell_missing(&found.bounds, accuracy);
    if let Some(path) = &options.npy {
        let shape = [frequencies_hz.len(), scene.actuators.len(), y_m.len(), x_m.len()];
        let values = found.answer.re.iter().zip(&found.answer.im);
        npy::write(path, T::TYPE, &shape, |file| {
            values.into_iter().try_for_each(|(re, im)| re.write(file).and_then(|()| im.write(file)))
        })
        .and_then(|()| npy::write_axes(path, &[("frequency_hz", &frequencies_hz), ("y_m", &y_m), ("x_m", &x_m)]))
        .map_err(|error| Failure::failed(format!("cannot write {}: {error}", path.display())))?;
    }
    let layout = scene.layout();
    let points = y_m.iter().flat_map(|y| x_m.iter().map(move |x| (*x, *y)));
    let there: Vec<bool> = points.map(|(x, y)| layout.layer_at(x, y).is_some()).collect();
    let extremes: Vec<_> = (0..scene.actuators.len())
        .map(|actuator| Extremes::of(&found.answer, &there, actuator, frequencies_hz.len()))
        .collect();
    let place = |point: usize| (x_m[point % x_m.len()] * 1e3, y_m[point / x_m.len()] * 1e3);
    if options.json {
        let mut answer = summarize_sweep(&scene, &found, &extremes, &frequencies_hz, place, elapsed_ms);
        answer["tolerance"] = json!(accuracy.requested_tolerance());
        answer["tolerance_met"] = json!(Bound::all_meet_accuracy(&found.bounds, accuracy));
        return print_json(&answer);
    }
    let mut text = format!(
        "{}: {} unknowns, {} points, {} frequencies, {elapsed_ms:.0} ms",
        scene.name,
        found.model.count_unknowns(),
        found.answer.points,
        frequencies_hz.len()
    );
    for ((actuator, extremes), bound) in scene.actuators.iter().zip(&extremes).zip(&found.bounds) {
        let bound = bound_text(*bound);
        let ((x, y), (u, v)) = (place(extremes.most.point), place(extremes.least.point));
        let _ = write!(
            text,
            "\n{}: error at most {bound} of each point's peak\n  most: {:.3} m/s^2 per N at {x:.1}, {y:.1} mm and {} Hz\n  \
             least of the points' peaks: {:.3} m/s^2 per N at {u:.1}, {v:.1} mm and {} Hz",
            actuator.id,
            extremes.most.value,
            frequencies_hz[extremes.most.frequency],
            extremes.least.value,
            frequencies_hz[extremes.least.frequency],
        );
    }
    print_text(&text)
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
    /// `there` tells the points that no cut-out has taken.
    fn of<T: Stored>(sweep: &AccelerationSweep<T>, there: &[bool], actuator: usize, frequencies: usize) -> Self {
        let mut peaks: Vec<Extreme> = (0..sweep.points).map(|point| Extreme { point, ..Extreme::default() }).collect();
        for frequency in 0..frequencies {
            for (peak, value) in peaks.iter_mut().zip(sweep.accelerations_of_all_points(frequency, actuator)) {
                if value.norm() > peak.value {
                    (peak.value, peak.frequency) = (value.norm(), frequency);
                }
            }
        }
        peaks.retain(|peak| there[peak.point]);
        let by_value = |a: &Extreme, b: &Extreme| a.value.total_cmp(&b.value);
        Self {
            most: peaks.iter().copied().max_by(by_value).unwrap_or_default(),
            least: peaks.iter().copied().min_by(by_value).unwrap_or_default(),
        }
    }
}

fn summarize_sweep<T: Stored>(
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
                "id": actuator.id, "error_bound": bound.known_limit(), "most": tell(&extremes.most),
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
fn check_size(scene: &Scene, points: usize, frequencies: usize) -> Result<(), Failure> {
    let values = points as f64 * frequencies as f64 * scene.actuators.len() as f64;
    if values <= MOST_SWEEP_VALUES {
        return Ok(());
    }
    Err(Failure::usage(format!(
        "--grid and --step: {points} points, {frequencies} frequencies and {} actuators are {values:.1e} values, at most \
         {MOST_SWEEP_VALUES:.1e} are allowed",
        scene.actuators.len()
    )))
}
