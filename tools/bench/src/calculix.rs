//! (c): CalculiX on the same plate.

use crate::clock::compute_median;
use crate::environment::Environment;
use crate::error::Error;
use crate::own::TIGHTEST;
use crate::problem::{Problem, compute_acceleration_curves_on_mesh};
use crate::process::run_and_parse_json;
use crate::table::{Table, format_relative_error, format_time};
use num_complex::Complex64;
use serde::Deserialize;
use std::path::Path;
use std::process::{Command, Stdio};

/// The program's name.
const CCX: &str = "ccx";

/// What `peers/calculix.py` prints.
#[derive(Clone, Debug, Deserialize)]
struct CalculixReport {
    version: String,
    mesh: String,
    unknowns: usize,
    elapsed_s: f64,
    frequencies_hz: Vec<f64>,
    x_m: Vec<f64>,
    y_m: Vec<f64>,
    acceleration_re: Vec<Vec<f64>>,
    acceleration_im: Vec<Vec<f64>>,
}

/// Runs CalculiX, or says why not.
///
/// # Errors
/// [`Error::Start`], [`Error::Failed`], [`Error::Json`], [`Error::Model`], [`Error::Response`].
pub fn build_table_of_calculix_comparison(
    environment: &Environment,
    problem: &Problem,
    problem_file: &Path,
) -> Result<Table, Error> {
    let columns = [
        "mesh",
        "unknowns",
        "frequencies",
        "time",
        "median difference",
        "largest difference, relative to the curve's peak",
    ];
    let mut table = Table::new("(c) Side by side: CalculiX", &columns);
    let found = Command::new(CCX).arg("-v").stdout(Stdio::null()).stderr(Stdio::null()).status().is_ok();
    if !found {
        table.columns.clear();
        table.above.push(format!("Skipped: no program `{CCX}` here (Debian's package calculix-ccx)."));
        return Ok(table);
    }
    let meshes: &[(&str, &str)] =
        if environment.quick { &[("12x8", "10")] } else { &[("12x8", "70"), ("24x16", "20")] };
    let mut version = String::new();
    for (mesh, between) in meshes {
        let mut command = environment.make_script_command("calculix.py");
        command.arg(problem_file).arg(environment.scratch.join("calculix")).args([
            "--mesh",
            mesh,
            "--between",
            between,
        ]);
        let report: CalculixReport = run_and_parse_json(&mut command)?;
        let (typical, largest) = compute_median_and_largest_relative_difference(&report, problem)?;
        table.add_row([
            report.mesh,
            report.unknowns.to_string(),
            report.frequencies_hz.len().to_string(),
            format_time(report.elapsed_s),
            format_relative_error(typical),
            format_relative_error(largest),
        ]);
        version = report.version;
    }
    table.above.push(format!(
        "CalculiX {version} uses S8R shells, which it converts to solids, and elements for springs, dashpots and \
         masses. It computes 60 modes and then the steady-state response to one load, at frequencies that it chooses \
         itself. The output is at the nodes of the mesh. The table compares this output with the most accurate answer \
         of `era` at the same frequencies and at the corners of the cells. The differences include the difference of \
         the models, because a thin plate has no shear. \"Median difference\" is the median of the relative \
         differences in magnitude. The largest difference occurs close to a sharp resonance, where a frequency error \
         of 0.1 % matters most."
    ));
    Ok(table)
}

/// Median difference of magnitudes relative to the value, and the largest deviation relative to the curve's peak.
fn compute_median_and_largest_relative_difference(
    report: &CalculixReport,
    problem: &Problem,
) -> Result<(f64, f64), Error> {
    let places: Vec<_> = report.x_m.iter().copied().zip(report.y_m.iter().copied()).collect();
    let own = compute_acceleration_curves_on_mesh(&problem.scene, TIGHTEST, &report.frequencies_hz, &places)?;
    let other =
        |place: usize, f: usize| Complex64::new(report.acceleration_re[f][place], report.acceleration_im[f][place]);
    let mut differences = Vec::new();
    let mut largest = 0.0_f64;
    // The first load's curves come first.
    for (place, curve) in own.values.chunks_exact(own.count).take(places.len()).enumerate() {
        let peak = curve.iter().map(|z| z.norm()).fold(f64::MIN_POSITIVE, f64::max);
        for (f, z) in curve.iter().enumerate() {
            differences.push((other(place, f).norm() / z.norm() - 1.0).abs());
            largest = largest.max((other(place, f) - z).norm() / peak);
        }
    }
    Ok((compute_median(differences), largest))
}
