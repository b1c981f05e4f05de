//! What the simulated timers do at the electrodes at one time, for tests that look at the device from outside.

use era_shared::MAX_CHANNELS;
use era_shared::waveform::ElectrodeWindows;

/// The period that a running timer repeats at one time.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ActivePeriod {
    /// When the electrodes are on; windows of length 0 if the timers do not reach the electrodes.
    pub windows: ElectrodeWindows,
    /// Time since the period began, in ticks.
    pub position_ticks: f64,
}

/// All outputs at one time of the board's clock.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct SimOutputs {
    /// The board's time in s.
    pub time_s: f64,
    /// Whether the timers reach the electrodes. If not, all electrodes are held low.
    pub connected: bool,
    /// The periods of the channels' timers; `None` if a timer stands still.
    pub active_periods: [Option<ActivePeriod>; MAX_CHANNELS],
}
