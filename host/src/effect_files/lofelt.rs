//! Lofelt's `.haptic`, version 1, as its data model describes it.
//!
//! Amplitudes are those of a signal; the intensities of AHAP, which count here, are their square roots, as in Lofelt's own conversion to AHAP. It
//! also weakens the vibration at a point with emphasis to 0.8, so that the pulse is felt.

use super::error::ReadError;
use super::events::{EnvelopePoint, EventList, HapticEvent, find_mean_level};
use super::format::FileFormat;
use super::json::{number_at, parse_lenient_json, text_at};
use serde_json::Value;

/// What is left of the vibration at a point with emphasis.
const BESIDE_EMPHASIS: f64 = 0.8;

/// Reads a text of a `.haptic` file.
///
/// # Errors
/// [`ReadError`] for what is no JSON, of another version, or without amplitudes.
pub fn read_lofelt_text(text: &str) -> Result<EventList, ReadError> {
    let whole = parse_lenient_json(text, FileFormat::Haptic)?;
    let mut list = EventList::new(FileFormat::Haptic, text_at(&whole["metadata"], "project").map(str::to_owned));
    match number_at(&whole["version"], "major") {
        Some(1.0) => {}
        Some(major) => return Err(ReadError::new_field_error("version.major", major, "1")),
        None => list.warn("version.major is missing: 1 is used"),
    }
    let envelopes = &whole["signals"]["continuous"]["envelopes"];
    let mut points: Vec<EnvelopePoint> = Vec::new();
    for (i, point) in list_points(&mut list, &envelopes["amplitude"], "amplitude") {
        let name = format!("envelopes.amplitude[{i}]");
        let (time_s, amplitude) = (point.0, list.clamp_with_warning(&format!("{name}.amplitude"), point.1, (0.0, 1.0)));
        let mut level = amplitude.sqrt();
        if let Some(emphasis) = envelopes["amplitude"][i].get("emphasis").filter(|emphasis| emphasis.is_object()) {
            let (strength, sharpness) = (number_at(emphasis, "amplitude"), number_at(emphasis, "frequency"));
            match strength.zip(sharpness) {
                Some((strength, sharpness)) => {
                    let strength = list.clamp_with_warning(&format!("{name}.emphasis.amplitude"), strength, (0.0, 1.0));
                    level *= BESIDE_EMPHASIS;
                    list.add_event_within_limits(
                        &format!("{name}.emphasis"),
                        HapticEvent::new_transient(time_s, strength.sqrt(), sharpness),
                    );
                }
                None => list.warn(format!("{name}.emphasis is left out: it has no amplitude or no frequency")),
            }
        }
        points.push(EnvelopePoint { time_s, level });
    }
    let mut sharpness: Vec<EnvelopePoint> = Vec::new();
    for (i, (time_s, frequency)) in list_points(&mut list, &envelopes["frequency"], "frequency") {
        let frequency = list.clamp_with_warning(&format!("envelopes.frequency[{i}].frequency"), frequency, (0.0, 1.0));
        sharpness.push(EnvelopePoint { time_s, level: frequency.sqrt() });
    }
    if let (Some(first), Some(last)) = (points.first().copied(), points.last().copied())
        && last.time_s > first.time_s
    {
        let duration_s = last.time_s - first.time_s;
        points.iter_mut().for_each(|point| point.time_s -= first.time_s);
        let mean = find_mean_level(&sharpness).unwrap_or(0.0);
        if sharpness.iter().any(|point| (point.level - mean).abs() > 0.1) {
            list.warn(format!(
                "envelopes.frequency, which sets the sharpness of the vibration, changes over time, but the program plays \
                 a vibration with one constant sharpness: the mean, {mean:.2}, is used"
            ));
        }
        list.add_event_within_limits(
            "envelopes.amplitude",
            HapticEvent::new_continuous((first.time_s, duration_s), 1.0, mean, points),
        );
    }
    list.finish()
}

