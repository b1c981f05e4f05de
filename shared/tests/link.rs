//! Frames: any bytes in any pieces, and nothing that was changed on the way gets through.

use era_shared::link::{DecodeError, Decoder, FrameKind, LinkArrival, MAX_BODY, MAX_ENCODED, PortWatch, encode_frame};
use era_shared::protocol::Request;
use proptest::prelude::*;

fn encode_request_frame(sequence: u16, request: &Request) -> Vec<u8> {
    let mut out = [0; MAX_ENCODED];
    let length = encode_frame(1, FrameKind::Request, sequence, request, &mut out).unwrap();
    out[..length].to_vec()
}

/// Version, kind, sequence number and body of a frame.
type Owned = (u8, u8, u16, Vec<u8>);

fn decode_all(decoder: &mut Decoder, bytes: &[u8]) -> Vec<Result<Owned, DecodeError>> {
    let mut found = Vec::new();
    decoder.feed_bytes(bytes, |result| {
        found.push(result.map(|frame| (frame.version, frame.kind, frame.sequence, frame.body.to_vec())));
    });
    found
}

#[test]
fn empty_stretches_are_silent_and_stray_bytes_spoil_one_frame_only() {
    let good = encode_request_frame(9, &Request::Status);
    let mut bytes = vec![0, 0, 0];
    bytes.extend_from_slice(b"stray");
    bytes.extend_from_slice(&good);
    bytes.extend_from_slice(&good);
    let found = decode_all(&mut Decoder::new(), &bytes);
    assert_eq!(found.len(), 2);
    assert!(found[0].is_err());
    assert_eq!(found[1].as_ref().unwrap().2, 9);
}

#[test]
fn a_flood_without_a_zero_is_one_error_and_the_next_frame_is_read() {
    let mut bytes = vec![0x55; 100_000];
    bytes.push(0);
    bytes.extend_from_slice(&encode_request_frame(3, &Request::Stop));
    let found = decode_all(&mut Decoder::new(), &bytes);
    assert_eq!(found[0], Err(DecodeError::TooLong));
    assert!(found[1].is_ok());
}

#[test]
fn the_longest_body_fits_and_one_byte_more_does_not() {
    // Postcard writes a slice as its length (two bytes from 128 on) and its bytes.
    let mut out = [0; MAX_ENCODED];
    let longest = vec![0xFF_u8; MAX_BODY - 2];
    let length = encode_frame(1, FrameKind::Reply, 0, &longest.as_slice(), &mut out).unwrap();
    assert!(length <= MAX_ENCODED);
    let found = decode_all(&mut Decoder::new(), &out[..length]);
    assert_eq!(found[0].as_ref().unwrap().3.len(), MAX_BODY);
    let too_long = vec![0xFF_u8; MAX_BODY - 1];
    assert!(encode_frame(1, FrameKind::Reply, 0, &too_long.as_slice(), &mut out).is_err());
    assert!(encode_frame(1, FrameKind::Reply, 0, &0_u8, &mut [0; 8]).is_err(), "a short buffer is refused");
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(if cfg!(miri) { 10 } else { 512 }))]

    /// No bytes make the decoder panic, and how they are cut makes no difference.
    #[test]
    fn any_bytes_in_any_pieces(bytes in prop::collection::vec(any::<u8>(), 0..2000), cuts in prop::collection::vec(0_usize..2000, 0..8)) {
        let whole = decode_all(&mut Decoder::new(), &bytes);
        let mut cuts: Vec<usize> = cuts.into_iter().map(|cut| cut.min(bytes.len())).collect();
        cuts.push(0);
        cuts.push(bytes.len());
        cuts.sort_unstable();
        let mut decoder = Decoder::new();
        let pieces: Vec<_> = cuts.windows(2).flat_map(|pair| decode_all(&mut decoder, &bytes[pair[0]..pair[1]])).collect();
        prop_assert_eq!(whole, pieces);
    }

    /// One flipped bit anywhere: the frame is not taken for a good one.
    #[test]
    fn one_changed_bit_never_passes(sequence: u16, bit in 0_usize..64) {
        let good = encode_request_frame(sequence, &Request::Arm { deadman_ms: Some(250) });
        let mut bad = good.clone();
        let bit = bit % (8 * (bad.len() - 1));
        bad[bit / 8] ^= 1 << (bit % 8);
        for result in decode_all(&mut Decoder::new(), &bad).into_iter().flatten() {
            prop_assert!(false, "taken: {:?}", result);
        }
    }
}

/// A port is closed once for each time that it was open, whatever else of its line changes; and it is this port's link that has another program then.
#[test]
fn a_port_that_was_open_is_reported_to_be_closed_once() {
    for link in 0..3 {
        let mut port = PortWatch::new(link);
        let told: Vec<Option<usize>> = [false, true, true, false, false, true, false]
            .into_iter()
            .map(|line| match port.note_port_state_and_build_reopened_arrival_if_just_closed(line) {
                Some((link, LinkArrival::Reopened)) => Some(link),
                Some((_, LinkArrival::Bytes(_))) => panic!("nothing has been received"),
                None => None,
            })
            .collect();
        assert_eq!(told, [None, None, None, Some(link), None, None, Some(link)]);
    }
}
