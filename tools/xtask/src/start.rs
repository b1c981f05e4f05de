//! `cargo xtask bench start`: how long `era serve` takes to its first plan, with an empty cache and with a warm one.

use crate::error::Error;
use crate::process::format_command;
use crate::release_build::build_release_programs_by_package_and_binary_name;
use crate::repository_root;
use clap::Parser;
use std::io::{BufRead, BufReader};
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::Instant;

/// The line of the log that ends a measurement, up to its number.
const PLANNED: &str = "the first plan was ready ";
/// The line that tells what the table takes.
const TABLE: &str = "plan table ";

/// What to measure.
#[derive(Parser)]
#[command(name = "cargo xtask bench start")]
struct Options {
    /// Starts per scene and state of the cache
    #[arg(long, value_name = "N", default_value_t = 5, value_parser = clap::value_parser!(u32).range(1..=1000))]
    runs: u32,
    /// Scene files; all examples unless given
    #[arg(long = "scene", value_name = "FILE")]
    scenes: Vec<PathBuf>,
    /// Accuracy
    #[arg(long, value_name = "NAME", default_value = "balanced")]
    accuracy: String,
}

/// The times from one start of the daemon to its first plan.
struct FirstPlanTimes {
    /// From the program's first line to its first plan, as it says itself, in ms.
    told_by_daemon_ms: f64,
    /// From asking the system for the process to reading that, in ms.
    seen_from_outside_ms: f64,
    /// Megabytes in memory and on disk, as the program says.
    sizes: String,
}

/// Runs a measurement.
///
/// # Errors
/// [`Error::Start`], [`Error::Failed`], [`Error::File`], [`Error::NoFirstPlan`].
pub fn build_daemon_and_measure_first_plan_times_cold_and_warm(arguments: &[std::ffi::OsString]) -> Result<(), Error> {
    let options = Options::parse_from(arguments);
    let root = repository_root()?;
    build_release_programs_by_package_and_binary_name(&root, &[("era-host", "era")])?;
    let scenes = if options.scenes.is_empty() { list_example_scenes(&root)? } else { options.scenes };
    let cache = root.join("target/bench-start");
    println!(
        "From the start of `era serve --accuracy {}` to its first plan in ms, medians of {} starts (in brackets: \
         measured from outside)",
        options.accuracy, options.runs
    );
    println!("{:<20} {:>18} {:>18}   table", "scene", "cold", "warm");
    for scene in scenes {
        let name = scene.file_stem().unwrap_or_default().to_string_lossy().into_owned();
        let starts = |cold: bool| {
            (0..options.runs)
                .map(|_| {
                    if cold {
                        delete_cache(&cache)?;
                    }
                    time_first_plan_of_one_start(&root, &scene, &options.accuracy, &cache)
                })
                .collect::<Result<Vec<_>, Error>>()
        };
        let (cold, warm) = (starts(true)?, starts(false)?);
        let sizes = warm.last().map(|start| start.sizes.clone()).unwrap_or_default();
        println!("{name:<20} {:>18} {:>18}   {sizes}", format_median_times(&cold), format_median_times(&warm));
    }
    delete_cache(&cache)
}

fn format_median_times(starts: &[FirstPlanTimes]) -> String {
    let of = |figure: fn(&FirstPlanTimes) -> f64| compute_median(starts.iter().map(figure).collect());
    format!("{:.0} ({:.0})", of(|start| start.told_by_daemon_ms), of(|start| start.seen_from_outside_ms))
}

fn compute_median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    values.get(values.len() / 2).copied().unwrap_or(f64::NAN)
}

fn list_example_scenes(root: &Path) -> Result<Vec<PathBuf>, Error> {
    let directory = root.join("examples/scenes");
    let unreadable = |source| Error::File { what: "cannot read", path: directory.clone(), source };
    let mut scenes = std::fs::read_dir(&directory)
        .and_then(|found| found.map(|entry| Ok(entry?.path())).collect::<std::io::Result<Vec<_>>>())
        .map_err(unreadable)?;
    scenes.retain(|path| path.extension().is_some_and(|ending| ending == "toml"));
    scenes.sort();
    Ok(scenes)
}

fn delete_cache(cache_folder: &Path) -> Result<(), Error> {
    match std::fs::remove_dir_all(cache_folder) {
        Err(source) if source.kind() != std::io::ErrorKind::NotFound => {
            Err(Error::File { what: "cannot delete", path: cache_folder.to_path_buf(), source })
        }
        _ => Ok(()),
    }
}

/// Starts the daemon, waits for its first plan, and ends it.
fn time_first_plan_of_one_start(
    root: &Path,
    scene: &Path,
    accuracy: &str,
    cache_folder: &Path,
) -> Result<FirstPlanTimes, Error> {
    let mut command = Command::new(root.join("target/release/era"));
    command.args(["serve", "--listen", "127.0.0.1:0", "--accuracy", accuracy, "--scene"]).arg(scene);
    command
        .env("ERA_CACHE_DIR", cache_folder)
        .env("ERA_LOG", "warn,era=info")
        .env("NO_COLOR", "1")
        .stderr(Stdio::piped());
    let started = Instant::now();
    let mut child = command.spawn().map_err(|source| Error::Start { command: format_command(&command), source })?;
    let mut sizes = String::new();
    let mut planned = None;
    let mut said = Vec::new();
    for line in child.stderr.take().into_iter().flat_map(|log| BufReader::new(log).lines().map_while(Result::ok)) {
        if let Some((_, rest)) = line.split_once(TABLE) {
            let figures = rest.split_once("; ").map_or(rest, |(_, figures)| figures);
            sizes = figures.split_once(" in /").map_or(figures, |(figures, _)| figures).to_owned() + " on disk";
        }
        if let Some((_, rest)) = line.split_once(PLANNED) {
            let number = rest.split(' ').next().and_then(|number| number.parse().ok());
            planned = number.map(|told_by_daemon_ms| (told_by_daemon_ms, started.elapsed()));
            break;
        }
        said.push(line);
    }
    // It may have ended by itself, which `wait` then says.
    let _ = child.kill();
    child.wait().map_err(|source| Error::Start { command: format_command(&command), source })?;
    let (told_by_daemon_ms, outside) =
        planned.ok_or_else(|| Error::NoFirstPlan { command: format_command(&command), said: said.join("\n") })?;
    Ok(FirstPlanTimes { told_by_daemon_ms, seen_from_outside_ms: outside.as_secs_f64() * 1e3, sizes })
}
