//! Apple Haptic and Audio Pattern (AHAP), as Apple's "Representing haptic patterns in AHAP files" describes it.
//!
//! As lenient as Core Haptics: keys that are not known are ignored, values out of range count as the nearest one in range, and what is missing
//! has a default. What Apple does not publish follows the reference software of ISO/IEC 23090-31, which reads AHAP, too: the intensity of
//! an event without one is 0.5, and a curve counts from its first to its last control point.

use super::error::ReadError;
use super::events::{EnvelopePoint, EventList, HapticEvent, envelope_level_at};
use super::format::FileFormat;
use super::json::{number_at, parse_lenient_json, text_at};
use serde_json::Value;

/// Intensity of an event that has none.
const DEFAULT_INTENSITY: f64 = 0.5;
/// Sharpness of an event that has none: that of 90 Hz, the reference software's frequency, between its 65 and 300 Hz.
const DEFAULT_SHARPNESS: f64 = 0.1;
/// Longest continuous event of Core Haptics in s.
const LONGEST_S: f64 = 30.0;
/// Most curves of a parameter; 16 points each last for 30 s, one point every 10 ms.
const MAX_CURVES: usize = 200;
/// Steps of a curve's sharpness over an event.
const SHARPNESS_STEPS: u32 = 16;

/// Control points of one parameter over time; between two curves, and outside of all, the parameter has no effect.
#[derive(Default)]
struct Control {
    /// Each curve's points, by their times in s.
    curves: Vec<Vec<EnvelopePoint>>,
}

/// Reads a text of AHAP.
///
/// # Errors
/// [`ReadError`] for what is no JSON, or has no pattern that can be played.
pub fn read_ahap_text(text: &str) -> Result<EventList, ReadError> {
    let whole = parse_lenient_json(text, FileFormat::Ahap)?;
    let mut list = EventList::new(FileFormat::Ahap, text_at(&whole["Metadata"], "Project").map(str::to_owned));
    let Some(pattern) = whole["Pattern"].as_array() else {
        let detail = "the key `Pattern` is missing, or is not a list".into();
        return Err(ReadError::Syntax { format: FileFormat::Ahap, detail });
    };
    if let Some(version) = number_at(&whole, "Version").filter(|version| *version > 1.0) {
        list.warn(format!(
            "Version is {version}, but this program supports version 1 only: keys of later versions are left out"
        ));
    }
    let (mut intensity, mut sharpness) = (Control::default(), Control::default());
    for (i, entry) in pattern.iter().enumerate() {
        for (key, value) in entry.as_object().into_iter().flatten() {
            match key.as_str() {
                "Event" => {}
                "ParameterCurve" | "Parameter" => {
                    let name = format!("Pattern[{i}].{key}");
                    match text_at(value, "ParameterID") {
                        Some("HapticIntensityControl") => {
                            intensity.add_curve_or_value(&mut list, value, &name, (0.0, 1.0));
                        }
                        Some("HapticSharpnessControl") => {
                            sharpness.add_curve_or_value(&mut list, value, &name, (-1.0, 1.0));
                        }
                        id => list.warn(format!(
                            "{name} is left out: its ParameterID is {}, but must be HapticIntensityControl or \
                             HapticSharpnessControl",
                            id.unwrap_or("missing")
                        )),
                    }
                }
                other => list.warn(format!("Pattern[{i}].{other} is left out: this key is not known")),
            }
        }
    }
    for control in [&mut intensity, &mut sharpness] {
        if control.curves.len() > MAX_CURVES {
            control.curves.truncate(MAX_CURVES);
            list.warn(format!(
                "only the first {MAX_CURVES} curves of each parameter are used; the others are left out"
            ));
        }
    }
    for (i, event) in pattern.iter().enumerate().filter_map(|(i, entry)| Some((i, entry.get("Event")?))) {
        if list.is_full() {
            break;
        }
        add_ahap_event(&mut list, event, &format!("Pattern[{i}].Event"), &intensity, &sharpness);
    }
    list.finish()
}

