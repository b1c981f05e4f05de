//! Single cases, each in a process of its own, so that its peak of memory is its own.

use crate::environment::Environment;
use crate::error::Error;
use crate::process::run_and_parse_json;
use clap::{Args, Subcommand};
use era_model::model::Fineness;
use era_model::model::{Accuracy, Bound, PanelModel, compute_modes_with_error_bounds};
use era_model::response::{CoordinateSolver, compute_acceleration_curves_per_newton_with_error_bounds};
use era_model::scene::{Scene, equidistant_numbers};
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::Instant;

/// A case.
#[derive(Clone, Debug, Subcommand)]
pub enum Case {
    /// Modes to a tolerance.
    Modes(ToleranceCase),
    /// Responses at a point to a tolerance.
    Response(ToleranceCase),
    /// A mesh of a given fineness.
    Mesh(MeshCase),
}

/// Something asked to a tolerance.
#[derive(Clone, Debug, Args)]
pub struct ToleranceCase {
    /// Scene file.
    #[arg(long)]
    pub scene: PathBuf,
    /// Relative.
    #[arg(long)]
    pub tolerance: f64,
    /// Highest frequency.
    #[arg(long)]
    pub max_hz: f64,
}

/// A mesh, and what is computed on it.
#[derive(Clone, Debug, Args)]
pub struct MeshCase {
    /// Scene file.
    #[arg(long)]
    pub scene: PathBuf,
    /// Widest cell.
    #[arg(long)]
    pub cell_m: f64,
    /// Order of the elements.
    #[arg(long)]
    pub order: usize,
    /// Highest frequency.
    #[arg(long)]
    pub max_hz: f64,
    /// Frequencies of the sweep.
    #[arg(long, default_value_t = 1000)]
    pub frequencies: usize,
}

/// What is asked in responses: where, in m, and how many frequencies up to the highest.
pub const POINT_M: (f64, f64) = (0.1, 0.06);
const COUNT: usize = 951;

/// What comes back.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub struct CaseOutcome {
    /// Answer with its bound, in s.
    pub elapsed_s: f64,
    /// Mesh and factors, in s.
    pub mesh_s: f64,
    /// Modes and residual shapes, in s.
    pub modes_s: f64,
    /// The sweep, in s.
    pub sweep_s: f64,
    /// Largest resident memory of the process.
    pub peak_bytes: f64,
    /// Of the finest mesh.
    pub unknowns: usize,
    /// Order of its elements.
    pub order: usize,
    /// Meshes that were solved.
    pub levels: usize,
    /// Modes, or modes and residual shapes of the reduced model.
    pub coordinates: usize,
    /// Frequencies of modes.
    pub frequencies_hz: Vec<f64>,
    /// For each frequency, or for each curve; `None` where there is none.
    pub bounds: Vec<Option<f64>>,
    /// Real and imaginary parts, curve after curve.
    pub curves: Vec<(f64, f64)>,
}

/// The frequencies of responses, in Hz.
#[must_use]
pub fn list_response_frequencies_hz(max_hz: f64) -> Vec<f64> {
    equidistant_numbers(50.0, max_hz, COUNT)
}

/// Runs a case in this process.
///
/// # Errors
/// [`Error::Parse`], [`Error::Model`], [`Error::Response`], [`Error::File`].
pub fn run_case(case: &Case) -> Result<CaseOutcome, Error> {
    let mut outcome = match case {
        Case::Modes(case) => compute_and_time_modes_and_bounds(case)?,
        Case::Response(case) => compute_and_time_responses_and_bounds(case)?,
        Case::Mesh(case) => time_mesh_modes_and_sweep(case)?,
    };
    if outcome.peak_bytes == 0.0 {
        outcome.peak_bytes = read_peak_memory_bytes()?;
    }
    Ok(outcome)
}

fn list_limit_of_each_bound_if_known(bounds: &[Bound]) -> Vec<Option<f64>> {
    bounds.iter().map(|bound| bound.limit_if_known()).collect()
}

