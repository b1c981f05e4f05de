//! One suite of device behaviour, run against three targets: the simulated device, the firmware image in the emulator,
//! and the board on the serial port that `ERA_DEVICE` names.
//!
//! [`mod@bench`] is a target under test with the clock and the knobs it has, [`outputs`] what its timers do at the electrodes,
//! [`breakage`] how it is broken, [`cases`] is the suite, [`targets`] says which targets are here and why others are not.
//! `tests/suite.rs` makes a test of every case on every target.

pub mod bench;
pub mod breakage;
pub mod cases;
mod link_cases;
pub mod outputs;
mod play_cases;
mod safety_cases;
pub mod targets;
mod version_cases;