fn add_ahap_event(list: &mut EventList, event: &Value, name: &str, intensity: &Control, sharpness: &Control) {
    let is_continuous = match text_at(event, "EventType") {
        Some("HapticTransient") => false,
        Some("HapticContinuous") => true,
        Some(audio @ ("AudioContinuous" | "AudioCustom")) => {
            return list.warn(format!("{name} is left out: its EventType is {audio}, which is a sound"));
        }
        other => {
            let other = other.unwrap_or("missing");
            return list.warn(format!(
                "{name} is left out: its EventType is {other}, but must be HapticTransient or HapticContinuous"
            ));
        }
    };
    let time_s = number_at(event, "Time").unwrap_or_else(|| {
        list.warn(format!("Time of {name} is missing or not a number: the event is played at 0 s"));
        0.0
    });
    let (mut own_intensity, mut own_sharpness, mut is_sustained) = (None, None, true);
    for parameter in event["EventParameters"].as_array().into_iter().flatten() {
        let id = text_at(parameter, "ParameterID").unwrap_or("missing");
        let Some(value) = number_at(parameter, "ParameterValue") else {
            list.warn(format!(
                "the parameter of {name} with the ParameterID {id} is left out: its ParameterValue is \
                               missing or not a number"
            ));
            continue;
        };
        match id {
            "HapticIntensity" => {
                own_intensity = Some(list.clamp_with_warning(&format!("{id} of {name}"), value, (0.0, 1.0)))
            }
            "HapticSharpness" => {
                own_sharpness = Some(list.clamp_with_warning(&format!("{id} of {name}"), value, (0.0, 1.0)))
            }
            "Sustained" => is_sustained = value != 0.0,
            "AttackTime" | "DecayTime" | "ReleaseTime" if value == 0.0 => {}
            "AttackTime" | "DecayTime" | "ReleaseTime" => {
                list.warn(format!(
                    "{id} of {name} is left out: Apple does not publish the times that the values 0 to 1 represent"
                ));
            }
            _ => list.warn(format!(
                "the parameter of {name} with the ParameterID {id} is left out: this ParameterID \
                                    is not known"
            )),
        }
    }
    let base = own_intensity.unwrap_or_else(|| {
        list.warn(format!("{name} has no HapticIntensity: {DEFAULT_INTENSITY} is used"));
        DEFAULT_INTENSITY
    });
    let base_sharpness = own_sharpness.unwrap_or_else(|| {
        list.warn(format!("{name} has no HapticSharpness: {DEFAULT_SHARPNESS} is used"));
        DEFAULT_SHARPNESS
    });
    let sharp_at = |time_s: f64| (base_sharpness + sharpness.value_at(time_s).unwrap_or(0.0)).clamp(0.0, 1.0);
    if !is_continuous {
        let strength = base * intensity.value_at(time_s).unwrap_or(1.0);
        return list.add_event_within_limits(name, HapticEvent::new_transient(time_s, strength, sharp_at(time_s)));
    }
    let Some(duration_s) = number_at(event, "EventDuration") else {
        return list.warn(format!("{name} is left out: an event of the type HapticContinuous needs EventDuration"));
    };
    let duration_s = if duration_s > 0.0 {
        list.clamp_with_warning(&format!("EventDuration of {name} in s"), duration_s, (0.0, LONGEST_S))
    } else {
        duration_s
    };
    let mut envelope = intensity.list_envelope_between(time_s, time_s + duration_s);
    if !is_sustained {
        // It decays for as long as it lasts; how, is not published.
        envelope = add_decay(&envelope, duration_s);
    }
    let steps: Vec<f64> = (0..SHARPNESS_STEPS)
        .map(|step| sharp_at(time_s + duration_s * (f64::from(step) + 0.5) / f64::from(SHARPNESS_STEPS)))
        .collect();
    let mean = steps.iter().sum::<f64>() / f64::from(SHARPNESS_STEPS);
    if steps.iter().any(|step| (step - mean).abs() > 0.1) {
        list.warn(format!("the sharpness of {name} changes over time: its mean {mean:.2} is used"));
    }
    list.add_event_within_limits(name, HapticEvent::new_continuous((time_s, duration_s), base, mean, envelope));
}

