//! The effects that have names, and their parameters.

use crate::click::{CRISP_RANGE_S, ClickOptions, Preference};
use era_shared::waveform::{Effect, FULL_LEVEL, Segment};
use serde::{Deserialize, Serialize};
use serde_json::Value;

/// Longest effect in ms; nobody needs more from one request.
const LONGEST_MS: f64 = 10_000.0;
/// Fraction of the full force to which a texture falls between its crests, in thousandths: 14 dB down, which is clearly a
/// gap, without the harmonics of windows that close altogether.
const TEXTURE_FLOOR: i16 = 200;
/// Pauses of a double click and a pulse train, and rises of a texture, are at least this long, in ms.
const SHORTEST_MS: f64 = 1.0;

/// Least and most count that any effect takes.
pub const COUNTS: (f64, f64) = (1.0, 100.0);
/// Least and most period in ms that any effect takes.
pub const PERIODS_MS: (f64, f64) = (10.0, 1000.0);

/// An effect by its name.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(utoipa::ToSchema))]
#[cfg_attr(feature = "schema", schema(as = Effect))]
#[cfg_attr(feature = "clap", derive(clap::ValueEnum))]
#[serde(rename_all = "snake_case")]
#[cfg_attr(feature = "clap", value(rename_all = "snake_case"))]
pub enum NamedEffect {
    /// A short burst of single windows (or, where the board cannot play windows, a push with a brake), designed for the panel and the touched place
    Click,
    /// Two clicks, `period_ms` apart
    DoubleClick,
    /// A vibration of full strength for `duration_ms`
    Buzz,
    /// A vibration whose strength rises, stays constant and falls within `duration_ms`
    Swell,
    /// `count` pulses, one every `period_ms`; each pulse lasts half of this time
    PulseTrain,
    /// A vibration whose strength rises and falls once every `period_ms`, for `duration_ms`: feels like ridges under a finger
    Texture,
}

/// An effect with its parameters; what is `None` has its default.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct EffectRequest {
    /// Which.
    pub effect: NamedEffect,
    /// How long, in ms: buzz, swell, texture.
    pub duration_ms: Option<f64>,
    /// How many: pulse train.
    pub count: Option<u32>,
    /// From one to the next, in ms: double click, pulse train, texture.
    pub period_ms: Option<f64>,
    /// Longest time until it is quiet, in ms: click.
    pub crisp_ms: Option<f64>,
    /// What counts more if it cannot be both: click.
    pub prefer: Option<Preference>,
}

/// Parameters that cannot be used.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum EffectError {
    /// Out of range.
    #[error("{field} is {value}, but the effect `{effect}` allows {min} to {max}")]
    Range {
        /// The field's name.
        field: &'static str,
        /// As given.
        value: f64,
        /// Name of the effect.
        effect: &'static str,
        /// Least allowed.
        min: f64,
        /// Most allowed.
        max: f64,
    },
    /// A parameter that the effect does not have.
    #[error("{field} is {value}, but the effect `{effect}` has no field `{field}`")]
    NotTaken {
        /// The field's name.
        field: &'static str,
        /// As given.
        value: f64,
        /// Name of the effect.
        effect: &'static str,
    },
    /// A preference for an effect that is always as strong as was asked for.
    #[error("prefer is {}, but the effect `{effect}` has no field `prefer`", prefer.name())]
    PreferNotTaken {
        /// As given.
        prefer: Preference,
        /// Name of the effect.
        effect: &'static str,
    },
}

impl EffectError {
    /// Field, value and allowed range as text.
    #[must_use]
    pub fn field_value_and_allowed_range(&self) -> (&'static str, Value, String) {
        let absent =
            |field: &str, effect: &str| format!("absent, because the effect `{effect}` has no field `{field}`");
        match self {
            Self::Range { field, value, min, max, .. } => (field, (*value).into(), format!("{min} to {max}")),
            Self::NotTaken { field, value, effect } => (field, (*value).into(), absent(field, effect)),
            Self::PreferNotTaken { prefer, effect } => ("prefer", prefer.name().into(), absent("prefer", effect)),
        }
    }
}

