//! `era sweep`: the response at every point of a grid.

use super::args::Sweep as Options;
use super::panel::{frequencies, need_actuators, tell_missing, tell_steps, warn_if_thick};
use super::progress::with_progress;
use super::{Failure, Outcome, print_json, print_text};
use crate::model::Bounded;
use crate::response::bounded_sweep;
use crate::response::sweep::{Arithmetic, Sweep};
use crate::scene::{Scene, SurfaceKind, evenly};
use serde_json::json;
use std::fmt::Write as _;
use std::io::Write as _;
use std::path::Path;
use std::time::Instant;

/// Tolerance from which on single precision does: its own error is 6e-6 of a curve's peak at most.
const SINGLE: f64 = 1e-5;
/// Most values: 1.6 GB in single precision, three levels of them at once.
const MOST_VALUES: f64 = 7e7;

/// A number with its bytes for a file.
trait Stored: Arithmetic + Into<f64> {
    /// NumPy's name of the complex type.
    const TYPE: &'static str;
    fn bytes(self) -> [u8; 8];
    const SIZE: usize;
}

impl Stored for f32 {
    const TYPE: &'static str = "<c8";
    const SIZE: usize = 4;
    fn bytes(self) -> [u8; 8] {
        let [a, b, c, d] = self.to_le_bytes();
        [a, b, c, d, 0, 0, 0, 0]
    }
}

impl Stored for f64 {
    const TYPE: &'static str = "<c16";
    const SIZE: usize = 8;
    fn bytes(self) -> [u8; 8] {
        self.to_le_bytes()
    }
}

pub fn run(options: &Options) -> Outcome {
    if options.panel.climb()?.value() >= SINGLE { run_in::<f32>(options) } else { run_in::<f64>(options) }
}

fn run_in<T: Stored>(options: &Options) -> Outcome {
    let started = Instant::now();
    let scene = options.panel.load()?;
    let frequencies_hz = frequencies(&options.band)?;
    if options.band.from <= 0.0 {
        let from = options.band.from;
        return Err(Failure::usage(format!("--from {from} is not in the allowed range above 0 Hz")));
    }
    let accuracy = options.panel.climb()?;
    let (x_m, y_m) = grid(options, &scene);
    check_size(&scene, x_m.len() * y_m.len(), frequencies_hz.len())?;
    need_actuators(&scene)?;
    warn_if_thick(&scene, options.band.to);
    let found = with_progress("computing the responses", || {
        bounded_sweep::<T>(&scene, accuracy, (&x_m, &y_m), &frequencies_hz)
    })?;
    let elapsed_ms = started.elapsed().as_secs_f64() * 1e3;
    tell_steps(&options.panel, &scene, accuracy, &found.steps);
    tell_missing(&found.bounds, accuracy);
    if let Some(path) = &options.npy {
        let shape = [frequencies_hz.len(), scene.actuators.len(), y_m.len(), x_m.len()];
        write_npy(path, &found.answer, shape)
            .map_err(|error| Failure::failed(format!("{}: {error}", path.display())))?;
    }
    let layout = scene.layout();
    let points = y_m.iter().flat_map(|y| x_m.iter().map(move |x| (*x, *y)));
    let there: Vec<bool> = points.map(|(x, y)| layout.at(x, y).is_some()).collect();
    let extremes: Vec<_> = (0..scene.actuators.len())
        .map(|actuator| Extremes::of(&found.answer, &there, actuator, frequencies_hz.len()))
        .collect();
    let place = |point: usize| (x_m[point % x_m.len()] * 1e3, y_m[point / x_m.len()] * 1e3);
    if options.json {
        return print_json(&summary(&scene, &found, &extremes, &frequencies_hz, place, elapsed_ms));
    }
    let mut text = format!(
        "{}: {} unknowns, {} points, {} frequencies, {elapsed_ms:.0} ms",
        scene.name,
        found.model.dofs(),
        found.answer.points,
        frequencies_hz.len()
    );
    for ((actuator, extremes), bound) in scene.actuators.iter().zip(&extremes).zip(&found.bounds) {
        let bound = bound.value().map_or_else(|| String::from("unknown"), |bound| format!("{bound:.0e}"));
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
struct Found {
    value: f64,
    point: usize,
    frequency: usize,
}

/// Of the points' largest values over all frequencies, the most and the least.
#[derive(Clone, Copy, Debug, Default)]
struct Extremes {
    most: Found,
    least: Found,
}

impl Extremes {
    /// `there` tells the points that no cut-out has taken.
    fn of<T: Stored>(sweep: &Sweep<T>, there: &[bool], actuator: usize, frequencies: usize) -> Self {
        let mut peaks: Vec<Found> = (0..sweep.points).map(|point| Found { point, ..Found::default() }).collect();
        for frequency in 0..frequencies {
            for (peak, value) in peaks.iter_mut().zip(sweep.field(frequency, actuator)) {
                if value.norm() > peak.value {
                    (peak.value, peak.frequency) = (value.norm(), frequency);
                }
            }
        }
        peaks.retain(|peak| there[peak.point]);
        let by_value = |a: &Found, b: &Found| a.value.total_cmp(&b.value);
        Self {
            most: peaks.iter().copied().max_by(by_value).unwrap_or_default(),
            least: peaks.iter().copied().min_by(by_value).unwrap_or_default(),
        }
    }
}

fn summary<T: Stored>(
    scene: &Scene,
    found: &Bounded<Sweep<T>>,
    extremes: &[Extremes],
    frequencies_hz: &[f64],
    place: impl Fn(usize) -> (f64, f64),
    elapsed_ms: f64,
) -> serde_json::Value {
    let tell = |found: &Found| {
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
                "id": actuator.id, "error_bound": bound.value(), "most": tell(&extremes.most),
                "least_peak": tell(&extremes.least),
            })
        })
        .collect();
    json!({
        "dofs": found.model.dofs(), "elapsed_ms": elapsed_ms, "points": found.answer.points,
        "frequencies": frequencies_hz.len(), "actuators": actuators,
    })
}

