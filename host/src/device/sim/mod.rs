//! The simulated device: the same device logic as the firmware's ([`era_shared::device`]), over a board whose timers
//! push a panel that is integrated in time, behind a real pseudo-terminal.
//!
//! The panel is moved by the electrode windows that the timer registers describe, not by the sine waves that the planner
//! thinks in, and it is integrated in the time domain, so what its accelerometer shows is a second, independent answer to
//! the question the planner answered.

mod accelerometer;
mod board;
mod drive_frames;
mod electrodes;
mod outputs;
mod panel;
mod peaks;
mod rails;
mod terminal;
mod timer;

pub use accelerometer::{Accelerometer, BANDWIDTH_HZ, low_pass_gain, low_pass_response};
pub use board::{Clock, Defects, Mistakes, SimBoard};
pub use drive_frames::DriveFrame;
pub use electrodes::{BrokenElectrode, ElectrodeFault, SimElectrodes};
pub use outputs::{ActivePeriod, SimOutputs};
pub use panel::{LargestTravel, STEP_S, SimPanel};
pub use peaks::TouchPeak;
pub use rails::SimRail;
pub use terminal::{SimControl, SimDevice, SimKnobs, SimObservations};
pub use timer::SimTimer;
