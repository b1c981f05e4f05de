//! How strong a drive is in time: envelopes that the board plays by its own clock, so that a host's jitter does not reach
//! the skin.

use super::sine::{ONE, quarter_sine_q30};
use heapless::Vec;
use serde::{Deserialize, Serialize};

/// Level of the full force, in thousandths.
pub const FULL_LEVEL: i16 = 1000;
/// The whole of what [`super::Sequencer::set_force_fraction_q16_of_drive_windows`] takes.
pub const FULL_STRENGTH: u32 = 1 << 16;
/// Most segments of an effect: two clicks with their brakes and pauses, and the whole still fits a frame.
pub const SEGMENTS: usize = 8;
/// Most times that an effect is played.
const MOST_REPEATS: u16 = 1_000;

/// A stretch of an effect. Levels are in thousandths of the drive's force, -1000 to 1000; a negative one turns the force
/// round, which brakes what the positive one set going. They change at the boundaries of the drive's periods.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Segment {
    /// One level for a time.
    Hold {
        /// In thousandths.
        level: i16,
        /// How long.
        milliseconds: u16,
    },
    /// From one level to another, evenly.
    Ramp {
        /// At the beginning, in thousandths.
        from: i16,
        /// At the end.
        to: i16,
        /// How long.
        milliseconds: u16,
    },
    /// One level for whole cycles of the drive.
    Cycles {
        /// In thousandths.
        level: i16,
        /// How many.
        count: u16,
    },
}

impl Segment {
    fn length_clocks(&self, period_clocks: u64, clocks_per_ms: u64) -> u64 {
        match *self {
            Self::Hold { milliseconds, .. } | Self::Ramp { milliseconds, .. } => {
                u64::from(milliseconds) * clocks_per_ms
            }
            Self::Cycles { count, .. } => u64::from(count) * period_clocks,
        }
    }
}

/// Segments that follow each other, played one or more times.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Effect {
    /// In order.
    pub segments: Vec<Segment, SEGMENTS>,
    /// How often, 1 to 1000.
    pub times: u16,
}

impl Effect {
    /// `drive_cycles` at full force, then `brake_cycles` with the force reversed.
    #[must_use]
    pub fn new_click(drive_cycles: u16, brake_cycles: u16) -> Self {
        let push = Segment::Cycles { level: FULL_LEVEL, count: drive_cycles };
        let brake = Segment::Cycles { level: -FULL_LEVEL, count: brake_cycles };
        Self::from_segments(&[push, brake], 1)
    }

    /// From no force to full force within `rise_ms`, held for `hold_ms`, and back to no force within `fall_ms`.
    #[must_use]
    pub fn new_swell(rise_ms: u16, hold_ms: u16, fall_ms: u16) -> Self {
        let segments = [
            Segment::Ramp { from: 0, to: FULL_LEVEL, milliseconds: rise_ms },
            Segment::Hold { level: FULL_LEVEL, milliseconds: hold_ms },
            Segment::Ramp { from: FULL_LEVEL, to: 0, milliseconds: fall_ms },
        ];
        Self::from_segments(&segments, 1)
    }

    /// `count` pulses of `on_ms`, with pauses of `off_ms` after each.
    #[must_use]
    pub fn new_pulse_train(on_ms: u16, off_ms: u16, count: u16) -> Self {
        let segments = [
            Segment::Hold { level: FULL_LEVEL, milliseconds: on_ms },
            Segment::Hold { level: 0, milliseconds: off_ms },
        ];
        Self::from_segments(&segments, count)
    }

    fn from_segments(segments: &[Segment], repeat_count: u16) -> Self {
        Self { segments: segments.iter().copied().collect(), times: repeat_count }
    }

    /// Whether levels, lengths and count are in range.
    #[must_use]
    pub fn is_valid(&self) -> bool {
        let level = |level: i16| (-FULL_LEVEL..=FULL_LEVEL).contains(&level);
        let segment = |segment: &Segment| match *segment {
            Segment::Hold { level: at, .. } | Segment::Cycles { level: at, .. } => level(at),
            Segment::Ramp { from, to, .. } => level(from) && level(to),
        };
        !self.segments.is_empty() && (1..=MOST_REPEATS).contains(&self.times) && self.segments.iter().all(segment)
    }
}

