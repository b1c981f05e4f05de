//! Windows that are given one by one, instead of as a rhythm: clicks, and signals that identify a panel.
//!
//! All channels begin at one clock edge. A channel's windows are cut into periods of its timer, one window in each, with their
//! boundaries in the pauses between windows, so that everything that holds for the periods of a drive holds for these: registers are
//! preloaded, no window is cut short, and the counter is never in two windows at once.

use super::edges::Electrode;
use super::period::{CompareWindow, TimerPeriod, saturate_to_u16};
use crate::MAX_CHANNELS;
use crate::circuit::least_electrode_charge_permille;
use crate::limits::LEAST_GUARD_NANOSECONDS;
use crate::protocol::ChannelLimits;
use heapless::Vec;
use serde::{Deserialize, Serialize};

/// Most windows of a sequence, all channels together: as many as fit a frame.
pub const MAX_WINDOWS: usize = 24;
/// Clocks in a tick of a sequence: 0.1 us at 170 MHz.
pub const SEQUENCE_TICK_CLOCKS: u32 = 17;
/// Shortest window in ticks: 300 us, in which an electrode of 116 pF behind 1 Mohm reaches 92 % of its voltage. With its pauses it is a period of
/// 500 us or more, which leaves the board 380 us to prepare the next.
pub const LEAST_WIDTH_TICKS: u32 = 3_000;
const _: () = assert!(
    // At least 86 %, two time constants, with all tolerances against it; a tick is 100 ns.
    least_electrode_charge_permille(LEAST_WIDTH_TICKS as u64 * 100) >= 860,
    "the shortest window charges an electrode to less than 86 %"
);
/// Longest pause before a window in ticks: 1 s.
pub const MOST_WAIT_TICKS: u32 = 10_000_000;
/// Shortest blank period in ticks: the board must be able to prepare what follows it.
const LEAST_BLANK_TICKS: u32 = 5_000;
/// A blank period of this many clocks and some more, in ticks of two clocks, brings a boundary onto the ticks of a sequence: 500 us,
/// a multiple of [`SEQUENCE_TICK_CLOCKS`].
const ALIGNING_CLOCKS: u64 = 85_000;
/// A sequence can begin this many clocks after a boundary, or later: an aligning period and two blank ones.
pub(super) const LEAST_LEAD_CLOCKS: u64 =
    ALIGNING_CLOCKS + 2 * (LEAST_BLANK_TICKS as u64 + 1) * SEQUENCE_TICK_CLOCKS as u64;

/// One window of a sequence.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct SequenceWindow {
    /// The channel, from 0.
    pub channel: u8,
    /// Which electrode is on.
    pub electrode: Electrode,
    /// From the end of the channel's window before, or from the beginning of the sequence, to the beginning of this one, in ticks of
    /// [`SEQUENCE_TICK_CLOCKS`].
    pub wait_ticks: u32,
    /// For how long the electrode is on, in ticks.
    pub width_ticks: u32,
}

/// Why a sequence is refused.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum SequenceError {
    /// It has no window.
    Empty,
    /// The board has no such channel.
    NoSuchChannel {
        /// The window's number, from 0.
        window: u8,
        /// Channels that the board has.
        channels: u8,
    },
    /// A window is too short or too long.
    Width {
        /// The window's number, from 0.
        window: u8,
        /// As asked for, in ticks.
        requested_ticks: u32,
        /// Least allowed.
        min_ticks: u32,
        /// Most allowed.
        max_ticks: u32,
    },
    /// The pause before a window is too short or too long.
    Wait {
        /// The window's number, from 0.
        window: u8,
        /// As asked for, in ticks.
        requested_ticks: u32,
        /// Least allowed: the guard time.
        min_ticks: u32,
        /// Most allowed.
        max_ticks: u32,
    },
    /// The sequence lasts longer than a channel may drive without a rest.
    TooLong {
        /// As asked for, in ms, rounded up.
        requested_ms: u32,
        /// Most allowed.
        max_ms: u32,
    },
    /// A rail's voltage is above the limit of a channel that it feeds, in mV.
    Voltage {
        /// The rail, from 1.
        rail: u8,
        /// As asked for.
        requested_millivolts: u32,
        /// Most allowed.
        max_millivolts: u32,
    },
}

