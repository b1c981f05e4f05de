//! From timer registers to the edges at the two electrodes, following RM0440 section 28.3.11 ("PWM center-aligned
//! mode"). The simulated device drives its panel with these windows, and the tests rebuild what the firmware's
//! registers do with the same code.

use super::registers::{OutputMode, TimerRegisters};

/// One of the two electrodes of an ERA.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Electrode {
    /// Pulls the mass in the positive direction.
    A,
    /// Pulls it in the negative direction.
    B,
}

/// The stretch of one period in which an electrode is on, in ticks from the counter's zero; `start < period`, and the
/// stretch may run over the period's end into the next.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Window {
    /// First tick.
    pub start: u32,
    /// Number of ticks; 0 means never on.
    pub length: u32,
}

/// The windows of both electrodes in one period.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Windows {
    /// Ticks in a period: 2 ARR.
    pub period: u32,
    /// Clocks in a tick: PSC + 1.
    pub divider: u32,
    /// Electrode A.
    pub a: Window,
    /// Electrode B.
    pub b: Window,
}

/// Why registers do not describe alternating windows.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum WindowsError {
    /// The timer is not in centre-aligned mode.
    NotCentreAligned,
    /// An output is active low.
    Polarity,
    /// An output is in another mode than PWM 1 or 2.
    Mode(Electrode),
    /// ARR is 0: the counter does not move.
    Stopped,
}

impl Windows {
    /// What the registers make the electrodes do. A timer that is not driving has windows of length 0.
    ///
    /// # Errors
    /// [`WindowsError`] if the timer drives but not in the way that this project uses it.
    pub fn from_registers(registers: &TimerRegisters) -> Result<Self, WindowsError> {
        let (reload, divider) = (registers.arr & 0xFFFF, (registers.psc & 0xFFFF) + 1);
        let period = 2 * reload;
        if !registers.is_driving() {
            let never = Window { start: 0, length: 0 };
            return Ok(Self { period, divider, a: never, b: never });
        }
        if !registers.is_centre_aligned() {
            return Err(WindowsError::NotCentreAligned);
        }
        if !registers.is_active_high() {
            return Err(WindowsError::Polarity);
        }
        if reload == 0 {
            return Err(WindowsError::Stopped);
        }
        let window = |output: usize, electrode: Electrode, compare: u32| {
            let mode = registers.mode(output).ok_or(WindowsError::Mode(electrode))?;
            let compare = compare.min(reload);
            // Counting up an output of mode 1 is on for CNT < CCR, counting down for CNT <= CCR: 2 CCR ticks around
            // zero. Mode 2 is its complement: 2 (ARR - CCR) ticks around the top.
            Ok(match mode {
                _ if !registers.enabled(output) => Window { start: 0, length: 0 },
                OutputMode::Below => Window { start: (period - compare) % period, length: 2 * compare },
                OutputMode::Above => Window { start: compare, length: period - 2 * compare },
            })
        };
        Ok(Self {
            period,
            divider,
            a: window(0, Electrode::A, registers.ccr1 & 0xFFFF)?,
            b: window(1, Electrode::B, registers.ccr2 & 0xFFFF)?,
        })
    }

    /// Which electrode is on at tick `tick` of the period; `Err` if both are.
    ///
    /// # Errors
    /// `()` would be lost information: the tick is returned at which both are on.
    pub fn on_at(&self, tick: u32) -> Result<Option<Electrode>, u32> {
        match (self.a.contains(tick, self.period), self.b.contains(tick, self.period)) {
            (true, true) => Err(tick),
            (true, false) => Ok(Some(Electrode::A)),
            (false, true) => Ok(Some(Electrode::B)),
            (false, false) => Ok(None),
        }
    }

    /// Ticks of a period in which both electrodes are on.
    #[must_use]
    pub fn overlap(&self) -> u32 {
        if self.a.length == 0 || self.b.length == 0 {
            return 0;
        }
        self.a.length + self.b.length - self.union_length()
    }

    /// The shorter of the two gaps between the windows in ticks; `None` if an electrode is never on.
    #[must_use]
    pub fn guard(&self) -> Option<u32> {
        if self.a.length == 0 || self.b.length == 0 {
            return None;
        }
        if self.overlap() > 0 {
            return Some(0);
        }
        let gap = |from: Window, to: Window| {
            let end = (from.start + from.length) % self.period;
            (to.start + self.period - end) % self.period
        };
        Some(gap(self.a, self.b).min(gap(self.b, self.a)))
    }

    /// Length of a tick in s for a timer clock in Hz.
    #[must_use]
    pub fn tick_s(&self, clock_hz: u32) -> f64 {
        f64::from(self.divider) / f64::from(clock_hz)
    }

    fn union_length(&self) -> u32 {
        // Seen from A's start, A is [0, a) and B starts at `offset`; what of B lies in A, or wraps around into it, is
        // shared.
        let offset = (self.b.start + self.period - self.a.start) % self.period;
        let first = self.a.length.saturating_sub(offset).min(self.b.length);
        let wrapped = (offset + self.b.length).saturating_sub(self.period).min(self.a.length);
        self.a.length + self.b.length - (first + wrapped).min(self.b.length)
    }
}

impl Window {
    fn contains(self, tick: u32, period: u32) -> bool {
        (tick % period.max(1) + period - self.start) % period.max(1) < self.length
    }
}
