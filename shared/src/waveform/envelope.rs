//! How strong a drive is in time: envelopes that the board plays by its own clock, so that a host's jitter does not reach
//! the skin.

use super::sine::{ONE, quarter_sine};
use heapless::Vec;
use serde::{Deserialize, Serialize};

/// Level of the full force, in thousandths.
pub const FULL_LEVEL: i16 = 1000;
/// The whole of what [`super::Sequencer::set_strength`] takes.
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

/// Segments that follow each other, played one or more times.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Effect {
    /// In order.
    pub segments: Vec<Segment, SEGMENTS>,
    /// How often, 1 to 1000.
    pub times: u16,
}

impl Effect {
    /// `cycles` at full force and `brake` reversed.
    #[must_use]
    pub fn click(cycles: u16, brake: u16) -> Self {
        let push = Segment::Cycles { level: FULL_LEVEL, count: cycles };
        let stop = Segment::Cycles { level: -FULL_LEVEL, count: brake };
        Self::of(&[push, stop], 1)
    }

    /// From nothing to full force within `rise` ms, held for `hold` ms, and back within `fall` ms.
    #[must_use]
    pub fn swell(rise: u16, hold: u16, fall: u16) -> Self {
        let segments = [
            Segment::Ramp { from: 0, to: FULL_LEVEL, milliseconds: rise },
            Segment::Hold { level: FULL_LEVEL, milliseconds: hold },
            Segment::Ramp { from: FULL_LEVEL, to: 0, milliseconds: fall },
        ];
        Self::of(&segments, 1)
    }

    /// `count` pulses of `on` ms with pauses of `off` ms.
    #[must_use]
    pub fn pulse_train(on: u16, off: u16, count: u16) -> Self {
        let segments =
            [Segment::Hold { level: FULL_LEVEL, milliseconds: on }, Segment::Hold { level: 0, milliseconds: off }];
        Self::of(&segments, count)
    }

    fn of(segments: &[Segment], times: u16) -> Self {
        Self { segments: segments.iter().copied().collect(), times }
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
pub(super) enum Playing {
    /// Not begun.
    Waiting,
    /// This level, in thousandths.
    Level(i16),
    /// Over.
    Ended,
}

impl Envelope {
    /// The level of the period of `period` clocks that begins at `boundary`; `clocks_per_ms` is the timers' clock. The first
    /// boundary at or after the start that this is asked for is the beginning: one that could not be used any more costs no
    /// cycle.
    pub(super) fn at(&mut self, boundary: u64, period: u64, clocks_per_ms: u64) -> Playing {
        if !self.begun {
            if boundary < self.start {
                return Playing::Waiting;
            }
            (self.start, self.begun) = (boundary, true);
        }
        let mut rest = boundary.saturating_sub(self.start);
        let length = |segment: &Segment| match *segment {
            Segment::Hold { milliseconds, .. } | Segment::Ramp { milliseconds, .. } => {
                u64::from(milliseconds) * clocks_per_ms
            }
            Segment::Cycles { count, .. } => u64::from(count) * period,
        };
        let once: u64 = self.effect.segments.iter().map(length).sum();
        if once == 0 || rest >= once * u64::from(self.effect.times) {
            return Playing::Ended;
        }
        rest %= once;
        for segment in &self.effect.segments {
            let length = length(segment);
            if rest < length {
                return Playing::Level(match *segment {
                    Segment::Hold { level, .. } | Segment::Cycles { level, .. } => level,
                    // The middle of the period stands for all of it.
                    Segment::Ramp { from, to, .. } => between(from, to, (rest + period / 2).min(length), length),
                });
            }
            rest -= length;
        }
        Playing::Ended
    }
}

fn between(from: i16, to: i16, part: u64, whole: u64) -> i16 {
    let (part, whole) = (i64::try_from(part).unwrap_or(i64::MAX), i64::try_from(whole.max(1)).unwrap_or(i64::MAX));
    let change = (i64::from(to) - i64::from(from)).saturating_mul(part) / whole;
    i16::try_from(i64::from(from) + change).unwrap_or(to)
}

/// Ticks of a window that makes `level` thousandths of the force of one of `width` ticks, times `strength` parts of
/// [`FULL_STRENGTH`]: the fundamental of the force goes with sin(pi w / 2), w the part of a half period that the window takes.
///
/// The widest that makes no more than that is searched for, in integers: the same on every processor, and within 10 us on the
/// board's.
#[must_use]
pub(super) fn width_for(ticks: u32, width: u32, level: i16, strength: u32) -> u32 {
    let level = u64::from(level.unsigned_abs().min(FULL_LEVEL.unsigned_abs()));
    let part = level * u64::from(strength.min(FULL_STRENGTH));
    let full = u64::from(FULL_LEVEL.unsigned_abs()) * u64::from(FULL_STRENGTH);
    if part >= full {
        return width;
    }
    // Twice 1/ticks, with 46 bits behind the point.
    let step = (1 << 47) / u64::from(ticks.max(2));
    let force = |width: u32| quarter_sine(u32::try_from((u64::from(width) * step) >> 16).unwrap_or(ONE));
    let wanted = u64::from(force(width)) * part / full;
    let (mut narrower, mut wider) = (0, width);
    while narrower + 1 < wider {
        let middle = u32::midpoint(narrower, wider);
        *(if u64::from(force(middle)) <= wanted { &mut narrower } else { &mut wider }) = middle;
    }
    narrower
}
