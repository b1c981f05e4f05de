//! An envelope cycle by cycle, as the board's `Envelope` works it out.

use era_shared::waveform::{Effect, FULL_LEVEL, Segment};

fn segment_duration_s(segment: &Segment, period_s: f64) -> f64 {
    match *segment {
        Segment::Hold { milliseconds, .. } | Segment::Ramp { milliseconds, .. } => f64::from(milliseconds) / 1e3,
        Segment::Cycles { count, .. } => f64::from(count) * period_s,
    }
}

/// How long an effect lasts in s on a drive with periods of `period_s`.
#[must_use]
pub fn effect_duration_s(effect: &Effect, period_s: f64) -> f64 {
    let once: f64 = effect.segments.iter().map(|segment| segment_duration_s(segment, period_s)).sum();
    once * f64::from(effect.times)
}

/// An effect shortened to what is new in it, for panels whose free motions decay in a given time: nothing is moved otherwise
/// by a level that is held for longer, nor by repetitions after the first ones.
#[derive(Clone, Debug, PartialEq)]
pub struct ShortenedEffect {
    /// Without segments longer than that time, and with repetitions to last that long and once more.
    pub effect: Effect,
    /// Lengths of a repetition's segments in s, shortened and as they are, and whether they are ramps.
    segments: Vec<(f64, f64, bool)>,
    /// How often the effect as it is repeats them.
    times: u16,
}

impl ShortenedEffect {
    /// Of `effect` on a drive with periods of `period_s`, for the time `enough_s`.
    #[must_use]
    pub fn new(effect: &Effect, period_s: f64, enough_s: f64) -> Self {
        #[allow(
            clippy::cast_possible_truncation,
            clippy::cast_sign_loss,
            reason = "at most some seconds; `as` saturates"
        )]
        let most_ms = (enough_s * 1e3).ceil() as u16;
        let mut cut = effect.clone();
        for segment in &mut cut.segments {
            if let Segment::Hold { milliseconds, .. } | Segment::Ramp { milliseconds, .. } = segment {
                *milliseconds = (*milliseconds).min(most_ms);
            }
        }
        let once_s = effect_duration_s(&Effect { times: 1, ..cut.clone() }, period_s);
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "`as` saturates")]
        let enough = (enough_s / once_s).ceil() as u16;
        cut.times = cut.times.min(enough.saturating_add(1));
        let lengths = |(short, whole): (&Segment, &Segment)| {
            (
                segment_duration_s(short, period_s),
                segment_duration_s(whole, period_s),
                matches!(whole, Segment::Ramp { .. }),
            )
        };
        let segments = cut.segments.iter().zip(&effect.segments).map(lengths).collect();
        Self { effect: cut, segments, times: effect.times }
    }

    /// When, in s from its start, the whole effect does what the shortened one does at `time_s`: later by what was left out
    /// before. What the last repetition does comes last in both.
    #[must_use]
    pub fn time_in_full_effect_s(&self, time_s: f64) -> f64 {
        let (short_s, once_s) = self.segments.iter().fold((0.0, 0.0), |sum, s| (sum.0 + s.0, sum.1 + s.1));
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "up to `times`")]
        let repetition = ((time_s / short_s) as u16).min(self.effect.times.saturating_sub(1));
        let mut rest_s = time_s - f64::from(repetition) * short_s;
        let before = if repetition + 1 >= self.effect.times { self.times.saturating_sub(1) } else { repetition };
        let mut at_s = f64::from(before) * once_s;
        for (short_s, whole_s, is_ramp) in &self.segments {
            if rest_s < *short_s {
                return at_s + if *is_ramp { rest_s * whole_s / short_s } else { rest_s };
            }
            rest_s -= short_s;
            at_s += whole_s;
        }
        at_s + rest_s
    }
}

/// Levels, -1 to 1, of the drive's periods from the first boundary on: each is that of the segment in which the period
/// begins, a ramp's that of the period's middle.
#[must_use]
pub fn level_in_each_period(effect: &Effect, period_s: f64) -> Vec<f64> {
    let once: f64 = effect.segments.iter().map(|segment| segment_duration_s(segment, period_s)).sum();
    let whole_s = once * f64::from(effect.times);
    // Boundaries that fall together with segments' ends but for rounding.
    let slack_s = 1e-9 * period_s;
    let part = |level: i16| f64::from(level) / f64::from(FULL_LEVEL);
    let mut out = Vec::new();
    let starts = (0_u32..).map(|i| f64::from(i) * period_s + slack_s).take_while(|start| *start < whole_s);
    for start_s in starts {
        let mut rest_s = start_s % once;
        for segment in &effect.segments {
            let length_s = segment_duration_s(segment, period_s);
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
        assert_eq!(level_in_each_period(&Effect::new_click(3, 2), 1.0 / 150.0), [1.0, 1.0, 1.0, -1.0, -1.0]);
        // 10 ms on and 5 ms off at 200 Hz, twice.
        assert_eq!(level_in_each_period(&Effect::new_pulse_train(10, 5, 2), 5e-3), [1.0, 1.0, 0.0, 1.0, 1.0, 0.0]);
        let swell = level_in_each_period(&Effect::new_swell(10, 5, 10), 5e-3);
        assert_eq!(swell.len(), 5);
        assert!((swell[0] - 0.25).abs() < 1e-6 && (swell[1] - 0.75).abs() < 1e-6 && swell[2] == 1.0);
        assert!((effect_duration_s(&Effect::new_swell(10, 5, 10), 5e-3) - 25e-3).abs() < 1e-12);
    }

    #[test]
    fn what_is_cut_comes_back_as_time() {
        let cut = ShortenedEffect::new(&Effect::new_swell(800, 400, 800), 5e-3, 0.25);
        assert!((effect_duration_s(&cut.effect, 5e-3) - 0.75).abs() < 1e-9, "{cut:?}");
        // In the middle of the rise; early in the hold; in the middle of the fall; after the end.
        for (short_s, whole_s) in [(0.125, 0.4), (0.3, 0.85), (0.625, 1.6), (0.8, 2.05)] {
            assert!(
                (cut.time_in_full_effect_s(short_s) - whole_s).abs() < 1e-9,
                "{short_s}: {}",
                cut.time_in_full_effect_s(short_s)
            );
        }
        let cut = ShortenedEffect::new(&Effect::new_pulse_train(25, 25, 100), 5e-3, 0.25);
        assert_eq!(cut.effect.times, 6);
        for (short_s, whole_s) in [(0.06, 0.06), (0.26, 4.96), (0.31, 5.01)] {
            assert!(
                (cut.time_in_full_effect_s(short_s) - whole_s).abs() < 1e-9,
                "{short_s}: {}",
                cut.time_in_full_effect_s(short_s)
            );
        }
        let few = Effect::new_pulse_train(25, 25, 3);
        let cut = ShortenedEffect::new(&few, 5e-3, 0.25);
        assert!(cut.effect == few && (cut.time_in_full_effect_s(0.17) - 0.17).abs() < 1e-12);
    }
}
