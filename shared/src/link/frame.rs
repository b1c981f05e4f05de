//! Encoding one frame, and the decoded frame itself.

use crc::{CRC_32_ISO_HDLC, Crc};
use serde::Serialize;

/// CRC-32 as in Ethernet and zlib (polynomial 0x04C11DB7 reflected); catches every burst of up to 32 bits.
pub(super) const CRC: Crc<u32> = Crc::<u32>::new(&CRC_32_ISO_HDLC);

/// Bytes before the body: version, kind, sequence number.
pub(super) const HEADER: usize = 4;
/// Bytes after the body: the CRC.
pub(super) const TRAILER: usize = 4;

/// Longest postcard body in bytes. 240 makes the longest raw frame 248 bytes, which COBS lengthens by one
/// (it adds one byte per 254), so that one encoded frame with its zero fits a 256-byte buffer.
pub const MAX_BODY: usize = 240;
/// Longest raw frame: header, body, CRC.
pub(super) const MAX_RAW: usize = HEADER + MAX_BODY + TRAILER;
/// Longest frame on the wire, with COBS overhead and the closing zero.
pub const MAX_ENCODED: usize = MAX_RAW + MAX_RAW / 254 + 1 + 1;

/// What a frame's body is. The numbers are wire format: never change or reuse one.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
pub enum FrameKind {
    /// Host to device: a [`crate::protocol::Request`].
    Request = 1,
    /// Device to host, with the request's sequence number: a [`crate::protocol::Reply`].
    Reply = 2,
}

impl TryFrom<u8> for FrameKind {
    type Error = u8;

    fn try_from(byte: u8) -> Result<Self, u8> {
        match byte {
            1 => Ok(FrameKind::Request),
            2 => Ok(FrameKind::Reply),
            other => Err(other),
        }
    }
}

/// One frame whose CRC was right. `kind` stays a plain byte, as a newer peer may use kinds unknown here.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Frame<'a> {
    /// Protocol version that the sender encoded the body in.
    pub version: u8,
    /// A [`FrameKind`], or a number from a newer peer.
    pub kind: u8,
    /// The request's number; a reply repeats it.
    pub sequence: u16,
    /// Postcard bytes, at most [`MAX_BODY`].
    pub body: &'a [u8],
}

/// Why a message could not be put into a frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum EncodeError {
    /// The body is longer than [`MAX_BODY`] bytes.
    BodyTooLong,
    /// The output buffer is shorter than [`MAX_ENCODED`] bytes.
    BufferTooShort,
}

/// Encodes `message` as one frame with its closing zero into `out` (at least [`MAX_ENCODED`] bytes) and returns
/// the number of bytes written.
///
/// # Errors
/// [`EncodeError`] if the body or the buffer does not fit.
pub fn encode_frame<M: Serialize>(
    version: u8,
    kind: FrameKind,
    sequence: u16,
    message: &M,
    out: &mut [u8],
) -> Result<usize, EncodeError> {
    if out.len() < MAX_ENCODED {
        return Err(EncodeError::BufferTooShort);
    }
    let mut raw = [0_u8; MAX_RAW];
    let [low, high] = sequence.to_le_bytes();
    raw[..HEADER].copy_from_slice(&[version, kind as u8, low, high]);
    let body =
        postcard::to_slice(message, &mut raw[HEADER..HEADER + MAX_BODY]).map_err(|_| EncodeError::BodyTooLong)?.len();
    let crc = CRC.checksum(&raw[..HEADER + body]);
    raw[HEADER + body..HEADER + body + TRAILER].copy_from_slice(&crc.to_le_bytes());
    let written = cobs::try_encode(&raw[..HEADER + body + TRAILER], out).map_err(|_| EncodeError::BufferTooShort)?;
    let end = out.get_mut(written).ok_or(EncodeError::BufferTooShort)?;
    *end = 0;
    Ok(written + 1)
}
