//! `era modes`: frequencies, damping ratios and shapes.

use super::args::Modes as Options;
use super::cost::Cost;
use super::output::write_text_file;
use super::panel::{bound_text, tell_missing, tell_steps, warn_if_thick};
use super::progress::{with_cost, with_progress};
use super::told::tell;
use super::{Failure, Outcome, print_json, print_text, reach};
use crate::model::{Bound, PanelMode, compute_modes_with_error_bounds};
use crate::scene::{Laminate, PlateRigidities, Scene, SurfaceKind};
use crate::study::shapes::ModeShapes;
use crate::study::{mode_sheet, npy};
use num_complex::Complex64;
use serde_json::json;
use std::fmt::Write;
use std::path::Path;
use std::time::Instant;

/// Most values of shapes: 160 MB, some three times that while they are computed.
const MOST_VALUES: f64 = 2e7;

pub fn run_modes(options: &Options) -> Outcome {
    let started = Instant::now();
    let scene = options.panel.load()?;
    let accuracy = options.panel.accuracy_within(options.time)?;
    let wants_shapes = options.csv.is_some() || options.npy.is_some() || options.png.is_some();
    let cost = Cost::of_modes(&scene, accuracy, options.max_hz)?;
    let found =
        with_cost("computing modes", cost, || compute_modes_with_error_bounds(&scene, accuracy, options.max_hz))?;
    // Only of what was not refused.
    warn_if_thick(&scene, options.max_hz);
    let elapsed_ms = started.elapsed().as_secs_f64() * 1e3;
    let dofs = found.model.count_unknowns();
    tell_steps(&options.panel, &scene, accuracy, &found.steps);
    tell_missing(&found.bounds, accuracy);
    if wants_shapes {
        let grid = scene.grid_lines_m(options.grid);
        check_size(grid.0.len() * grid.1.len(), found.answer.len())?;
        let shapes = with_progress("computing the shapes", || ModeShapes::of(&scene, &found, options.max_hz, grid))?;
        if write_shapes(options, &scene, &shapes)? {
            return Ok(());
        }
    }
    let modes = || found.answer.iter().zip(&found.bounds);
    if options.json {
        let list: Vec<_> = modes()
            .map(|(mode, bound)| {
                let of_pole = |s: &Complex64| json!([s.re, s.im]);
                json!({
                    "frequency_hz": mode.frequency_hz, "damping_ratio": mode.damping_ratio, "error_bound": bound.known_limit(),
                    "pole_frequency_hz": mode.pole.frequency_hz, "pole_error_bound": mode.pole_bound.known_limit(),
                    "poles_per_s": mode.pole.eigenvalues().iter().map(of_pole).collect::<Vec<_>>(),
                })
            })
            .collect();
        let mut answer = json!({
            "dofs": dofs, "elapsed_ms": elapsed_ms, "tolerance": accuracy.requested_tolerance(),
            "tolerance_met": Bound::all_meet_accuracy(&found.bounds, accuracy), "modes": list,
        });
        if let Some(laminate) = scene.surface.laminate() {
            answer["layers"] = layers_json(&scene, &laminate);
        }
        return print_json(&answer);
    }
    let layers = scene.surface.laminate().map_or_else(String::new, |laminate| layers_text(&scene, &laminate));
    let heading = format!("{}: {dofs} unknowns, {elapsed_ms:.0} ms{layers}", scene.name);
    print_text(&format_modes(&heading, modes()))
}

/// What a scene's layers are together.
fn layers_json(scene: &Scene, laminate: &Laminate) -> serde_json::Value {
    let mut layers = json!({
        "thickness_mm": laminate.thickness_m * 1e3, "mass_kg_per_m2": laminate.per_area_kg_m2, "loss_factor": laminate.loss_factor,
    });
    for (name, stiffness) in laminate.named_bending_stiffnesses(scene.surface.kind, scene.surface.width_m) {
        layers[name] = json!(stiffness);
    }
    layers
}

