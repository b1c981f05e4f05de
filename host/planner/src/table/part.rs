//! One actuator's part of a setting of all.

use serde::Serialize;

/// One actuator's part of a setting.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Part {
    /// The actuator's `id`.
    pub actuator: String,
    /// In Hz.
    pub frequency_hz: f64,
    /// Amplitude of the force's fundamental in N, the mass at rest.
    pub force_n: f64,
    /// Phase of the force in rad.
    pub phase_rad: f64,
    /// Electrode voltage in V.
    pub voltage_v: f64,
    /// Part of its half period for which an electrode is on.
    pub pulse_width: f64,
    /// The frequency as an index.
    #[serde(skip)]
    pub frequency: usize,
}
