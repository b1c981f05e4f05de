//! The formats.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

/// Most bytes of a text.
pub const MAX_TEXT_BYTES: usize = 256 * 1024;
/// Most bytes of a sound: 30 s of two channels with 16 bits at 48 kHz have 5.8 MB, with 32 bits 11.5 MB.
const MAX_SOUND_BYTES: usize = 12 * 1024 * 1024;

/// A format of effects.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema, clap::ValueEnum)]
#[serde(rename_all = "snake_case")]
pub enum FileFormat {
    /// The format of this program, as TOML
    Toml,
    /// The format of this program, as JSON
    Json,
    /// Apple Haptic and Audio Pattern
    Ahap,
    /// Haptics JSON Interchange Format (ISO/IEC 23090-31)
    Hjif,
    /// The binary form of HJIF, in packets (ISO/IEC 23090-31)
    Hmpg,
    /// Lofelt's `.haptic`, version 1
    Haptic,
    /// A sound, whose loudness over time is used as the intensity
    Wav,
}

impl std::fmt::Display for FileFormat {
    fn fmt(&self, out: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        out.write_str(match self {
            Self::Toml => "TOML",
            Self::Json => "JSON",
            Self::Ahap => "AHAP",
            Self::Hjif => "HJIF",
            Self::Hmpg => "HMPG",
            Self::Haptic => "Lofelt .haptic",
            Self::Wav => "WAV",
        })
    }
}

impl FileFormat {
    /// The most bytes of a file.
    #[must_use]
    pub const fn max_bytes(self) -> usize {
        if matches!(self, Self::Wav) { MAX_SOUND_BYTES } else { MAX_TEXT_BYTES }
    }

    /// The most bytes of any file.
    pub const MOST_BYTES: usize = MAX_SOUND_BYTES;
}
