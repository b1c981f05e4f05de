//! Times and their quantiles.

use std::time::Duration;

/// Times that were measured, in ms; infinite for what never came.
#[derive(Clone, Debug, Default)]
pub struct Times(Vec<f64>);

impl Times {
    /// Adds one.
    pub fn add_time(&mut self, time: Duration) {
        self.0.push(time.as_secs_f64() * 1e3);
    }

    /// Adds one of something that never came.
    pub fn add_missing(&mut self) {
        self.0.push(f64::INFINITY);
    }

    /// Adds those of another.
    pub fn merge(&mut self, other: Self) {
        self.0.extend(other.0);
    }

    /// How many there are.
    #[must_use]
    pub const fn len(&self) -> usize {
        self.0.len()
    }

    /// How many are longer than so many ms.
    #[must_use]
    pub fn count_missing_or_longer_than(&self, limit_ms: f64) -> usize {
        self.0.iter().filter(|time| **time > limit_ms).count()
    }

    /// The longest in ms; infinite if one is missing.
    #[must_use]
    pub fn longest_counting_missing_as_infinite_ms(&self) -> Option<f64> {
        self.0.iter().copied().max_by(f64::total_cmp)
    }

    /// The time in ms that so many percent are no longer than; of few, the longest. One that is missing counts as infinite.
    #[must_use]
    pub fn percentile_counting_missing_as_infinite_ms(&self, percent: usize) -> Option<f64> {
        let mut sorted = self.0.clone();
        sorted.sort_by(f64::total_cmp);
        sorted.get(sorted.len() * percent / 100).or(sorted.last()).copied()
    }

    /// Median, p99 and the longest in ms, for people.
    #[must_use]
    pub fn describe_median_p99_and_longest(&self) -> String {
        let all = [
            self.percentile_counting_missing_as_infinite_ms(50),
            self.percentile_counting_missing_as_infinite_ms(99),
            self.longest_counting_missing_as_infinite_ms(),
        ];
        let [Some(median), Some(p99), Some(longest)] = all else { return "-".into() };
        format!(
            "{} / {} / {} ms",
            format_ms_number_or_never(median),
            format_ms_number_or_never(p99),
            format_ms_number_or_never(longest)
        )
    }
}

/// A time in ms, for people.
#[must_use]
pub fn format_ms_number_or_never(ms: f64) -> String {
    if ms.is_finite() { format!("{ms:.2}") } else { "never".into() }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quantiles_are_of_the_sorted_times() {
        let mut times = Times::default();
        assert_eq!(times.describe_median_p99_and_longest(), "-");
        for ms in (0..200).rev() {
            times.add_time(Duration::from_millis(ms));
        }
        assert_eq!(times.describe_median_p99_and_longest(), "100.00 / 198.00 / 199.00 ms");
        assert_eq!(
            (times.count_missing_or_longer_than(197.5), times.longest_counting_missing_as_infinite_ms()),
            (2, Some(199.0))
        );
    }

    /// Two of a hundred that never came are more than one percent.
    #[test]
    fn what_never_came_is_later_than_anything() {
        let mut times = Times::default();
        times.add_missing();
        times.add_missing();
        for _ in 0..98 {
            times.add_time(Duration::from_millis(1));
        }
        assert_eq!(times.describe_median_p99_and_longest(), "1.00 / never / never ms");
    }
}
