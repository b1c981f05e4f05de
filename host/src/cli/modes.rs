//! `era modes`: frequencies, damping ratios and shapes.

use super::args_panel::Modes as Options;
use super::cost::Cost;
use super::output::write_text_file_atomically;
use super::panel::{
    format_bound_or_not_known, tell_model_scope_and_mesh_accuracy_if_explaining,
    tell_why_bound_is_missing_or_largest_exceeds_tolerance, warn_if_too_thick_for_thin_plate_theory,
};
use super::progress::{run_telling_expected_cost_and_showing_progress, run_with_progress};
use super::terminal_messages::tell;
use super::{CommandResult, Failure, print_json, print_text_after_queued_log, reach};
use crate::maps::shapes::ModeShapes;
use crate::maps::{mode_sheet, npy};
use crate::model::{Bound, PanelMode, compute_modes_with_error_bounds};
use crate::scene::{Laminate, PlateRigidities, Scene, SurfaceKind};
use num_complex::Complex64;
use serde_json::json;
use std::fmt::Write;
use std::path::Path;
use std::time::Instant;

/// Most values of shapes: 160 MB, some three times that while they are computed.
const MOST_VALUES: f64 = 2e7;

pub fn run_modes(options: &Options) -> CommandResult {
    let started = Instant::now();
    let scene = options.panel.load_scene()?;
    let accuracy = options.panel.accuracy_from_time_limit_or_options(options.time)?;
    let wants_shapes = options.csv.is_some() || options.npy.is_some() || options.png.is_some();
    let cost = Cost::estimate_for_modes_unless_time_limited(&scene, accuracy, options.max_hz)?;
    let found = run_telling_expected_cost_and_showing_progress("computing modes", cost, || {
        compute_modes_with_error_bounds(&scene, accuracy, options.max_hz)
    })?;
    // Only of what was not refused.
    warn_if_too_thick_for_thin_plate_theory(&scene, options.max_hz);
    let elapsed_ms = started.elapsed().as_secs_f64() * 1e3;
    let dofs = found.model.count_unknowns();
    tell_model_scope_and_mesh_accuracy_if_explaining(&options.panel, &scene, accuracy, &found.steps);
    tell_why_bound_is_missing_or_largest_exceeds_tolerance(&found.bounds, accuracy);
    if wants_shapes {
        let grid = scene.surface_grid_lines_or_bar_axis_line_m(options.grid);
        refuse_too_many_mode_shape_values(grid.0.len() * grid.1.len(), found.answer.len())?;
        let shapes =
            run_with_progress("computing the shapes", || ModeShapes::compute(&scene, &found, options.max_hz, grid))?;
        if write_mode_shapes_true_if_to_stdout(options, &scene, &shapes)? {
            return Ok(());
        }
    }
    let modes = || found.answer.iter().zip(&found.bounds);
    if options.json {
        let list: Vec<_> = modes()
            .map(|(mode, bound)| {
                let of_pole = |s: &Complex64| json!([s.re, s.im]);
                json!({
                    "frequency_hz": mode.frequency_hz, "damping_ratio": mode.damping_ratio, "error_bound": bound.limit_if_known(),
                    "pole_frequency_hz": mode.pole.frequency_hz, "pole_error_bound": mode.pole_bound.limit_if_known(),
                    "poles_per_s": mode.pole.eigenvalues_without_conjugates().iter().map(of_pole).collect::<Vec<_>>(),
                })
            })
            .collect();
        let mut answer = json!({
            "dofs": dofs, "elapsed_ms": elapsed_ms, "tolerance": accuracy.tolerance_unless_time_limit_given(),
            "tolerance_met": Bound::all_meet_tolerance_if_given_and_decidable(&found.bounds, accuracy), "modes": list,
        });
        if let Some(laminate) = scene.surface.laminate_if_layered() {
            answer["layers"] = laminate_totals_to_json(&scene, &laminate);
        }
        return print_json(&answer);
    }
    let layers = scene
        .surface
        .laminate_if_layered()
        .map_or_else(String::new, |laminate| format_laminate_totals_line(&scene, &laminate));
    let heading = format!(
        "{}: modes of a model with {dofs} unknowns, computed \
    in {elapsed_ms:.0} ms{layers}",
        scene.name
    );
    print_text_after_queued_log(&format_mode_table(&heading, modes()))
}