/// What is played, with all its parameters.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Shape {
    /// So many clicks, so many ms from one to the next.
    Clicks {
        /// 1 or 2.
        count: u16,
        /// In ms.
        period_ms: u16,
    },
    /// The same envelope for every drive, whatever the panel.
    Fixed,
}

/// Range and default of one parameter, where an effect has it.
type Limits = Option<(f64, f64, f64)>;

impl NamedEffect {
    /// As in requests.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Click => "click",
            Self::DoubleClick => "double_click",
            Self::Buzz => "buzz",
            Self::Swell => "swell",
            Self::PulseTrain => "pulse_train",
            Self::Texture => "texture",
        }
    }

    /// Least, most and default of duration (ms), count and period (ms).
    const fn least_most_and_default_duration_count_and_period_if_any(self) -> (Limits, Limits, Limits) {
        match self {
            Self::Click => (None, None, None),
            // Closer than 50 ms they merge, beyond 500 ms they are two gestures.
            Self::DoubleClick => (None, None, Some((50.0, 500.0, 120.0))),
            Self::Buzz => (Some((1.0, LONGEST_MS, 200.0)), None, None),
            Self::Swell => (Some((10.0, LONGEST_MS, 500.0)), None, None),
            Self::PulseTrain => (None, Some((COUNTS.0, COUNTS.1, 5.0)), Some((PERIODS_MS.0, PERIODS_MS.1, 60.0))),
            // 8 to 40 Hz: slower is felt as single bumps, faster as a tone of its own.
            Self::Texture => (Some((50.0, LONGEST_MS, 1000.0)), None, Some((25.0, 125.0, 50.0))),
        }
    }

    /// Least, most and default of the time until quiet in ms.
    fn least_most_and_default_time_until_quiet_ms_if_click(self) -> Limits {
        let (least_s, most_s) = CRISP_RANGE_S;
        (self == Self::Click).then_some((1e3 * least_s, 1e3 * most_s, 1e3 * ClickOptions::default().crisp_s))
    }
}

impl EffectRequest {
    /// An effect with its defaults.
    #[must_use]
    pub const fn with_defaults(effect: NamedEffect) -> Self {
        Self { effect, duration_ms: None, count: None, period_ms: None, crisp_ms: None, prefer: None }
    }

    /// Duration in ms, count and period in ms; 0 where the effect has none.
    fn check_parameters_and_get_duration_ms_count_and_period_ms_or_0(&self) -> Result<(f64, f64, f64), EffectError> {
        let name = self.effect.name();
        let one = |field, given: Option<f64>, limits: Limits| match (given, limits) {
            (None, limits) => Ok(limits.map_or(0.0, |(_, _, default)| default)),
            (Some(value), None) => Err(EffectError::NotTaken { field, value, effect: name }),
            (Some(value), Some((min, max, _))) if (min..=max).contains(&value) => Ok(value),
            (Some(value), Some((min, max, _))) => Err(EffectError::Range { field, value, effect: name, min, max }),
        };
        let (duration, count, period) = self.effect.least_most_and_default_duration_count_and_period_if_any();
        let duration_ms = one("duration_ms", self.duration_ms, duration)?;
        let count = one("count", self.count.map(f64::from), count)?;
        let period_ms = one("period_ms", self.period_ms, period)?;
        one("crisp_ms", self.crisp_ms, self.effect.least_most_and_default_time_until_quiet_ms_if_click())?;
        if let Some(prefer) = self.prefer.filter(|_| self.effect != NamedEffect::Click) {
            return Err(EffectError::PreferNotTaken { prefer, effect: name });
        }
        if count * period_ms > LONGEST_MS {
            let max = (LONGEST_MS / period_ms).floor();
            return Err(EffectError::Range { field: "count", value: count, effect: name, min: 1.0, max });
        }
        Ok((duration_ms, count, period_ms))
    }

