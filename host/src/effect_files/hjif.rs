//! HJIF, the JSON form of ISO/IEC 23090-31, read as its reference software reads it: what an object lacks leaves that object out.

use super::error::ReadError;
use super::events::EventList;
use super::format::FileFormat;
use super::json::{number_at, parse_lenient_json, text_at};
use super::mpeg::{
    BandKind, EffectKind, Keyframe, MpegBand, MpegChannel, MpegEffect, MpegHaptics, MpegPerception,
    add_events_of_haptics,
};
use serde_json::Value;

/// Ticks per s if the file does not say.
const DEFAULT_TICKS_PER_S: f64 = 1000.0;
/// Effects inside each other that are read.
const MAX_DEPTH: usize = 8;

/// Reads a text of HJIF.
///
/// # Errors
/// [`ReadError`] for what is no JSON, or has no perceptions.
pub fn read_hjif_text(text: &str) -> Result<EventList, ReadError> {
    let whole = parse_lenient_json(text, FileFormat::Hjif)?;
    let mut list = EventList::new(FileFormat::Hjif, text_at(&whole, "description").map(str::to_owned));
    for key in ["version", "profile", "level", "date"] {
        if whole.get(key).is_none() {
            list.warn(format!("the key `{key}` is missing, but the standard requires this key"));
        }
    }
    let Some(perceptions) = whole["perceptions"].as_array() else {
        let detail = "the key `perceptions` is missing, or is not a list".into();
        return Err(ReadError::Syntax { format: FileFormat::Hjif, detail });
    };
    let ticks_per_s = number_at(&whole, "timescale").unwrap_or(DEFAULT_TICKS_PER_S);
    if !(1.0..=1e9).contains(&ticks_per_s) {
        return Err(ReadError::new_field_error("timescale", ticks_per_s, "1 to 1e9"));
    }
    let mut haptics = MpegHaptics { ticks_per_s, perceptions: Vec::new() };
    for (p, perception) in perceptions.iter().enumerate() {
        let name = format!("perceptions[{p}]");
        let channels = list_entries(&mut list, perception, "channels", &name);
        haptics.perceptions.push(MpegPerception {
            id: number_as_id(perception, "id"),
            modality: text_at(perception, "perception_modality").unwrap_or("Other").to_owned(),
            library: perception["effect_library"]
                .as_array()
                .into_iter()
                .flatten()
                .map(|own| read_effect(own, 0))
                .collect(),
            channels: channels
                .iter()
                .enumerate()
                .map(|(c, own)| read_channel(&mut list, own, &format!("{name}.channels[{c}]")))
                .collect(),
        });
    }
    add_events_of_haptics(&mut list, &haptics);
    list.finish()
}

/// The entries of a list that has to be there.
fn list_entries(list: &mut EventList, value: &Value, key: &str, name: &str) -> Vec<Value> {
    value[key].as_array().cloned().unwrap_or_else(|| {
        list.warn(format!("{name} is left out: its key `{key}` is missing, or is not a list"));
        Vec::new()
    })
}

fn read_channel(list: &mut EventList, channel: &Value, name: &str) -> MpegChannel {
    let mut bands = Vec::new();
    for (b, band) in list_entries(list, channel, "bands", name).iter().enumerate() {
        let name = format!("{name}.bands[{b}]");
        let kind = match text_at(band, "band_type") {
            Some("Transient") => BandKind::Transient,
            Some("Curve") => BandKind::Curve,
            Some("VectorialWave") => BandKind::VectorialWave,
            Some("WaveletWave") => BandKind::WaveletWave,
            other => {
                let other = other.unwrap_or("missing");
                list.warn(format!("{name} is left out: its band_type is {other}, but must be Transient, Curve, VectorialWave or WaveletWave"));
                continue;
            }
        };
        let limit = |key: &str, default: f64| number_at(band, key).unwrap_or(default);
        bands.push(MpegBand {
            id: 0,
            kind,
            limits_hz: (limit("lower_frequency_limit", 0.0), limit("upper_frequency_limit", 1000.0)),
            effects: list_entries(list, band, "effects", &name).iter().map(|own| read_effect(own, 0)).collect(),
        });
    }
    MpegChannel { id: number_as_id(channel, "id"), gain: number_at(channel, "gain").unwrap_or(1.0), bands }
}

fn read_effect(effect: &Value, depth: usize) -> MpegEffect {
    let keyframe = |own: &Value| Keyframe {
        position: number_at(own, "relative_position"),
        amplitude: number_at(own, "amplitude_modulation"),
        frequency_hz: number_at(own, "frequency_modulation"),
    };
    // Drafts called them so; the reference software has no effects of effects in JSON.
    let parts = effect["composition"].as_array().or_else(|| effect["timeline"].as_array());
    MpegEffect {
        id: number_as_id(effect, "id"),
        kind: match text_at(effect, "effect_type") {
            Some("Reference") => EffectKind::Reference,
            Some("Composite") => EffectKind::Composite,
            _ => EffectKind::Basis,
        },
        position: number_at(effect, "position").unwrap_or(0.0),
        keyframes: effect["keyframes"].as_array().into_iter().flatten().map(keyframe).collect(),
        parts: match parts {
            Some(parts) if depth < MAX_DEPTH => parts.iter().map(|own| read_effect(own, depth + 1)).collect(),
            _ => Vec::new(),
        },
    }
}

