//! `cargo xtask test` and `cargo xtask ci`: everything that can be checked, set-up included.

use crate::error::Error;
use crate::process::run;
use crate::{crosscheck, dependencies, emulate, firmware, fuzz, house, image, miri, python, root, setup, waveforms};
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
pub fn test() -> Result<(), Error> {
    setup::ensure("cargo xtask test", setup::TEST)?;
    tests()
}

fn tests() -> Result<(), Error> {
    let root = root()?;
    step("firmware image", || firmware::command(&firmware::Options::default()))?;
    step("emulator", || {
        run(Command::new("python3").arg("tools/emulator/launch.py").arg("--setup-only").current_dir(&root))
    })?;
    step("waveforms", || waveforms::command(&waveforms::Options::default()))?;
    step("report from the emulated board", emulate::test)?;
    // What is shipped, optimised as it is shipped, and one build for all that follows.
    step("tests", || run(cargo(&root).args(["test", "--workspace", "--release"])))?;
    step("Python package", python::tests)?;
    step("advisories", dependencies::some_advisories)?;
    step("independent reference: its own tests", crosscheck::own_tests)?;
    step("independent reference: random scenes", crosscheck::some_scenes)
}

/// Formatting, lints, documentation and dependencies of both workspaces, then [`test()`].
///
/// # Errors
/// As [`test()`].
pub fn ci() -> Result<(), Error> {
    setup::ensure("cargo xtask ci", setup::CI)?;
    let root = root()?;
    let firmware = root.join("firmware");
    step("formatting", || {
        run(cargo(&root).args(["fmt", "--all", "--check"]))?;
        run(cargo(&firmware).args(["fmt", "--check"]))
    })?;
    step("firmware image, budgets", || firmware::command(&firmware::Options::with_budget()))?;
    step("lints", || {
        run(cargo(&root).args(["clippy", "--workspace", "--all-targets", "--", "-D", "warnings"]))?;
        image::cargo("clippy", &["--", "-D", "warnings"])
    })?;
    step("circles of imports", house::run_survey)?;
    step("documentation", || {
        run(cargo(&root).args(["doc", "--workspace", "--no-deps"]).env("RUSTDOCFLAGS", "-D warnings"))
    })?;
    step("dependencies", dependencies::licences)?;
    let planted = ["test", "-p", "xtask", "--test", "advisories", "--", "--ignored"];
    step("advisories: planted ones are found", || run(cargo(&root).args(planted)))?;
    tests()?;
    step("miri", miri::short)?;
    step("fuzzing", || fuzz::command(&fuzz::Options::bounded(FUZZ_S)))
}

fn cargo(folder: &Path) -> Command {
    let mut command = Command::new("cargo");
    command.current_dir(folder);
    command
}

/// Runs one step and says how long it took, and how long all steps so far: of a run that is cut short, what took the time.
fn step(name: &str, work: impl FnOnce() -> Result<(), Error>) -> Result<(), Error> {
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
