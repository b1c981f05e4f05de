//! What the commands for boards take.

use super::headings::DEVICE;
use crate::device::Target;
use clap::Args;
use std::path::PathBuf;

#[derive(Clone, Debug, Args)]
pub struct Flash {
    /// Firmware image, an ELF file [default: the image that `cargo xtask firmware` has built]
    pub image: Option<PathBuf>,
    /// Use a debug probe with the program probe-rs (the default if probe-rs is installed and finds a probe)
    #[arg(long, conflicts_with = "dfu", help_heading = DEVICE)]
    pub probe: bool,
    /// Use the USB interface of the board's chip (pins PA11 and PA12) and the bootloader of the chip
    #[arg(long, help_heading = DEVICE)]
    pub dfu: bool,
    /// Board: auto (finds the connected board) or the path of the board's serial port [default: auto]
    #[arg(long, value_name = "PORT", help_heading = DEVICE)]
    pub port: Option<Target>,
    /// Do not ask whether the high-voltage supply is off: with this option you confirm that you have switched the supply off
    #[arg(short, long)]
    pub yes: bool,
    /// Write the image even if the board's firmware has a newer protocol version, or if this program does not know the
    /// image's protocol version
    #[arg(long)]
    pub force: bool,
    /// Print JSON
    #[arg(long)]
    pub json: bool,
}

#[derive(Clone, Debug, Args)]
pub struct Monitor {
    /// Board: auto (finds the connected board), emulated, or the path of the board's serial port [default: auto]
    #[arg(long, value_name = "PORT", conflicts_with = "probe", help_heading = DEVICE)]
    pub port: Option<Target>,
    /// Use a debug probe with the program probe-rs
    #[arg(long, help_heading = DEVICE)]
    pub probe: bool,
    /// Image of the firmware that the board runs [default: the image that `cargo xtask firmware` has built]
    #[arg(long, value_name = "IMAGE")]
    pub elf: Option<PathBuf>,
    /// Print a line of JSON for each line of the log
    #[arg(long)]
    pub json: bool,
}
