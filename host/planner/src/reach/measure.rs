//! What peaks are measured in.

use crate::STANDARD_GRAVITY;
use crate::perception::felt_threshold_m_per_s2;
use serde::Serialize;

/// What peaks are measured in.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Measure {
    /// Acceleration in g.
    #[default]
    G,
    /// Acceleration over the threshold of feeling at its frequency: 1 is just felt.
    Thresholds,
}

impl Measure {
    /// What an acceleration of 1 m/s^2 at a frequency counts.
    #[must_use]
    pub fn weight_per_m_per_s2(self, frequency_hz: f64) -> f64 {
        match self {
            Measure::G => 1.0 / STANDARD_GRAVITY,
            Measure::Thresholds => 1.0 / felt_threshold_m_per_s2(frequency_hz),
        }
    }
}
