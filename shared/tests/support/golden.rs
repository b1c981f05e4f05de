//! Messages and their bytes, for the golden tests of each protocol version.

use era_shared::link::{Decoder, FrameKind, MAX_ENCODED, encode_frame};
use serde::{Serialize, de::DeserializeOwned};
use std::fmt::Debug;

pub fn format_hex(bytes: &[u8]) -> String {
    bytes.iter().map(|byte| format!("{byte:02x}")).collect()
}

/// The message has exactly these bytes, and they decode to it again.
pub fn check_message_bytes<M: Serialize + DeserializeOwned + PartialEq + Debug>(
    version: u8,
    kind: FrameKind,
    message: M,
    expected: &str,
) {
    let mut out = [0; MAX_ENCODED];
    let length = encode_frame(version, kind, 0x1234, &message, &mut out).unwrap();
    assert_eq!(format_hex(&out[..length]), expected, "{message:?}");
    let mut decoded = None;
    Decoder::new().feed_bytes(&out[..length], |frame| {
        let frame = frame.unwrap();
        assert_eq!((frame.version, frame.kind, frame.sequence), (version, kind as u8, 0x1234));
        decoded = Some(postcard::from_bytes::<M>(frame.body).unwrap());
    });
    assert_eq!(decoded, Some(message));
}
