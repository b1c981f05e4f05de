//! The host side of the ERA haptics system: panel model, planner, devices, daemon and command line.
//!
//! Data flows one way: [`scene`] (what is there) -> [`model`] (finite elements, modes) -> [`response`] (how it answers a
//! harmonic force) -> [`planner`] (which drives make a touch felt) -> [`device`] (commands to a board, simulated or
//! real). [`daemon`] puts HTTP and a WebSocket in front of it, [`verify`] compares what the planner predicts with what
//! the simulated device measures, [`study`] draws fields, [`flash`] writes a board's firmware,
//! [`monitor`] shows its log, and [`cli`] is the command
//! line.

pub mod cli;
pub mod daemon;
pub mod device;
pub mod effects;
pub mod flash;
pub mod model;
pub mod monitor;
pub mod planner;
pub mod response;
pub mod scene;
pub mod study;
pub mod transient;
pub mod verify;
