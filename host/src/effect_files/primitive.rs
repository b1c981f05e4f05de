//! Primitives: short effects with names, which files put together.

use super::events::{EnvelopePoint, HapticEvent};
use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

/// A primitive, named as Android (`VibrationEffect.Composition`) and HID (usage page 0x0E, haptics) name them.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum Primitive {
    /// A crisp click
    Click,
    /// A light, sharp click for many in a row
    Tick,
    /// A light, dull click for many in a row
    LowTick,
    /// A dull, strong hit
    Thud,
    /// Two swells: something that turns
    Spin,
    /// Rises within 150 ms
    #[serde(alias = "rise")]
    QuickRise,
    /// Rises within 500 ms
    SlowRise,
    /// Falls within 100 ms
    #[serde(alias = "fall")]
    QuickFall,
    /// Vibrates evenly
    Buzz,
    /// Vibrates evenly, dull
    Rumble,
    /// A key that goes down
    Press,
    /// A key that comes up
    Release,
    /// Barely felt: the finger is over something
    Hover,
    /// Two clicks, the second one stronger: done
    Success,
    /// Three thuds: not done
    Error,
}

/// What a primitive is made of.
enum Shape {
    /// Pulses: each with its time in s, intensity and sharpness.
    Pulses(&'static [(f64, f64, f64)]),
    /// A vibration: its duration in s, sharpness, and envelope as parts of the duration with their levels.
    Vibration(f64, f64, &'static [(f64, f64)]),
}

impl Primitive {
    /// All of them.
    pub const ALL: [Self; 15] = [
        Self::Click,
        Self::Tick,
        Self::LowTick,
        Self::Thud,
        Self::Spin,
        Self::QuickRise,
        Self::SlowRise,
        Self::QuickFall,
        Self::Buzz,
        Self::Rumble,
        Self::Press,
        Self::Release,
        Self::Hover,
        Self::Success,
        Self::Error,
    ];

    /// As files name it.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Click => "click",
            Self::Tick => "tick",
            Self::LowTick => "low_tick",
            Self::Thud => "thud",
            Self::Spin => "spin",
            Self::QuickRise => "quick_rise",
            Self::SlowRise => "slow_rise",
            Self::QuickFall => "quick_fall",
            Self::Buzz => "buzz",
            Self::Rumble => "rumble",
            Self::Press => "press",
            Self::Release => "release",
            Self::Hover => "hover",
            Self::Success => "success",
            Self::Error => "error",
        }
    }

