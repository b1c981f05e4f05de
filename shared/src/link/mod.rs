//! Frames on the wire.
//!
//! A frame is, before byte stuffing: protocol version (1 byte), kind (1 byte), sequence number (2 bytes, little
//! endian), postcard body, CRC-32 of all that (4 bytes, little endian). It is COBS-encoded, so that it holds no zero
//! byte, and ends with one zero byte. USB CDC-ACM and the UART carry the same frames.

mod arrival;
mod decoder;
mod frame;
mod port_watch;

/// USB vendor of the board: pid.codes' pair for tests and private use. A product that is sold needs its own.
pub const USB_VENDOR: u16 = 0x1209;
/// USB product of the board.
pub const USB_PRODUCT: u16 = 0x0001;
/// What the computer's list of serial ports shows.
pub const USB_PRODUCT_NAME: &str = "ERA haptics board";

/// Speed of the UART link (the ST-LINK virtual COM port) in baud; USB has no speed to set. Slow enough for every adapter.
pub const UART_BAUD: u32 = 115_200;

pub use arrival::{LinkArrival, MAX_PACKET};
pub use decoder::{DecodeError, Decoder};
pub use frame::{EncodeError, Frame, FrameKind, MAX_BODY, MAX_ENCODED, encode_frame};
pub use port_watch::PortWatch;
