//! Writing the firmware to a board: through a debug probe ([`probe`]), or over USB with the chip's ROM bootloader
//! ([`usb`], [`dfuse`], [`program`]). What is written ([`image`]) and where ([`check`], [`layout`]) is checked before
//! anything is erased.
//!
//! None of this has been tried on a board yet; the tests run it against a bootloader in memory
//! (`host/tests/flash/rom.rs`).

pub mod board;
pub mod check;
pub mod dfuse;
pub mod image;
pub mod layout;
pub mod probe;
pub mod program;
pub mod usb;
