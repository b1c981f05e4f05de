//! What a fingertip feels: the threshold of vibration over frequency, and levels above it.
//!
//! The thresholds are those of the Android vibrator service (AOSP, `BasicToPwleSegmentAdapter.java`, Android 16, "minimum
//! perceptible acceleration", dB re 1 g of peak), which interpolates them linearly in Hz and dB; so does this module.
//!
//! Outside 10..400 Hz, where the table ends: below 10 Hz the threshold is held at that of 10 Hz (constant acceleration:
//! cautious, as the table still falls towards low frequencies, and no ERA drives a panel there), above 400 Hz the slope
//! between 300 and 400 Hz, 7 dB per 100 Hz, goes on.

use crate::STANDARD_GRAVITY;

/// Hz and dB re 1 g, ascending in frequency.
const TABLE: [(f64, f64); 12] = [
    (10.0, -48.90),
    (20.0, -40.36),
    (30.0, -34.31),
    (40.0, -32.81),
    (60.0, -31.77),
    (80.0, -31.77),
    (100.0, -31.90),
    (150.0, -31.35),
    (200.0, -30.86),
    (250.0, -28.98),
    (300.0, -26.81),
    (400.0, -19.81),
];

/// Frequency in Hz whose accelerations count in full where accelerations are weighed: that of most phones' and pads' actuators.
pub const REFERENCE_HZ: f64 = 150.0;

/// Threshold in dB re 1 g (peak) at `hz`.
fn felt_threshold_db_re_1_g(hz: f64) -> f64 {
    let hz = hz.max(TABLE[0].0);
    // The segment that holds `hz`, or the last one, which goes on.
    let upper = TABLE.iter().skip(1).take(TABLE.len() - 2).position(|(f, _)| hz <= *f).unwrap_or(TABLE.len() - 2);
    let ((f0, db0), (f1, db1)) = (TABLE[upper], TABLE[upper + 1]);
    db0 + (db1 - db0) * (hz - f0) / (f1 - f0)
}

/// Levels in dB above the threshold below which nothing moves but rounding: a thirty-millionth of what is just felt.
pub const LEAST_DB: f64 = -150.0;

/// Least peak acceleration that is felt at `hz`, in m/s^2.
#[must_use]
pub fn felt_threshold_m_per_s2(hz: f64) -> f64 {
    STANDARD_GRAVITY * amplitude_ratio_of_db(felt_threshold_db_re_1_g(hz))
}

/// How much an acceleration at `hz` counts where it counts as it is felt: 1 at [`REFERENCE_HZ`], less where the threshold is
/// higher.
#[must_use]
pub fn felt_weight_relative_to_reference_hz(hz: f64) -> f64 {
    felt_threshold_m_per_s2(REFERENCE_HZ) / felt_threshold_m_per_s2(hz)
}

/// Peak acceleration in m/s^2 that lies `db_above_threshold` above the threshold at `hz`.
#[must_use]
pub fn acceleration_at_level_above_threshold_m_per_s2(hz: f64, db_above_threshold: f64) -> f64 {
    amplitude_ratio_of_db(db_above_threshold) * felt_threshold_m_per_s2(hz)
}

/// Sum over `hz_and_peaks_m_per_s2`, (frequency in Hz, peak acceleration in m/s^2), of acceleration over threshold: 1 is just felt.
///
/// Adding amplitudes in units of their thresholds is what equation 23 does to accelerations: the peak of a sum of sines
/// of distinct frequencies. It is linear in the strength of a plan, and for one frequency it is that frequency's
/// sensation level.
#[must_use]
pub fn sum_peaks_each_divided_by_its_felt_threshold(hz_and_peaks_m_per_s2: &[(f64, f64)]) -> f64 {
    hz_and_peaks_m_per_s2.iter().map(|(hz, acceleration)| acceleration.abs() / felt_threshold_m_per_s2(*hz)).sum()
}

/// A strength in thresholds as a level in dB; `None` below [`LEAST_DB`], where nothing moves but rounding.
#[must_use]
pub fn threshold_multiple_to_db_unless_at_rest(thresholds: f64) -> Option<f64> {
    Some(20.0 * thresholds.log10()).filter(|db| *db >= LEAST_DB)
}