/// The same envelope, falling to 0 within a duration.
fn add_decay(envelope: &[EnvelopePoint], duration_s: f64) -> Vec<EnvelopePoint> {
    let fall = |time_s: f64| (1.0 - time_s / duration_s).clamp(0.0, 1.0);
    let mut points: Vec<EnvelopePoint> =
        envelope.iter().map(|point| EnvelopePoint { level: point.level * fall(point.time_s), ..*point }).collect();
    if points.first().is_none_or(|first| first.time_s > 0.0) {
        points.insert(0, EnvelopePoint { time_s: 0.0, level: envelope_level_at(envelope, 0.0) });
    }
    points.push(EnvelopePoint { time_s: duration_s, level: 0.0 });
    points
}

impl Control {
    /// A `ParameterCurve` with its control points, or a `Parameter`, which counts from its time on.
    fn add_curve_or_value(&mut self, list: &mut EventList, value: &Value, name: &str, range: (f64, f64)) {
        let begin_s = number_at(value, "Time").unwrap_or(0.0);
        let Some(points) = value["ParameterCurveControlPoints"].as_array() else {
            let Some(level) = number_at(value, "ParameterValue") else {
                return list.warn(format!(
                    "{name} is left out: it has neither ParameterCurveControlPoints nor ParameterValue"
                ));
            };
            let level = list.clamp_with_warning(&format!("ParameterValue of {name}"), level, range);
            let point = |time_s| EnvelopePoint { time_s, level };
            self.curves.push(vec![point(begin_s), point(f64::MAX)]);
            return;
        };
        let mut curve = Vec::with_capacity(points.len());
        for (i, point) in points.iter().enumerate() {
            let (Some(time_s), Some(level)) = (number_at(point, "Time"), number_at(point, "ParameterValue")) else {
                list.warn(format!("control point {i} of {name} is left out: it has no Time or no ParameterValue"));
                continue;
            };
            let level = list.clamp_with_warning(&format!("ParameterValue of {name}"), level, range);
            curve.push(EnvelopePoint { time_s: begin_s + time_s, level });
        }
        curve.sort_by(|a, b| a.time_s.total_cmp(&b.time_s));
        if !curve.is_empty() {
            self.curves.push(curve);
        }
    }

    /// The value at a time, that of the curve that begins last; `None` where there is no curve.
    fn value_at(&self, time_s: f64) -> Option<f64> {
        let counts = |curve: &&Vec<EnvelopePoint>| {
            curve.first().is_some_and(|first| first.time_s <= time_s)
                && curve.last().is_some_and(|last| time_s <= last.time_s)
        };
        let begin = |curve: &&Vec<EnvelopePoint>| curve.first().map_or(0.0, |first| first.time_s);
        let last = self.curves.iter().filter(counts).max_by(|a, b| begin(a).total_cmp(&begin(b)))?;
        Some(envelope_level_at(last, time_s))
    }

    /// The factors between two times, as an envelope from the first one on; empty where they are 1.
    fn list_envelope_between(&self, from_s: f64, to_s: f64) -> Vec<EnvelopePoint> {
        let mut times: Vec<f64> =
            self.curves.iter().flatten().map(|point| point.time_s).filter(|t| from_s < *t && *t < to_s).collect();
        if times.is_empty() && self.value_at(from_s).is_none() {
            return Vec::new();
        }
        times.extend([from_s, to_s]);
        times.sort_by(f64::total_cmp);
        times.dedup();
        // On both sides of each time, as curves begin and end with steps.
        let beside_s = 1e-6;
        let mut envelope = Vec::with_capacity(2 * times.len());
        for time_s in times {
            for at_s in [time_s - beside_s, time_s + beside_s] {
                if (from_s..=to_s).contains(&at_s) {
                    let level = self.value_at(at_s).unwrap_or(1.0);
                    envelope.push(EnvelopePoint { time_s: at_s - from_s, level });
                }
            }
        }
        envelope
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effect_files::events::EventKind;

    const PATTERN: &str = r#"{
        "Version": 1.0,
        "Metadata": {"Project": "Basis", "Created": "2024", "Extra": 1},
        "Pattern": [
            {"Event": {"Time": 0.0, "EventType": "HapticTransient", "EventParameters": [
                {"ParameterID": "HapticIntensity", "ParameterValue": 0.8},
                {"ParameterID": "HapticSharpness", "ParameterValue": 0.4}]}},
            {"Event": {"Time": 0.1, "EventType": "HapticContinuous", "EventDuration": 0.4, "EventParameters": [
                {"ParameterID": "HapticIntensity", "ParameterValue": 0.5},
                {"ParameterID": "HapticSharpness", "ParameterValue": 0.2},
                {"ParameterID": "AttackTime", "ParameterValue": 0.3}]}},
            {"Event": {"Time": 0.2, "EventType": "AudioCustom", "EventWaveformPath": "a.wav"}},
            {"Event": {"Time": 0.9, "EventType": "HapticTransient", "EventParameters": [
                {"ParameterID": "HapticIntensity", "ParameterValue": 1.7}]}},
            {"ParameterCurve": {"ParameterID": "HapticIntensityControl", "Time": 0.1, "ParameterCurveControlPoints": [
                {"Time": 0.0, "ParameterValue": 0.0},
                {"Time": 0.2, "ParameterValue": 1.0},
            ]}},
            {"ParameterCurve": {"ParameterID": "HapticSharpnessControl", "Time": 0.1, "ParameterCurveControlPoints": [
                {"Time": 0.0, "ParameterValue": 0.5}, {"Time": 0.4, "ParameterValue": 0.5}]}},
        ],
    }"#;

