//! A drive: of an actuator, as a plan has it, and of a channel, as the board has it.

use serde::Serialize;

/// A channel's drive as the board has it, in SI units.
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
    /// Phase of its windows in rad.
    pub phase_rad: f64,
}

/// An actuator's drive: planned, of a setting for the whole surface, or of an effect at full level.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[cfg_attr(feature = "schema", derive(utoipa::ToSchema))]
pub struct Drive {
    /// The actuator's `id`.
    pub actuator: String,
    /// Fundamental of its force in Hz.
    pub frequency_hz: f64,
    /// Electrode voltage in V.
    pub voltage_v: f64,
    /// Part of its half period for which an electrode is on.
    pub pulse_width: f64,
    /// Phase of its windows in rad: the middle of a window of electrode A is where the cosine of this phase is 1.
    pub phase_rad: f64,
    /// Phase in rad of the fundamental of its force, which lags behind the windows of electrodes that charge through resistors.
    pub force_phase_rad: f64,
    /// Amplitude of the force's fundamental in N, the mass at rest.
    pub force_n: f64,
}

/// The drives with their channels: actuator i of the scene is on channel i of the board.
pub fn assign_channels_in_order_of_drives<'a>(drives: impl IntoIterator<Item = &'a Drive>) -> Vec<SiDrive> {
    let on = |(channel, drive): (u8, &Drive)| {
        let Drive { frequency_hz, voltage_v, pulse_width, phase_rad, .. } = *drive;
        SiDrive { channel, frequency_hz, voltage_v, pulse_width, phase_rad }
    };
    (0..).zip(drives).map(on).collect()
}