/// What a scene's layers are together.
fn laminate_totals_to_json(scene: &Scene, laminate: &Laminate) -> serde_json::Value {
    let mut layers = json!({
        "thickness_mm": laminate.thickness_m * 1e3, "mass_kg_per_m2": laminate.per_area_kg_m2, "loss_factor": laminate.loss_factor,
    });
    for (name, stiffness) in laminate.named_bending_stiffnesses(scene.surface.kind, scene.surface.width_m) {
        layers[name] = json!(stiffness);
    }
    layers
}

/// The same as a line below the heading.
fn format_laminate_totals_line(scene: &Scene, laminate: &Laminate) -> String {
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
fn refuse_too_many_mode_shape_values(points: usize, modes: usize) -> Result<(), Failure> {
    let values = points as f64 * modes as f64;
    if values <= MOST_VALUES {
        return Ok(());
    }
    Err(Failure::usage_error(format!(
        "--grid and --max-hz: {points} points for each of {modes} modes make {values:.1e} values, but at most \
         {MOST_VALUES:.1e} are allowed"
    )))
}

fn format_mode_table<'a>(heading: &str, modes: impl Iterator<Item = (&'a PanelMode, &'a Bound)>) -> String {
    let mut text =
        format!("{heading}\n mode   frequency   error at most   damping ratio   pole frequency   pole error at most");
    for (i, (mode, bound)) in modes.enumerate() {
        let (bound, own) = (format_bound_or_not_known(*bound), format_bound_or_not_known(mode.pole_bound));
        let PanelMode { frequency_hz, damping_ratio, pole, .. } = mode;
        // Of a pole that is not known there are none.
        let known = |value: f64, shown: String| if value.is_finite() { shown } else { "-".into() };
        let ratio = known(*damping_ratio, format!("{damping_ratio:.5}"));
        let pole_hz = known(pole.frequency_hz, format!("{:.3}", pole.frequency_hz));
        let _ =
            write!(text, "\n{:5} {frequency_hz:8.3} Hz   {bound:>13}   {ratio:>13} {pole_hz:>13} Hz {own:>20}", i + 1);
        if mode.frequency_hz == 0.0 {
            text.push_str("   (rigid motion: no support resists this motion)");
        } else if let Some(slower) = pole.slower.filter(|_| !pole.is_known()) {
            let _ = write!(
                text,
                "   (decays without oscillation: real pole {:.4e} 1/s; the meshes do not agree on the faster pole)",
                slower.re
            );
        } else if !pole.is_known() {
            text.push_str("   (the pole of this mode was not found, or the meshes do not agree on the pole)");
        } else if let Some(slower) = pole.slower {
            let _ =
                write!(text, "   (decays without oscillation: real poles {:.4e} and {:.4e} 1/s)", pole.s.re, slower.re);
        } else if mode.damping_ratio == 0.0 {
            text.push_str("   (undamped: the response at resonance is unbounded)");
        }
    }
    text
}

/// Writes the shapes as asked for; whether they went to standard output.
fn write_mode_shapes_true_if_to_stdout(options: &Options, scene: &Scene, shapes: &ModeShapes) -> Result<bool, Failure> {
    let failed = |path: &Path, error: std::io::Error| {
        Failure::runtime_error(format!("cannot write {}: {error}", path.display()))
    };
    if let Some(path) = &options.npy {
        let sides = [shapes.frequencies_hz.len(), shapes.y_m.len(), shapes.x_m.len()];
        let axes: [(&str, &[f64]); 3] =
            [("frequency_hz", &shapes.frequencies_hz), ("y_m", &shapes.y_m), ("x_m", &shapes.x_m)];
        npy::write_npy_doubles(path, &sides, shapes.iter_values_of_all_modes())
            .and_then(|()| npy::write_npy_axis_files_beside_array(path, &axes))
            .map_err(|error| failed(path, error))?;
        tell!("wrote {}, and one file for each axis to the same folder", path.display());
    }
    if let Some(path) = &options.png {
        if shapes.frequencies_hz.len() > mode_sheet::MOST_MODES {
            tell!("--png draws the first {} of {} modes", mode_sheet::MOST_MODES, shapes.frequencies_hz.len());
        }
        reach::tell_picture_written(
            path,
            mode_sheet::write_sheet_of_first_modes_png(path, scene, shapes).map_err(Failure::runtime_error)?,
        );
    }
    match &options.csv {
        Some(path) if path.as_os_str() == "-" => print_text_after_queued_log(shapes.to_csv().trim_end()).map(|()| true),
        Some(path) => {
            write_text_file_atomically(path, &shapes.to_csv())?;
            tell!("wrote {}", path.display());
            Ok(false)
        }
        None => Ok(false),
    }
}
