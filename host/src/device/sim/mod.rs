//! The simulated device: the same device logic as the firmware's ([`era_shared::device`]), over a board whose timers
//! push a panel that is integrated in time, behind a real pseudo-terminal.
//!
//! The panel is moved by the electrode windows that the timer registers describe, not by the sine waves that the planner
//! thinks in, and it is integrated in the time domain, so what its accelerometer shows is a second, independent answer to
//! the question the planner answered.

mod accelerometer;
mod board;
mod heard;
mod panel;
mod peaks;
mod rails;
mod source;
mod terminal;

pub use accelerometer::{Accelerometer, BANDWIDTH_HZ, attenuation, low_pass};
pub use board::{Clock, Defects, Mistakes, SimBoard};
pub use heard::SetFrame;
pub use panel::{Extreme, Panel, STEP_S};
pub use peaks::TouchPeak;
pub use rails::Rail;
pub use source::Source;
pub use terminal::{Knobs, SimControl, SimDevice, Watch};
