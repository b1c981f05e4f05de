//! Log lines about what may happen a thousand times a second: one line a second, with the count.

/// Between two lines, in us.
const INTERVAL_US: u64 = 1_000_000;

/// Decides when a count is worth a line in the log.
#[derive(Clone, Copy, Debug, Default)]
pub struct CountReport {
    reported: u32,
    next_us: u64,
}

impl CountReport {
    /// Nothing has been counted.
    #[must_use]
    pub const fn new() -> Self {
        Self { reported: 0, next_us: 0 }
    }

    /// How many events have been added to `total` since the last report, if there are any and that was at least a second ago. `total` may wrap
    /// around.
    pub const fn take_increase_if_due(&mut self, total: u32, now_us: u64) -> Option<u32> {
        if total == self.reported || now_us < self.next_us {
            return None;
        }
        let increase = total.wrapping_sub(self.reported);
        *self = Self { reported: total, next_us: now_us + INTERVAL_US };
        Some(increase)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_flood_is_one_line_a_second() {
        let mut report = CountReport::new();
        let mut lines = Vec::new();
        // 2000 events a second for three seconds, looked at every ms.
        for ms in 0..3_000_u64 {
            let total = u32::try_from(2 * ms).expect("small");
            lines.extend(report.take_increase_if_due(total, ms * 1_000).map(|count| (ms, count)));
        }
        assert_eq!(lines, [(1, 2), (1_001, 2_000), (2_001, 2_000)]);
        assert_eq!(report.take_increase_if_due(4_002, 2_500_000), None, "not yet");
        assert_eq!(report.take_increase_if_due(5_998, 9_000_000), Some(1_996), "the rest is not lost");
        assert_eq!(report.take_increase_if_due(5_998, 99_000_000), None, "nothing new");
    }

    #[test]
    fn a_count_may_wrap_around() {
        let mut report = CountReport::new();
        assert_eq!(report.take_increase_if_due(u32::MAX, 0), Some(u32::MAX));
        assert_eq!(report.take_increase_if_due(4, 1_000_000), Some(5));
    }
}
