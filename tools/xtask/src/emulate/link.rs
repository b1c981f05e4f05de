//! The serial link to the board, through the bridge's control channel: emulated time passes only while an answer is awaited,
//! so what happens does not depend on how fast this program or the machine is.

use super::bridge::Bridge;
use crate::error::Error;
use era_shared::link::{Decoder, FrameKind, MAX_ENCODED, encode_frame};
use era_shared::protocol::{CURRENT_VERSION, Reply, Request};
use serde_json::json;

/// How long the board may take to answer, in s of its own time. It takes a few ms.
const ANSWER_LIMIT_S: f64 = 0.1;

/// Numbers the requests.
#[derive(Debug, Default)]
pub struct Link {
    sequence: u16,
}

impl Link {
    /// Sends a request and waits for its reply.
    ///
    /// # Errors
    /// [`Error::Bridge`], [`Error::NoReply`] if the board does not answer.
    pub fn send_request(&mut self, bridge: &mut Bridge, request: &Request) -> Result<Reply, Error> {
        self.send_request_as_version(bridge, CURRENT_VERSION, request)
    }

    /// The same in the words of another protocol version.
    ///
    /// # Errors
    /// As [`Self::send_request`].
    pub fn send_request_as_version(
        &mut self,
        bridge: &mut Bridge,
        version: u8,
        request: &Request,
    ) -> Result<Reply, Error> {
        self.sequence = self.sequence.wrapping_add(1);
        let answer = exchange_bytes_until_first_frame(
            bridge,
            &encode_request_frame(version, self.sequence, request)?,
            ANSWER_LIMIT_S,
        )?;
        find_reply_with_sequence_among_frames(&answer, self.sequence)
            .ok_or_else(|| Error::NoReply(format!("no reply to {request:?}")))
    }
}

/// A request as a frame.
///
/// # Errors
/// [`Error::Encode`].
pub fn encode_request_frame(version: u8, sequence: u16, request: &Request) -> Result<Vec<u8>, Error> {
    let mut frame = [0; MAX_ENCODED];
    let length = encode_frame(version, FrameKind::Request, sequence, request, &mut frame).map_err(Error::Encode)?;
    Ok(frame.iter().take(length).copied().collect())
}

/// The reply with this number among the frames in `bytes`.
pub fn find_reply_with_sequence_among_frames(bytes: &[u8], sequence: u16) -> Option<Reply> {
    let mut reply = None;
    Decoder::new().feed_bytes(bytes, |frame| {
        if let Ok(frame) = frame
            && frame.kind == FrameKind::Reply as u8
            && frame.sequence == sequence
        {
            reply = postcard::from_bytes(frame.body).ok();
        }
    });
    reply
}

/// Sends bytes to the board's UART and returns what it answers within `limit_s`, up to the end of the first frame.
///
/// # Errors
/// [`Error::Bridge`].
pub fn exchange_bytes_until_first_frame(bridge: &mut Bridge, bytes: &[u8], limit_s: f64) -> Result<Vec<u8>, Error> {
    let hex: String = bytes.iter().map(|byte| format!("{byte:02x}")).collect();
    let answer = bridge.send_command(&json!({"op": "exchange", "hex": hex, "seconds": limit_s}))?;
    let text = answer["hex"].as_str().unwrap_or_default();
    let pairs = text.as_bytes().chunks(2).map(|pair| std::str::from_utf8(pair).unwrap_or_default());
    pairs
        .map(|pair| u8::from_str_radix(pair, 16).map_err(|error| Error::Bridge(format!("{error} in {text}"))))
        .collect()
}
