//! The effects that have names, for clients that offer them.

use super::primitive::Primitive;
use crate::effects::NamedEffect;
use serde::Serialize;
use utoipa::ToSchema;

/// An effect that has a name.
#[derive(Clone, Debug, PartialEq, Serialize, ToSchema)]
#[schema(as = NamedEffect)]
pub struct NamedEffectView {
    /// Name of the effect in requests and files.
    pub name: &'static str,
    /// Where the name is used.
    pub used_in: NameUse,
    /// What the effect feels like.
    pub feel: &'static str,
    /// Default duration in ms; null for pulses, whose duration depends on the panel.
    pub duration_ms: Option<f64>,
    /// Constant of Android's `VibrationEffect.Composition`; null without one.
    pub android: Option<&'static str>,
    /// Waveform of HID's usage page 0x0E; null without one.
    pub hid: Option<&'static str>,
}

/// Where a name is used: `touch` as `effect` of a touch, `file` as `primitive` of an effect file.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum NameUse {
    /// As `effect` of a touch.
    Touch,
    /// As `primitive` of an effect file.
    File,
}

/// All effects that have names: first those of touches, then those of files.
#[must_use]
pub fn list_named_effects() -> Vec<NamedEffectView> {
    let touch = |(effect, feel, duration_ms): (NamedEffect, &'static str, Option<f64>)| NamedEffectView {
        name: effect.name(),
        used_in: NameUse::Touch,
        feel,
        duration_ms,
        android: None,
        hid: None,
    };
    let touches = [
        (NamedEffect::Click, "a crisp click", None),
        (NamedEffect::DoubleClick, "two clicks, 120 ms apart", None),
        (NamedEffect::Buzz, "a vibration of constant intensity", Some(200.0)),
        (NamedEffect::Swell, "a vibration that grows, stays constant and fades", Some(500.0)),
        (NamedEffect::PulseTrain, "five pulses, one every 60 ms", Some(300.0)),
        (NamedEffect::Texture, "a ridged surface under the finger, one ridge every 50 ms", Some(1000.0)),
    ];
    let file = |primitive: Primitive| NamedEffectView {
        name: primitive.name(),
        used_in: NameUse::File,
        feel: primitive.describe_feel(),
        duration_ms: primitive.default_duration_s().map(|duration_s| 1e3 * duration_s),
        android: primitive.android_name(),
        hid: primitive.hid_name(),
    };
    touches.into_iter().map(touch).chain(Primitive::ALL.into_iter().map(file)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::EffectRequest;
    use crate::effects::envelope::effect_duration_s;
    use clap::ValueEnum;

    #[test]
    fn every_effect_of_touches_is_listed_with_its_duration() {
        let list = list_named_effects();
        for effect in NamedEffect::value_variants() {
            let own = list.iter().find(|own| own.used_in == NameUse::Touch && own.name == effect.name()).unwrap();
            let Some(duration_ms) = own.duration_ms else { continue };
            let envelope = EffectRequest::with_defaults(*effect).build_envelope_or_plain_push_if_click().unwrap();
            assert!((1e3 * effect_duration_s(&envelope, 5e-3) - duration_ms).abs() < 1e-6, "{}", own.name);
        }
    }
}
