//! Why a live socket is closed, as a code (RFC 6455, 7.4.1) and in words.

use axum::extract::ws::{CloseFrame, close_code};
use std::io::ErrorKind;
use std::time::Duration;
use tungstenite::Error;
use tungstenite::error::ProtocolError;

/// Longest reason in bytes: a control frame has 125, two of which are the code.
const LONGEST: usize = 123;

/// What a page is told whose message cannot be read; nothing where nobody is there to be told.
pub fn close_frame_for_error(error: axum::Error) -> Option<CloseFrame> {
    let error = error.into_inner().downcast::<Error>().ok()?;
    match *error {
        Error::Protocol(ProtocolError::ResetWithoutClosingHandshake) => None,
        Error::Protocol(error) => Some(make_close_frame(close_code::PROTOCOL, &error.to_string())),
        Error::Utf8(_) => Some(make_close_frame(close_code::INVALID, "a text message must be UTF-8")),
        Error::Capacity(error) => Some(make_close_frame(close_code::SIZE, &error.to_string())),
        Error::Io(error) if error.kind() == ErrorKind::QuotaExceeded => {
            Some(make_close_frame(close_code::SIZE, "the parts of a message are too long in total"))
        }
        _ => None,
    }
}

/// What a page is told that has said nothing for so long.
pub fn close_frame_for_silence(silence: Duration) -> CloseFrame {
    make_close_frame(
        close_code::POLICY,
        &format!("nothing was received for {silence:?}, not even the answer to a ping"),
    )
}

/// What every page is told when the daemon ends.
pub fn close_frame_for_shutdown() -> CloseFrame {
    make_close_frame(close_code::AWAY, "the daemon is shutting down")
}

fn make_close_frame(code: u16, reason: &str) -> CloseFrame {
    let end = reason.floor_char_boundary(LONGEST);
    CloseFrame { code, reason: reason[..end].into() }
}
