//! How long the last requests took.

use std::collections::VecDeque;
use std::time::Duration;

/// Most round trips that are kept.
const KEPT: usize = 64;

/// The last round trips, in their order.
#[derive(Clone, Debug, Default)]
pub struct RoundTripHistory(VecDeque<Duration>);

/// Statistics of the last round trips.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct RoundTripSummary {
    /// Their median.
    pub median: Option<Duration>,
    /// The longest.
    pub worst: Option<Duration>,
    /// Mean difference between one and the next: 0 where each takes as long as any other.
    pub jitter: Option<Duration>,
}

impl RoundTripHistory {
    /// Adds a round trip.
    pub fn add_round_trip(&mut self, time: Duration) {
        if self.0.len() == KEPT {
            self.0.pop_front();
        }
        self.0.push_back(time);
    }

    /// The newest round trip.
    #[must_use]
    pub fn newest_round_trip(&self) -> Option<Duration> {
        self.0.back().copied()
    }

    /// Statistics of the round trips that are kept.
    #[must_use]
    pub fn compute_median_worst_and_jitter(&self) -> RoundTripSummary {
        let mut sorted: Vec<Duration> = self.0.iter().copied().collect();
        sorted.sort_unstable();
        let steps = self.0.iter().zip(self.0.iter().skip(1)).map(|(one, next)| one.abs_diff(*next));
        let count = u32::try_from(self.0.len()).unwrap_or(u32::MAX).saturating_sub(1);
        RoundTripSummary {
            median: sorted.get(sorted.len() / 2).copied(),
            worst: sorted.last().copied(),
            jitter: steps.sum::<Duration>().checked_div(count),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn jitter_is_the_mean_step_from_one_round_trip_to_the_next() {
        let of = |ms: &[u64]| {
            RoundTripHistory(ms.iter().copied().map(Duration::from_millis).collect()).compute_median_worst_and_jitter()
        };
        let ms = |ms| Some(Duration::from_millis(ms));
        assert_eq!(of(&[]), RoundTripSummary::default());
        assert_eq!(of(&[4]), RoundTripSummary { median: ms(4), worst: ms(4), jitter: None });
        assert_eq!(of(&[7, 7, 7]), RoundTripSummary { median: ms(7), worst: ms(7), jitter: ms(0) });
        // Steps of 8, 4 and 12, whichever way they go.
        assert_eq!(of(&[2, 10, 6, 18]), RoundTripSummary { median: ms(10), worst: ms(18), jitter: ms(8) });
    }

    #[test]
    fn the_last_64_are_reported() {
        let mut last = RoundTripHistory::default();
        last.add_round_trip(Duration::from_secs(9));
        (0..64).for_each(|_| last.add_round_trip(Duration::from_millis(2)));
        assert_eq!(
            (last.compute_median_worst_and_jitter().worst, last.newest_round_trip()),
            (Some(Duration::from_millis(2)), Some(Duration::from_millis(2)))
        );
    }
}
