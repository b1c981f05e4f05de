//! How long the last requests took.

use std::collections::VecDeque;
use std::time::Duration;

/// Round trips that are told of.
const KEPT: usize = 64;

/// The last of them, in their order.
#[derive(Clone, Debug, Default)]
pub struct Last(VecDeque<Duration>);

/// What there is to say of them.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct RoundTrips {
    /// Their median.
    pub median: Option<Duration>,
    /// The longest.
    pub worst: Option<Duration>,
    /// Mean difference between one and the next: 0 where each takes as long as any other.
    pub jitter: Option<Duration>,
}

impl Last {
    /// Takes another one.
    pub fn note(&mut self, time: Duration) {
        if self.0.len() == KEPT {
            self.0.pop_front();
        }
        self.0.push_back(time);
    }

    /// The newest.
    #[must_use]
    pub fn newest(&self) -> Option<Duration> {
        self.0.back().copied()
    }

    /// What there is to say of them.
    #[must_use]
    pub fn told(&self) -> RoundTrips {
        let mut sorted: Vec<Duration> = self.0.iter().copied().collect();
        sorted.sort_unstable();
        let steps = self.0.iter().zip(self.0.iter().skip(1)).map(|(one, next)| one.abs_diff(*next));
        let count = u32::try_from(self.0.len()).unwrap_or(u32::MAX).saturating_sub(1);
        RoundTrips {
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
        let of = |ms: &[u64]| Last(ms.iter().copied().map(Duration::from_millis).collect()).told();
        let ms = |ms| Some(Duration::from_millis(ms));
        assert_eq!(of(&[]), RoundTrips::default());
        assert_eq!(of(&[4]), RoundTrips { median: ms(4), worst: ms(4), jitter: None });
        assert_eq!(of(&[7, 7, 7]), RoundTrips { median: ms(7), worst: ms(7), jitter: ms(0) });
        // Steps of 8, 4 and 12, whichever way they go.
        assert_eq!(of(&[2, 10, 6, 18]), RoundTrips { median: ms(10), worst: ms(18), jitter: ms(8) });
    }

    #[test]
    fn the_last_64_are_told_of() {
        let mut last = Last::default();
        last.note(Duration::from_secs(9));
        (0..64).for_each(|_| last.note(Duration::from_millis(2)));
        assert_eq!(
            (last.told().worst, last.newest()),
            (Some(Duration::from_millis(2)), Some(Duration::from_millis(2)))
        );
    }
}
