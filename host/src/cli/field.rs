//! The command `field`: a touch over the surface, or what else is mapped.

use super::args::At;
use super::args_field::Field;
use super::output::write_text_file_atomically;
use super::panel::{
    make_target_from_at_and_intensity_options, prepare_table_with_scene_finger_if_any_at_places,
    tell_missing_or_exceeded_plan_bounds, tell_why_bound_is_missing_or_largest_exceeds_tolerance,
};
use super::progress::run_with_progress;
use super::terminal_messages::tell;
use super::{CommandResult, Failure, field_click, print_json, print_text_after_queued_log, reach};
use crate::maps;
use crate::model::Bound;
use crate::study::tolerances;
use serde_json::json;

/// Runs it.
pub fn map_touch_click_or_reach_or_compare_drive_schemes(options: &Field) -> CommandResult {
    if let Some(effect) = options.effect {
        return field_click::compute_and_write_click_map_refusing_other_effects(options, effect);
    }
    if let Some(crisp_ms) = options.crispness.crisp_ms {
        return Err(Failure::usage_error(format!(
            "--crisp-ms is {crisp_ms}, but --crisp-ms is allowed only with --effect click"
        )));
    }
    if let Some(prefer) = options.crispness.prefer {
        return Err(Failure::usage_error(format!(
            "--prefer is {}, but --prefer is allowed only with --effect click",
            prefer.name()
        )));
    }
    let at = match options.at {
        _ if options.reach => return reach::compute_and_write_reach_maps(options),
        _ if options.schemes => return reach::compare_drive_schemes_and_write_result(options),
        Some(at) => At { at, unit: options.unit, intensity_g: options.intensity_g },
        None => {
            return Err(Failure::usage_error(
                "one of the options --at X,Y, --effect click, --reach and --schemes is required",
            ));
        }
    };
    let scene = options.panel.load_scene()?;
    let target = make_target_from_at_and_intensity_options(&scene, &at)?;
    let touched = [(target.x_m, target.y_m)];
    let table = prepare_table_with_scene_finger_if_any_at_places(&options.panel, options.keep, &scene, &touched)?;
    let plan = table.plan(&[target])?;
    let field = maps::PeakField::from_plan(&table, &plan);
    let bound = crate::planner::plan::bound_field_error_relative_to_largest_peak(&table, &plan);
    let accuracy = options.panel.accuracy()?;
    tell_why_bound_is_missing_or_largest_exceeds_tolerance(&[bound], accuracy);
    tell_missing_or_exceeded_plan_bounds(&[&plan], accuracy, options.panel.explain);
    if let Some(path) = &options.png {
        reach::tell_picture_written(
            path,
            maps::write_field_png(path, &scene, &plan, &field).map_err(Failure::runtime_error)?,
        );
    }
    if let (Some(bound), false) = (bound.limit_if_known(), options.json) {
        tell!(
            "accuracy: each value differs from the exact solution of the model by at most {bound:.0e} times the largest peak on the surface"
        );
    }
    let to_output = options.csv.as_ref().is_some_and(|path| path.as_os_str() == "-");
    if let Some(path) = options.csv.as_ref().filter(|_| !to_output) {
        write_text_file_atomically(path, &field.to_csv())?;
    }
    let off = options.spread.map(|off| {
        let looked = || tolerances::compute_target_peak_spread_under_tolerances(&scene, &touched, &plan, off);
        run_with_progress("computing the changes of the peak for panels that deviate from the scene", looked)
            .map_err(Failure::runtime_error)
    });
    let off = off.transpose()?;
    if options.json {
        let mut map = json!(field);
        // As the daemon's.
        (map["nx"], map["ny"]) = (json!(field.x_mm.len()), json!(field.y_mm.len()));
        map["max_g"] = json!(field.peak_g.iter().flatten().copied().fold(0.0, f64::max));
        let mut answer = json!({
            "plan": plan, "field": map, "error_bound": bound.limit_if_known(), "tolerance": accuracy.relative_tolerance_or_tightest(),
            "tolerance_met": Bound::all_meet_tolerance_if_given_and_decidable(&[bound], accuracy),
        });
        if let Some(off) = off {
            answer["off"] = json!(off);
        }
        return print_json(&answer);
    }
    if let Some(off) = off {
        tell!("{}", off.describe_in_words());
    }
    if to_output || options.png.is_none() && options.csv.is_none() {
        return print_text_after_queued_log(field.to_csv().trim_end());
    }
    Ok(())
}
