//! A window of a burst.

use era_shared::limits::GUARD_NANOSECONDS;
use era_shared::waveform::Electrode;

/// Before the first slot, in s: no window may begin sooner than a guard after the burst's start.
pub const LEAD_S: f64 = GUARD_NANOSECONDS as f64 * 1e-9;

/// One window.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ClickWindow {
    /// Index of the actuator.
    pub actuator: usize,
    /// Which electrode is on; A pulls as positive force.
    pub electrode: Electrode,
    /// From the burst's common start, in s; a whole number of ticks of 0.1 us.
    pub begin_s: f64,
    /// For how long it is on, in s; a whole number of ticks.
    pub width_s: f64,
    /// Voltage of its rail in V.
    pub voltage_v: f64,
}
