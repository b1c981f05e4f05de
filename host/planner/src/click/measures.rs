//! The figures of a click.
//!
//! Peak duration, pulse-to-ring ratio and the figure of merit for sharpness follow Android's assessment of haptics hardware: the pulse is
//! what is above a tenth of the peak, the ring what follows it down to a hundredth; the ratio is that of their root mean squares, in dB, and the
//! figure of merit is the ratio over the duration of the pulse.

use super::felt::FINE_RECORD;
use super::window::LEAD_S;

/// Part of the peak below which a place is quiet.
pub const QUIET: f64 = 0.1;
/// Part of the peak at which a ring ends.
const RING_ENDS: f64 = 0.01;
/// Time in s for which it has to be quiet at least: between two crests anything is.
const QUIET_FOR_S: f64 = 0.05;
/// Last sample of a record that counts: what comes before its beginning is at its end.
pub const COUNTED: usize = FINE_RECORD * 9 / 10;

/// The figures of a motion.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ClickMeasures {
    /// Largest acceleration, in the motion's unit.
    pub peak: f64,
    /// When it comes, in s.
    pub peak_s: f64,
    /// From when on it stays below a tenth of the peak, in s; `None` if it does not within 0.85 s.
    pub quiet_s: Option<f64>,
    /// For how long the pulse lasts, in s.
    pub pulse_s: f64,
    /// Pulse-to-ring ratio in dB; `None` without a ring.
    pub pulse_to_ring_db: Option<f64>,
}

impl ClickMeasures {
    /// The times of a motion that begins [`LEAD_S`] after its burst, from the burst's start.
    #[must_use]
    pub fn shift_times_to_count_from_burst_start(self) -> Self {
        let quiet_s = self.quiet_s.map(|quiet_s| if self.peak > 0.0 { quiet_s + LEAD_S } else { quiet_s });
        Self { peak_s: self.peak_s + LEAD_S, quiet_s, ..self }
    }

    /// Figure of merit for sharpness in dB/ms.
    #[must_use]
    pub fn sharpness_db_per_ms_if_pulse_to_ring_ratio_known(&self) -> Option<f64> {
        self.pulse_to_ring_db.filter(|_| self.pulse_s > 0.0).map(|ratio| ratio / (1e3 * self.pulse_s))
    }
}

/// Measures a felt motion of [`FINE_RECORD`] samples in 1 s.
#[must_use]
#[expect(clippy::cast_precision_loss, reason = "a constant")]
pub fn measure_click(motion: &[f64]) -> ClickMeasures {
    measure_motion(motion.get(..COUNTED).unwrap_or(motion), 1.0 / FINE_RECORD as f64)
}

/// Measures what a felt motion of [`FINE_RECORD`] samples in 1 s is from a time in s on; times count from there.
#[must_use]
#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "some thousand samples")]
pub fn measure_click_from_time(motion: &[f64], from_s: f64) -> ClickMeasures {
    let from = (from_s * FINE_RECORD as f64).round() as usize;
    measure_motion(motion.get(from..COUNTED).unwrap_or(&[]), 1.0 / FINE_RECORD as f64)
}

/// When a felt motion of [`FINE_RECORD`] samples in 1 s stays below `level` from then on, in s; `None` if it does not within 0.85 s.
#[must_use]
#[expect(clippy::cast_precision_loss, reason = "a constant")]
pub fn find_quiet_start_of_record_s(motion: &[f64], level: f64) -> Option<f64> {
    find_quiet_start_s(motion.get(..COUNTED).unwrap_or(motion), 1.0 / FINE_RECORD as f64, level)
}

#[expect(clippy::cast_precision_loss, reason = "sample numbers")]
fn find_quiet_start_s(motion: &[f64], step_s: f64, level: f64) -> Option<f64> {
    let start_s = motion.iter().rposition(|x| x.abs() > level).map_or(0.0, |last| (last + 1) as f64 * step_s);
    (start_s + QUIET_FOR_S <= motion.len() as f64 * step_s).then_some(start_s)
}

/// Measures a motion with a sample every `step_s`.
#[must_use]
#[expect(clippy::cast_precision_loss, reason = "sample numbers")]
pub fn measure_motion(motion: &[f64], step_s: f64) -> ClickMeasures {
    let second = |sample: usize| sample as f64 * step_s;
    let (at, peak) =
        motion.iter().map(|x| x.abs()).enumerate().fold((0, 0.0), |most, now| if now.1 > most.1 { now } else { most });
    let first_above = |part: f64| motion.iter().position(|x| x.abs() > part * peak).unwrap_or(0);
    let end_above = |part: f64| motion.iter().rposition(|x| x.abs() > part * peak).map_or(0, |last| last + 1);
    let (begin, end, ring_end) = (first_above(QUIET), end_above(QUIET), end_above(RING_ENDS));
    let rms = |from: usize, to: usize| {
        let part = motion.get(from..to).unwrap_or(&[]);
        (part.iter().map(|x| x * x).sum::<f64>() / part.len().max(1) as f64).sqrt()
    };
    let ring = rms(end, ring_end);
    let quiet_s = find_quiet_start_s(motion, step_s, QUIET * peak);
    ClickMeasures {
        peak,
        peak_s: second(at),
        quiet_s,
        pulse_s: second(end.saturating_sub(begin)),
        pulse_to_ring_db: (quiet_s.is_some() && ring > 0.0).then(|| 20.0 * (rms(begin, end) / ring).log10()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::TAU;

    /// A decaying cosine: all figures by hand.
    #[test]
    fn a_decaying_motion_has_known_figures() {
        // e^(-100 t): a tenth after ln 10 / 100 = 23.03 ms, a hundredth after twice that.
        let motion: Vec<f64> = (0..16_000)
            .map(|k| f64::from(k) / 16e3)
            .map(|t| 2.0 * (-100.0 * t).exp() * (TAU * 200.0 * t).cos())
            .collect();
        let found = measure_click(&motion);
        assert!((found.peak - 2.0).abs() < 1e-9 && found.peak_s == 0.0);
        let quiet_s = found.quiet_s.unwrap();
        assert!((0.0205..0.02303).contains(&quiet_s) && (found.pulse_s - quiet_s).abs() < 1e-9, "{found:?}");
        // Of an exponential that falls by ten, twice in equal times: 20 dB.
        assert!((found.pulse_to_ring_db.unwrap() - 20.0).abs() < 1.0, "{found:?}");
        assert!((found.sharpness_db_per_ms_if_pulse_to_ring_ratio_known().unwrap() - 0.9).abs() < 0.1, "{found:?}");
    }

    #[test]
    fn what_does_not_end_is_not_quiet() {
        let motion: Vec<f64> = (0..16_000).map(|k| (TAU * 100.0 * f64::from(k) / 16e3).sin()).collect();
        let found = measure_click(&motion);
        assert_eq!((found.quiet_s, found.pulse_to_ring_db), (None, None));
        let still = measure_click(&[0.0; 16_000]);
        assert_eq!((still.peak, still.quiet_s), (0.0, Some(0.0)));
    }
}
