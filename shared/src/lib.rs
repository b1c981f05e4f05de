//! What the firmware of the ERA actuator board, its simulation and the host program have in common.
//!
//! An *electrostatic resonant actuator* (ERA) has a grounded mass on springs between two high-voltage electrodes,
//! A and B, that are energised in turn and never together. This crate is `no_std` and does not allocate:
//!
//! * [`link`]: frames on the wire (COBS, CRC-32) and an incremental decoder that takes any bytes in any pieces,
//! * [`protocol`]: the messages inside the frames, append-only from version to version,
//! * [`waveform`]: integer arithmetic from SI units to timer registers and back to electrode edges, envelopes, and the
//!   sequencer that brings running timers from one drive to the next,
//! * [`supply`]: set-points of the high-voltage rails, and whether what is measured can be believed,
//! * [`safety`]: the safety state machine, the dead-man timer, the self-test before arming, the budget of each channel,
//! * [`circuit`]: the values of the high-voltage circuit outside the chip, [`limits`]: every limit, with its derivation,
//! * [`board`]: the trait that hardware implements,
//! * [`device`]: the device's whole behaviour over a [`board::Board`]: what a frame does and what silence does.
//!
//! Data flows one way: bytes -> [`link`] -> [`protocol`] -> [`device`] (asks [`safety`] and [`supply`], computes
//! [`waveform`]) -> [`board`].
#![cfg_attr(not(test), no_std)]
#![forbid(unsafe_code)]

pub mod board;
pub mod circuit;
pub mod device;
pub mod image;
pub mod limits;
pub mod link;
pub mod log_limit;
pub mod log_ring;
pub mod protocol;
pub mod safety;
pub mod supply;
pub mod waveform;

/// Most ERA channels a board can have; fixes the size of every per-channel array (domain limit: two to four ERAs).
pub const MAX_CHANNELS: usize = 4;
