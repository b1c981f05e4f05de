//! For how long the board has driven without a rest: it ends what drives for longer than a burst.

use era_shared::limits::{BURST_MAX_MS, REST_MS};
use std::time::{Duration, Instant};

/// The board's longest burst, which the session asks for.
const LONGEST: Duration = Duration::from_millis(BURST_MAX_MS as u64);
/// A rest is made so long before that: half a second is enough to hear of it on a busy computer, and 5 % of a burst.
const AHEAD: Duration = Duration::from_millis(500);
/// What ends no later than this after the board's burst needs no rest before: a touch of just as long as that.
const JUST: Duration = Duration::from_millis(100);
/// A rest of the board, and 15 ms for the frames that begin and end it.
pub const REST: Duration = Duration::from_millis(REST_MS as u64 + 15);

/// One burst: drives without a rest between them. The board counts each channel by itself; here all count together, so that
/// a burst is never taken for shorter than it is.
#[derive(Clone, Copy, Debug)]
pub struct Burst {
    since: Instant,
    /// When its last drive ends, or has.
    until: Instant,
    /// How much later the board may end it.
    late: Duration,
}

impl Burst {
    /// A drive begins at `now` that is to end at `until`, with the period that it is in then; what there is of a burst then.
    #[must_use]
    pub fn continue_unless_rested_else_begin(
        previous: Option<Self>,
        now: Instant,
        until: Instant,
        lowest_drive_hz: f64,
    ) -> Self {
        let late = Duration::try_from_secs_f64(1.0 / lowest_drive_hz).unwrap_or_default();
        let goes_on = previous.filter(|burst| now < burst.find_end_of_rest());
        Self { since: goes_on.map_or(now, |burst| burst.since), until, late }
    }

    /// The last drive ends at `when`, if it does not before.
    pub fn end_no_later_than(&mut self, when: Instant) {
        self.until = self.until.min(when);
    }

    /// The last drive goes on until `until`.
    pub fn end_no_earlier_than(&mut self, until: Instant) {
        self.until = self.until.max(until);
    }

    /// When the board has rested, with nothing driven in between.
    #[must_use]
    pub fn find_end_of_rest(&self) -> Instant {
        self.until + self.late + REST
    }

    /// When it has to be interrupted by a rest, if what is driven is to go on until `drive_end`.
    #[must_use]
    pub fn start_of_rest_needed_if_driven_until(&self, drive_end: Instant) -> Option<Instant> {
        (drive_end > self.since + LONGEST + JUST).then(|| self.since + LONGEST - AHEAD)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const MS: Duration = Duration::from_millis(1);

    #[test]
    fn a_burst_lasts_until_a_rest() {
        let zero = Instant::now();
        let at = |ms: u32| zero + MS * ms;
        let touch = |before, ms| Burst::continue_unless_rested_else_begin(before, at(ms), at(ms + 1000), 50.0);
        let mut burst = touch(None, 0);
        assert_eq!(burst.start_of_rest_needed_if_driven_until(at(1000)), None);
        assert_eq!(burst.start_of_rest_needed_if_driven_until(at(10_000)), None, "a touch of 10 s is driven whole");
        assert_eq!(burst.start_of_rest_needed_if_driven_until(at(10_200)), Some(at(9500)));
        for ms in (0..9000).step_by(33) {
            burst = touch(Some(burst), ms);
            assert_eq!(burst.start_of_rest_needed_if_driven_until(at(ms + 20_000)), Some(at(9500)), "at {ms} ms");
        }
        burst.end_no_later_than(at(9500));
        // 100 ms are the board's rest; the last period may take 20 ms to end.
        assert!((at(9620)..at(9700)).contains(&burst.find_end_of_rest()));
        assert_eq!(touch(Some(burst), 9600).start_of_rest_needed_if_driven_until(at(30_000)), Some(at(9500)));
        assert_eq!(touch(Some(burst), 9700).start_of_rest_needed_if_driven_until(at(30_000)), Some(at(19_200)));
    }
}
