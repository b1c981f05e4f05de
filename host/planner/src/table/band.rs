//! A table in a band that is asked for.

use crate::MIN_SPACING_HZ;

/// A band with too few of the table's frequencies.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
#[error(
    "too few of the planner's frequencies are in this band; allowed are {least_hz} to {most_hz} Hz{}",
    spaced(*actuators, *needed_hz)
)]
pub struct BandError {
    /// As asked for, or the least there is.
    pub from_hz: f64,
    /// As asked for, or the most there is.
    pub to_hz: f64,
    /// Lowest frequency of the table.
    pub least_hz: f64,
    /// Highest.
    pub most_hz: f64,
    /// Actuators that need a frequency each.
    pub actuators: usize,
    /// Width of a band that has room for them.
    pub needed_hz: f64,
}

fn spaced(actuators: usize, needed_hz: f64) -> String {
    if actuators < 2 {
        return String::new();
    }
    format!("; frequencies of {actuators} actuators, {MIN_SPACING_HZ} Hz apart, need {needed_hz} Hz between the two")
}
