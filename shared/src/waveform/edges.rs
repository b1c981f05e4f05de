//! From timer registers to the edges at the two electrodes, following RM0440 sections 28.3.10 ("PWM edge-aligned mode") and
//! 28.3.13 ("Combined PWM mode"). The simulated device drives its panel with these windows, and the tests rebuild what the
//! firmware's registers do with the same code.

use super::registers::TimerRegisters;
use serde::{Deserialize, Serialize};

/// One of the two electrodes of an ERA. Wire format: append only.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Electrode {
    /// Pulls the mass in the positive direction.
    A,
    /// Pulls it in the negative direction.
    B,
}

/// The stretch of one period in which an electrode is on, in ticks from the counter's zero; `start < period`, and the
/// stretch may run over the period's end into the next.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct TickWindow {
    /// First tick.
    pub start: u32,
    /// Number of ticks; 0 means never on.
    pub length: u32,
}

/// The windows of both electrodes in one period.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ElectrodeWindows {
    /// Ticks in a period: ARR + 1.
    pub period: u32,
    /// Clocks in a tick: PSC + 1.
    pub divider: u32,
    /// Electrode A.
    pub a: TickWindow,
    /// Electrode B.
    pub b: TickWindow,
}

/// Why registers do not describe alternating windows.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum WindowsError {
    /// The counter does not count upwards.
    NotUpwards,
    /// An output is active low, or a complementary output is on.
    Polarity,
    /// A register is not preloaded: a change would not wait for the boundary.
    NotPreloaded,
    /// Both or none of an electrode's pair of channels reach pins.
    Outputs(Electrode),
    /// A pair of channels is not in the two modes that make a window.
    Mode(Electrode),
    /// ARR is 0: the counter does not move.
    Stopped,
}

impl ElectrodeWindows {
    /// The windows that these registers make. A timer that is not driving has windows of length 0.
    ///
    /// # Errors
    /// [`WindowsError`] if the timer drives in another way than this project uses.
    pub fn from_registers(registers: &TimerRegisters) -> Result<Self, WindowsError> {
        let (reload, divider) = (registers.arr & 0xFFFF, (registers.psc & 0xFFFF) + 1);
        let period = reload + 1;
        let never = TickWindow { start: 0, length: 0 };
        if !registers.is_counting_with_outputs_enabled() {
            return Ok(Self { period, divider, a: never, b: never });
        }
        if !registers.counts_up() {
            return Err(WindowsError::NotUpwards);
        }
        if !registers.has_only_active_high_outputs() {
            return Err(WindowsError::Polarity);
        }
        if !registers.is_preload_enabled() {
            return Err(WindowsError::NotPreloaded);
        }
        if reload == 0 {
            return Err(WindowsError::Stopped);
        }
        let window = |first: u8, electrode: Electrode| {
            let (with_output, other) =
                match (registers.is_channel_output_enabled(first), registers.is_channel_output_enabled(first + 1)) {
                    (true, false) => (first, first + 1),
                    (false, true) => (first + 1, first),
                    _ => return Err(WindowsError::Outputs(electrode)),
                };
            let ((opening, on), (closing, off)) =
                (registers.channel_mode_and_compare(with_output), registers.channel_mode_and_compare(other));
            if !TimerRegisters::mode_opens_window(opening) || !TimerRegisters::mode_closes_window(closing) {
                return Err(WindowsError::Mode(electrode));
            }
            // On while on <= CNT < off, and CNT never exceeds ARR.
            let end = off.min(period);
            Ok(if on < end { TickWindow { start: on, length: end - on } } else { never })
        };
        Ok(Self { period, divider, a: window(1, Electrode::A)?, b: window(3, Electrode::B)? })
    }

    /// Which electrode is on at tick `tick` of the period, if any.
    ///
    /// # Errors
    /// The tick, if both electrodes are on at it.
    pub fn electrode_on_at_tick_or_err_if_both_on(&self, tick: u32) -> Result<Option<Electrode>, u32> {
        match (self.a.contains_tick(tick, self.period), self.b.contains_tick(tick, self.period)) {
            (true, true) => Err(tick),
            (true, false) => Ok(Some(Electrode::A)),
            (false, true) => Ok(Some(Electrode::B)),
            (false, false) => Ok(None),
        }
    }

    /// Ticks of a period in which both electrodes are on.
    #[must_use]
    pub fn overlap_ticks(&self) -> u32 {
        if self.a.length == 0 || self.b.length == 0 {
            return 0;
        }
        self.a.length + self.b.length - self.union_length_ticks()
    }

    /// The shorter of the two gaps between the windows in ticks; `None` if an electrode is never on.
    #[must_use]
    pub fn shortest_guard_ticks_if_both_have_windows(&self) -> Option<u32> {
        if self.a.length == 0 || self.b.length == 0 {
            return None;
        }
        if self.overlap_ticks() > 0 {
            return Some(0);
        }
        let gap = |from: TickWindow, to: TickWindow| {
            let end = (from.start + from.length) % self.period;
            (to.start + self.period - end) % self.period
        };
        Some(gap(self.a, self.b).min(gap(self.b, self.a)))
    }

    /// Length of a tick in s for a timer clock in Hz.
    #[must_use]
    pub fn tick_length_s(&self, clock_hz: u32) -> f64 {
        f64::from(self.divider) / f64::from(clock_hz)
    }

    fn union_length_ticks(&self) -> u32 {
        // Seen from A's start, A is [0, a) and B starts at `offset`; what of B lies in A, or wraps around into it, is
        // shared.
        let offset = (self.b.start + self.period - self.a.start) % self.period;
        let first = self.a.length.saturating_sub(offset).min(self.b.length);
        let wrapped = (offset + self.b.length).saturating_sub(self.period).min(self.a.length);
        self.a.length + self.b.length - (first + wrapped).min(self.b.length)
    }
}

impl TickWindow {
    fn contains_tick(self, tick: u32, period_ticks: u32) -> bool {
        (tick % period_ticks.max(1) + period_ticks - self.start) % period_ticks.max(1) < self.length
    }
}
