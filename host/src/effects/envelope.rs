//! An envelope cycle by cycle, as the board's `Envelope` works it out.

use era_shared::waveform::{Effect, FULL_LEVEL, Segment};

fn segment_s(segment: &Segment, period_s: f64) -> f64 {
    match *segment {
        Segment::Hold { milliseconds, .. } | Segment::Ramp { milliseconds, .. } => f64::from(milliseconds) / 1e3,
        Segment::Cycles { count, .. } => f64::from(count) * period_s,
    }
}

/// How long an effect lasts in s on a drive with periods of `period_s`.
#[must_use]
pub fn length_s(effect: &Effect, period_s: f64) -> f64 {
    let once: f64 = effect.segments.iter().map(|segment| segment_s(segment, period_s)).sum();
    once * f64::from(effect.times)
}

/// Levels, -1 to 1, of the drive's periods from the first boundary on, at most `most` of them: each is that of the segment
/// in which the period begins, a ramp's that of the period's middle.
#[must_use]
pub fn levels(effect: &Effect, period_s: f64, most: usize) -> Vec<f64> {
    let once: f64 = effect.segments.iter().map(|segment| segment_s(segment, period_s)).sum();
    let whole_s = once * f64::from(effect.times);
    // Boundaries that fall together with segments' ends but for rounding.
    let slack_s = 1e-9 * period_s;
    let part = |level: i16| f64::from(level) / f64::from(FULL_LEVEL);
    let mut out = Vec::new();
    #[allow(clippy::cast_precision_loss, reason = "at most `most`")]
    let starts = (0..most).map(|i| i as f64 * period_s + slack_s).take_while(|start| *start < whole_s);
    for start_s in starts {
        let mut rest_s = start_s % once;
        for segment in &effect.segments {
            let length_s = segment_s(segment, period_s);
            if rest_s < length_s {
                out.push(match *segment {
                    Segment::Hold { level, .. } | Segment::Cycles { level, .. } => part(level),
                    Segment::Ramp { from, to, .. } => {
                        let middle_s = (rest_s + 0.5 * period_s).min(length_s);
                        part(from) + (part(to) - part(from)) * middle_s / length_s
                    }
                });
                break;
            }
            rest_s -= length_s;
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cycle_by_cycle() {
        assert_eq!(levels(&Effect::click(3, 2), 1.0 / 150.0, 99), [1.0, 1.0, 1.0, -1.0, -1.0]);
        // 10 ms on and 5 ms off at 200 Hz, twice.
        assert_eq!(levels(&Effect::pulse_train(10, 5, 2), 5e-3, 99), [1.0, 1.0, 0.0, 1.0, 1.0, 0.0]);
        assert_eq!(levels(&Effect::pulse_train(10, 5, 2), 5e-3, 4), [1.0, 1.0, 0.0, 1.0]);
        let swell = levels(&Effect::swell(10, 5, 10), 5e-3, 99);
        assert_eq!(swell.len(), 5);
        assert!((swell[0] - 0.25).abs() < 1e-6 && (swell[1] - 0.75).abs() < 1e-6 && swell[2] == 1.0);
        assert!((length_s(&Effect::swell(10, 5, 10), 5e-3) - 25e-3).abs() < 1e-12);
    }
}