fn compute_and_time_modes_and_bounds(case: &ToleranceCase) -> Result<CaseOutcome, Error> {
    let scene = Scene::load(&case.scene)?;
    let started = Instant::now();
    let found = compute_modes_with_error_bounds(&scene, Accuracy::from_tolerance(case.tolerance)?, case.max_hz)?;
    Ok(CaseOutcome {
        elapsed_s: started.elapsed().as_secs_f64(),
        unknowns: found.model.count_unknowns(),
        order: found.model.element_order(),
        levels: found.steps.len(),
        coordinates: found.answer.len(),
        frequencies_hz: found.answer.iter().map(|mode| mode.frequency_hz).collect(),
        bounds: list_limit_of_each_bound_if_known(&found.bounds),
        ..CaseOutcome::default()
    })
}

fn compute_and_time_responses_and_bounds(case: &ToleranceCase) -> Result<CaseOutcome, Error> {
    let scene = Scene::load(&case.scene)?;
    let frequencies_hz = list_response_frequencies_hz(case.max_hz);
    let started = Instant::now();
    let found = compute_acceleration_curves_per_newton_with_error_bounds(
        &scene,
        Accuracy::from_tolerance(case.tolerance)?,
        POINT_M,
        &frequencies_hz,
    )?;
    let elapsed_s = started.elapsed().as_secs_f64();
    // Before anything else is allocated.
    let peak_bytes = read_peak_memory_bytes()?;
    let reduced = found.model.reduce_with_residual_shapes_of_actuators_damping_and_points(case.max_hz, &[POINT_M])?;
    Ok(CaseOutcome {
        elapsed_s,
        peak_bytes,
        unknowns: found.model.count_unknowns(),
        order: found.model.element_order(),
        levels: found.steps.len(),
        coordinates: reduced.count_coordinates(),
        bounds: list_limit_of_each_bound_if_known(&found.bounds),
        curves: found.answer.iter().flatten().map(|z| (z.re, z.im)).collect(),
        ..CaseOutcome::default()
    })
}

fn time_mesh_modes_and_sweep(case: &MeshCase) -> Result<CaseOutcome, Error> {
    let scene = Scene::load(&case.scene)?;
    let fineness = Fineness { cell_m: case.cell_m, order: case.order, layers: 0 };
    let started = Instant::now();
    let model = PanelModel::build_with_fineness(&scene, fineness)?;
    let mesh_s = started.elapsed().as_secs_f64();
    let reduced = model.reduce_with_residual_shapes_of_actuators_damping_and_points(case.max_hz, &[])?;
    let modes_s = started.elapsed().as_secs_f64() - mesh_s;
    let begun = Instant::now();
    let solver = CoordinateSolver::new(&reduced);
    for frequency_hz in equidistant_numbers(50.0, case.max_hz, case.frequencies) {
        std::hint::black_box(solver.solve_coordinates_per_newton_at(frequency_hz)?);
    }
    Ok(CaseOutcome {
        elapsed_s: started.elapsed().as_secs_f64(),
        mesh_s,
        modes_s,
        sweep_s: begun.elapsed().as_secs_f64(),
        unknowns: model.count_unknowns(),
        order: case.order,
        levels: 1,
        coordinates: reduced.count_coordinates(),
        ..CaseOutcome::default()
    })
}

/// The most memory that was resident in this process, as the kernel says; NaN if it does not.
fn read_peak_memory_bytes() -> Result<f64, Error> {
    let path = Path::new("/proc/self/status");
    let text = std::fs::read_to_string(path).map_err(Error::file_error(path))?;
    let kilobytes = |line: &str| line.split_whitespace().nth(1).and_then(|value| value.parse::<f64>().ok());
    let found = text.lines().find(|line| line.starts_with("VmHWM:")).and_then(kilobytes);
    Ok(found.map_or(f64::NAN, |kilobytes| kilobytes * 1024.0))
}

/// Runs a case in a process of its own.
///
/// # Errors
/// [`Error::Start`], [`Error::Failed`], [`Error::Json`].
pub fn run_case_in_child_process(
    environment: &Environment,
    kind: &str,
    scene: &Path,
    options: &[(&str, String)],
) -> Result<CaseOutcome, Error> {
    let mut command = Command::new(&environment.own_program);
    command.args(["case", kind, "--scene"]).arg(scene);
    for (option, value) in options {
        command.arg(option).arg(value);
    }
    run_and_parse_json(&mut command)
}
