//! A window of an effect, by the actuator's name.

use crate::click::ClickWindow;
use era_shared::waveform::Electrode;
use serde::Serialize;

/// One window of a burst, from the burst's common start.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[cfg_attr(feature = "schema", derive(utoipa::ToSchema))]
pub struct EffectWindow {
    /// The actuator's `id`.
    pub actuator: String,
    /// The board's channel, from 0.
    #[serde(skip)]
    pub channel: usize,
    /// Which electrode is on: A pulls as positive force.
    #[cfg_attr(feature = "schema", schema(value_type = String))]
    pub electrode: Electrode,
    /// When it begins, in us.
    pub begin_us: f64,
    /// For how long it is on, in us.
    pub width_us: f64,
    /// Voltage of its rail in V.
    pub voltage_v: f64,
}

impl EffectWindow {
    /// The window by the actuator's index, in s: actuator i of a scene is on channel i of the board.
    #[must_use]
    pub fn to_click_window_in_seconds_by_actuator_index(&self) -> ClickWindow {
        ClickWindow {
            actuator: self.channel,
            electrode: self.electrode,
            begin_s: 1e-6 * self.begin_us,
            width_s: 1e-6 * self.width_us,
            voltage_v: self.voltage_v,
        }
    }
}
