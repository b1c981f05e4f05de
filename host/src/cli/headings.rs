//! Headings of the groups of options in the help of commands.
//!
//! A group of options that is flattened into a command leaves its heading to all options after it, so that each of these
//! names its own heading, or [`NO_HEADING`].

pub(super) const MODEL: &str = "Scene and model";
pub(super) const BAND: &str = "Frequencies and points";
pub(super) const MOTION: &str = "Drives and motion";
pub(super) const TOUCH: &str = "Touch";
pub(super) const REACH: &str = "Reach and drive schemes";
pub(super) const EFFECT: &str = "Effect";
pub(super) const PLANNER: &str = "Planner";
pub(super) const DESIGNS: &str = "Designs";
pub(super) const OUTPUT: &str = "Output";
pub(super) const DAEMON: &str = "Daemon";
pub(super) const DEVICE: &str = "Device";
pub(super) const LISTENING: &str = "Listening";
pub(super) const ACCESS: &str = "Access";
pub(super) const RECORDING: &str = "Recording";
pub(super) const CHECKED: &str = "What is checked";
pub(super) const SERVICE: &str = "Service";
pub(super) const FILES: &str = "Files";
/// For options that belong to no group: the help lists them first, under "Options", and arguments under "Arguments".
pub(super) const NO_HEADING: Option<&str> = None;
