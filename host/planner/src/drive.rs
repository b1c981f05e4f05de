//! A drive of one channel as the board has it.

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