/// Level above the threshold in dB, as [`threshold_multiple_to_db_unless_at_rest`] of [`sum_peaks_each_divided_by_its_felt_threshold`]; negative below it, `None` where nothing moves.
#[must_use]
pub fn level_above_threshold_unless_at_rest_db(hz_and_peaks_m_per_s2: &[(f64, f64)]) -> Option<f64> {
    threshold_multiple_to_db_unless_at_rest(sum_peaks_each_divided_by_its_felt_threshold(hz_and_peaks_m_per_s2))
}

/// Factor for the strength of `hz_and_peaks_m_per_s2` that brings them to `db_above_threshold` above the threshold; `None` where nothing moves.
#[must_use]
pub fn scale_factor_to_level_unless_at_rest(
    hz_and_peaks_m_per_s2: &[(f64, f64)],
    db_above_threshold: f64,
) -> Option<f64> {
    let times = sum_peaks_each_divided_by_its_felt_threshold(hz_and_peaks_m_per_s2);
    (times > 0.0).then(|| amplitude_ratio_of_db(db_above_threshold) / times)
}

fn amplitude_ratio_of_db(db: f64) -> f64 {
    10_f64.powf(db / 20.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// m/s^2 of the table's rows, to the three places to which they are commonly given.
    #[test]
    fn rows_of_the_table() {
        let rows = [(10.0, 0.035), (40.0, 0.224), (100.0, 0.249), (150.0, 0.265), (250.0, 0.349), (400.0, 1.002)];
        for (hz, expected) in rows {
            assert!((felt_threshold_m_per_s2(hz) - expected).abs() < 6e-4, "{hz}: {}", felt_threshold_m_per_s2(hz));
        }
        for (hz, db) in TABLE {
            assert!((felt_threshold_db_re_1_g(hz) - db).abs() < 1e-12, "{hz}");
        }
    }

    #[test]
    fn between_rows_db_are_linear_in_hz() {
        assert!((felt_threshold_db_re_1_g(125.0) - f64::midpoint(-31.90, -31.35)).abs() < 1e-12);
        assert!((felt_threshold_db_re_1_g(15.0) - f64::midpoint(-48.90, -40.36)).abs() < 1e-12);
        assert!((felt_threshold_db_re_1_g(375.0) - (-26.81 + 0.75 * 7.0)).abs() < 1e-12);
    }

    #[test]
    fn outside_the_table() {
        assert_eq!(felt_threshold_m_per_s2(0.0), felt_threshold_m_per_s2(10.0));
        assert!((felt_threshold_db_re_1_g(600.0) - (-19.81 + 14.0)).abs() < 1e-12);
    }

    #[test]
    fn levels_and_accelerations_are_inverse() {
        for (hz, db) in [(12.0, 3.0), (160.0, 25.0), (333.0, -6.0)] {
            let acceleration = acceleration_at_level_above_threshold_m_per_s2(hz, db);
            assert!(
                (level_above_threshold_unless_at_rest_db(&[(hz, acceleration)]).unwrap_or(f64::NAN) - db).abs() < 1e-12
            );
        }
        assert_eq!(level_above_threshold_unless_at_rest_db(&[(160.0, 0.0)]), None);
        assert_eq!(scale_factor_to_level_unless_at_rest(&[], 20.0), None);
    }

    #[test]
    fn rounding_has_no_level() {
        assert_eq!(
            (
                threshold_multiple_to_db_unless_at_rest(0.0),
                threshold_multiple_to_db_unless_at_rest(1e-18),
                threshold_multiple_to_db_unless_at_rest(f64::NAN)
            ),
            (None, None, None)
        );
        assert_eq!(
            (
                threshold_multiple_to_db_unless_at_rest(1e-7),
                threshold_multiple_to_db_unless_at_rest(1.0),
                threshold_multiple_to_db_unless_at_rest(100.0)
            ),
            (Some(-140.0), Some(0.0), Some(40.0))
        );
    }

    #[test]
    fn components_add_in_units_of_their_thresholds() {
        let components = [(100.0, 3.0 * felt_threshold_m_per_s2(100.0)), (300.0, 7.0 * felt_threshold_m_per_s2(300.0))];
        assert!((level_above_threshold_unless_at_rest_db(&components).unwrap_or(f64::NAN) - 20.0).abs() < 1e-12);
        assert!((scale_factor_to_level_unless_at_rest(&components, 40.0).unwrap_or(f64::NAN) - 10.0).abs() < 1e-12);
    }
}
