//! Options of `era effect`.

use super::args::{At, CacheOptions, Crispness, PanelOptions, Rhythm};
use super::headings::{EFFECT, NO_HEADING, OUTPUT, TOUCH};
use super::values::parse_path_ending_in_csv_wav_or_png;
use crate::effect_files::FileFormat;
use crate::effects::NamedEffect;
use clap::Args;
use std::path::PathBuf;

/// An effect to design.
#[derive(Clone, Debug, Args)]
pub struct EffectOptions {
    #[command(flatten)]
    pub panel: PanelOptions,
    #[command(flatten)]
    pub keep: CacheOptions,
    #[command(flatten)]
    pub at: At,
    /// Requested peak acceleration, in dB above the threshold of feeling (in place of --intensity-g)
    #[arg(long, value_name = "DB", allow_negative_numbers = true, conflicts_with = "intensity_g", help_heading = TOUCH)]
    pub intensity_db: Option<f64>,
    /// Name of the effect
    #[arg(value_name = "NAME", required_unless_present_any = ["effect", "file"], conflicts_with = "effect",
        help_heading = NO_HEADING)]
    pub name: Option<NamedEffect>,
    /// Name of the effect; give this option or the argument NAME, but not both
    #[arg(long, value_name = "NAME", hide_possible_values = true, help_heading = EFFECT)]
    pub effect: Option<NamedEffect>,
    /// Duration in ms
    #[arg(long, value_name = "T", allow_negative_numbers = true, help_heading = EFFECT)]
    pub duration_ms: Option<f64>,
    #[command(flatten)]
    pub rhythm: Rhythm,
    #[command(flatten)]
    pub crispness: Crispness,
    /// Design the effect for a board with protocol version 3 or lower, which plays clicks as drives with envelopes
    #[arg(long, help_heading = EFFECT, conflicts_with = "file")]
    pub envelopes: bool,
    #[command(flatten)]
    pub from_file: EffectFileOptions,
    /// Print JSON
    #[arg(long, help_heading = OUTPUT)]
    pub json: bool,
}

/// An effect from a file.
#[derive(Clone, Debug, Args)]
pub struct EffectFileOptions {
    /// Effect file to read in place of a named effect: TOML, JSON, AHAP, HJIF, HMPG, Lofelt .haptic or WAV
    #[arg(
        long,
        value_name = "FILE",
        help_heading = EFFECT,
        conflicts_with_all = ["name", "effect", "duration_ms", "count", "period_ms", "crisp_ms", "prefer", "intensity_db"]
    )]
    pub file: Option<PathBuf>,
    /// Format of the file [default: detected from the content of the file]
    #[arg(long, value_enum, requires = "file", help_heading = EFFECT)]
    pub format: Option<FileFormat>,
    /// Write the acceleration over time to this file, whose name ends in .csv, .wav or .png
    #[arg(long, value_name = "FILE", value_parser = parse_path_ending_in_csv_wav_or_png, help_heading = OUTPUT)]
    pub export: Option<PathBuf>,
}

impl EffectFileOptions {
    /// The option that is given without a file, though it is about one. Of an option that another one excludes, clap asks for nothing.
    pub fn find_given_option_that_requires_missing_file(&self) -> Option<&'static str> {
        self.format.is_some().then_some("--format").filter(|_| self.file.is_none())
    }
}
