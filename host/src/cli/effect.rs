//! `era effect`: an effect as the board would play it, and what the panel would do.

use super::args_effect::EffectOptions;
use super::effect_file::{
    design_effect_file_for_panel_print_and_export_if_asked, write_accelerations_as_png_csv_or_wav_by_extension,
};
use super::effect_finger::{ClickPanels, measure_clicks_across_finger_unless_undamped};
use super::panel::{
    collect_plan_bounds, load_or_compute_plan_table, make_target_from_at_and_intensity_options,
    prepare_table_with_scene_finger_if_any_at_places, tell_missing_or_exceeded_plan_bounds,
};
use super::{CommandResult, Failure, print_json, print_text_after_queued_log};
use crate::effect_files::motion::RATE_HZ;
use crate::effects::{
    self, DesignError, EffectRequest, Intensity, NamedEffect, design_effect,
    design_effect_of_windows_if_common_click_exists_else_of_drives, intensity,
    plan_request_with_intensity_for_targets_without_one, sample_acceleration_of_design_unless_undamped_m_per_s2,
};
use crate::model::Bound;
use crate::planner::click::ClickOptions;
use crate::planner::click::measures::ClickMeasures;
use crate::planner::rise::PanelPoles;
use crate::planner::{Request, STANDARD_GRAVITY};
use serde_json::{Value, json};
use std::fmt::Write;
use std::time::Instant;