/// A window with its place in time.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct PlacedWindow {
    channel: u8,
    electrode: Electrode,
    /// First tick since the beginning of the sequence.
    begin: u32,
    /// First tick after it.
    end: u32,
}

/// The windows of a sequence, checked, with their places in time.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct PlacedWindows {
    /// The beginning of the sequence, in clocks since the timers' start.
    start: u64,
    /// Half of the shortest pause of each channel, in ticks.
    half_guards: [u32; MAX_CHANNELS],
    windows: Vec<PlacedWindow, MAX_WINDOWS>,
}

/// The longest window in ticks that fits a 16-bit counter with what is longest around it and not a blank period of its own: half a
/// guard and nearly a blank period before the first window of a channel, half a guard and half a blank period after it.
const fn widest_window_ticks_that_fit_16_bit_counter(guard: u32) -> u32 {
    TimerPeriod::MOST_TICKS.saturating_sub(guard.saturating_add(LEAST_BLANK_TICKS * 3 / 2 + 1))
}

/// The guard time of a channel in ticks, rounded up to an even number.
fn guard_ticks(limits: &ChannelLimits) -> u32 {
    let nanoseconds = u64::from(limits.min_guard_ns.max(LEAST_GUARD_NANOSECONDS));
    let per_tick = u64::from(SEQUENCE_TICK_CLOCKS) * 1_000_000_000;
    let half = (nanoseconds * u64::from(limits.timer_clock_hz)).div_ceil(2 * per_tick);
    u32::try_from(2 * half).unwrap_or(u32::MAX)
}

impl PlacedWindows {
    /// Checks a sequence. It begins with the timers' start, until [`Self::set_start_clock`] says otherwise.
    ///
    /// # Errors
    /// [`SequenceError`] with the limits for everything out of range; nothing is clamped.
    pub fn from_sequence(limits: &[ChannelLimits], sequence: &[SequenceWindow]) -> Result<Self, SequenceError> {
        if sequence.is_empty() {
            return Err(SequenceError::Empty);
        }
        let mut placed = Self { start: 0, half_guards: [0; MAX_CHANNELS], windows: Vec::new() };
        for (window, asked) in (0..).zip(sequence) {
            let channels = u8::try_from(limits.len()).unwrap_or(u8::MAX);
            let unknown = SequenceError::NoSuchChannel { window, channels };
            let limit = limits.get(usize::from(asked.channel)).ok_or(unknown)?;
            let half_guard = placed.half_guards.get_mut(usize::from(asked.channel)).ok_or(unknown)?;
            let guard = guard_ticks(limit);
            *half_guard = guard / 2;
            let most = widest_window_ticks_that_fit_16_bit_counter(guard);
            if !(LEAST_WIDTH_TICKS..=most).contains(&asked.width_ticks) {
                return Err(SequenceError::Width {
                    window,
                    requested_ticks: asked.width_ticks,
                    min_ticks: LEAST_WIDTH_TICKS,
                    max_ticks: most,
                });
            }
            if !(guard..=MOST_WAIT_TICKS).contains(&asked.wait_ticks) {
                return Err(SequenceError::Wait {
                    window,
                    requested_ticks: asked.wait_ticks,
                    min_ticks: guard,
                    max_ticks: MOST_WAIT_TICKS,
                });
            }
            // At most 24 x 1 s, which 32 bits hold.
            let before = placed.windows_of(asked.channel).next_back();
            let begin = before.map_or(0, |before| before.end) + asked.wait_ticks;
            let SequenceWindow { channel, electrode, width_ticks, .. } = *asked;
            // As long as the message, which holds no more.
            let _ = placed.windows.push(PlacedWindow { channel, electrode, begin, end: begin + width_ticks });
        }
        Ok(placed)
    }

    fn windows_of(&self, channel: u8) -> impl DoubleEndedIterator<Item = &PlacedWindow> {
        self.windows.iter().filter(move |window| window.channel == channel)
    }

    /// Moves the beginning of the sequence to a clock since the timers' start.
    pub const fn set_start_clock(&mut self, start: u64) {
        self.start = start;
    }

