//! How a click is to be.

use super::measures::ClickMeasures;
use era_shared::supply::RAILS;
use era_shared::waveform::MAX_WINDOWS;

/// What a click is to be where it cannot be both strong and crisp.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[cfg_attr(feature = "schema", derive(utoipa::ToSchema))]
#[cfg_attr(feature = "clap", derive(clap::ValueEnum))]
#[serde(rename_all = "lowercase")]
pub enum Preference {
    /// The click is as strong as requested if possible, even if it then takes longer than `crisp_ms` until it is quiet
    #[default]
    Strength,
    /// The click is quiet after `crisp_ms` if possible, even if it is then weaker than requested
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
    /// Whether to compute the strongest crisp click that is possible ([`super::bound`]), which takes as long as the click.
    pub with_best_possible: bool,
    /// The part of its forces that the click gets in the end, 0 to 1: for what is left of earlier touches.
    pub force_fraction: f64,
    /// The voltages in V at which the rails stand, 0 where that is not known. Where a click needs not much less, it is designed for these voltages:
    /// a board that changes its rails begins some 13 ms later.
    pub standing_rails_v: [f64; RAILS],
    /// Of a double click, the time in s from the first click to the second, which is the same; `None` for a single click.
    pub second_click_after_s: Option<f64>,
}

impl ClickOptions {
    /// Most windows of each click: a board takes all windows of a double click at once.
    #[must_use]
    pub const fn max_windows_of_each_click(&self) -> usize {
        if self.second_click_after_s.is_some() { MAX_WINDOWS / 2 } else { MAX_WINDOWS }
    }

    /// Whether a place that moves like this clicks crisply: its peak comes in time, and it is quiet at the time asked for. Times count from the
    /// burst's start.
    #[must_use]
    pub fn does_motion_peak_and_become_quiet_in_time(&self, measures: &ClickMeasures) -> bool {
        let is_quiet = measures.quiet_s.is_some_and(|quiet_s| quiet_s <= self.crisp_s);
        measures.peak > 0.0 && measures.peak_s <= LATEST_PEAK_S && is_quiet
    }
}

/// A rail stays as it is if its voltage is at most this many times the voltage that a click needs. Forces are then up to 2.25 times as large as
/// needed, and windows narrower.
pub const MAX_STANDING_RAIL_RATIO: f64 = 1.5;
/// Latest peak of a crisp click, in s after the start of the burst: a later one is felt as late.
pub const LATEST_PEAK_S: f64 = 0.015;
/// Least and most of [`ClickOptions::crisp_s`] in s.
pub const CRISP_RANGE_S: (f64, f64) = (0.020, 0.100);

impl Default for ClickOptions {
    fn default() -> Self {
        Self {
            crisp_s: 0.045,
            preference: Preference::Strength,
            with_best_possible: false,
            force_fraction: 1.0,
            standing_rails_v: [0.0; RAILS],
            second_click_after_s: None,
        }
    }
}
