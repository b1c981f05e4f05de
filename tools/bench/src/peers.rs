//! (c): the same problem solved by others.

use crate::environment::Environment;
use crate::error::Error;
use crate::fit;
use crate::own::EraMeasurement;
use crate::problem::{Problem, WANTED};
use crate::process::run_and_parse_json;
use crate::table::{Table, format_factor, format_relative_error, format_time};
use serde::Deserialize;
use std::path::Path;

/// What `peers/peers.py` prints.
#[derive(Clone, Debug, Deserialize)]
pub struct PeerReport {
    /// Version of NumPy.
    pub numpy: String,
    /// Version of SciPy.
    pub scipy: String,
    /// In the order of the meshes.
    pub results: Vec<PeerMeasurement>,
}

/// Size, times and error of one method on one mesh.
#[derive(Clone, Debug, Deserialize)]
pub struct PeerMeasurement {
    /// `direct`, `modal`, `modal+2` or `real`.
    pub method: String,
    /// As in `12x8`.
    pub mesh: String,
    /// Along x.
    pub cells: f64,
    /// Of the mesh.
    pub unknowns: usize,
    /// Assembly, and modes if there are any.
    pub set_up_s: f64,
    /// All frequencies and both loads.
    pub sweep_s: f64,
    /// Frequencies that `sweep_s` was measured at.
    pub timed_frequencies: usize,
    /// Largest on any curve, relative to its peak.
    pub error: f64,
}

impl PeerMeasurement {
    fn total_time_s(&self) -> f64 {
        self.set_up_s + self.sweep_s
    }
}

/// Names of the methods, as scripts and people call them.
const METHODS: [(&str, &str); 4] = [
    ("direct", "SciPy sparse LU at each frequency"),
    ("modal", "SciPy modal, 60 modes"),
    ("modal+2", "SciPy modal, 60 modes, 2 residual terms"),
    ("real", "thesis' equation 15 (dense, real, NumPy)"),
];

/// Runs SciPy and NumPy on a problem file.
///
/// # Errors
/// [`Error::Start`], [`Error::Failed`], [`Error::Json`].
pub fn run_scipy_and_numpy(environment: &Environment, problem_file: &Path) -> Result<PeerReport, Error> {
    let mut command = environment.make_script_command("peers.py");
    command.arg(problem_file);
    if environment.quick {
        command.args([
            "--meshes",
            "12x8",
            "24x16",
            "48x32",
            "--direct-most",
            "48",
            "--real-most",
            "12",
            "--solves",
            "4",
        ]);
    } else {
        command.args(["--meshes", "12x8", "24x16", "48x32", "96x64", "--direct-most", "96", "--real-most", "24"]);
    }
    run_and_parse_json(&mut command)
}

/// The table of every measurement.
#[must_use]
pub fn build_table_of_all_measurements(report: &PeerReport, own: &[EraMeasurement], problem: &Problem) -> Table {
    let columns = ["method", "mesh", "unknowns", "set-up", "sweep", "timed at", "total", "error"];
    let mut table = Table::new("(c) Side by side: every measurement", &columns);
    table.above.push(format!(
        "The problem is the starting plate with a loss factor of 0.005, {} frequencies from 50 to 1000 Hz, two loads \
         and {} points. Each method has one thread. The error is the largest difference from the most accurate answer \
         on any curve, relative to the peak of the curve. \"Set-up\" is the time from the scene to the matrices and \
         modes. \"Timed at\" is the number of frequencies at which the sweep was timed. If this number is below that \
         of all frequencies, the sweep time is the median time of one frequency, multiplied by the number of all \
         frequencies. The timed frequencies include those with the largest errors. In the rows of `era`, the column \
         \"mesh\" has the number of coordinates. Versions: NumPy {}, SciPy {}.",
        problem.frequencies_hz.len(),
        problem.count_points(),
        report.numpy,
        report.scipy
    ));
    for own in own {
        table.add_row([
            own.name.clone(),
            format!("{} coordinates", own.coordinates),
            own.unknowns.to_string(),
            format_time(own.set_up_s),
            own.sweep_s.map_or_else(String::new, format_time),
            problem.frequencies_hz.len().to_string(),
            format_time(own.total_time_s()),
            format_relative_error(own.error),
        ]);
    }
    for (method, name) in METHODS {
        for result in report.results.iter().filter(|result| result.method == method) {
            table.add_row([
                String::from(name),
                result.mesh.clone(),
                result.unknowns.to_string(),
                format_time(result.set_up_s),
                format_time(result.sweep_s),
                result.timed_frequencies.to_string(),
                format_time(result.total_time_s()),
                format_relative_error(result.error),
            ]);
        }
    }
    table
}

/// The mesh and the time with which a method comes down to an error.
struct MeshAndTime {
    cells: f64,
    total_s: f64,
    /// Or extrapolated.
    is_interpolated: bool,
}

