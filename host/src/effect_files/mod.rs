//! Effects as files: reading them, and what a panel makes of them.
//!
//! [`read_effect_bytes`] reads a file of any format into a list of [`events`]; what it leaves out it says in warnings. [`parts`] cuts the list
//! into what a board plays one after the other, [`panel`] designs these parts for a place, and [`motion`] computes the acceleration that
//! follows. [`own`] is this program's own format, whose events are [`primitive`]s; the others are those of other programs. [`named`] lists what has a name, and [`view`] is what answers have.

mod ahap;
mod bits;
mod error;
pub mod events;
mod format;
mod hjif;
mod hmpg;
mod json;
mod lofelt;
pub mod motion;
mod mpeg;
pub mod named;
pub mod own;
pub mod panel;
pub mod parts;
pub mod primitive;
pub mod view;
mod wav;

pub use error::ReadError;
pub use events::EventList;
pub use format::{FileFormat, MAX_TEXT_BYTES};

/// Reads a file. Without a format, the file shows its own.
///
/// # Errors
/// [`ReadError`].
pub fn read_effect_bytes(bytes: &[u8], format: Option<FileFormat>) -> Result<EventList, ReadError> {
    let format = format.map_or_else(|| detect_format(bytes), Ok)?;
    if bytes.len() > format.max_bytes() {
        return Err(ReadError::TooLarge { bytes: bytes.len(), format, max: format.max_bytes() });
    }
    match format {
        FileFormat::Wav => return wav::read_wav_bytes(bytes),
        FileFormat::Hmpg => return hmpg::read_hmpg_bytes(bytes),
        _ => {}
    }
    let text = std::str::from_utf8(bytes)
        .map_err(|error| ReadError::Syntax { format, detail: format!("it is not text in UTF-8: {error}") })?;
    match format {
        FileFormat::Ahap => ahap::read_ahap_text(text),
        FileFormat::Hjif => hjif::read_hjif_text(text),
        FileFormat::Haptic => lofelt::read_lofelt_text(text),
        FileFormat::Toml | FileFormat::Json | FileFormat::Wav | FileFormat::Hmpg => own::read_own_text(text, format),
    }
}

/// What a file looks like; a text that begins like an object of JSON is told by its keys.
///
/// # Errors
/// [`ReadError::NotRead`] for what looks like none.
pub fn detect_format(bytes: &[u8]) -> Result<FileFormat, ReadError> {
    if bytes.starts_with(b"RIFF") {
        return Ok(FileFormat::Wav);
    }
    let Ok(text) = std::str::from_utf8(bytes) else {
        // An initialization unit begins with six bits of its type 0, two of synchronisation, and four of its layer.
        return if bytes.first().is_some_and(|first| first >> 2 == 0) {
            Ok(FileFormat::Hmpg)
        } else {
            Err(ReadError::NotRead(
                "the file is neither text nor WAV nor HMPG; its format must be one of toml, json, ahap, hjif, hmpg, haptic and wav".into(),
            ))
        };
    };
    if text.bytes().any(|byte| byte == 0) {
        return Ok(FileFormat::Hmpg);
    }
    let text = text.trim_start_matches('\u{feff}').trim_start();
    if !text.starts_with('{') {
        return Ok(FileFormat::Toml);
    }
    // Not parsed: what is wrong in it is told by the reader of its format.
    let keys = [("Pattern", FileFormat::Ahap), ("perceptions", FileFormat::Hjif), ("signals", FileFormat::Haptic)];
    let has = |(key, _): &(&str, FileFormat)| text.contains(&format!("\"{key}\""));
    Ok(keys.into_iter().find(has).map_or(FileFormat::Json, |(_, format)| format))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn files_show_their_format() {
        for (bytes, format) in [
            (&b"version = 1"[..], FileFormat::Toml),
            (b"\xef\xbb\xbf {\"version\": 1, \"events\": []}", FileFormat::Json),
            (b"{\"Pattern\": []}", FileFormat::Ahap),
            (b"{\"perceptions\": []}", FileFormat::Hjif),
            (b"{\"signals\": {}}", FileFormat::Haptic),
            (b"RIFF\0\0\0\0WAVE", FileFormat::Wav),
            (b"\0\0\0\0\0\0\0\0\0", FileFormat::Hmpg),
        ] {
            assert_eq!(detect_format(bytes), Ok(format));
        }
        assert!(detect_format(&[0xff, 0xd8]).is_err());
        let long = vec![b' '; MAX_TEXT_BYTES + 1];
        let error = read_effect_bytes(&long, Some(FileFormat::Ahap)).unwrap_err().to_string();
        assert_eq!(error, "the file has 262145 bytes, but a file of format AHAP may have at most 262144");
    }
}
