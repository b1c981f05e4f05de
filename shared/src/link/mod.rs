//! Frames on the wire.
//!
//! A frame is, before byte stuffing: protocol version (1 byte), kind (1 byte), sequence number (2 bytes, little
//! endian), postcard body, CRC-32 of all that (4 bytes, little endian). It is COBS-encoded, so that it holds no zero
//! byte, and ends with one zero byte. USB CDC-ACM and the UART carry the same frames.

mod decoder;
mod frame;

pub use decoder::{DecodeError, Decoder};
pub use frame::{EncodeError, Frame, Kind, MAX_BODY, MAX_ENCODED, encode};