fn find_mesh_and_time_for_error(
    results: &[&PeerMeasurement],
    error: f64,
    errors: &[(f64, f64)],
) -> Option<MeshAndTime> {
    let cells = fit::find_x_where_power_law_falls_to(errors, error)?;
    let totals: Vec<_> = results.iter().map(|result| (result.cells, result.total_time_s())).collect();
    let total_s = fit::evaluate_power_law(&totals, cells)?;
    Some(MeshAndTime { cells, total_s, is_interpolated: fit::is_within_measured_range(&totals, cells) })
}

/// The table of times at equal error, and of how many times the program's own they are.
#[must_use]
pub fn build_table_of_times_at_equal_error(report: &PeerReport, own: &EraMeasurement) -> Table {
    let columns = ["method", "error", "cells along x", "total", "ratio", "from"];
    let mut table = Table::new(format!("(c) Side by side: at equal error, {}", own.name), &columns);
    let own_s = own.total_time_s();
    table.above.push(format!(
        "The row \"{}\" above takes {} from scene to result{}, and has an error of {}. The next table says which mesh \
         and how much time each other method needs for two errors: 0.1 %, and the error of that row. Mesh and time are \
         interpolated or extrapolated from the meshes above, along straight lines in logarithms.",
        own.name,
        format_time(own_s),
        own.sweep_s.map_or_else(String::new, |s| format!(" ({} after the modes are known)", format_time(s))),
        format_relative_error(own.error)
    ));
    // The error is the mesh's, whichever way its matrices are solved.
    let list_results_of =
        |method: &str| report.results.iter().filter(|result| result.method == method).collect::<Vec<_>>();
    let list_cells_and_errors_of =
        |method: &str| list_results_of(method).iter().map(|result| (result.cells, result.error)).collect::<Vec<_>>();
    for (method, name) in METHODS {
        let errors = list_cells_and_errors_of(if method == "modal" { "modal" } else { "modal+2" });
        let mut wanted = vec![WANTED];
        if own.error < WANTED {
            wanted.push(own.error);
        }
        for error in wanted {
            let measured = list_results_of(method);
            let cells = match find_mesh_and_time_for_error(&measured, error, &errors) {
                Some(MeshAndTime { cells, total_s, is_interpolated }) => [
                    format!("{cells:.0}"),
                    format_time(total_s),
                    format_factor(total_s / own_s),
                    String::from(if is_interpolated { "interpolated" } else { "extrapolated" }),
                ],
                None if measured.len() < 2 => ["-", "-", "-", "one mesh only"].map(String::from),
                None => ["-", "-", "-", "not reached by finer meshes"].map(String::from),
            };
            table.add_row([String::from(name), format_relative_error(error)].into_iter().chain(cells));
        }
    }
    table
}

#[cfg(test)]
mod tests {
    use super::*;

    fn make_report() -> PeerReport {
        let result = |method: &str, cells: f64, seconds: f64, error: f64| {
            serde_json::json!({
                "method": method, "mesh": "any", "cells": cells, "unknowns": 1, "set_up_s": 0.0, "sweep_s": seconds,
                "timed_frequencies": 3, "error": error,
            })
        };
        let results = vec![
            result("modal+2", 10.0, 0.1, 1e-1),
            result("modal+2", 100.0, 1.0, 1e-3),
            result("modal", 10.0, 0.1, 1e-1),
            result("modal", 100.0, 1.0, 1e-1),
            result("direct", 10.0, 1.0, 1e-1),
            result("direct", 20.0, 8.0, 2.5e-2),
        ];
        serde_json::from_value(serde_json::json!({"numpy": "1", "scipy": "2", "results": results})).unwrap()
    }

    /// One second in all for an error.
    fn make_own_measurement(error: f64) -> EraMeasurement {
        let name = String::from("own");
        EraMeasurement { name, unknowns: 1, coordinates: 1, set_up_s: 0.5, sweep_s: Some(0.5), error, operations: 1.0 }
    }

    #[test]
    fn equal_error_is_read_off_the_measurements() {
        let rows = build_table_of_times_at_equal_error(&make_report(), &make_own_measurement(2e-3)).rows;
        let row = |method: usize| rows[method].iter().map(String::as_str).collect::<Vec<_>>();
        // 100 cells are ten times ten: as the cube of it, 1000 s.
        assert_eq!(row(0)[2..], ["100", "1000 s", "1000 x", "extrapolated"]);
        assert_eq!(row(1)[5], "not reached by finer meshes");
        assert_eq!(row(2)[2..], ["100", "1.00 s", "1.00 x", "interpolated"]);
        assert_eq!(rows.len(), 4);
    }

    #[test]
    fn own_error_is_a_second_goal_if_it_is_smaller() {
        let rows = build_table_of_times_at_equal_error(&make_report(), &make_own_measurement(1e-5)).rows;
        assert_eq!(rows.len(), 8);
        assert_eq!((rows[4][1].as_str(), rows[5][1].as_str(), rows[5][2].as_str()), ("1.0e-3", "1.0e-5", "1000"));
    }
}
