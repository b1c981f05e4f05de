//! A band of frequencies that a request restricts the plan table to.

use crate::MIN_SPACING_HZ;

/// The error for a band that holds too few of the table's frequencies.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
#[error(
    "the band from {from_hz} to {to_hz} Hz contains too few of the planner's frequencies, which lie between {least_hz} and {most_hz} Hz{}",
    describe_needed_band_width(*actuators, *needed_hz)
)]
pub struct BandError {
    /// Lower end of the band in Hz: the requested one, or the table's lowest frequency.
    pub from_hz: f64,
    /// Upper end of the band in Hz: the requested one, or the table's highest frequency.
    pub to_hz: f64,
    /// Lowest frequency of the table in Hz.
    pub least_hz: f64,
    /// Highest frequency of the table in Hz.
    pub most_hz: f64,
    /// Number of actuators; each needs a frequency of its own.
    pub actuators: usize,
    /// Least width in Hz of a band that fits all of them.
    pub needed_hz: f64,
}

/// The part of the error message about the spacing of frequencies; empty for fewer than two actuators.
fn describe_needed_band_width(actuators: usize, width_hz: f64) -> String {
    if actuators < 2 {
        return String::new();
    }
    format!(
        "; {actuators} actuators need frequencies that are at least {MIN_SPACING_HZ} Hz apart, so the band must be at \
         least {width_hz} Hz wide"
    )
}
