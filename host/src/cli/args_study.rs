//! Arguments of `era study`.

use clap::Args;
use std::path::PathBuf;

use crate::design::run::Shard;

#[derive(Clone, Debug, Args)]
pub struct Study {
    /// The study's file (see docs/src/studies.md)
    #[arg(value_name = "STUDY.toml")]
    pub study: PathBuf,
    /// Folder of the results, made if it is not there; what is in it already is not computed again [default: the name of
    /// the study's file without its ending, with -results, in the current directory]
    #[arg(long, value_name = "DIR")]
    pub out: Option<PathBuf>,
    /// Designs at a time; as many as there are processors if not given
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..))]
    pub workers: Option<u16>,
    /// Compute the I-th of N shares only, into the folder that all share: for job arrays, with --gather afterwards
    #[arg(long, value_name = "I/N", conflicts_with = "gather")]
    pub shard: Option<Shard>,
    /// Compute no designs: make the results of those that are in the folder
    #[arg(long)]
    pub gather: bool,
    /// Print JSON
    #[arg(long)]
    pub json: bool,
}