    #[test]
    fn a_pattern_is_read_as_core_haptics_does() {
        let list = read_ahap_text(PATTERN).unwrap();
        assert_eq!((list.name.as_deref(), list.events.len()), (Some("Basis"), 3));
        assert_eq!(list.events[0], HapticEvent::new_transient(0.0, 0.8, 0.4));
        assert_eq!((list.events[2].intensity, list.events[2].sharpness), (1.0, DEFAULT_SHARPNESS));
        let held = &list.events[1];
        let EventKind::Continuous { duration_s, envelope } = &held.kind else { panic!("continuous") };
        assert!((*duration_s - 0.4).abs() < 1e-12 && (held.sharpness - 0.7).abs() < 1e-9);
        // The curve multiplies while it lasts; after its last point the event has its own intensity again.
        for (time_s, level) in [(0.1, 0.5), (0.15, 0.75), (0.25, 1.0), (0.4, 1.0)] {
            assert!((envelope_level_at(envelope, time_s) - level).abs() < 1e-4, "{time_s}: {envelope:?}");
        }
        let said = list.warnings.join("\n");
        for part in [
            "AudioCustom, which is a sound",
            "AttackTime of Pattern[1].Event is left out",
            "is 1.7, but must be 0 to 1: 1 is used",
            "Pattern[3].Event has no HapticSharpness: 0.1 is used",
        ] {
            assert!(said.contains(part), "{part}: {said}");
        }
        assert_eq!(list.warnings.len(), 4, "{said}");
    }

    #[test]
    fn what_is_missing_or_wrong_is_said_and_nothing_panics() {
        for (text, message) in [
            ("{", "the file is not a valid AHAP file"),
            ("[]", "the key `Pattern` is missing"),
            (r#"{"Pattern": 3}"#, "the key `Pattern` is missing, or is not a list"),
            (
                r#"{"Pattern": [1, {"Event": 2}, {"Event": {"EventType": "HapticContinuous"}}, {"Parameter": null}]}"#,
                "needs EventDuration",
            ),
        ] {
            let found = read_ahap_text(text).unwrap_err().to_string();
            assert!(found.contains(message), "{message}: {found}");
        }
        let parameter = r#"{"Pattern": [{"Parameter": {"ParameterID": "HapticIntensityControl", "ParameterValue": 0.5, "Time": 1}},
            {"Event": {"EventType": "HapticTransient"}}, {"Event": {"Time": 2, "EventType": "HapticTransient"}},
            {"Event": {"Time": 3, "EventType": "HapticContinuous", "EventDuration": 1, "EventParameters": [
                {"ParameterID": "Sustained", "ParameterValue": 0}]}}]}"#;
        let list = read_ahap_text(parameter).unwrap();
        let strengths: Vec<f64> = list.events.iter().map(|event| event.intensity).collect();
        assert_eq!(strengths, [0.5, 0.25, 0.5]);
        let EventKind::Continuous { envelope, .. } = &list.events[2].kind else { panic!("continuous") };
        assert!((envelope_level_at(envelope, 0.5) - 0.25).abs() < 1e-4, "half of a control of 0.5: {envelope:?}");
    }
}