/// The same as a line below the heading.
fn layers_text(scene: &Scene, laminate: &Laminate) -> String {
    let Laminate { thickness_m, per_area_kg_m2, rigidities: PlateRigidities { d11, d12, d22, d66 }, .. } = laminate;
    let stiffness = match scene.surface.kind {
        SurfaceKind::Plate => format!("D11 {d11:.4e}, D12 {d12:.4e}, D22 {d22:.4e}, D66 {d66:.4e} N m"),
        SurfaceKind::Bar => format!("E I {:.4e} N m^2", d11 * scene.surface.width_m),
    };
    format!(
        "\n{} layers, {:.4} mm: {stiffness}, {per_area_kg_m2:.4} kg/m^2",
        scene.surface.layers.len(),
        thickness_m * 1e3
    )
}

#[expect(clippy::cast_precision_loss, reason = "a size to be refused")]
fn check_size(points: usize, modes: usize) -> Result<(), Failure> {
    let values = points as f64 * modes as f64;
    if values <= MOST_VALUES {
        return Ok(());
    }
    Err(Failure::usage(format!(
        "--grid and --max-hz: {points} points and {modes} modes are {values:.1e} values, at most {MOST_VALUES:.1e} are allowed"
    )))
}

fn format_modes<'a>(heading: &str, modes: impl Iterator<Item = (&'a PanelMode, &'a Bound)>) -> String {
    let mut text =
        format!("{heading}\n mode   frequency   error at most   damping ratio   pole at   its error at most");
    for (i, (mode, bound)) in modes.enumerate() {
        let (bound, own) = (bound_text(*bound), bound_text(mode.pole_bound));
        let PanelMode { frequency_hz, damping_ratio, pole, .. } = mode;
        // Of a pole that is not known there are none.
        let known = |value: f64, shown: String| if value.is_finite() { shown } else { "-".into() };
        let ratio = known(*damping_ratio, format!("{damping_ratio:.5}"));
        let pole_hz = known(pole.frequency_hz, format!("{:.3}", pole.frequency_hz));
        let _ =
            write!(text, "\n{:5} {frequency_hz:8.3} Hz   {bound:>13}   {ratio:>13} {pole_hz:>8} Hz {own:>13}", i + 1);
        if mode.frequency_hz == 0.0 {
            text.push_str("   (nothing holds this motion)");
        } else if let Some(slower) = pole.slower.filter(|_| !pole.is_known()) {
            let _ = write!(
                text,
                "   (does not swing: {:.4e} 1/s, and a faster one that meshes do not agree on)",
                slower.re
            );
        } else if !pole.is_known() {
            text.push_str("   (the pole of this mode was not found, or meshes do not agree on it)");
        } else if let Some(slower) = pole.slower {
            let _ = write!(text, "   (does not swing: {:.4e} and {:.4e} 1/s)", pole.s.re, slower.re);
        } else if mode.damping_ratio == 0.0 {
            text.push_str("   (undamped: unbounded at resonance)");
        }
    }
    text
}

/// Writes the shapes as asked for; whether they went to standard output.
fn write_shapes(options: &Options, scene: &Scene, shapes: &ModeShapes) -> Result<bool, Failure> {
    let failed =
        |path: &Path, error: std::io::Error| Failure::failed(format!("cannot write {}: {error}", path.display()));
    if let Some(path) = &options.npy {
        let sides = [shapes.frequencies_hz.len(), shapes.y_m.len(), shapes.x_m.len()];
        let axes: [(&str, &[f64]); 3] =
            [("frequency_hz", &shapes.frequencies_hz), ("y_m", &shapes.y_m), ("x_m", &shapes.x_m)];
        npy::write_doubles(path, &sides, shapes.values())
            .and_then(|()| npy::write_axes(path, &axes))
            .map_err(|error| failed(path, error))?;
        tell!("wrote {}, and its axes beside it", path.display());
    }
    if let Some(path) = &options.png {
        if shapes.frequencies_hz.len() > mode_sheet::MOST_MODES {
            tell!("--png draws the first {} of {} modes", mode_sheet::MOST_MODES, shapes.frequencies_hz.len());
        }
        reach::tell_written(path, mode_sheet::write(path, scene, shapes).map_err(Failure::failed)?);
    }
    match &options.csv {
        Some(path) if path.as_os_str() == "-" => print_text(shapes.csv().trim_end()).map(|()| true),
        Some(path) => {
            write_text_file(path, &shapes.csv())?;
            tell!("wrote {}", path.display());
            Ok(false)
        }
        None => Ok(false),
    }
}
