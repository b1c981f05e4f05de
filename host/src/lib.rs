//! The host side of the ERA haptics system: devices, daemon and command line over the panel's model and the planner.
//!
//! Data flows one way: [`scene`] (what is there) -> [`model`] (finite elements, modes) -> [`response`] (how it answers a
//! harmonic force) -> [`planner`] (which drives make a touch felt) -> [`device`] (commands to a board, simulated or
//! real). The first three, with [`transient`], are the crate `era-model`; the planner, with [`effects`] and [`maps`], is
//! `era-planner`; both are known here by the names of their modules. [`study`], design studies, is the crate `era-study`. [`daemon`] puts HTTP and a WebSocket in front of it,
//! [`verify`] compares what the planner predicts with what the simulated device measures, [`flash`] writes a board's
//! firmware, [`monitor`] shows its log, [`install`] knows the files that Linux wants for it, [`doctor`] finds what stands in its way,
//! [`replay`] reads what the daemon has recorded, [`effect_files`] effects that others have written, `private_file` what is secret, `certificate` certificates and keys, `serde_messages` what serde says of wrong texts, `whole_numbers` what clients write as such; `connection` is the way to a daemon,
//! and [`cli`] is the command line.

mod certificate;
pub mod cli;
mod connection;
pub mod daemon;
pub mod device;
pub mod doctor;
pub mod effect_files;
pub mod flash;
pub mod install;
pub mod monitor;
mod private_file;
pub mod replay;
mod serde_messages;
pub mod verify;
mod whole_numbers;

pub use era_model::{model, response, scene, text_file, transient};
pub use era_planner as planner;
pub use era_planner::{effects, maps};
pub use era_study as study;
