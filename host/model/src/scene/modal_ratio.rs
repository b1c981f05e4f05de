//! Damping ratios of modes, which may depend on their frequencies.

use serde::Serialize;

/// Most points of a table.
pub const MOST_POINTS: usize = 10;

/// A viscous damping ratio for each mode by its frequency: straight between points, constant beyond the first and the last.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct ModalRatio {
    /// Frequencies in Hz, ascending, with the ratios there. Those from `count` on are of no account.
    points: [(f64, f64); MOST_POINTS],
    count: usize,
}

impl ModalRatio {
    /// The same ratio for all modes.
    #[must_use]
    pub const fn from_single_ratio(ratio: f64) -> Self {
        Self { points: [(0.0, ratio); MOST_POINTS], count: 1 }
    }

    /// A table of frequencies in Hz and ratios; `None` unless there are 1 to 10 of them, frequencies ascending.
    #[must_use]
    pub fn from_table_if_ascending_with_1_to_10_pairs(frequencies_and_ratios: &[(f64, f64)]) -> Option<Self> {
        let last = *frequencies_and_ratios.last()?;
        if frequencies_and_ratios.len() > MOST_POINTS
            || !frequencies_and_ratios.windows(2).all(|pair| pair[0].0 < pair[1].0)
        {
            return None;
        }
        let mut points = [last; MOST_POINTS];
        points[..frequencies_and_ratios.len()].copy_from_slice(frequencies_and_ratios);
        Some(Self { points, count: frequencies_and_ratios.len() })
    }

    /// Whether all modes have the same ratio.
    #[must_use]
    pub fn is_same_for_all_modes(&self) -> bool {
        self.points.iter().all(|(_, ratio)| ratio.total_cmp(&self.points[0].1).is_eq())
    }

    /// The ratio of a mode of this frequency in Hz.
    #[must_use]
    pub fn damping_ratio_at_frequency(&self, frequency_hz: f64) -> f64 {
        let points = &self.points[..self.count];
        let after = points.partition_point(|(hz, _)| *hz <= frequency_hz);
        match (after.checked_sub(1).and_then(|before| points.get(before)), points.get(after)) {
            (Some((from_hz, from)), Some((to_hz, to))) => {
                from + (to - from) * (frequency_hz - from_hz) / (to_hz - from_hz)
            }
            (Some((_, end)), None) | (None, Some((_, end))) => *end,
            (None, None) => 0.0,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ratios_are_straight_between_points_and_constant_beyond() {
        let table =
            ModalRatio::from_table_if_ascending_with_1_to_10_pairs(&[(50.0, 0.02), (150.0, 0.01), (400.0, 0.04)])
                .unwrap();
        for (hz, ratio) in [(0.0, 0.02), (50.0, 0.02), (75.0, 0.0175), (150.0, 0.01), (275.0, 0.025), (1e9, 0.04)] {
            assert!(
                (table.damping_ratio_at_frequency(hz) - ratio).abs() < 1e-15,
                "{hz}: {}",
                table.damping_ratio_at_frequency(hz)
            );
        }
        assert!(!table.is_same_for_all_modes() && ModalRatio::from_single_ratio(0.3).is_same_for_all_modes());
        assert_eq!(ModalRatio::from_single_ratio(0.3).damping_ratio_at_frequency(123.0), 0.3);
        assert_eq!(
            [
                ModalRatio::from_table_if_ascending_with_1_to_10_pairs(&[]),
                ModalRatio::from_table_if_ascending_with_1_to_10_pairs(&[(2.0, 0.1), (2.0, 0.2)])
            ],
            [None, None]
        );
        assert_eq!(ModalRatio::from_table_if_ascending_with_1_to_10_pairs(&[(1.0, 0.1); MOST_POINTS + 1]), None);
    }
}
