//! What the commands for boards take.

use crate::device::Target;
use clap::Args;
use std::path::PathBuf;

#[derive(Clone, Debug, Args)]
pub struct Flash {
    /// The image, an ELF file [default: what `cargo xtask firmware` has built]
    pub image: Option<PathBuf>,
    /// Through a debug probe, by the program probe-rs (the default if it is installed and finds one)
    #[arg(long, conflicts_with = "dfu")]
    pub probe: bool,
    /// Over the board's own USB connector, by the chip's bootloader
    #[arg(long)]
    pub dfu: bool,
    /// auto (the default), or the path of the board's serial port
    #[arg(long, value_name = "PORT")]
    pub port: Option<Target>,
    /// Do not ask; the high-voltage supply is off
    #[arg(short, long)]
    pub yes: bool,
    /// Also a step back in the protocol
    #[arg(long)]
    pub force: bool,
    /// Print JSON
    #[arg(long)]
    pub json: bool,
}

#[derive(Clone, Debug, Args)]
pub struct Monitor {
    /// auto (the default), emulated, or the path of the board's serial port
    #[arg(long, value_name = "PORT", conflicts_with = "probe")]
    pub port: Option<Target>,
    /// Through a debug probe, by the program probe-rs
    #[arg(long)]
    pub probe: bool,
    /// The image that the board runs [default: what `cargo xtask firmware` has built]
    #[arg(long, value_name = "IMAGE")]
    pub elf: Option<PathBuf>,
    /// Print a line of JSON for each line of the log
    #[arg(long)]
    pub json: bool,
}
