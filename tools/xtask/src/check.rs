//! `cargo xtask test` and `cargo xtask ci`: everything that can be checked, set-up included.

use crate::error::{Error, file_error};
use crate::process::run_command;
use crate::{
    crosscheck, dependencies, emulate, firmware, fuzz, house, image, miri, mutate, python, repository_root, setup,
    waveforms,
};
use std::fs::File;
use std::path::{Path, PathBuf};
use std::process::{Child, Command};
use std::sync::OnceLock;
use std::time::Instant;

/// How long each fuzz target runs among the other checks, in s. Ten minutes are for before a release.
const FUZZ_S: u64 = 40;

/// Which tests to run.
#[derive(Debug, clap::Args)]
pub struct TestOptions {
    /// Only the checks of the board's code beside the workspace's tests: waveforms, emulated board, planted mistakes
    #[arg(long)]
    board: bool,
}

/// Gets what the tests need, makes the firmware and the emulator's environment, then runs every test of the workspace.
///
/// # Errors
/// [`Error::Missing`] before anything is run, or the first step that failed.
pub fn install_missing_needs_and_run_tests(options: &TestOptions) -> Result<(), Error> {
    setup::install_missing_needs("cargo xtask test", setup::TEST)?;
    if options.board { run_waveform_emulated_board_and_mutation_steps() } else { run_test_steps() }
}

/// What checks the board's code and needs no program of the host.
fn run_waveform_emulated_board_and_mutation_steps() -> Result<(), Error> {
    run_step("waveforms", || waveforms::check_waveforms(&waveforms::Options::default()))?;
    run_step("report from the emulated board", emulate::run_emulator_self_test_and_board_report)?;
    run_step("planted mistakes", || {
        mutate::run_mutation_tests(&mutate::Options::for_sample_of_shared_crate_mutations(10))
    })
}

/// A developer command in a process of its own beside other steps, which leaves a processor idle for part of its time. It writes into a file, which is
/// shown at its end.
struct CommandBeside {
    process: Child,
    arguments: &'static [&'static str],
    output: PathBuf,
}

impl CommandBeside {
    /// [`run_waveform_emulated_board_and_mutation_steps`]: they wait for the emulated board half of the time.
    const BOARD_STEPS: &[&str] = &["test", "--board"];
    /// The firmware's image with its budget: the last crates and the links need one processor.
    const FIRMWARE_BUDGET: &[&str] = &["firmware", "--budget"];

    fn start(root: &Path, arguments: &'static [&'static str]) -> Result<Self, Error> {
        let name = format!("target/beside-{}", arguments.first().copied().unwrap_or_default());
        let output = root.join(format!("{name}.log"));
        let file = File::create(&output).map_err(file_error("cannot make", &output))?;
        let errors = file.try_clone().map_err(file_error("cannot make", &output))?;
        // The workspace's tests build this program again, and remove the file that runs now.
        let own = std::env::current_exe().map_err(file_error("cannot find", Path::new("this program")))?;
        let copy = root.join(name);
        std::fs::copy(&own, &copy).map_err(file_error("cannot make", &copy))?;
        let mut command = Command::new(copy);
        command.current_dir(root).args(arguments).stdout(file).stderr(errors);
        let process = command
            .spawn()
            .map_err(|source| Error::Start { command: crate::process::format_command(&command), source })?;
        Ok(Self { process, arguments, output })
    }

    fn await_end_and_show_output(mut self) -> Result<(), Error> {
        let command = || format!("cargo xtask {}", self.arguments.join(" "));
        let status = self.process.wait().map_err(|source| Error::Start { command: command(), source })?;
        let shown = std::fs::read(&self.output).map_err(file_error("cannot read", &self.output))?;
        print!("{}", String::from_utf8_lossy(&shown));
        if status.success() { Ok(()) } else { Err(Error::Failed { command: command(), status }) }
    }
}

fn run_test_steps() -> Result<(), Error> {
    let root = repository_root()?;
    run_step("firmware image", || {
        firmware::build_image_and_print_path_or_memory_usage_and_budget(&firmware::Options::default())
    })?;
    run_step("emulator", || {
        run_command(Command::new("python3").arg("tools/emulator/launch.py").arg("--setup-only").current_dir(&root))
    })?;
    let board = CommandBeside::start(&root, CommandBeside::BOARD_STEPS)?;
    // What is shipped, optimised as it is shipped, and one build for all that follows.
    let tests = ["test", "--workspace", "--release"];
    let built = run_step("tests: build", || run_command(cargo_command(&root).args(tests).arg("--no-run")));
    run_step("board, beside that build", || board.await_end_and_show_output())?;
    built?;
    run_step("tests", || run_command(cargo_command(&root).args(tests)))?;
    run_step("Python package", python::build_and_install_wheel_and_run_python_tests_and_type_checks)?;
    run_step("advisories", dependencies::check_advisories_if_database_present)?;
    run_step("independent reference: its own tests", crosscheck::run_own_tests_of_python_reference)?;
    run_step("independent reference: random scenes", crosscheck::compare_random_scenes_with_python_reference)?;
    run_step(
        "independent reference: clicks of the firmware",
        crosscheck::compare_emulated_board_clicks_with_python_reference,
    )
}

/// Formatting, lints, documentation and dependencies of both workspaces, then [`install_missing_needs_and_run_tests()`].
///
/// # Errors
/// As [`install_missing_needs_and_run_tests()`].
pub fn install_missing_needs_and_run_ci_checks() -> Result<(), Error> {
    setup::install_missing_needs("cargo xtask ci", setup::CI)?;
    let root = repository_root()?;
    let firmware = root.join("firmware");
    run_step("formatting", || {
        run_command(cargo_command(&root).args(["fmt", "--all", "--check"]))?;
        run_command(cargo_command(&firmware).args(["fmt", "--check"]))
    })?;
    let budget = CommandBeside::start(&root, CommandBeside::FIRMWARE_BUDGET)?;
    let linted = run_step("lints", || {
        run_command(cargo_command(&root).args([
            "clippy",
            "--workspace",
            "--all-targets",
            "--release",
            "--",
            "-D",
            "warnings",
        ]))
    });
    run_step("firmware image, budgets, beside the lints", || budget.await_end_and_show_output())?;
    linted?;
    run_step("lints of the firmware", || image::run_firmware_cargo("clippy", &["--", "-D", "warnings"]))?;
    run_step("circles of imports", house::survey_crates_failing_on_import_cycles_or_folder_order)?;
    run_step("documentation", || {
        run_command(
            cargo_command(&root)
                .args(["doc", "--workspace", "--no-deps", "--release"])
                .env("RUSTDOCFLAGS", "-D warnings"),
        )
    })?;
    run_step("dependencies", dependencies::ensure_cargo_deny_and_check_licences_bans_and_sources)?;
    let planted = ["test", "--release", "-p", "xtask", "--test", "advisories", "--", "--ignored"];
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
