//! Times and their quantiles.

use std::time::Duration;

/// Times that were measured, in ms.
#[derive(Clone, Debug, Default)]
pub struct Times(Vec<f64>);

impl Times {
    /// Adds one.
    pub fn add(&mut self, time: Duration) {
        self.0.push(time.as_secs_f64() * 1e3);
    }

    /// Adds those of another.
    pub fn join(&mut self, other: Self) {
        self.0.extend(other.0);
    }

    /// How many there are.
    #[must_use]
    pub const fn len(&self) -> usize {
        self.0.len()
    }

    /// Median, p99 and the longest in ms, for people.
    #[must_use]
    pub fn told(&self) -> String {
        let mut sorted = self.0.clone();
        sorted.sort_by(f64::total_cmp);
        let Some(longest) = sorted.last() else { return "-".into() };
        let at = |percent: usize| sorted.get(sorted.len() * percent / 100).copied().unwrap_or(*longest);
        format!("{:.2} / {:.2} / {longest:.2} ms", at(50), at(99))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quantiles_are_of_the_sorted_times() {
        let mut times = Times::default();
        assert_eq!(times.told(), "-");
        for ms in (0..200).rev() {
            times.add(Duration::from_millis(ms));
        }
        assert_eq!(times.told(), "100.00 / 198.00 / 199.00 ms");
    }
}
