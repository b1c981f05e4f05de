//! How a click is to be.

use super::measures::ClickMeasures;

/// What a click is to be where it cannot be both strong and crisp.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[cfg_attr(feature = "schema", derive(utoipa::ToSchema))]
#[cfg_attr(feature = "clap", derive(clap::ValueEnum))]
#[serde(rename_all = "lowercase")]
pub enum Preference {
    /// As strong as was asked for, even if it rings longer
    #[default]
    Strength,
    /// Quiet at the time asked for, even if it is weaker
    Crispness,
}

impl Preference {
    /// As in requests.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Strength => "strength",
            Self::Crispness => "crispness",
        }
    }
}

/// How a click is to be.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ClickOptions {
    /// Longest time in s until it is quiet.
    pub crisp_s: f64,
    /// What counts more.
    pub preference: Preference,
    /// Whether to compute the figures that clicks are compared by: the strongest click that is possible, and the sound.
    pub with_figures_for_comparison: bool,
    /// The part of its forces that the click gets in the end, 0 to 1: for what is left of earlier touches.
    pub force_fraction: f64,
}

impl ClickOptions {
    /// Whether a place that moves like this clicks crisply: its peak comes in time, and it is quiet at the time asked for. Times count from the
    /// burst's start.
    #[must_use]
    pub fn is_motion_crisp(&self, measures: &ClickMeasures) -> bool {
        let is_quiet = measures.quiet_s.is_some_and(|quiet_s| quiet_s <= self.crisp_s);
        measures.peak > 0.0 && measures.peak_s <= LATEST_PEAK_S && is_quiet
    }
}

/// Latest peak of a crisp click, in s after the start of the burst: a later one is felt as late.
pub const LATEST_PEAK_S: f64 = 0.015;
/// Least and most of [`ClickOptions::crisp_s`] in s.
pub const CRISP_RANGE_S: (f64, f64) = (0.020, 0.100);

impl Default for ClickOptions {
    fn default() -> Self {
        Self {
            crisp_s: 0.045,
            preference: Preference::Strength,
            with_figures_for_comparison: false,
            force_fraction: 1.0,
        }
    }
}
