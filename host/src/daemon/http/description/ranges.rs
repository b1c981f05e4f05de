//! Ranges of what requests take, from the numbers by which they are checked.

use super::find_component_schema;
use crate::daemon::design::attachments::TABLES;
use crate::daemon::design::preview::MAX_SCENE;
use crate::daemon::live::controls::{self, MOST_CONTROLS};
use crate::daemon::touch::admission::MAX_NAME;
use crate::daemon::touch::request::{MAX_DURATION_MS, MAX_INTENSITY_G, MIN_DURATION_MS};
use crate::effect_files::MAX_TEXT_BYTES;
use crate::effect_files::own::{FIELD_RANGES, MAX_ENVELOPE_POINTS};
use crate::effects::intensity::{MAX_DB, MIN_DB};
use crate::effects::named::{COUNTS, PERIODS_MS};
use crate::planner::MAX_QUIET_ZONES;
use crate::planner::click::CRISP_RANGE_S;
use crate::planner::request::{MAX_QUIET_RADIUS_M, MAX_TARGETS};
use crate::planner::schedule::{MAX_WINDOW_MS, MIN_WINDOW_MS};
use crate::study::tolerances::MOST;
use serde_json::{Value, json};

/// Names of numbers in requests, with the least and most that each takes.
fn list_field_ranges() -> Vec<(&'static str, f64, f64)> {
    let (least_ms, most_ms) = (f64::from(MIN_DURATION_MS), f64::from(MAX_DURATION_MS));
    let no_most = f64::INFINITY;
    let mut all = vec![
        ("intensity_g", 0.0, MAX_INTENSITY_G),
        ("intensity_db", MIN_DB, MAX_DB),
        ("duration_ms", least_ms, most_ms),
        ("count", COUNTS.0, COUNTS.1),
        ("period_ms", PERIODS_MS.0, PERIODS_MS.1),
        ("crisp_ms", 1e3 * CRISP_RANGE_S.0, 1e3 * CRISP_RANGE_S.1),
        ("from_ms", 0.0, MAX_WINDOW_MS - MIN_WINDOW_MS),
        ("to_ms", MIN_WINDOW_MS, MAX_WINDOW_MS),
        ("x_px", 0.0, no_most),
        ("y_px", 0.0, no_most),
        ("radius_mm", 0.0, MAX_QUIET_RADIUS_M * 1e3),
        ("at_most_g", 0.0, no_most),
    ];
    all.extend(MOST.map(|(name, most)| (name, 0.0, most)));
    all
}

/// Puts the ranges into the schemas of requests.
pub fn insert_ranges_lengths_and_patterns_of_request_fields(document: &mut Value) {
    let requests = [
        "Touch",
        "Also",
        "QuietZone",
        "PreviewRequest",
        "TolerancesRequest",
        "WantedTolerances",
        "LiveIn",
        "Finger",
        "EffectFileRequest",
    ];
    for name in requests {
        let properties = find_component_schema(document, name).and_then(|schema| schema.get_mut("properties"));
        let Some(properties) = properties.and_then(Value::as_object_mut) else { continue };
        for (field, least, most) in list_field_ranges() {
            // A finger may be a little outside the screen.
            let may_be_below = name == "Finger" && matches!(field, "x_px" | "y_px");
            if let Some(own) = properties.get_mut(field).filter(|_| !may_be_below) {
                // What a preview is asked for is driven by nobody, and may be anything.
                let is_free = name == "PreviewRequest" && field == "intensity_g";
                set_minimum_and_maximum(own, least, if is_free { f64::INFINITY } else { most });
            }
        }
        let lists = [
            ("also", MAX_TARGETS - 1),
            ("quiet", MAX_QUIET_ZONES),
            ("touches", MAX_TARGETS),
            ("controls", MOST_CONTROLS),
        ];
        for (field, most) in lists {
            if let Some(own) = properties.get_mut(field) {
                own["maxItems"] = most.into();
            }
        }
        if let Some(scene) = properties.get_mut("scene") {
            // Bytes in fact, of which a character takes one or more.
            scene["maxLength"] = MAX_SCENE.into();
        }
        if let Some(file) = properties.get_mut("file") {
            file["maxLength"] = MAX_TEXT_BYTES.into();
        }
        if let Some(moves) = properties.get_mut("moves") {
            moves["propertyNames"] = json!({"pattern": format!("^({})\\[[1-9][0-9]*\\]$", TABLES.join("|"))});
        }
    }
    insert_ranges_of_nested_objects(document);
    insert_parameter_ranges_and_request_id_pattern(document);
}

fn insert_ranges_of_nested_objects(document: &mut Value) {
    let mut find_property = |schema: &str, field: &str, change: &dyn Fn(&mut Value)| {
        let properties = find_component_schema(document, schema).and_then(|schema| schema.get_mut("properties"));
        if let Some(property) = properties.and_then(|properties| properties.get_mut(field)) {
            change(property);
        }
    };
    for (schema, field, (least, most)) in FIELD_RANGES {
        find_property(schema, field, &|property| set_minimum_and_maximum(property, least, most));
    }
    for (field, (least, most)) in controls::FIELD_RANGES {
        find_property("Control", field, &|property| set_minimum_and_maximum(property, least, most));
    }
    find_property("FileEvent", "envelope", &|points| {
        (points["minItems"], points["maxItems"]) = (1.into(), MAX_ENVELOPE_POINTS.into());
    });
}

fn insert_parameter_ranges_and_request_id_pattern(document: &mut Value) {
    let operations = document["paths"].as_object_mut().into_iter().flat_map(|paths| paths.values_mut());
    for operation in operations.filter_map(Value::as_object_mut).flat_map(|item| item.values_mut()) {
        let parameters = operation.get_mut("parameters").and_then(Value::as_array_mut);
        for parameter in parameters.into_iter().flatten() {
            let name = parameter["name"].as_str().unwrap_or_default().to_owned();
            if name == "x-request-id" {
                // Not of digits alone: these are the daemon's own names.
                parameter["schema"]["pattern"] = format!("^(?=.*[A-Za-z_.-])[A-Za-z0-9_.-]{{1,{MAX_NAME}}}$").into();
                parameter["schema"]["maxLength"] = MAX_NAME.into();
            }
            if let Some((_, least, most)) = list_field_ranges().into_iter().find(|(known, ..)| *known == name) {
                set_minimum_and_maximum(&mut parameter["schema"], least, most);
            }
        }
    }
}

fn set_minimum_and_maximum(schema: &mut Value, minimum: f64, maximum: f64) {
    schema["minimum"] = to_json_number(minimum);
    if maximum.is_finite() {
        schema["maximum"] = to_json_number(maximum);
    }
}

/// A whole number as such: that of a count is one.
#[expect(clippy::cast_possible_truncation, reason = "whole and small")]
fn to_json_number(value: f64) -> Value {
    if value.fract() == 0.0 { json!(value as i64) } else { json!(value) }
}
