//! Arguments of `era study`.

use clap::Args;
use std::path::PathBuf;

use crate::design::run::Shard;

#[derive(Clone, Debug, Args)]
pub struct Study {
    /// The study's file (see docs/src/studies.md)
    #[arg(value_name = "STUDY.toml")]
    pub study: PathBuf,
    /// Folder of the results; existing results in it are not computed again [default: the name of
    /// the study's file without its ending, with -results, in the current directory]
    #[arg(long, value_name = "DIR")]
    pub out: Option<PathBuf>,
    /// Designs at a time [default: the number of processors]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..))]
    pub workers: Option<u16>,
    /// Compute only the I-th of N shares, into the common folder: for job arrays; use --gather afterwards
    #[arg(long, value_name = "I/N", conflicts_with = "gather")]
    pub shard: Option<Shard>,
    /// Compute no designs, and make the results from the designs in the folder
    #[arg(long)]
    pub gather: bool,
    /// Print JSON
    #[arg(long)]
    pub json: bool,
}
