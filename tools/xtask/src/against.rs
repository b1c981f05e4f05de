//! `cargo xtask bench planner --against REV`: the planner of another commit beside this one's, on the same machine in one run.

use crate::error::Error;
use crate::process::{capture_output, run_command};
use crate::repository_root;
use std::path::Path;
use std::process::Command;

/// The table that is compared.
const TITLE: &str = "== Time per plan";
/// Its columns that say what a row is about.
const NAMES: [&str; 2] = ["actuators", "touches"];
/// Those that are compared.
const FIGURES: [&str; 2] = ["median", "p99"];

/// Builds the measuring program of `revision` in a checkout of its own, runs both, and prints their times and the ratios.
///
/// # Errors
/// [`Error::Start`], [`Error::Failed`]: there is no such commit, or it has no such measurement.
pub fn compare_planner_times_with_revision(revision: &str) -> Result<(), Error> {
    let root = repository_root()?;
    let other = root.join("target/against/checkout");
    let git = |arguments: &[&str]| run_command(Command::new("git").current_dir(&root).args(arguments));
    let path = other.display().to_string();
    // One that an interrupted run has left.
    git(&["worktree", "prune"])?;
    if other.exists() {
        git(&["worktree", "remove", "--force", &path])?;
    }
    git(&["worktree", "add", "--detach", "--quiet", &path, revision])?;
    let (before, after) =
        (build_and_run_planner_benchmark_of_checkout(&other)?, build_and_run_planner_benchmark_of_checkout(&root)?);
    git(&["worktree", "remove", "--force", &path])?;
    print!(
        "{}",
        format_comparison(
            revision,
            &parse_rows_of_time_per_plan_table(&before),
            &parse_rows_of_time_per_plan_table(&after)
        )
    );
    Ok(())
}

/// What the measuring program of a checkout prints. The build is kept in `target/against` of this one.
fn build_and_run_planner_benchmark_of_checkout(checkout: &Path) -> Result<String, Error> {
    let target =
        repository_root()?.join("target").join(if checkout == repository_root()? { "." } else { "against/target" });
    let build = ["build", "--release", "--quiet", "-p", "era-bench"];
    run_command(Command::new("cargo").current_dir(checkout).env("CARGO_TARGET_DIR", &target).args(build))?;
    capture_output(Command::new(target.join("release/era-bench")).current_dir(checkout).arg("planner"))
}

/// A row of the table: what it is about, and its figures in s.
#[derive(Clone, Debug, PartialEq)]
struct Row {
    name: String,
    seconds: Vec<Option<f64>>,
}

/// The rows of the table in a measurement's text, where columns are two spaces apart at least.
fn parse_rows_of_time_per_plan_table(text: &str) -> Vec<Row> {
    let cells = |line: &str| -> Vec<String> {
        line.split("  ").map(str::trim).filter(|cell| !cell.is_empty()).map(str::to_owned).collect()
    };
    let table = text.lines().skip_while(|line| *line != TITLE).take_while(|line| !line.is_empty());
    let mut lines = table.map(cells).skip_while(|cells| cells.first().is_none_or(|cell| cell != NAMES[0]));
    let Some(header) = lines.next() else { return Vec::new() };
    let place = |name: &str| header.iter().position(|cell| cell == name);
    let row = |cells: Vec<String>| {
        let cell = |name: &str| place(name).and_then(|at| cells.get(at));
        let name = NAMES.iter().filter_map(|name| cell(name)).cloned().collect::<Vec<_>>().join(", ");
        Row { name, seconds: FIGURES.iter().map(|figure| parse_time_with_unit_as_seconds(cell(figure)?)).collect() }
    };
    lines.map(row).collect()
}

/// A time as the measuring program prints it.
fn parse_time_with_unit_as_seconds(cell: &str) -> Option<f64> {
    let (number, unit) = cell.split_once(' ')?;
    let scale = match unit {
        "s" => 1.0,
        "ms" => 1e-3,
        "us" => 1e-6,
        _ => return None,
    };
    Some(number.parse::<f64>().ok()? * scale)
}

/// Both, row by row.
fn format_comparison(revision: &str, before: &[Row], after: &[Row]) -> String {
    let mut text = format!("Time per plan in us: {revision}, this checkout, and their ratio\n");
    for row in after {
        let old = before.iter().find(|old| old.name == row.name);
        text.push_str(&format!("{:24}", row.name));
        for (k, figure) in FIGURES.iter().enumerate() {
            let old = old.and_then(|old| *old.seconds.get(k)?);
            let new = row.seconds.get(k).copied().flatten();
            let shown = |value: Option<f64>| value.map_or_else(|| "-".to_owned(), |s| format!("{:.0}", s * 1e6));
            let ratio = old.zip(new).map_or_else(|| "-".to_owned(), |(old, new)| format!("{:.2}", new / old));
            text.push_str(&format!("  {figure} {:>6} {:>6} {ratio:>5}", shown(old), shown(new)));
        }
        text.push('\n');
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    const TEXT: &str = "Measured on 2 cores.\n\n== Time per plan\nExample plate, balanced.\n\
        actuators        touches   median      p99  longest\n\
        1          0.05 to 0.5 g   148 us  1.24 ms  2.04 ms\n\
        4                   20 g  5.12 ms  19.6 ms     2 s\n\n== Against brute force\nactuators  touches\n1  2\n";

    #[test]
    fn rows_are_read_with_their_units() {
        let read = parse_rows_of_time_per_plan_table(TEXT);
        assert_eq!(read.len(), 2);
        assert_eq!(read[0].name, "1, 0.05 to 0.5 g");
        let near = |value: Option<f64>, wanted: f64| (value.unwrap() / wanted - 1.0).abs() < 1e-12;
        assert!(near(read[0].seconds[0], 148e-6) && near(read[1].seconds[1], 19.6e-3), "{read:?}");
    }

    #[test]
    fn ratios_are_new_over_old_and_rows_that_only_one_has_stay() {
        let mut after = parse_rows_of_time_per_plan_table(TEXT);
        after[0].seconds[0] = Some(74e-6);
        let text = format_comparison("v0", &parse_rows_of_time_per_plan_table(TEXT)[..1], &after);
        assert!(text.contains("median    148     74  0.50"), "{text}");
        assert!(text.lines().last().unwrap().contains("median      -   5120     -"), "{text}");
    }
}