    /// How a click is to be.
    #[must_use]
    pub fn click_options(&self) -> ClickOptions {
        let usual = ClickOptions::default();
        let (_, _, period) = self.effect.least_most_and_default_duration_count_and_period_if_any();
        let period_ms = self.period_ms.or(period.map(|(_, _, default_ms)| default_ms));
        ClickOptions {
            second_click_after_s: period_ms
                .filter(|_| self.effect == NamedEffect::DoubleClick)
                .map(|ms| 1e-3 * ms.round()),
            crisp_s: self.crisp_ms.map_or(usual.crisp_s, |crisp_ms| 1e-3 * crisp_ms),
            preference: self.prefer.unwrap_or_default(),
            ..usual
        }
    }

    /// What is to be designed, after a look at the parameters.
    ///
    /// # Errors
    /// [`EffectError`].
    pub fn check_parameters_and_choose_clicks_or_fixed_envelope(&self) -> Result<Shape, EffectError> {
        let (_, _, period_ms) = self.check_parameters_and_get_duration_ms_count_and_period_ms_or_0()?;
        Ok(match self.effect {
            NamedEffect::Click => Shape::Clicks { count: 1, period_ms: 0 },
            NamedEffect::DoubleClick => Shape::Clicks { count: 2, period_ms: round_to_u16(period_ms) },
            NamedEffect::Buzz | NamedEffect::Swell | NamedEffect::PulseTrain | NamedEffect::Texture => Shape::Fixed,
        })
    }

    /// The envelope of an effect that does not depend on the panel; a click's is a plain push here.
    ///
    /// # Errors
    /// [`EffectError`].
    pub fn build_envelope_or_plain_push_if_click(&self) -> Result<Effect, EffectError> {
        let (duration_ms, count, period_ms) = self.check_parameters_and_get_duration_ms_count_and_period_ms_or_0()?;
        let hold = |level, ms: f64| Segment::Hold { level, milliseconds: round_to_u16(ms) };
        let ramp = |from, to, ms: f64| Segment::Ramp { from, to, milliseconds: round_to_u16(ms) };
        let of = |segments: &[Segment], times: f64| Effect {
            segments: segments.iter().copied().collect(),
            times: round_to_u16(times.max(1.0)),
        };
        Ok(match self.effect {
            NamedEffect::Click | NamedEffect::DoubleClick => Effect::new_click(1, 0),
            NamedEffect::Buzz => of(&[hold(FULL_LEVEL, duration_ms)], 1.0),
            NamedEffect::Swell => of(
                &[
                    ramp(0, FULL_LEVEL, 0.4 * duration_ms),
                    hold(FULL_LEVEL, 0.2 * duration_ms),
                    ramp(FULL_LEVEL, 0, 0.4 * duration_ms),
                ],
                1.0,
            ),
            NamedEffect::PulseTrain => {
                let (pulse_ms, pause_ms) = split_period_into_whole_ms_halves(period_ms);
                of(&[hold(FULL_LEVEL, pulse_ms), hold(0, pause_ms)], count)
            }
            NamedEffect::Texture => {
                let (up_ms, down_ms) = split_period_into_whole_ms_halves(period_ms);
                of(
                    &[ramp(TEXTURE_FLOOR, FULL_LEVEL, up_ms), ramp(FULL_LEVEL, TEXTURE_FLOOR, down_ms)],
                    (duration_ms / period_ms).round(),
                )
            }
        })
    }
}

/// Halves of a period in whole ms that add up to it: of an odd one the first is longer by 1 ms.
fn split_period_into_whole_ms_halves(period_ms: f64) -> (f64, f64) {
    let first_ms = (0.5 * period_ms).round().max(SHORTEST_MS);
    (first_ms, (period_ms.round() - first_ms).max(SHORTEST_MS))
}

/// To whole ms or times, which is what the board counts in.
#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "`as` saturates; values are in range")]
fn round_to_u16(value: f64) -> u16 {
    value.round() as u16
}

