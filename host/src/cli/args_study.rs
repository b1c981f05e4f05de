//! Arguments of `era study`.

use clap::Args;
use std::path::PathBuf;

use super::headings::{DESIGNS, OUTPUT};
use crate::study::run::Shard;

#[derive(Clone, Debug, Args)]
pub struct Study {
    /// The study's file (see docs/src/studies.md)
    #[arg(value_name = "STUDY.toml")]
    pub study: PathBuf,
    /// Folder of the results; designs whose results are already in this folder are not computed again [default:
    /// STUDY-results in the current directory, for the file STUDY.toml]
    #[arg(long, value_name = "DIR", help_heading = OUTPUT)]
    pub out: Option<PathBuf>,
    /// Number of designs that are computed at the same time [default: the number of processors]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..), help_heading = DESIGNS)]
    pub workers: Option<u16>,
    /// Compute only share I of N, for job arrays; give all shares the same folder with --out. When all shares are
    /// complete, --gather combines their results
    #[arg(long, value_name = "I/N", conflicts_with = "gather", help_heading = DESIGNS)]
    pub shard: Option<Shard>,
    /// Combine the results of the designs that are already in the folder of --out, without computing more designs
    #[arg(long, help_heading = DESIGNS)]
    pub gather: bool,
    /// Print JSON
    #[arg(long, help_heading = OUTPUT)]
    pub json: bool,
}
