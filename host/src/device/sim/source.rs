//! One ERA's electrostatic force as its timer makes it.

use era_shared::protocol::ChannelLimits;
use era_shared::waveform::{ChannelProgram, TimerRegisters, Window, Windows, WindowsError};

/// A running channel: electrode windows, and the force while an electrode is on.
#[derive(Clone, Copy, Debug)]
pub struct Source {
    windows: Windows,
    tick_s: f64,
    start_ticks: f64,
    started_s: f64,
    force_n: f64,
}

impl Source {
    /// A channel that starts at `started_s` and pulls with `newtons_per_volt_squared` V^2 (eps0 S / (2 g^2), the force at
    /// the rest position) while electrode A is on, with the opposite force while B is on.
    ///
    /// # Errors
    /// [`WindowsError`] if the registers do not describe alternating windows.
    pub fn new(program: &ChannelProgram, started_s: f64, newtons_per_volt_squared: f64) -> Result<Self, WindowsError> {
        let windows = Windows::from_registers(&TimerRegisters::running(&program.timer))?;
        let voltage_v = f64::from(program.achieved.voltage_millivolts) / 1e3;
        Ok(Self {
            windows,
            tick_s: windows.tick_s(ChannelLimits::BOARD.timer_clock_hz),
            start_ticks: f64::from(program.timer.start_count),
            started_s,
            force_n: newtons_per_volt_squared * voltage_v * voltage_v,
        })
    }

    /// Mean force in N from `from_s` to `from_s + step_s`. The mean, not a sample: edges fall anywhere within a step,
    /// and their exact area is what moves the panel.
    #[must_use]
    pub fn mean_force_n(&self, from_s: f64, step_s: f64) -> f64 {
        let from = self.start_ticks + (from_s - self.started_s) / self.tick_s;
        let to = from + step_s / self.tick_s;
        let on = |window: Window| {
            on_ticks_until(window, self.windows.period, to) - on_ticks_until(window, self.windows.period, from)
        };
        self.force_n * (on(self.windows.a) - on(self.windows.b)) * self.tick_s / step_s
    }
}

/// Ticks for which the window is on from the counter's zero to `ticks` (which may be many periods on), up to a constant.
fn on_ticks_until(window: Window, period: u32, ticks: f64) -> f64 {
    let (period, length) = (f64::from(period), f64::from(window.length));
    let since_start = ticks - f64::from(window.start);
    let periods = (since_start / period).floor();
    periods * length + (since_start - periods * period).min(length)
}
