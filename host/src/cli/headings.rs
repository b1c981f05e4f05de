//! Headings of the groups of options in the help of commands.

pub(super) const MODEL: &str = "Scene and model";
pub(super) const TOUCH: &str = "Touch";
pub(super) const PLANNER: &str = "Planner";
pub(super) const DAEMON: &str = "Daemon";
pub(super) const DEVICE: &str = "Device";
pub(super) const LISTENING: &str = "Listening";
pub(super) const ACCESS: &str = "Access";
pub(super) const RECORDING: &str = "Recording";