/// An effect with its start, in clocks since the timers started.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Envelope {
    /// What is played.
    pub effect: Effect,
    /// From when on. Once it has begun: the boundary at which it did.
    pub start: u64,
    /// Whether it has begun.
    pub begun: bool,
}

/// What an envelope says about a period.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum EnvelopeLevel {
    /// Not begun.
    Waiting,
    /// This level, in thousandths.
    Level(i16),
    /// Over.
    Ended,
}

impl Envelope {
    /// How long it lasts, in clocks.
    pub(super) fn length_clocks(&self, period_clocks: u64, clocks_per_ms: u64) -> u64 {
        let lengths = self.effect.segments.iter().map(|segment| segment.length_clocks(period_clocks, clocks_per_ms));
        lengths.sum::<u64>() * u64::from(self.effect.times)
    }

    /// The level for the period of `period_clocks` that begins at `boundary_clock`; `clocks_per_ms` is the timers' clock. The envelope begins at the
    /// first boundary at or after its start for which this is called, so that a boundary that came too late to be used costs no cycle.
    pub(super) fn begin_if_due_and_get_level(
        &mut self,
        boundary_clock: u64,
        period_clocks: u64,
        clocks_per_ms: u64,
    ) -> EnvelopeLevel {
        if !self.begun {
            if boundary_clock < self.start {
                return EnvelopeLevel::Waiting;
            }
            (self.start, self.begun) = (boundary_clock, true);
        }
        let mut rest = boundary_clock.saturating_sub(self.start);
        let length = |segment: &Segment| segment.length_clocks(period_clocks, clocks_per_ms);
        let once: u64 = self.effect.segments.iter().map(length).sum();
        if once == 0 || rest >= once * u64::from(self.effect.times) {
            return EnvelopeLevel::Ended;
        }
        rest %= once;
        for segment in &self.effect.segments {
            let length = length(segment);
            if rest < length {
                return EnvelopeLevel::Level(match *segment {
                    Segment::Hold { level, .. } | Segment::Cycles { level, .. } => level,
                    // The middle of the period stands for all of it.
                    Segment::Ramp { from, to, .. } => {
                        interpolate_level(from, to, (rest + period_clocks / 2).min(length), length)
                    }
                });
            }
            rest -= length;
        }
        EnvelopeLevel::Ended
    }
}

fn interpolate_level(from: i16, to: i16, elapsed: u64, duration: u64) -> i16 {
    let (part, whole) =
        (i64::try_from(elapsed).unwrap_or(i64::MAX), i64::try_from(duration.max(1)).unwrap_or(i64::MAX));
    let change = (i64::from(to) - i64::from(from)).saturating_mul(part) / whole;
    i16::try_from(i64::from(from) + change).unwrap_or(to)
}

/// Ticks of the window whose force is that of a window of `full_width` ticks times `level_permille` thousandths times `force_fraction_q16` parts of
/// [`FULL_STRENGTH`]. The fundamental of the force goes with sin(pi w / 2), where w is the fraction of the half period that the window takes.
///
/// The widest window that makes no more force is searched for in integers: with the same result on every processor, and within 10 us on
/// the board's.
#[must_use]
pub(super) fn window_ticks_for_level(
    period_ticks: u32,
    full_width: u32,
    level_permille: i16,
    force_fraction_q16: u32,
) -> u32 {
    let level_permille = u64::from(level_permille.unsigned_abs().min(FULL_LEVEL.unsigned_abs()));
    let part = level_permille * u64::from(force_fraction_q16.min(FULL_STRENGTH));
    let full = u64::from(FULL_LEVEL.unsigned_abs()) * u64::from(FULL_STRENGTH);
    if part >= full {
        return full_width;
    }
    // Twice 1/ticks, with 46 bits behind the point.
    let step = (1 << 47) / u64::from(period_ticks.max(2));
    let force = |width: u32| quarter_sine_q30(u32::try_from((u64::from(width) * step) >> 16).unwrap_or(ONE));
    let wanted = u64::from(force(full_width)) * part / full;
    let (mut narrower, mut wider) = (0, full_width);
    while narrower + 1 < wider {
        let middle = u32::midpoint(narrower, wider);
        *(if u64::from(force(middle)) <= wanted { &mut narrower } else { &mut wider }) = middle;
    }
    narrower
}
