//! `cargo xtask soak` and `cargo xtask bench daemon`: builds the program and the load in release mode and puts it on.

use crate::error::Error;
use crate::process::run_command;
use crate::release_build::build_release_programs_by_package_and_binary_name;
use crate::repository_root;
use clap::Args;
use std::ffi::OsString;
use std::process::Command;

/// For how long, and with what.
#[derive(Args)]
pub struct Options {
    /// How long, in minutes; with faults, the last round of them is ended
    #[arg(long, value_name = "N", default_value = "1")]
    minutes: f64,
    /// Inject faults: cable, line dead or dead one way, rubbish on the line, slow clients, the daemon held and killed
    #[arg(long)]
    faults: bool,
    /// Seed of all random choices
    #[arg(long, value_name = "S", default_value = "1")]
    seed: u64,
}

/// Drives a running daemon as many clients would and prints what became of it.
///
/// # Errors
/// [`Error::Start`], [`Error::Failed`]: something was lost, not noticed or told in time, not recovered from, ever growing, or unsafe.
pub fn run_soak(options: &Options) -> Result<(), Error> {
    let (minutes, seed) = (options.minutes.to_string(), options.seed.to_string());
    let mut arguments: Vec<OsString> =
        ["soak", "--minutes", &minutes, "--seed", &seed].into_iter().map(Into::into).collect();
    arguments.extend(options.faults.then(|| "--faults".into()));
    build_daemon_and_load_program_and_run_load(&arguments)
}

/// Builds both programs and runs the load.
///
/// # Errors
/// As [`run_soak`].
pub fn build_daemon_and_load_program_and_run_load(arguments: &[OsString]) -> Result<(), Error> {
    let root = repository_root()?;
    build_release_programs_by_package_and_binary_name(&root, &[("era-host", "era"), ("era-load", "era-load")])?;
    run_command(Command::new(root.join("target/release/era-load")).current_dir(&root).args(arguments))
}