pub fn design_and_print_effect(options: &EffectOptions) -> CommandResult {
    if let Some(path) = &options.from_file.file {
        return design_effect_file_for_panel_print_and_export_if_asked(options, path);
    }
    if let Some(option) = options.from_file.find_given_option_that_requires_missing_file() {
        return Err(Failure::usage_error(format!("{option} is given, but is allowed only with --file")));
    }
    let scene = options.panel.load_scene()?;
    let effect = options
        .name
        .or(options.effect)
        .ok_or_else(|| Failure::usage_error("no effect is named: use `era effect NAME`"))?;
    let request = EffectRequest {
        effect,
        duration_ms: options.duration_ms,
        count: options.rhythm.count,
        period_ms: options.rhythm.period_ms,
        crisp_ms: options.crispness.crisp_ms,
        prefer: options.crispness.prefer,
    };
    request.build_envelope_or_plain_push_if_click().map_err(Failure::usage_error)?;
    let target = make_target_from_at_and_intensity_options(&scene, &options.at)?;
    let table = prepare_table_with_scene_finger_if_any_at_places(
        &options.panel,
        options.keep,
        &scene,
        &[(target.x_m, target.y_m)],
    )?;
    let rise = PanelPoles::find_poles_if_converged(&table.model)
        .ok_or(DesignError::Unbounded)
        .map_err(Failure::runtime_error)?;
    let wanted = options.at.intensity_g.map(Intensity::G).or(options.intensity_db.map(Intensity::AboveThresholdDb));
    let plan = plan_request_with_intensity_for_targets_without_one(
        &table,
        || Some(&rise),
        &Request::for_touch(&[target]),
        wanted,
    )?;
    let started = Instant::now();
    let click = ClickOptions { with_best_possible: true, ..request.click_options() };
    let design = if options.envelopes {
        design_effect(&table, &rise, &plan, request)
    } else {
        design_effect_of_windows_if_common_click_exists_else_of_drives(&table, &rise, &plan, request, click)
    };
    let design = design.map_err(Failure::runtime_error)?;
    let elapsed_ms = started.elapsed().as_secs_f64() * 1e3;
    let finger = match scene.finger {
        Some(_) if effect == NamedEffect::Click => {
            let bare = load_or_compute_plan_table(&options.panel, options.keep, &scene)?;
            let panels = ClickPanels { bare: &bare, with_finger: &table, rise_with_finger: &rise };
            let request_of_touch = Request::for_touch(&[target]);
            let bare_plan = plan_request_with_intensity_for_targets_without_one(
                &bare,
                || bare.panel_poles(),
                &request_of_touch,
                wanted,
            )?;
            measure_clicks_across_finger_unless_undamped(&panels, &bare_plan, request, &design)
        }
        Some(_) | None => None,
    };
    let shape = intensity::mode_shape_values_at_point_or_on_bar_axis(&table, target.x_m, target.y_m);
    if let Some(export) = &options.from_file.export {
        let step_s = 1.0 / f64::from(RATE_HZ);
        let samples_g = sample_acceleration_of_design_unless_undamped_m_per_s2(&table, &rise, &design, &shape, step_s)
            .ok_or(DesignError::Unbounded)
            .map_err(Failure::runtime_error)?
            .into_iter()
            .map(|acceleration| acceleration / STANDARD_GRAVITY)
            .collect();
        let title = format!("{}: {}", scene.name, effect.name());
        let place_mm = (1e3 * target.x_m, 1e3 * target.y_m);
        write_accelerations_as_png_csv_or_wav_by_extension(export, &title, &[place_mm], &[samples_g])?;
    }
    let drives = intensity::list_switched_forces_of_plan(&table, &plan);
    let accuracy = options.panel.accuracy()?;
    tell_missing_or_exceeded_plan_bounds(&[&plan], accuracy, options.panel.explain);
    let (timing, level_db) = (
        rise.find_rise_and_decay_times(&shape, &drives),
        intensity::level_above_threshold_at_point_if_any_motion_db(&rise, &shape, &drives),
    );
    if options.json {
        let mut answer = json!(effects::view::EffectView::new(&design));
        answer["elapsed_ms"] = json!(elapsed_ms);
        answer["plan"] = json!(plan);
        answer["tolerance"] = json!(accuracy.relative_tolerance_or_tightest());
        answer["tolerance_met"] =
            json!(Bound::all_meet_tolerance_if_given_and_decidable(&collect_plan_bounds(&[&plan]), accuracy));
        answer["plan_timing"] = json!(timing);
        // The same as the daemon says it.
        answer["times"] = json!(crate::planner::report::compute_rise_and_decay_times_at_first_target(&table, &plan));
        answer["plan_level_db"] = json!(level_db);
        if let Some(own) = &finger {
            let view = |own: &ClickMeasures| {
                let quiet_ms = own.quiet_s.map(|quiet_s| 1e3 * quiet_s);
                let crisp = click.does_motion_peak_and_become_quiet_in_time(own);
                json!({"peak_g": own.peak / STANDARD_GRAVITY, "peak_at_ms": 1e3 * own.peak_s, "quiet_ms": quiet_ms, "crisp": crisp})
            };
            answer["without_finger"] = own.same_windows_without_finger.as_ref().map_or(Value::Null, view);
            answer["played_by_daemon"] = own.daemon_windows_with_finger.as_ref().map_or(Value::Null, view);
        }
        return print_json(&answer);
    }
    let predicted = design.predicted;
    let mut text = format!("{} at {:.1} mm, {:.1} mm", effect.name(), 1e3 * plan.target_m[0], 1e3 * plan.target_m[1]);
    for designed in &design.drives {
        let drive = &designed.drive;
        let _ = write!(
            text,
            "\n  {:12} {:7.2} Hz  {:7.1} V  {:.4} N  {}",
            drive.actuator,
            drive.frequency_hz,
            drive.voltage_v,
            drive.force_n,
            effects::view::describe_segments(designed)
        );
    }
    for window in &design.windows {
        let effects::EffectWindow { actuator, electrode, begin_us, width_us, voltage_v, .. } = window;
        let _ = write!(
            text,
            "\n  {actuator:12} {electrode:?} from {begin_us:8.1} us for {width_us:6.1} us at {voltage_v:.0} V"
        );
    }
    let _ = match design.windows.is_empty() {
        true => write!(
            text,
            "\npeak {:.3} g ({:.3} to {:.3} g, depending on the phases of the drives) {:.1} ms after the start",
            predicted.peak_g, predicted.peak_least_g, predicted.peak_most_g, predicted.peak_at_ms
        ),
        false => write!(text, "\npeak {:.3} g {:.1} ms after the start", predicted.peak_g, predicted.peak_at_ms),
    };
    if effect == NamedEffect::DoubleClick && !design.windows.is_empty() {
        let _ = write!(text, "\npeak of the weaker one of the two clicks: {:.3} g", predicted.peak_least_g);
    }
    if let Some(best_g) = predicted.best_possible_g {
        let _ = write!(
            text,
            "\nlargest possible peak of a crisp click (with any forces for 30 ms, each at most the force of an electrode on \
             a mass at rest): {best_g:.3} g"
        );
    }
    if let (Some(pulse_ms), Some(ratio)) = (predicted.pulse_ms, predicted.pulse_to_ring_db) {
        let _ = write!(text, "\npulse of {pulse_ms:.1} ms, {ratio:.1} dB above the vibration after the pulse");
        if let Some(sharpness) = predicted.sharpness_db_per_ms {
            let _ = write!(text, " (sharpness: {sharpness:.2} dB/ms)");
        }
    }
    if let Some(contrast_db) = predicted.contrast_db {
        let _ = write!(
            text,
            "\ncontrast of the click: {contrast_db:.1} dB (felt motion at the target, relative to the surface)"
        );
    }
    if let Some(sound_db) = predicted.sound_db {
        let _ = write!(text, "\nsound: {sound_db:.1} dB (A-weighted mean-square velocity of the surface, re 1 mm/s)");
    }
    let ms = |time: Option<f64>| {
        let after_start = |ms: f64| format!("{ms:.1} ms after the start");
        time.map_or_else(|| "more than 300 ms after the end".to_owned(), after_start)
    };
    let _ = write!(
        text,
        "\nresidual vibration after the end: {:.1} % of the peak; the motion finally falls below a tenth of the peak {}",
        1e2 * predicted.residual,
        ms(predicted.quiet_ms)
    );
    if let Some(unbraked) = predicted.quiet_unbraked_ms {
        let _ = write!(text, " (without the braking part of the effect: {})", ms(Some(unbraked)));
    }
    if let Some(own) = &finger {
        let mut add_line = |windows: &str, own: &ClickMeasures| {
            let crisp = if click.does_motion_peak_and_become_quiet_in_time(own) { "crisp" } else { "not crisp" };
            let quiet =
                own.quiet_s.map_or_else(|| "for more than 850 ms".to_owned(), |s| format!("until {:.1} ms", 1e3 * s));
            let (peak_g, peak_ms) = (own.peak / STANDARD_GRAVITY, 1e3 * own.peak_s);
            let _ = write!(
                text,
                "\n{windows}: peak {peak_g:.3} g {peak_ms:.1} ms after the start, vibration {quiet} ({crisp})"
            );
        };
        if let Some(own) = &own.same_windows_without_finger {
            add_line("the same windows without the finger", own);
        }
        if let Some(own) = &own.daemon_windows_with_finger {
            add_line("the windows that the daemon would play (designed without the finger), with the finger", own);
        }
    }
    if predicted.crisp == Some(false) {
        let crisp_ms = request.crisp_ms.unwrap_or(1e3 * ClickOptions::default().crisp_s);
        let _ = write!(
            text,
            "\nnot crisp: the peak should come within 15 ms, and the motion should fall below a tenth of the peak \
             within {crisp_ms} ms{}",
            if effect == NamedEffect::DoubleClick { ", both counted from the start of each click" } else { "" }
        );
    }
    let _ = write!(text, "\ndesigned in {elapsed_ms:.1} ms");
    if let Some(limit) = &design.limited_by {
        let _ = write!(text, "\nlimited by {limit}");
    }
    print_text_after_queued_log(&text)
}
