//! The frame decoder on any bytes in any pieces, against a second decoder that is written for clearness alone.

use era_shared::link::{DecodeError, Decoder, Frame, MAX_BODY, MAX_ENCODED};

/// An owned [`Frame`], or why there is none.
type Found = Result<(u8, u8, u16, Vec<u8>), DecodeError>;

/// Runs one input: its first byte says in pieces of how many bytes the rest arrives (0: all at once).
///
/// # Panics
/// If what the decoder finds depends on the pieces, is not what [`decode_stream_with_reference_decoder`] finds, or
/// spoils the frame after it.
pub fn check_decoder_against_reference(input: &[u8]) {
    let Some((&piece, bytes)) = input.split_first() else { return };
    let mut expected = decode_stream_with_reference_decoder(bytes);
    let piece = if piece == 0 { bytes.len().max(1) } else { usize::from(piece) };
    let mut decoder = Decoder::new();
    let mut found = Vec::new();
    for part in bytes.chunks(piece) {
        decoder.feed_bytes(part, |result| found.push(copy_frame_or_error(result)));
    }
    assert_eq!(found, expected, "in pieces of {piece} bytes");
    assert!(found.iter().flatten().all(|(.., body)| body.len() <= MAX_BODY), "a body longer than any may be");

    // Whatever came before, a zero ends it, and the frame after that arrives whole.
    let closing = [&[0][..], &KEEP_ALIVE].concat();
    expected = decode_stream_with_reference_decoder(&[bytes, &closing].concat());
    decoder.feed_bytes(&closing, |result| found.push(copy_frame_or_error(result)));
    assert_eq!(found, expected, "with a frame after it");
    assert_eq!(found.last(), Some(&Ok((1, 1, 0x1234, vec![5]))), "the frame after it");
}

/// `KeepAlive` of version 1 with the number 0x1234.
const KEEP_ALIVE: [u8; 11] = [0x0A, 1, 1, 0x34, 0x12, 5, 0xD8, 0x70, 2, 0x68, 0];

fn copy_frame_or_error(result: Result<Frame<'_>, DecodeError>) -> Found {
    result.map(|frame| (frame.version, frame.kind, frame.sequence, frame.body.to_vec()))
}

/// What ends in `bytes`, by the words of the format: stretches between zeros, unstuffed, with a CRC at their end.
#[must_use]
pub fn decode_stream_with_reference_decoder(bytes: &[u8]) -> Vec<Found> {
    let mut stretches: Vec<&[u8]> = bytes.split(|byte| *byte == 0).collect();
    stretches.pop(); // The last one has not ended yet.
    stretches.into_iter().filter(|stretch| !stretch.is_empty()).map(decode_frame_with_reference_decoder).collect()
}

fn decode_frame_with_reference_decoder(stuffed: &[u8]) -> Found {
    // With the zero that ended it.
    if stuffed.len() + 1 > MAX_ENCODED {
        return Err(DecodeError::TooLong);
    }
    let raw = decode_cobs(stuffed).ok_or(DecodeError::Stuffing)?;
    let Some((covered, crc)) = raw.split_last_chunk::<4>() else { return Err(DecodeError::TooShort) };
    let [version, kind, low, high, body @ ..] = covered else { return Err(DecodeError::TooShort) };
    if u32::from_le_bytes(*crc) != compute_crc32(covered) {
        return Err(DecodeError::Crc);
    }
    Ok((*version, *kind, u16::from_le_bytes([*low, *high]), body.to_vec()))
}

/// COBS (Cheshire and Baker 1999): each block starts with its length, and stands for a zero at its end unless it is 254
/// bytes long or the last. `None` if a block is longer than what is left.
fn decode_cobs(mut rest: &[u8]) -> Option<Vec<u8>> {
    let mut raw = Vec::new();
    while let Some((&length, after)) = rest.split_first() {
        let (block, next) = after.split_at_checked(usize::from(length).checked_sub(1)?)?;
        raw.extend_from_slice(block);
        if length != 0xFF && !next.is_empty() {
            raw.push(0);
        }
        rest = next;
    }
    Some(raw)
}

/// The reverse of [`decode_cobs`] for frames, which are shorter than a block of 254 bytes.
fn encode_cobs(raw: &[u8]) -> Vec<u8> {
    let block = |stretch: &[u8]| [&[stretch.len() as u8 + 1], stretch].concat();
    raw.split(|byte| *byte == 0).flat_map(block).collect()
}

/// A frame with its zero, of any version and kind, and of a body that may be longer than the product's encoder allows.
pub(crate) fn encode_unchecked_frame(version: u8, kind: u8, sequence: u16, body: &[u8]) -> Vec<u8> {
    let [low, high] = sequence.to_le_bytes();
    let mut raw = vec![version, kind, low, high];
    raw.extend_from_slice(body);
    raw.extend(compute_crc32(&raw).to_le_bytes());
    let mut bytes = encode_cobs(&raw);
    bytes.push(0);
    bytes
}

/// CRC-32 of IEEE 802.3, bit by bit.
fn compute_crc32(bytes: &[u8]) -> u32 {
    let step = |crc: u32, _| (crc >> 1) ^ (0xEDB8_8320 & (crc & 1).wrapping_neg());
    !bytes.iter().fold(u32::MAX, |crc, byte| (0..8).fold(crc ^ u32::from(*byte), step))
}
