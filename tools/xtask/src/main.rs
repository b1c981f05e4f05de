//! Developer commands: `cargo xtask test`, `ci`, `firmware`, `emulate`, `fuzz`, `miri`, `waveforms`, `crosscheck`, `bench`,
//! `soak`, `advisories`, `house`, `python`, `dist`.

mod against;
mod bench;
mod budget;
mod check;
mod crosscheck;
mod dependencies;
mod dist;
mod elf;
mod emulate;
mod error;
mod firmware;
mod fuzz;
mod house;
mod image;
mod load;
mod miri;
mod mutate;
mod process;
mod python;
mod release_build;
mod setup;
mod stack;
mod start;
mod target;
mod triple;
mod waveforms;

use clap::{Parser, Subcommand};
use error::Error;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

/// Developer commands of the ERA haptics system.
#[derive(Parser)]
#[command(name = "cargo xtask", bin_name = "cargo xtask")]
struct Arguments {
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand)]
enum Command {
    /// Run all tests: host, shared crate, simulated and emulated device, page; set-up included.
    Test(check::TestOptions),
    /// Run everything that CI runs: formatting, lints, documentation, dependencies, then all tests.
    Ci,
    /// Build the firmware image and print its size and its path; gets the compilation target if it is missing.
    Firmware(firmware::Options),
    /// Measure on this machine, side by side with peers; builds in release mode.
    Bench(bench::Options),
    /// Drive a running daemon as many clients would, with faults or without, and print what became of it
    Soak(load::Options),
    /// Look for inputs that the decoder or the device logic cannot stand, with libFuzzer.
    Fuzz(fuzz::Options),
    /// Check the electrodes' waveforms over the whole space of drives, from registers to edges
    Waveforms(waveforms::Options),
    /// Plant mistakes in the board's code, one after the other, and show which test detects each
    Mutate(mutate::Options),
    /// Compare what the program prints with an independent reference in Python, on random scenes
    Crosscheck(crosscheck::Options),
    /// Build the Python package, then run its tests, its examples and the check of its types
    Python,
    /// Make all that a release has in `target/dist`: Debian's package, wheel, firmware, manual, checksums; try the package in a Debian system
    Dist(dist::Options),
    /// Fail if files import each other in circles; list files that are too long
    House,
    /// Look for known vulnerabilities in the crates that this depends on, in a copy of the RustSec advisory database
    Advisories(dependencies::Options),
    /// Run the tests of the shared crate under Miri, which needs a nightly compiler with that component.
    Miri,
    /// Build the firmware, run it on the emulated board and say hello to it.
    Emulate(emulate::Options),
}

fn main() -> ExitCode {
    let result = match Arguments::parse().command {
        Command::Test(options) => check::install_missing_needs_and_run_tests(&options),
        Command::Ci => check::install_missing_needs_and_run_ci_checks(),
        Command::Firmware(options) => firmware::build_image_and_print_path_or_memory_usage_and_budget(&options),
        Command::Bench(options) => bench::build_and_run_chosen_benchmark(&options),
        Command::Soak(options) => load::run_soak(&options),
        Command::Fuzz(options) => fuzz::run_fuzzing(&options),
        Command::Waveforms(options) => waveforms::check_waveforms(&options),
        Command::Mutate(options) => mutate::run_mutation_tests(&options),
        Command::Crosscheck(options) => crosscheck::install_needs_build_program_and_run_crosscheck(&options),
        Command::Python => python::install_needs_build_program_and_check_python_package(),
        Command::Dist(options) => dist::build_release_and_try_package_in_chroot_unless_disabled(&options),
        Command::House => house::survey_crates_failing_on_import_cycles_or_folder_order(),
        Command::Advisories(options) => dependencies::check_advisories_in_given_or_local_database(&options),
        Command::Miri => miri::run_all_miri_tests_failing_if_not_installed(),
        Command::Emulate(options) => emulate::build_image_and_run_emulator_or_board_report(&options),
    };
    match result {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("error: {error}");
            let mut cause = std::error::Error::source(&error);
            while let Some(inner) = cause {
                eprintln!("  because: {inner}");
                cause = inner.source();
            }
            ExitCode::FAILURE
        }
    }
}

/// The repository's root.
fn repository_root() -> Result<PathBuf, Error> {
    let here = Path::new(env!("CARGO_MANIFEST_DIR"));
    here.ancestors().nth(2).map(Path::to_path_buf).ok_or_else(|| Error::NoRepository(here.to_path_buf()))
}
