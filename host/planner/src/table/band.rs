//! A table in a band that is asked for.

use super::PlanTable;
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

impl PlanTable {
    /// The table without the frequencies below and above what is asked for, all of it where nothing is.
    ///
    /// # Errors
    /// [`BandError`] if what is left has no room for a frequency of each actuator.
    pub fn in_band(self, from_hz: Option<f64>, to_hz: Option<f64>) -> Result<Self, BandError> {
        if from_hz.is_none() && to_hz.is_none() {
            return Ok(self);
        }
        let ends = |table: &Self| table.frequencies_hz.first().copied().zip(table.frequencies_hz.last().copied());
        let (least_hz, most_hz) = ends(&self).unwrap_or_default();
        let (from_hz, to_hz) = (from_hz.unwrap_or(least_hz), to_hz.unwrap_or(most_hz));
        let actuators = self.electrodes.len();
        // A small count.
        let needed_hz = (1..actuators).fold(0.0, |sum, _| sum + MIN_SPACING_HZ);
        let error = BandError { from_hz, to_hz, least_hz, most_hz, actuators, needed_hz };
        let table = self.between(from_hz, to_hz).ok_or(error)?;
        let (first, last) = ends(&table).unwrap_or_default();
        if last - first < needed_hz { Err(error) } else { Ok(table) }
    }
}
