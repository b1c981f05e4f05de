//! Files of text as editors on any system write them.

use std::io::{Error, ErrorKind, Result};
use std::path::Path;

/// What some editors put before a text in UTF-8: the byte order mark, EF BB BF.
pub const BYTE_ORDER_MARK: &str = "\u{feff}";

/// Reads a file of text in UTF-8, without the byte order mark that it may begin with.
///
/// # Errors
/// As the system has it, or that the file has other bytes than UTF-8 (`InvalidData`), UTF-16 by name.
pub fn read_text_file(path: &Path) -> Result<String> {
    decode_utf8_and_drop_byte_order_mark(std::fs::read(path)?)
}

/// Refuses bytes that begin as a text in UTF-16 does.
///
/// # Errors
/// That they do (`InvalidData`).
pub fn refuse_utf16(bytes: &[u8]) -> Result<()> {
    if bytes.starts_with(&[0xff, 0xfe]) || bytes.starts_with(&[0xfe, 0xff]) {
        let reason = "the file is in UTF-16, but must be in UTF-8: save the file in UTF-8";
        return Err(Error::new(ErrorKind::InvalidData, reason));
    }
    Ok(())
}

/// The text of these bytes in UTF-8, without the byte order mark that it may begin with.
///
/// # Errors
/// That they are something else than UTF-8 (`InvalidData`), UTF-16 by name.
pub fn decode_utf8_and_drop_byte_order_mark(bytes: Vec<u8>) -> Result<String> {
    let wrong = |reason: String| Error::new(ErrorKind::InvalidData, reason);
    refuse_utf16(&bytes)?;
    let mut text = String::from_utf8(bytes).map_err(|error| {
        let at = error.utf8_error().valid_up_to();
        wrong(format!("the file is not text in UTF-8 (byte {} is wrong)", at + 1))
    })?;
    if text.starts_with(BYTE_ORDER_MARK) {
        text.drain(..BYTE_ORDER_MARK.len());
    }
    Ok(text)
}