/// Columns and rows in m, border to border.
fn grid(options: &Options, scene: &Scene) -> (Vec<f64>, Vec<f64>) {
    let rows = if scene.surface.kind == SurfaceKind::Bar { 1 } else { options.grid.1 };
    (evenly(0.0, scene.surface.length_m, options.grid.0), evenly(0.0, scene.surface.width_m, rows))
}

#[allow(clippy::cast_precision_loss, reason = "a size to be refused")]
fn check_size(scene: &Scene, points: usize, frequencies: usize) -> Result<(), Failure> {
    let values = points as f64 * frequencies as f64 * scene.actuators.len() as f64;
    if values <= MOST_VALUES {
        return Ok(());
    }
    Err(Failure::usage(format!(
        "--grid and --step: {points} points, {frequencies} frequencies and {} actuators are {values:.1e} values, at most \
         {MOST_VALUES:.1e} are allowed",
        scene.actuators.len()
    )))
}

/// Version 1.0 of NumPy's format: a magic number, a header padded to 64 bytes, the numbers.
fn write_npy<T: Stored>(path: &Path, sweep: &Sweep<T>, [f, a, y, x]: [usize; 4]) -> std::io::Result<()> {
    let mut header = format!("{{'descr': '{}', 'fortran_order': False, 'shape': ({f}, {a}, {y}, {x}), }}", T::TYPE);
    let length = (header.len() + 11).next_multiple_of(64) - 11;
    header = format!("{header:length$}\n");
    let mut file = std::io::BufWriter::new(std::fs::File::create(path)?);
    file.write_all(b"\x93NUMPY\x01\x00")?;
    let length = u16::try_from(header.len()).map_err(std::io::Error::other)?;
    file.write_all(&length.to_le_bytes())?;
    file.write_all(header.as_bytes())?;
    for (re, im) in sweep.re.iter().zip(&sweep.im) {
        file.write_all(&re.bytes()[..T::SIZE])?;
        file.write_all(&im.bytes()[..T::SIZE])?;
    }
    file.flush()
}