    /// For each channel whether it has windows.
    #[must_use]
    pub fn used_channels(&self) -> [bool; MAX_CHANNELS] {
        core::array::from_fn(|channel| self.windows.iter().any(|window| usize::from(window.channel) == channel))
    }

    /// Whether blank periods can still lead from a boundary to the beginning, wherever the boundary lies.
    #[must_use]
    pub const fn is_start_reachable_from_boundary(&self, boundary: u64) -> bool {
        boundary + LEAST_LEAD_CLOCKS <= self.start
    }

    /// First tick after the last window, from the beginning of the sequence.
    #[must_use]
    pub fn last_window_end_tick(&self) -> u32 {
        self.windows.iter().map(|window| window.end).max().unwrap_or(0)
    }

    /// Begin and end of each window of a channel, in us since the beginning of the sequence, rounded away from each other.
    pub fn window_begin_and_end_times_us(&self, channel: u8, clocks_per_us: u64) -> impl Iterator<Item = (u64, u64)> {
        let clocks = |tick: u32| u64::from(tick) * u64::from(SEQUENCE_TICK_CLOCKS);
        let rounded = move |window: &PlacedWindow| {
            (clocks(window.begin) / clocks_per_us.max(1), clocks(window.end).div_ceil(clocks_per_us.max(1)))
        };
        self.windows_of(channel).map(rounded)
    }

    /// The period that a channel's timer has to make from `boundary` on, in clocks since the timers' start; `None` once all of its windows
    /// are over. Before the beginning these are blank periods that lead to it exactly. The same boundary always gives the same period.
    #[must_use]
    pub fn period_from_boundary_unless_windows_over(&self, channel: u8, boundary: u64) -> Option<TimerPeriod> {
        let tick = u64::from(SEQUENCE_TICK_CLOCKS);
        let Some(since_start) = boundary.checked_sub(self.start) else {
            let lead = self.start - boundary;
            // Twice nine is one more than a tick: k periods of two clocks make up for what is left of whole ticks.
            let aligning = ALIGNING_CLOCKS + 2 * (lead % tick * 9 % tick);
            if !lead.is_multiple_of(tick) && lead >= aligning {
                return Some(TimerPeriod::without_windows(2, u32::try_from(aligning / 2).unwrap_or(u32::MAX)));
            }
            return Some(blank_period_for_wait_or_its_first_part(u32::try_from(lead / tick).unwrap_or(u32::MAX)));
        };
        let now = u32::try_from(since_start / tick).ok()?;
        let half_guard = self.half_guards.get(usize::from(channel)).copied()?;
        // A window whose beginning was missed is left out: half of one would be a runt.
        let mut rest = self.windows_of(channel).skip_while(|window| window.begin < now + half_guard);
        let (window, later) = (rest.next()?, rest.next());
        let wait = window.begin - now;
        let lead = wait.saturating_sub(half_guard);
        if lead >= LEAST_BLANK_TICKS {
            return Some(blank_period_for_wait_or_its_first_part(lead));
        }
        // To the middle of the pause after it, or half a guard after it where a blank period fits in between.
        let pause = later.map_or(2 * half_guard, |later| later.begin - window.end);
        let after = if pause - 2 * half_guard >= LEAST_BLANK_TICKS { half_guard } else { pause / 2 };
        let (on, off) = (wait, window.end - now);
        let place = CompareWindow { on: saturate_to_u16(on), off: saturate_to_u16(off) };
        let blank = TimerPeriod::without_windows(SEQUENCE_TICK_CLOCKS, off + after);
        Some(match window.electrode {
            Electrode::A => TimerPeriod { a: place, ..blank },
            Electrode::B => TimerPeriod { b: place, ..blank },
        })
    }
}

/// A blank period that ends where the next begins, in `ticks`, or one on the way there.
fn blank_period_for_wait_or_its_first_part(ticks: u32) -> TimerPeriod {
    let longest = TimerPeriod::MOST_TICKS;
    let length = if ticks <= longest { ticks.max(2) } else { longest.min(ticks - LEAST_BLANK_TICKS) };
    TimerPeriod::without_windows(SEQUENCE_TICK_CLOCKS, length)
}