    /// What it feels like.
    #[must_use]
    pub const fn describe_feel(self) -> &'static str {
        match self {
            Self::Click => "a crisp click",
            Self::Tick => "a light, sharp click for rapid repetition",
            Self::LowTick => "a light, dull click for rapid repetition",
            Self::Thud => "a strong, dull impact",
            Self::Spin => "a vibration that swells twice, like that of a spinning object",
            Self::QuickRise => "a vibration that grows from zero over 150 ms",
            Self::SlowRise => "a vibration that grows from zero over 500 ms",
            Self::QuickFall => "a vibration that fades to zero over 100 ms",
            Self::Buzz => "a vibration of constant intensity",
            Self::Rumble => "a dull vibration of constant intensity",
            Self::Press => "a key that is pressed",
            Self::Release => "a key that is released",
            Self::Hover => "a very weak, sharp click, for a finger that hovers over a control",
            Self::Success => "two clicks, the second one stronger",
            Self::Error => "three thuds",
        }
    }

    /// Android's constant for it.
    #[must_use]
    pub const fn android_name(self) -> Option<&'static str> {
        Some(match self {
            Self::Click => "PRIMITIVE_CLICK",
            Self::Tick => "PRIMITIVE_TICK",
            Self::LowTick => "PRIMITIVE_LOW_TICK",
            Self::Thud => "PRIMITIVE_THUD",
            Self::Spin => "PRIMITIVE_SPIN",
            Self::QuickRise => "PRIMITIVE_QUICK_RISE",
            Self::SlowRise => "PRIMITIVE_SLOW_RISE",
            Self::QuickFall => "PRIMITIVE_QUICK_FALL",
            _ => return None,
        })
    }

    /// The waveform of HID's usage page 0x0E.
    #[must_use]
    pub const fn hid_name(self) -> Option<&'static str> {
        Some(match self {
            Self::Click => "WAVEFORM_CLICK",
            Self::Buzz => "WAVEFORM_BUZZ_CONTINUOUS",
            Self::Rumble => "WAVEFORM_RUMBLE_CONTINUOUS",
            Self::Press => "WAVEFORM_PRESS",
            Self::Release => "WAVEFORM_RELEASE",
            Self::Hover => "WAVEFORM_HOVER",
            Self::Success => "WAVEFORM_SUCCESS",
            Self::Error => "WAVEFORM_ERROR",
            _ => return None,
        })
    }

    const fn describe_as_pulses_or_vibration(self) -> Shape {
        const LEVEL: &[(f64, f64)] = &[];
        const RISE: &[(f64, f64)] = &[(0.0, 0.0), (1.0, 1.0)];
        const FALL: &[(f64, f64)] = &[(0.0, 1.0), (1.0, 0.0)];
        const SWELLS: &[(f64, f64)] = &[(0.0, 0.0), (0.3, 1.0), (0.5, 0.2), (0.75, 0.8), (1.0, 0.0)];
        match self {
            Self::Click => Shape::Pulses(&[(0.0, 1.0, 0.5)]),
            Self::Tick => Shape::Pulses(&[(0.0, 0.5, 0.9)]),
            Self::LowTick => Shape::Pulses(&[(0.0, 0.5, 0.2)]),
            Self::Thud => Shape::Pulses(&[(0.0, 1.0, 0.1)]),
            Self::Press => Shape::Pulses(&[(0.0, 0.9, 0.5)]),
            Self::Release => Shape::Pulses(&[(0.0, 0.6, 0.8)]),
            Self::Hover => Shape::Pulses(&[(0.0, 0.3, 0.9)]),
            Self::Success => Shape::Pulses(&[(0.0, 0.6, 0.6), (0.15, 1.0, 0.6)]),
            Self::Error => Shape::Pulses(&[(0.0, 1.0, 0.1), (0.12, 1.0, 0.1), (0.24, 1.0, 0.1)]),
            Self::Spin => Shape::Vibration(0.3, 0.4, SWELLS),
            Self::QuickRise => Shape::Vibration(0.15, 0.5, RISE),
            Self::SlowRise => Shape::Vibration(0.5, 0.4, RISE),
            Self::QuickFall => Shape::Vibration(0.1, 0.5, FALL),
            Self::Buzz => Shape::Vibration(0.2, 0.5, LEVEL),
            Self::Rumble => Shape::Vibration(0.2, 0.0, LEVEL),
        }
    }

    /// How long it lasts if a file gives no duration, in s; `None` for pulses, which have none.
    #[must_use]
    pub const fn default_duration_s(self) -> Option<f64> {
        match self.describe_as_pulses_or_vibration() {
            Shape::Pulses(_) => None,
            Shape::Vibration(duration_s, _, _) => Some(duration_s),
        }
    }

    /// Its events, from time 0 on. The intensity multiplies its own; sharpness and duration stand in the place of its own.
    #[must_use]
    pub fn list_events(self, intensity: f64, sharpness: Option<f64>, duration_s: Option<f64>) -> Vec<HapticEvent> {
        match self.describe_as_pulses_or_vibration() {
            Shape::Pulses(pulses) => pulses
                .iter()
                .map(|(time_s, own, sharp)| {
                    HapticEvent::new_transient(*time_s, intensity * own, sharpness.unwrap_or(*sharp))
                })
                .collect(),
            Shape::Vibration(own_s, sharp, envelope) => {
                let duration_s = duration_s.unwrap_or(own_s);
                let point = |(part, level): &(f64, f64)| EnvelopePoint { time_s: part * duration_s, level: *level };
                let envelope = envelope.iter().map(point).collect();
                vec![HapticEvent::new_continuous((0.0, duration_s), intensity, sharpness.unwrap_or(sharp), envelope)]
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_those_of_files_and_no_android_primitive_is_missing() {
        for primitive in Primitive::ALL {
            assert_eq!(serde_json::json!(primitive), primitive.name());
            assert!(!primitive.list_events(1.0, None, None).is_empty());
        }
        let android: Vec<&str> = Primitive::ALL.into_iter().filter_map(Primitive::android_name).collect();
        // As many as VibrationEffectCompositionPrimitive has: 1 to 8.
        assert_eq!(android.len(), 8);
        assert_eq!(serde_json::from_str::<Primitive>("\"rise\"").unwrap(), Primitive::QuickRise);
    }
}
