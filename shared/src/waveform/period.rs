//! One period of a timer: what its preloaded registers say.

/// A window between two compare values: on while `on <= counter < off`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct CompareWindow {
    /// First tick.
    pub on: u16,
    /// First tick after it.
    pub off: u16,
}

impl CompareWindow {
    /// Never on: the counter neither reaches 0xFFFF (ARR stays below it) nor is below 0.
    pub const NEVER: Self = Self { on: u16::MAX, off: 0 };
}

/// Rhythm and windows of one period.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct TimerPeriod {
    /// Clocks in a tick, PSC + 1: 1 to 65 536.
    pub divider: u32,
    /// Ticks in a period, ARR + 1: 2 to 65 535.
    pub ticks: u32,
    /// Electrode A.
    pub a: CompareWindow,
    /// Electrode B.
    pub b: CompareWindow,
}

/// A period of exactly 1 ms at 170 MHz in which nothing is on: what a timer does while its channel is off, so that a drive
/// begins within a ms.
pub const IDLE: TimerPeriod = TimerPeriod::without_windows(4, 42_500);

impl TimerPeriod {
    /// Most ticks in a period: ARR must stay below 0xFFFF, see [`CompareWindow::NEVER`].
    pub const MOST_TICKS: u32 = 65_535;
    /// Most clocks in a tick: a 16-bit prescaler plus one.
    pub const MOST_DIVIDER: u32 = 65_536;

    /// A period in which nothing is on.
    #[must_use]
    pub const fn without_windows(divider: u32, ticks: u32) -> Self {
        Self { divider, ticks, a: CompareWindow::NEVER, b: CompareWindow::NEVER }
    }

    /// A period with windows of `width_ticks` ticks, each in the middle of its half; blank if `width_ticks` is 0. `reversed` exchanges
    /// the electrodes, which turns the force round. `width_ticks` must be below half of `ticks` by the guard time;
    /// [`super::compute_channel_program()`] sees to it.
    #[must_use]
    pub fn with_windows(divider: u32, ticks: u32, width_ticks: u32, reversed: bool) -> Self {
        if width_ticks == 0 || 2 * width_ticks >= ticks {
            return Self::without_windows(divider, ticks);
        }
        let first = first_window_start(ticks, width_ticks);
        let window = |on: u32| CompareWindow { on: saturate_to_u16(on), off: saturate_to_u16(on + width_ticks) };
        let (early, late) = (window(first), window(first + ticks / 2));
        let (a, b) = if reversed { (late, early) } else { (early, late) };
        Self { divider, ticks, a, b }
    }

    /// Clocks in the period.
    #[must_use]
    pub const fn length_clocks(&self) -> u64 {
        self.divider as u64 * self.ticks as u64
    }

    /// Ticks of the wider of the two windows.
    #[must_use]
    pub const fn widest_window_ticks(&self) -> u16 {
        let (a, b) = (self.a.off.saturating_sub(self.a.on), self.b.off.saturating_sub(self.b.on));
        if a > b { a } else { b }
    }

    /// Whether no electrode is on in it.
    #[must_use]
    pub fn has_no_windows(&self) -> bool {
        self.a == CompareWindow::NEVER && self.b == CompareWindow::NEVER
    }
}

/// First tick of the earlier window: half of the half period's ticks that the window leaves.
pub(super) const fn first_window_start(ticks: u32, width_ticks: u32) -> u32 {
    (ticks - 2 * width_ticks) / 4
}

// Callers keep the values in range; saturating keeps a mistake from becoming a short period.
pub(super) fn saturate_to_u16(value: u32) -> u16 {
    u16::try_from(value).unwrap_or(u16::MAX)
}
