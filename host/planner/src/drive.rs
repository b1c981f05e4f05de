//! A drive: of an actuator, as a plan has it, and of a channel, as the board has it.

use serde::Serialize;

/// One drive in SI units.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SiDrive {
    /// 0-based.
    pub channel: u8,
    /// Fundamental of the force in Hz.
    pub frequency_hz: f64,
    /// Electrode voltage in V.
    pub voltage_v: f64,
    /// Part of its half period for which an electrode is on.
    pub pulse_width: f64,
    /// Phase of the force in rad.
    pub phase_rad: f64,
}

/// One actuator's part.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Drive {
    /// The actuator's `id`.
    pub actuator: String,
    /// Fundamental of its force in Hz.
    pub frequency_hz: f64,
    /// Electrode voltage in V.
    pub voltage_v: f64,
    /// Part of its half period for which an electrode is on.
    pub pulse_width: f64,
    /// Phase of its force in rad.
    pub phase_rad: f64,
    /// Amplitude of the force's fundamental in N, the mass at rest.
    pub force_n: f64,
}
