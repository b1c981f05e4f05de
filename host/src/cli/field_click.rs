//! `era field --effect click`: a click at every place of the surface.

use super::args_field::Field;
use super::panel::{check_has_actuators, load_or_compute_plan_table};
use super::progress::run_with_progress;
use super::reach::{format_place, tell_picture_written, write_csv_if_asked_true_if_to_stdout};
use super::terminal_messages::tell;
use super::{CommandResult, Failure, print_json, print_text_after_queued_log};
use crate::effects::{DesignError, EffectRequest, NamedEffect};
use crate::planner::maps::ClickMap;
use crate::planner::maps::clicks::{ClickMapError, PlaceClick};
use serde_json::json;
use std::fmt::Write;

/// Most places that are listed as not crisp.
const MOST_LISTED: usize = 10;

impl From<ClickMapError> for Failure {
    fn from(error: ClickMapError) -> Self {
        match error {
            ClickMapError::Plan(error) => error.into(),
            ClickMapError::Design(DesignError::Request(error)) => Failure::usage_error(error),
            ClickMapError::Design(DesignError::Unbounded) | ClickMapError::NoPlaces { .. } => {
                Failure::runtime_error(error)
            }
        }
    }
}

/// Designs the click at every place, and writes what is asked for.
pub fn compute_and_write_click_map_refusing_other_effects(options: &Field, effect: NamedEffect) -> CommandResult {
    if effect != NamedEffect::Click {
        return Err(Failure::usage_error(format!("--effect is {}, but must be click", effect.name())));
    }
    let request = EffectRequest {
        crisp_ms: options.crispness.crisp_ms,
        prefer: options.crispness.prefer,
        ..EffectRequest::with_defaults(effect)
    };
    request.build_envelope_or_plain_push_if_click().map_err(Failure::usage_error)?;
    let scene = options.panel.load_scene()?;
    check_has_actuators(&scene)?;
    if scene.finger.is_some() {
        tell!("the scene's [finger] is not used: clicks are designed for the panel without a finger");
    }
    let table = load_or_compute_plan_table(&options.panel, options.keep, &scene)?;
    let map = run_with_progress("designing a click at every place", || {
        ClickMap::compute(&table, request, options.intensity_g)
    })?;
    if let Some(path) = &options.png {
        tell_picture_written(path, map.write_quiet_time_png(path, &scene).map_err(Failure::runtime_error)?);
    }
    if write_csv_if_asked_true_if_to_stdout(options, &map.to_csv())? {
        return Ok(());
    }
    if options.json {
        return print_json(&json!({
            "scene": scene.name, "intensity_g": map.intensity_g, "crisp_share": map.crisp_share(),
            "least_peak_g": map.find_weakest_place().map(|place| place.peak_g), "places": map.places().collect::<Vec<_>>(),
        }));
    }
    print_text_after_queued_log(&format!(
        "{}, clicks of {} g\n{}",
        scene.name,
        map.intensity_g,
        describe_click_map(&map)
    ))
}

/// The figures of a map, and the places that are not crisp, those that are quiet last first.
fn describe_click_map(map: &ClickMap) -> String {
    let mut text = format!(
        "crisp (from the start of the click: peak within 15 ms, motion below a tenth of the peak after {} ms): {:.0} % of {} places",
        map.crisp_ms,
        1e2 * map.crisp_share(),
        map.places().count()
    );
    if let Some(weakest) = map.find_weakest_place() {
        let place = format_place([weakest.x_mm, weakest.y_mm]);
        let _ = write!(text, "\nlowest peak: {:.3} g at {place}", weakest.peak_g);
    }
    let median = map
        .median_time_until_quiet_ms_unless_half_never_quiet()
        .map_or_else(|| "never".to_owned(), |ms| format!("{ms:.1} ms"));
    let _ = write!(text, "\nquiet time (median): {median}");
    let mut rest: Vec<&PlaceClick> = map.places().filter(|place| !place.crisp).collect();
    let quiet_ms = |place: &PlaceClick| place.quiet_ms.unwrap_or(f64::INFINITY);
    rest.sort_by(|a, b| quiet_ms(b).total_cmp(&quiet_ms(a)));
    if !rest.is_empty() {
        let _ = write!(text, "\nnot crisp:");
    }
    let listed = if rest.len() > MOST_LISTED { MOST_LISTED - 1 } else { MOST_LISTED };
    for place in rest.iter().take(listed) {
        let _ = write!(
            text,
            "\n  {}: peak {:.3} g after {:.1} ms, {}",
            format_place([place.x_mm, place.y_mm]),
            place.peak_g,
            place.peak_at_ms,
            place.quiet_ms.map_or_else(|| "never quiet".to_owned(), |ms| format!("quiet after {ms:.1} ms"))
        );
    }
    if rest.len() > listed {
        let _ = write!(text, "\n  and {} more places (--csv writes all places)", rest.len() - listed);
    }
    text
}
