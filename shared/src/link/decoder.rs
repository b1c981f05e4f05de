//! The incremental decoder: any bytes, in any pieces, never a panic.

use super::frame::{CRC, Frame, HEADER, MAX_ENCODED, TRAILER};

/// Why the bytes between two zeros were no frame. Each is counted by the device and reported in its status.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum DecodeError {
    /// More bytes than the longest frame before a zero came; all were dropped up to that zero.
    TooLong,
    /// The byte stuffing is broken.
    Stuffing,
    /// Too few bytes for a header and a CRC.
    TooShort,
    /// The CRC does not fit the bytes: something was changed or lost on the way.
    Crc,
}

/// Collects bytes until a zero and then gives the frame, or says why there is none. Empty stretches (two zeros in a
/// row, which senders may use to flush a line) are passed over in silence.
#[derive(Clone, Debug)]
pub struct Decoder {
    // Without the zero that ends a frame: with room for it, a frame one byte too long would pass.
    buffer: [u8; MAX_ENCODED - 1],
    length: usize,
    overflowed: bool,
}

impl Default for Decoder {
    fn default() -> Self {
        Self::new()
    }
}

impl Decoder {
    /// A decoder that has seen nothing.
    #[must_use]
    pub const fn new() -> Self {
        Self { buffer: [0; MAX_ENCODED - 1], length: 0, overflowed: false }
    }

    /// Discards the bytes of an incomplete frame.
    pub fn discard_partial_frame(&mut self) {
        self.length = 0;
        self.overflowed = false;
    }

    /// Takes one byte. The byte that ends a frame returns the frame, or why the bytes are none.
    pub fn push_byte(&mut self, byte: u8) -> Option<Result<Frame<'_>, DecodeError>> {
        if byte != 0 {
            match self.buffer.get_mut(self.length) {
                Some(place) => {
                    *place = byte;
                    self.length += 1;
                }
                None => self.overflowed = true,
            }
            return None;
        }
        let (length, overflowed) = (self.length, self.overflowed);
        self.discard_partial_frame();
        if overflowed {
            return Some(Err(DecodeError::TooLong));
        }
        if length == 0 {
            return None;
        }
        Some(self.decode_buffered_frame(length))
    }

    /// Takes `bytes` and calls `on_frame` for every frame, or broken stretch, that ends in them.
    pub fn feed_bytes(&mut self, bytes: &[u8], mut on_frame: impl FnMut(Result<Frame<'_>, DecodeError>)) {
        for &byte in bytes {
            if let Some(result) = self.push_byte(byte) {
                on_frame(result);
            }
        }
    }

    fn decode_buffered_frame(&mut self, length: usize) -> Result<Frame<'_>, DecodeError> {
        let stuffed = self.buffer.get_mut(..length).ok_or(DecodeError::TooLong)?;
        let raw_length = cobs::decode_in_place(stuffed).map_err(|_| DecodeError::Stuffing)?;
        let raw = self.buffer.get(..raw_length).ok_or(DecodeError::Stuffing)?;
        let body_end = raw_length.checked_sub(TRAILER).filter(|end| *end >= HEADER).ok_or(DecodeError::TooShort)?;
        let (covered, trailer) = raw.split_at(body_end);
        let crc = trailer.iter().rev().fold(0_u32, |sum, byte| (sum << 8) | u32::from(*byte));
        if CRC.checksum(covered) != crc {
            return Err(DecodeError::Crc);
        }
        match covered {
            [version, kind, low, high, body @ ..] => {
                Ok(Frame { version: *version, kind: *kind, sequence: u16::from_le_bytes([*low, *high]), body })
            }
            _ => Err(DecodeError::TooShort),
        }
    }
}
