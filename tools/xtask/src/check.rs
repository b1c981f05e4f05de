//! `cargo xtask test` and `cargo xtask ci`: everything that can be checked, set-up included.

use crate::error::Error;
use crate::process::run_command;
use crate::{
    crosscheck, dependencies, emulate, firmware, fuzz, house, image, miri, mutate, python, repository_root, setup,
    waveforms,
};
use std::path::Path;
use std::process::Command;
use std::sync::OnceLock;
use std::time::Instant;

/// How long each fuzz target runs among the other checks, in s. Ten minutes are for before a release.
const FUZZ_S: u64 = 40;

/// Gets what the tests need, makes the firmware and the emulator's environment, then runs every test of the workspace.
///
/// # Errors
/// [`Error::Missing`] before anything is run, or the first step that failed.
pub fn run_all_tests() -> Result<(), Error> {
    setup::install_missing_needs("cargo xtask test", setup::TEST)?;
    run_test_steps()
}

fn run_test_steps() -> Result<(), Error> {
    let root = repository_root()?;
    run_step("firmware image", || firmware::build_image_and_report(&firmware::Options::default()))?;
    run_step("emulator", || {
        run_command(Command::new("python3").arg("tools/emulator/launch.py").arg("--setup-only").current_dir(&root))
    })?;
    run_step("waveforms", || waveforms::check_waveforms(&waveforms::Options::default()))?;
    run_step("report from the emulated board", emulate::run_emulator_self_test_and_board_report)?;
    // What is shipped, optimised as it is shipped, and one build for all that follows.
    run_step("tests", || run_command(cargo_command(&root).args(["test", "--workspace", "--release"])))?;
    run_step("planted mistakes", || mutate::plant_mistakes(&mutate::Options::some(10)))?;
    run_step("Python package", python::run_package_tests)?;
    run_step("advisories", dependencies::check_advisories_if_present)?;
    run_step("independent reference: its own tests", crosscheck::run_reference_tests)?;
    run_step("independent reference: random scenes", crosscheck::compare_random_scenes)
}

/// Formatting, lints, documentation and dependencies of both workspaces, then [`run_all_tests()`].
///
/// # Errors
/// As [`run_all_tests()`].
pub fn run_ci_checks() -> Result<(), Error> {
    setup::install_missing_needs("cargo xtask ci", setup::CI)?;
    let root = repository_root()?;
    let firmware = root.join("firmware");
    run_step("formatting", || {
        run_command(cargo_command(&root).args(["fmt", "--all", "--check"]))?;
        run_command(cargo_command(&firmware).args(["fmt", "--check"]))
    })?;
    run_step("firmware image, budgets", || firmware::build_image_and_report(&firmware::Options::with_budget()))?;
    run_step("lints", || {
        run_command(cargo_command(&root).args(["clippy", "--workspace", "--all-targets", "--", "-D", "warnings"]))?;
        image::run_firmware_cargo("clippy", &["--", "-D", "warnings"])
    })?;
    run_step("circles of imports", house::survey_crates_failing_on_import_cycles)?;
    run_step("documentation", || {
        run_command(cargo_command(&root).args(["doc", "--workspace", "--no-deps"]).env("RUSTDOCFLAGS", "-D warnings"))
    })?;
    run_step("dependencies", dependencies::check_licences_bans_and_sources)?;
    let planted = ["test", "-p", "xtask", "--test", "advisories", "--", "--ignored"];
    run_step("advisories: planted ones are found", || run_command(cargo_command(&root).args(planted)))?;
    run_test_steps()?;
    run_step("miri", miri::run_short_miri_tests_if_installed)?;
    run_step("fuzzing", || fuzz::run_fuzzing(&fuzz::Options::for_seconds(FUZZ_S)))
}

fn cargo_command(folder: &Path) -> Command {
    let mut command = Command::new("cargo");
    command.current_dir(folder);
    command
}

/// Runs one step and says how long it took, and how long all steps so far: of a run that is cut short, what took the time.
fn run_step(name: &str, work: impl FnOnce() -> Result<(), Error>) -> Result<(), Error> {
    static FIRST: OnceLock<Instant> = OnceLock::new();
    println!("== {name}");
    let started = Instant::now();
    let first = *FIRST.get_or_init(|| started);
    let result = work();
    let verdict = if result.is_ok() { "done" } else { "FAILED" };
    println!(
        "== {name}: {verdict} after {:.0} s, {:.0} s in all",
        started.elapsed().as_secs_f64(),
        first.elapsed().as_secs_f64()
    );
    result
}
