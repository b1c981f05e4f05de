//! `cargo xtask crosscheck`: the program, built in release mode, against the independent reference of `tools/crosscheck/`.

use crate::error::Error;
use crate::process::run_command;
use crate::release_build::build_release_programs_by_package_and_binary_name;
use crate::{image, repository_root, setup};
use clap::Args;
use std::path::PathBuf;
use std::process::Command;

/// How many random scenes `cargo xtask test` compares: some three minutes on two cores.
const SCENES_AMONG_TESTS: u32 = 30;
/// How many clicks `cargo xtask test` plays on the emulated board.
const CLICKS_AMONG_TESTS: u32 = 6;
/// The reference's own tests.
const OWN_TESTS: [&str; 7] =
    ["-m", "unittest", "discover", "--top-level-directory", "tools", "--start-directory", "tools/crosscheck/tests"];

/// Which scenes, and which comparisons.
#[derive(Args, Default)]
pub struct Options {
    /// How many random scenes
    #[arg(long, default_value = "300")]
    scenes: u32,
    /// Index of the first one, to go on where a run ended
    #[arg(long, default_value = "0")]
    first: u32,
    /// Seed of the random scenes
    #[arg(long, default_value = "1")]
    seed: u64,
    /// Comparisons to make, by name, with commas between; all unless told
    #[arg(long)]
    part: Option<String>,
    /// One scene only, by its index
    #[arg(long)]
    only: Option<u32>,
    /// This scene file instead of random scenes; each index is another place on the scene
    #[arg(long, value_name = "FILE")]
    scene: Option<PathBuf>,
    /// Play the windows of clicks on the firmware image on the emulated board, and compare the motion that its pulses make
    #[arg(long)]
    emulated: bool,
    /// Plant a mistake in this quantity: the comparison must fail
    #[arg(long)]
    plant: Option<String>,
    /// Plant a mistake in every quantity, one after the other, and fail if one is not found
    #[arg(long)]
    prove: bool,
    /// Print every result
    #[arg(long)]
    verbose: bool,
}

/// Compares.
///
/// # Errors
/// [`Error::Missing`], [`Error::Python`], [`Error::Start`], [`Error::Failed`] where something differs.
pub fn install_needs_build_program_and_run_crosscheck(options: &Options) -> Result<(), Error> {
    setup::install_missing_needs("cargo xtask crosscheck", setup::CROSSCHECK)?;
    let image = if options.emulated { Some(image::build_image_and_return_target_source(false)?.0) } else { None };
    let numbers =
        [("--scenes", u64::from(options.scenes)), ("--first", options.first.into()), ("--seed", options.seed)];
    let mut arguments: Vec<String> =
        numbers.into_iter().flat_map(|(name, value)| [name.to_owned(), value.to_string()]).collect();
    let values = [
        ("--part", options.part.clone()),
        ("--only", options.only.map(|index| index.to_string())),
        ("--plant", options.plant.clone()),
        ("--scene", options.scene.as_ref().map(|path| path.display().to_string())),
        ("--elf", image.map(|path| path.display().to_string())),
    ];
    for (name, value) in values {
        arguments.extend(value.into_iter().flat_map(|value| [name.to_owned(), value]));
    }
    let flags = [("--prove", options.prove), ("--verbose", options.verbose)];
    arguments.extend(flags.iter().filter(|(_, set)| *set).map(|(name, _)| (*name).to_owned()));
    build_release_programs_by_package_and_binary_name(&repository_root()?, &[("era-host", "era")])?;
    run_scene_comparison(&arguments)
}

/// The reference's own tests, for `cargo xtask test`.
///
/// # Errors
/// As [`install_needs_build_program_and_run_crosscheck`].
pub fn run_own_tests_of_python_reference() -> Result<(), Error> {
    run_command(ensure_environment_and_get_reference_python_command()?.args(OWN_TESTS))
}

/// The first random scenes, all comparisons, for `cargo xtask test`: with the program that its tests have built.
///
/// # Errors
/// As [`install_needs_build_program_and_run_crosscheck`].
pub fn compare_random_scenes_with_python_reference() -> Result<(), Error> {
    run_scene_comparison(&["--scenes".to_owned(), SCENES_AMONG_TESTS.to_string()])
}

/// Clicks on the example plate from the edges at the pins of the firmware image, for `cargo xtask test`: with the program that its tests have built.
///
/// # Errors
/// As [`install_needs_build_program_and_run_crosscheck`].
pub fn compare_emulated_board_clicks_with_python_reference() -> Result<(), Error> {
    let image = image::build_image_and_return_target_source(false)?.0;
    let clicks = CLICKS_AMONG_TESTS.to_string();
    let words = ["--part", "clicks", "--scene", "examples/scenes/plate.toml", "--scenes", &clicks, "--elf"];
    run_scene_comparison(&words.into_iter().map(str::to_owned).chain([image.display().to_string()]).collect::<Vec<_>>())
}

fn run_scene_comparison(arguments: &[String]) -> Result<(), Error> {
    let root = repository_root()?;
    run_command(
        ensure_environment_and_get_reference_python_command()?
            .args(["-m", "crosscheck", "--era"])
            .arg(root.join("target/release/era"))
            .args(arguments),
    )
}

/// The environment's interpreter, in the repository's root, with one thread per process.
fn ensure_environment_and_get_reference_python_command() -> Result<Command, Error> {
    let root = repository_root()?;
    let requirements = root.join("tools/crosscheck/requirements.txt");
    let python = python_environment::ensure_environment_and_return_interpreter(
        &requirements,
        &root.join("target/crosscheck-venv"),
    )
    .map_err(Error::Python)?;
    let mut command = Command::new(python);
    command.current_dir(&root).env("PYTHONPATH", root.join("tools"));
    command.envs([("OMP_NUM_THREADS", "1"), ("OPENBLAS_NUM_THREADS", "1")]);
    Ok(command)
}
