//! `cargo xtask bench`: builds the measuring program in release mode and runs it; `start`, `daemon`, `costs` and `slider` measure `era serve`
//! itself, and `planner --against REV` another commit's planner as well.

use crate::error::Error;
use crate::process::run_command;
use crate::release_build::build_release_programs_by_package_and_binary_name;
use crate::repository_root;
use clap::Args;
use std::ffi::OsString;
use std::process::Command;

/// What to measure.
#[derive(Args)]
#[command(disable_help_flag = true)]
pub struct Options {
    /// What to measure, and how: `model --help`, `start --help`, `daemon --help`, `costs --help` and `slider --help` say it all
    #[arg(
        trailing_var_arg = true,
        allow_hyphen_values = true,
        required = true,
        value_name = "model|planner|study|feel|imports|start|daemon|costs|slider ..."
    )]
    arguments: Vec<OsString>,
}

/// Runs a measurement.
///
/// # Errors
/// [`Error::Start`], [`Error::Failed`].
pub fn build_and_run_chosen_benchmark(options: &Options) -> Result<(), Error> {
    if options.arguments.first().is_some_and(|what| what == "start") {
        return crate::start::build_daemon_and_measure_first_plan_times_cold_and_warm(&options.arguments);
    }
    if options.arguments.first().is_some_and(|what| ["daemon", "costs", "slider"].iter().any(|own| what == own)) {
        return crate::load::build_daemon_and_load_program_and_run_load(&options.arguments);
    }
    if let [what, option, revision] = options.arguments.as_slice()
        && what == "planner"
        && option == "--against"
    {
        return crate::against::compare_planner_times_with_revision(&revision.to_string_lossy());
    }
    let root = repository_root()?;
    // What reads effect files is the program itself.
    let reads_files = options.arguments.first().is_some_and(|what| what == "imports");
    let programs = [("era-bench", "era-bench"), ("era-host", "era")];
    build_release_programs_by_package_and_binary_name(&root, if reads_files { &programs } else { &programs[..1] })?;
    run_command(Command::new(root.join("target/release/era-bench")).args(&options.arguments))
}
