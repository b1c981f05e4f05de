//! `cargo xtask bench model`: builds the programs in release mode and measures.

use crate::error::Error;
use crate::process::run;
use crate::root;
use clap::{Args, Subcommand};
use std::path::PathBuf;
use std::process::Command;

/// What to measure.
#[derive(Args)]
pub struct Options {
    #[command(subcommand)]
    what: What,
}

#[derive(Subcommand)]
enum What {
    /// The panel model: what accuracy costs, how cost grows, peers at equal error, motion in time, arithmetic.
    Model(Model),
}

#[derive(Args)]
struct Model {
    /// Smaller and fewer cases: a check that everything runs
    #[arg(long)]
    quick: bool,
    /// Parts to measure: tradeoff, growth, peers, table1, arithmetic [default: all]
    #[arg(long, value_name = "PART", num_args = 1..)]
    only: Vec<String>,
    /// Also write the tables to a Markdown file
    #[arg(long, value_name = "FILE")]
    markdown: Option<PathBuf>,
    /// Also write the plot of what accuracy costs to an SVG file
    #[arg(long, value_name = "FILE")]
    plot: Option<PathBuf>,
}

/// Runs a measurement.
///
/// # Errors
/// [`Error::Start`], [`Error::Failed`].
pub fn command(options: &Options) -> Result<(), Error> {
    let root = root()?;
    let What::Model(model) = &options.what;
    // Both in one build: the measurements start `era` too.
    run(Command::new("cargo").current_dir(&root).args([
        "build",
        "--release",
        "--quiet",
        "-p",
        "era-host",
        "-p",
        "era-bench",
    ]))?;
    let mut measure = Command::new(root.join("target/release/era-bench"));
    measure.arg("model");
    if model.quick {
        measure.arg("--quick");
    }
    for part in &model.only {
        measure.arg("--only").arg(part);
    }
    for (option, file) in [("--markdown", &model.markdown), ("--plot", &model.plot)] {
        if let Some(file) = file {
            measure.arg(option).arg(file);
        }
    }
    run(&mut measure)
}