#[expect(clippy::cast_possible_truncation, reason = "`as` saturates")]
fn number_as_id(value: &Value, key: &str) -> i64 {
    number_at(value, key).unwrap_or(-1.0) as i64
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effect_files::events::{EventKind, envelope_level_at};

    const FILE: &str = r#"{
        "version": "2023", "profile": "Main", "level": 1, "date": "2024-05-01", "description": "by hand", "timescale": 1000,
        "perceptions": [{
            "id": 0, "avatar_id": 0, "description": "", "perception_modality": "Vibrotactile",
            "effect_library": [{"id": 7, "effect_type": "Basis", "position": 99, "phase": 0, "base_signal": "Sine", "keyframes": [
                {"relative_position": 0, "amplitude_modulation": 0.4, "frequency_modulation": 300}]}],
            "channels": [{"id": 0, "description": "", "gain": 0.5, "mixing_coefficient": 1, "body_part_mask": 0, "bands": [
                {"band_type": "Transient", "lower_frequency_limit": 65, "upper_frequency_limit": 300, "effects": [
                    {"effect_type": "Basis", "position": 100, "phase": 0, "base_signal": "Sine", "keyframes": [
                        {"relative_position": 0, "amplitude_modulation": 1.0, "frequency_modulation": 182},
                        {"relative_position": 50, "amplitude_modulation": -0.5, "frequency_modulation": 65}]},
                    {"effect_type": "Reference", "id": 7, "position": 400}, {"effect_type": "Reference", "id": 8, "position": 0}]},
                {"band_type": "VectorialWave", "lower_frequency_limit": 0, "upper_frequency_limit": 1000, "effects": [
                    {"effect_type": "Basis", "position": 1000, "phase": 0, "base_signal": "Sine", "keyframes": [
                        {"relative_position": 0, "frequency_modulation": 100},
                        {"relative_position": 100, "amplitude_modulation": 0.4},
                        {"relative_position": 200, "amplitude_modulation": 0.8, "frequency_modulation": 100},
                        {"relative_position": 400, "frequency_modulation": 100}]}]},
                {"band_type": "WaveletWave", "block_length": 32, "lower_frequency_limit": 0, "upper_frequency_limit": 1000, "effects": []}]}]},
            {"id": 1, "perception_modality": "Temperature", "channels": []}],
        "avatars": [], "syncs": []}"#;

    #[test]
    fn bands_become_events_as_the_reference_software_evaluates_them() {
        let list = read_hjif_text(FILE).unwrap();
        let pulses: Vec<(f64, f64, f64)> = list
            .events
            .iter()
            .filter(|event| event.kind == EventKind::Transient)
            .map(|event| (event.time_s, event.intensity, event.sharpness))
            .collect();
        // Gain 0.5; 182 Hz is (182 - 65) / 235.
        assert_eq!(pulses, [(0.1, 0.5, 117.0 / 235.0), (0.15, 0.25, 0.0), (0.4, 0.2, 1.0)]);
        let wave = list.events.last().unwrap();
        let EventKind::Continuous { duration_s, envelope } = &wave.kind else { panic!("a wave") };
        assert!(
            (wave.time_s, *duration_s, wave.intensity) == (1.0, 0.4, 1.0)
                && (wave.sharpness - 35.0 / 235.0).abs() < 1e-9
        );
        for (time_s, level) in [(0.05, 0.2), (0.15, 0.3), (0.3, 0.4)] {
            assert!((envelope_level_at(envelope, time_s) - level).abs() < 1e-9, "{time_s}");
        }
        let said = list.warnings.join("\n");
        for part in [
            "the effect library of its perception has no effect `8`",
            "bands[2] is left out: its effects are wavelets",
            "perceptions[1] is left out: its modality is Temperature",
        ] {
            assert!(said.contains(part), "{part}: {said}");
        }
        assert_eq!(list.warnings.len(), 3, "{said}");
    }

    #[test]
    fn circles_of_references_end() {
        let text =
            FILE.replacen("\"id\": 7, \"effect_type\": \"Basis\"", "\"id\": 7, \"effect_type\": \"Reference\"", 1);
        let list = read_hjif_text(&text).unwrap();
        assert!(list.warnings.join("\n").contains("nested more than 8 levels deep"), "{:?}", list.warnings);
        assert!(
            read_hjif_text("{\"perceptions\": 1}")
                .unwrap_err()
                .to_string()
                .contains("the key `perceptions` is missing")
        );
        let error = read_hjif_text("{\"perceptions\": [], \"timescale\": 0}").unwrap_err().to_string();
        assert_eq!(error, "timescale is 0, but must be 1 to 1e9");
    }
}
