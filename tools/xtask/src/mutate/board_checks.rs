//! What judges an image with a mistake in it: the parts of the report from the emulated board, and the emulator's own tests.

use super::{TreeVerdict, run_command_and_get_success_and_all_output};
use crate::emulate::report::ReportPart;
use crate::error::{Error, file_error};
use clap::ValueEnum;
use std::path::Path;
use std::process::Command;

/// A check of an image.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum BoardCheck {
    /// A part of the report.
    Report(ReportPart),
    /// Pins, registers and pulses against the manufacturer's data, which share nothing with the report.
    EmulatorTests,
}

/// All checks, the shortest first.
const CHECKS: [BoardCheck; 8] = [
    BoardCheck::Report(ReportPart::Load),
    BoardCheck::Report(ReportPart::Settings),
    BoardCheck::EmulatorTests,
    BoardCheck::Report(ReportPart::Permit),
    BoardCheck::Report(ReportPart::Electrodes),
    BoardCheck::Report(ReportPart::Failures),
    BoardCheck::Report(ReportPart::Trips),
    BoardCheck::Report(ReportPart::Session),
];

/// Runs the checks one after the other on an image, `first` before the others, until one finds something wrong.
///
/// # Errors
/// A program that cannot be started.
pub fn run_board_checks_until_one_fails(
    tree: &Path,
    image: &Path,
    first: Option<BoardCheck>,
) -> Result<TreeVerdict, Error> {
    let others = CHECKS.into_iter().filter(|check| Some(*check) != first);
    for check in first.into_iter().chain(others) {
        let verdict = match check {
            BoardCheck::Report(part) => run_parts_of_report_until_first_wrong_row(image, &[part])?,
            BoardCheck::EmulatorTests => run_emulator_tests(tree, image)?,
        };
        if !matches!(verdict, TreeVerdict::Sound) {
            return Ok(verdict);
        }
    }
    Ok(TreeVerdict::Sound)
}

/// Runs all checks, the parts of the report on all processors.
///
/// # Errors
/// A program that cannot be started.
pub fn run_all_board_checks(tree: &Path, image: &Path) -> Result<TreeVerdict, Error> {
    match run_parts_of_report_until_first_wrong_row(image, ReportPart::value_variants())? {
        TreeVerdict::Sound => run_emulator_tests(tree, image),
        other => Ok(other),
    }
}

fn run_parts_of_report_until_first_wrong_row(image: &Path, parts: &[ReportPart]) -> Result<TreeVerdict, Error> {
    let own = std::env::current_exe().map_err(file_error("cannot find", Path::new("this program")))?;
    let mut command = Command::new(own);
    command.args(["emulate", "--report", "--first-wrong", "--image"]).arg(image);
    for name in parts.iter().filter_map(ReportPart::to_possible_value) {
        command.args(["--part", name.get_name()]);
    }
    let (works, output) = run_command_and_get_success_and_all_output(&mut command)?;
    let wrong = output.lines().filter_map(|line| line.strip_prefix("wrong: ")).map(|row| format!("report: {row}"));
    Ok(if works { TreeVerdict::Sound } else { TreeVerdict::Failed(wrong.collect()) })
}

fn run_emulator_tests(tree: &Path, image: &Path) -> Result<TreeVerdict, Error> {
    let launch = tree.join("tools/emulator/launch.py");
    let (works, output) = run_command_and_get_success_and_all_output(
        Command::new("python3").arg(launch).args(["--self-test", "--elf"]).arg(image),
    )?;
    Ok(if works { TreeVerdict::Sound } else { TreeVerdict::Failed(list_failed_python_tests(&output)) })
}

/// The tests that unittest names as failed: lines such as `FAIL: test_pins (test_pin_map.PinMapTest.test_pins)`.
fn list_failed_python_tests(output: &str) -> Vec<String> {
    let name = |line: &str| line.strip_prefix("FAIL: ").or_else(|| line.strip_prefix("ERROR: ")).map(str::to_owned);
    output.lines().filter_map(name).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn failed_python_tests_are_named() {
        let output = "....\nFAIL: test_pins (test_pin_map.PinMapTest.test_pins)\nTraceback\nERROR: test_two (a.B)\n";
        assert_eq!(
            list_failed_python_tests(output),
            ["test_pins (test_pin_map.PinMapTest.test_pins)", "test_two (a.B)"]
        );
    }

    /// A part that is missing here would never judge a mistake.
    #[test]
    fn every_part_of_the_report_is_among_the_checks() {
        for part in ReportPart::value_variants() {
            assert!(CHECKS.contains(&BoardCheck::Report(*part)), "{part:?}");
        }
    }
}