/// The points of an envelope with their places in the file: time in s, and value.
fn list_points(list: &mut EventList, envelope: &Value, value_key: &str) -> Vec<(usize, (f64, f64))> {
    let mut points: Vec<(usize, (f64, f64))> = Vec::new();
    for (i, point) in envelope.as_array().into_iter().flatten().enumerate() {
        let name = format!("envelopes.{value_key}[{i}]");
        let Some((time_s, value)) = number_at(point, "time").zip(number_at(point, value_key)) else {
            list.warn(format!("{name} is left out: it has no time or no {value_key}"));
            continue;
        };
        let before_s = points.last().map_or(0.0, |(_, (before_s, _))| *before_s);
        if time_s < before_s {
            list.warn(format!(
                "{name} is left out: its time is {time_s} s, but must be at least {before_s} s (the time of the \
                previous point; 0 s for the first point)"
            ));
            continue;
        }
        points.push((i, (time_s, value)));
    }
    points
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effect_files::ahap::read_ahap_text;
    use crate::effect_files::events::{EventKind, envelope_level_at};

    const CLIP: &str = r#"{
        "version": {"major": 1, "minor": 0, "patch": 0},
        "metadata": {"editor": "by hand", "project": "ramp", "tags": []},
        "signals": {"continuous": {"envelopes": {
            "amplitude": [
                {"time": 0.0, "amplitude": 0.04},
                {"time": 0.2, "amplitude": 0.25, "emphasis": {"amplitude": 0.64, "frequency": 0.3}},
                {"time": 0.4, "amplitude": 0.09}],
            "frequency": [{"time": 0.0, "frequency": 0.49}, {"time": 0.4, "frequency": 0.49}]}}}}"#;

    /// What Lofelt's conversion makes of the same clip, by hand from its source: curves of square roots, and one event with intensity 1 and
    /// sharpness 0 under them.
    const CONVERTED: &str = r#"{"Version": 1.0, "Metadata": {"Project": "ramp"}, "Pattern": [
        {"ParameterCurve": {"ParameterID": "HapticIntensityControl", "Time": 0.0, "ParameterCurveControlPoints": [
            {"Time": 0.0, "ParameterValue": 0.2}, {"Time": 0.2, "ParameterValue": 0.4}, {"Time": 0.4, "ParameterValue": 0.3}]}},
        {"ParameterCurve": {"ParameterID": "HapticSharpnessControl", "Time": 0.0, "ParameterCurveControlPoints": [
            {"Time": 0.0, "ParameterValue": 0.7}, {"Time": 0.4, "ParameterValue": 0.7}]}},
        {"Event": {"EventType": "HapticContinuous", "Time": 0.0, "EventDuration": 0.4, "EventParameters": [
            {"ParameterID": "HapticIntensity", "ParameterValue": 1.0}, {"ParameterID": "HapticSharpness", "ParameterValue": 0.0}]}},
        {"Event": {"EventType": "HapticTransient", "Time": 0.5, "EventParameters": [
            {"ParameterID": "HapticIntensity", "ParameterValue": 0.8}, {"ParameterID": "HapticSharpness", "ParameterValue": 0.3}]}}]}"#;

    #[test]
    fn a_clip_is_what_its_conversion_to_ahap_is() {
        let (own, converted) = (read_lofelt_text(CLIP).unwrap(), read_ahap_text(CONVERTED).unwrap());
        assert_eq!((own.name.as_deref(), &own.warnings[..]), (Some("ramp"), &[][..]));
        let held = |list: &EventList| {
            let of = |event: &HapticEvent| match &event.kind {
                EventKind::Continuous { duration_s, envelope } => {
                    Some((event.time_s, *duration_s, event.intensity, event.sharpness, envelope.clone()))
                }
                EventKind::Transient => None,
            };
            list.events.iter().find_map(of).unwrap()
        };
        let (own_held, other) = (held(&own), held(&converted));
        assert!((own_held.3 - other.3).abs() < 1e-9, "{own_held:?} {other:?}");
        assert_eq!((own_held.0, own_held.1, own_held.2), (other.0, other.1, other.2));
        for step in 0..40 {
            let at_s = 0.01 * f64::from(step);
            let (found, expected) = (envelope_level_at(&own_held.4, at_s), envelope_level_at(&other.4, at_s));
            assert!((found - expected).abs() < 1e-4, "{at_s}: {found} {expected}");
        }
        // Apart from its time, which is beyond the curves there, where they do not count.
        let pulse = |list: &EventList| {
            let is = |event: &&HapticEvent| event.kind == EventKind::Transient;
            list.events.iter().find(is).map(|event| (event.intensity, event.sharpness)).unwrap()
        };
        assert_eq!(pulse(&own), pulse(&converted));
    }

    #[test]
    fn what_is_wrong_is_said() {
        let version = r#"{"version": {"major": 2}, "signals": {}}"#;
        assert_eq!(read_lofelt_text(version).unwrap_err().to_string(), "version.major is 2, but must be 1");
        let text = r#"{"signals": {"continuous": {"envelopes": {"amplitude": [
            {"time": 0, "amplitude": 2}, {"time": 1}, {"time": 1, "amplitude": 0.5, "emphasis": {"amplitude": 1}}, {"time": 0.5, "amplitude": 1}]}}}}"#;
        let said = read_lofelt_text(text).unwrap().warnings.join("\n");
        for part in [
            "version.major is missing",
            "envelopes.amplitude[0].amplitude is 2",
            "envelopes.amplitude[1] is left out: it has no time or no amplitude",
            "envelopes.amplitude[2].emphasis is left out",
            "envelopes.amplitude[3] is left out: its time is 0.5 s, but must be at least 1",
        ] {
            assert!(said.contains(part), "{part}: {said}");
        }
        assert!(read_lofelt_text("{\"signals\": []}").is_err());
    }
}