#[cfg(test)]
mod tests {
    use super::super::envelope::effect_duration_s;
    use super::*;

    #[cfg(feature = "clap")]
    #[test]
    fn every_effect_has_one_name_and_an_envelope_that_the_board_takes() {
        use clap::ValueEnum;
        for effect in NamedEffect::value_variants() {
            let request = EffectRequest::with_defaults(*effect);
            assert!(request.build_envelope_or_plain_push_if_click().unwrap().is_valid(), "{effect:?}");
            assert!(effect.to_possible_value().unwrap().get_name() == effect.name());
        }
    }

    #[test]
    fn defaults_are_what_the_board_takes() {
        let lasts =
            |request: EffectRequest| effect_duration_s(&request.build_envelope_or_plain_push_if_click().unwrap(), 5e-3);
        let of = EffectRequest::with_defaults;
        assert!((lasts(of(NamedEffect::Swell)) - 0.5).abs() < 1e-9);
        assert!((lasts(of(NamedEffect::PulseTrain)) - 0.3).abs() < 1e-9);
        assert!((lasts(EffectRequest { duration_ms: Some(750.0), ..of(NamedEffect::Texture) }) - 0.75).abs() < 1e-9);
        let train = EffectRequest { count: Some(7), period_ms: Some(20.0), ..of(NamedEffect::PulseTrain) };
        assert!((lasts(train) - 0.14).abs() < 1e-9);
        let odd = EffectRequest { count: Some(3), period_ms: Some(47.0), ..of(NamedEffect::PulseTrain) };
        assert!((lasts(odd) - 0.141).abs() < 1e-9);
        let odd = EffectRequest { duration_ms: Some(750.0), period_ms: Some(75.0), ..of(NamedEffect::Texture) };
        assert!((lasts(odd) - 0.75).abs() < 1e-9);
        assert!((lasts(EffectRequest { duration_ms: Some(40.0), ..of(NamedEffect::Buzz) }) - 0.04).abs() < 1e-9);
    }

    #[test]
    fn what_cannot_be_used_is_named() {
        let of = EffectRequest::with_defaults;
        let cases = [
            (
                EffectRequest { duration_ms: Some(20.0), ..of(NamedEffect::Click) },
                "duration_ms is 20, but the effect `click` has no field `duration_ms`",
            ),
            (
                EffectRequest { count: Some(2), ..of(NamedEffect::Buzz) },
                "count is 2, but the effect `buzz` has no field `count`",
            ),
            (
                EffectRequest { duration_ms: Some(0.5), ..of(NamedEffect::Buzz) },
                "duration_ms is 0.5, but the effect `buzz` allows 1 to 10000",
            ),
            (
                EffectRequest { period_ms: Some(f64::NAN), ..of(NamedEffect::Texture) },
                "period_ms is NaN, but the effect `texture` allows 25 to 125",
            ),
            (
                EffectRequest { crisp_ms: Some(19.0), ..of(NamedEffect::Click) },
                "crisp_ms is 19, but the effect `click` allows 20 to 100",
            ),
            (
                EffectRequest { crisp_ms: Some(45.0), ..of(NamedEffect::DoubleClick) },
                "crisp_ms is 45, but the effect `double_click` has no field `crisp_ms`",
            ),
            (
                EffectRequest { prefer: Some(Preference::Crispness), ..of(NamedEffect::Swell) },
                "prefer is crispness, but the effect `swell` has no field `prefer`",
            ),
            (
                EffectRequest { count: Some(50), period_ms: Some(400.0), ..of(NamedEffect::PulseTrain) },
                "count is 50, but the effect `pulse_train` allows 1 to 25",
            ),
        ];
        for (request, text) in cases {
            assert_eq!(request.build_envelope_or_plain_push_if_click().unwrap_err().to_string(), text);
            assert_eq!(request.check_parameters_and_choose_clicks_or_fixed_envelope().unwrap_err().to_string(), text);
        }
    }
}
