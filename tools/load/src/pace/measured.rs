//! What one load came to.

use super::frames::find_last_frame_arrivals_unless_ambiguous;
use super::touches::{Touch, TouchEnd};
use crate::times::Times;
use era::device::sim::DriveFrame;
use std::collections::BTreeMap;

/// What one load came to. All times run from when a touch was due.
#[derive(Debug, Default)]
pub struct TouchStatistics {
    /// To the answer, of touches that were driven.
    pub answer: Times,
    /// To the last byte of the frame that drives the touch; never for one that was refused or whose frame did not come.
    pub frame: Times,
    /// Until it was told that a newer touch stands in its place.
    pub overtaken: Times,
    /// Touches that were sent.
    pub sent: usize,
    /// Those that were refused, by why.
    pub refused: BTreeMap<String, usize>,
    /// Those that were answered as driven, and of which no frame was on the line.
    pub unseen: usize,
    /// Those that were driven, counted from 1, with the time to their frame in ms; the longest first.
    pub latest: Vec<(usize, f64)>,
}

impl TouchStatistics {
    /// Of these touches, with the frames that were on the board's line meanwhile.
    ///
    /// # Errors
    /// As [`find_last_frame_arrivals_unless_ambiguous`].
    pub fn from_touches(touches: &[Touch], frames: &[DriveFrame]) -> Result<Self, String> {
        let mut all = Self { sent: touches.len(), ..Self::default() };
        for (number, (touch, arrived)) in
            touches.iter().zip(find_last_frame_arrivals_unless_ambiguous(touches, frames)?).enumerate()
        {
            let ended = touch.ended.saturating_duration_since(touch.due);
            match &touch.end {
                TouchEnd::Overtaken => all.overtaken.add_time(ended),
                TouchEnd::Refused(why) => {
                    all.frame.add_missing();
                    *all.refused.entry(why.clone()).or_default() += 1;
                }
                TouchEnd::Driven(_) => {
                    all.answer.add_time(ended);
                    match arrived {
                        Some(at) => {
                            let took = at.saturating_duration_since(touch.due);
                            all.frame.add_time(took);
                            all.latest.push((number + 1, took.as_secs_f64() * 1e3));
                        }
                        None => {
                            all.frame.add_missing();
                            all.unseen += 1;
                        }
                    }
                }
            }
        }
        all.latest.sort_by(|a, b| b.1.total_cmp(&a.1));
        Ok(all)
    }

    /// Which touches took more than so many ms to their frame, in words: up to three, and nothing if there was none.
    #[must_use]
    pub fn list_slowest_touches_over_limit(&self, limit_ms: f64) -> Option<String> {
        let late: Vec<String> = (self.latest.iter().take(3).filter(|(_, took)| *took > limit_ms))
            .map(|(number, took)| format!("touch {number} {took:.2} ms"))
            .collect();
        (!late.is_empty()).then(|| format!("longest: {}", late.join(", ")))
    }

    /// Touches that were driven: the others were overtaken or refused.
    #[must_use]
    pub const fn count_driven(&self) -> usize {
        self.answer.len()
    }

    /// What was refused and what was not seen, in words; nothing if there was none.
    #[must_use]
    pub fn describe_counts_of_refused_touches_and_those_without_frame(&self) -> Vec<String> {
        let mut all: Vec<String> = self.refused.iter().map(|(why, count)| format!("{count} refused: {why}")).collect();
        all.extend(
            (self.unseen > 0).then(|| format!("{} answered as driven without a frame on the line", self.unseen)),
        );
        all
    }
}

/// From when each touch was due to its end, whatever that was.
#[must_use]
pub fn collect_due_to_end_times_refused_as_missing(touches: &[Touch]) -> Times {
    let mut times = Times::default();
    for touch in touches {
        match touch.end {
            TouchEnd::Refused(_) => times.add_missing(),
            _ => times.add_time(touch.ended.saturating_duration_since(touch.due)),
        }
    }
    times
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::time::{Duration, Instant};

    /// A refused touch, and one whose frame never came, are late and not left out; one that was overtaken is neither.
    #[test]
    fn what_did_not_reach_the_board_counts_as_never() {
        let due = Instant::now();
        let ended = due + Duration::from_millis(7);
        let of = |end| Touch { due, ended, end };
        let touches =
            [of(TouchEnd::Driven(Vec::new())), of(TouchEnd::Overtaken), of(TouchEnd::Refused("queue-full".into()))];
        let measured = TouchStatistics::from_touches(&touches, &[]).unwrap();
        assert_eq!((measured.sent, measured.count_driven(), measured.unseen), (3, 1, 1));
        assert_eq!(
            (measured.frame.len(), measured.frame.percentile_counting_missing_as_infinite_ms(0)),
            (2, Some(f64::INFINITY))
        );
        assert_eq!(measured.overtaken.longest_counting_missing_as_infinite_ms(), Some(7.0));
        assert_eq!(measured.describe_counts_of_refused_touches_and_those_without_frame().len(), 2);
    }

    /// A touch that was sent late, as all connections were busy, has waited since it was due.
    #[test]
    fn times_run_from_when_a_touch_was_due() {
        let due = Instant::now();
        let at = due + Duration::from_millis(40);
        let touch = Touch { due, ended: due + Duration::from_millis(41), end: TouchEnd::Driven(Vec::new()) };
        let frame = DriveFrame { at, drives: Vec::new(), window_count: 0, windows_begin_after: None };
        let measured = TouchStatistics::from_touches(&[touch], &[frame]).unwrap();
        assert_eq!(
            (
                measured.frame.longest_counting_missing_as_infinite_ms(),
                measured.answer.longest_counting_missing_as_infinite_ms()
            ),
            (Some(40.0), Some(41.0))
        );
    }
}
