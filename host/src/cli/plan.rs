//! `era plan`: the drives for a touch, or for several.

use super::args::{At, CacheOptions, PanelOptions, Unit};
use super::args_field::{Corners, parse_zone_corners_mm_in_any_order};
use super::headings::{NO_HEADING, PLANNER, TOUCH};
use super::panel::{
    collect_plan_bounds, convert_point_option_to_m, load_or_compute_plan_table,
    make_target_from_at_and_intensity_options, prepare_table_with_scene_finger_if_any_at_places,
    tell_missing_or_exceeded_plan_bounds,
};
use super::progress::run_with_progress;
use super::reach::convert_zone_to_region;
use super::terminal_messages::tell;
use super::values::parse_tolerances_of_springs_modulus_thickness_and_places;
use super::wishes::PlanWishes;
use super::{CommandResult, Failure, print_json, print_text_after_queued_log};
use crate::effects::set_missing_target_peaks_from_level_if_given;
use crate::model::Bound;
use crate::planner::explain::Explanation;
use crate::planner::schedule::{Span, Stretch, Window, cut_windows_into_spans, plan_each_span};
use crate::planner::trade::TradeOffs;
use crate::planner::{
    FirstTargetReport, Grouping, Objective, Plan, PlanError, PlanTable, QuietZone, Request, SearchEffort, Target, Times,
};
use crate::scene::Scene;
use crate::study::tolerances::{self, Spread, Tolerances};
use clap::Args;
use serde::Serialize;
use std::fmt::Write;

/// Levels in dB below the threshold of feeling that are still told by their number.
const LEAST_SHOWN_DB: f64 = -60.0;

/// What to plan for.
#[derive(Clone, Debug, Args)]
pub struct PlanOptions {
    #[command(flatten)]
    pub panel: PanelOptions,
    #[command(flatten)]
    pub keep: CacheOptions,
    #[command(flatten)]
    pub at: At,
    /// Requested peak acceleration, in dB above the threshold of feeling (in place of --intensity-g), for the target
    /// and for each target of --also that is given without a peak
    #[arg(long, value_name = "DB", allow_negative_numbers = true, conflicts_with = "intensity_g", help_heading = TOUCH)]
    pub intensity_db: Option<f64>,
    #[command(flatten)]
    pub wishes: PlanWishes,
    /// For --objective reach: plan for this rectangle, in mm, instead of the whole surface; on a bar, Y0 and Y1 are
    /// ignored
    #[arg(long, value_name = "X0,Y0,X1,Y1", value_parser = parse_zone_corners_mm_in_any_order, allow_hyphen_values = true, help_heading = PLANNER)]
    pub zone: Option<Corners>,
    /// Compute how much the peaks at the targets change if the panel differs from the scene (if --spread has no values: by up to 20 % in
    /// spring stiffness, 10 % in Young's modulus, 5 % in thickness and 1 mm in the positions of supports, masses and actuators); this takes some seconds
    #[arg(long, alias = "tolerances", value_name = "SPRINGS,MODULUS,THICKNESS,MM", num_args = 0..=1, require_equals = true,
        default_missing_value = "0.2,0.1,0.05,1", value_parser = parse_tolerances_of_springs_modulus_thickness_and_places, help_heading = PLANNER)]
    pub spread: Option<Tolerances>,
    /// Print JSON
    #[arg(long, help_heading = NO_HEADING)]
    pub json: bool,
}

/// A plan with what goes with it; the plan's own fields stay at the top.
#[derive(Serialize)]
struct PlanAnswer {
    #[serde(flatten)]
    plan: Plan,
    /// The requested limit of `error_bound`, relative.
    tolerance: f64,
    /// Whether `error_bound` of every plan is at most `tolerance`; `null` if a bound is missing and no bound is above `tolerance`.
    tolerance_met: Option<bool>,
    /// When the vibration of the (first) target begins and when it has decayed, in the form that the daemon uses.
    times: Times,
    /// Details of the first target, if the plan has no time windows.
    #[serde(skip_serializing_if = "Option::is_none")]
    details: Option<FirstTargetReport>,
    /// One for each plan, with `--explain`.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    explanations: Vec<Explanation>,
    #[serde(skip_serializing_if = "Option::is_none")]
    trade: Option<TradeOffs>,
    #[serde(skip_serializing_if = "Option::is_none")]
    stretches: Option<Vec<Stretch>>,
    /// With `--spread`.
    #[serde(skip_serializing_if = "Option::is_none")]
    off: Option<Spread>,
}

pub fn run_plan(options: &PlanOptions) -> CommandResult {
    let scene = options.panel.load_scene()?;
    let request = make_request(&scene, options)?;
    let windows = list_target_windows_if_any_given_filling_others_to_latest_end(options);
    let spans = windows.map(|windows| cut_windows_into_spans(&windows)).transpose()?;
    let fingers = list_modelled_finger_places_m_empty_for_reach(&request);
    let table = prepare_request_table_refusing_finger_with_windows(&scene, options, &request, spans.is_some())?;
    let accuracy = options.panel.accuracy()?;
    let mut answer = run_with_progress("planning", || {
        plan_request_as_whole_or_per_time_span(
            &table,
            options,
            request,
            spans,
            accuracy.relative_tolerance_or_tightest(),
        )
    })?;
    // In JSON they are part of the answer.
    for explanation in answer.explanations.iter().filter(|_| !options.json) {
        tell!("{}", super::plan_explain::format_explanation(explanation));
    }
    let plans = list_plans(&answer);
    tell_missing_or_exceeded_plan_bounds(&plans, accuracy, options.panel.explain);
    answer.tolerance_met = Bound::all_meet_tolerance_if_given_and_decidable(&collect_plan_bounds(&plans), accuracy);
    if let Some(tolerances) = options.spread {
        let off =
            || tolerances::compute_target_peak_spread_under_tolerances(&scene, &fingers, &answer.plan, tolerances);
        answer.off = Some(
            run_with_progress("computing how much the peaks change if the panel differs from the scene", off)
                .map_err(Failure::runtime_error)?,
        );
    }
    if options.json {
        return print_json(&answer);
    }
    print_text_after_queued_log(&format_plan_answer(&answer))
}

/// The table that the request is planned with: of the panel with its fingers on it.
fn prepare_request_table_refusing_finger_with_windows(
    scene: &Scene,
    options: &PlanOptions,
    request: &Request,
    has_time_windows: bool,
) -> Result<PlanTable, Failure> {
    let PlanOptions { panel, keep, .. } = options;
    if scene.finger.is_some() && has_time_windows {
        return Err(Failure::usage_error(
            "time windows cannot be combined with the scene's [finger], because the model has a finger on every \
             target all the time, not only during the window of the target: omit the time windows, or use a scene \
             without [finger]",
        ));
    }
    if scene.finger.is_some() && request.objective == Objective::Reach {
        tell!(
            "the scene's [finger] is not used, because the objective `reach` uses the same actuator \
             settings for a touch at any place"
        );
        return load_or_compute_plan_table(panel, *keep, scene);
    }
    prepare_table_with_scene_finger_if_any_at_places(
        panel,
        *keep,
        scene,
        &list_modelled_finger_places_m_empty_for_reach(request),
    )
}

/// Where the scene's finger is, in m: on every target, unless the setting is for touches of any place.
fn list_modelled_finger_places_m_empty_for_reach(request: &Request) -> Vec<(f64, f64)> {
    if request.objective == Objective::Reach {
        return Vec::new();
    }
    request.targets.iter().map(|target| (target.x_m, target.y_m)).collect()
}

/// Plans for a request, as a whole or stretch by stretch.
fn plan_request_as_whole_or_per_time_span(
    table: &PlanTable,
    options: &PlanOptions,
    request: Request,
    spans: Option<Vec<Span>>,
    tolerance_to_report: f64,
) -> Result<PlanAnswer, Failure> {
    match spans {
        None => {
            let request = set_missing_target_peaks_from_level_if_given(table, request, options.intensity_db)?;
            let (planned, trade) = crate::planner::trade::plan_and_improve_by_exploring_trade_offs(table, &request)?;
            let details =
                Some(crate::planner::report::build_harmonics_and_timing_report_at_first_target(table, &planned));
            let explanations = explain_plans_if_asked(table, options, [&request].into_iter())?;
            Ok(PlanAnswer {
                details,
                trade,
                times: crate::planner::report::compute_rise_and_decay_times_at_first_target(table, &planned.plan),
                plan: planned.plan,
                tolerance: tolerance_to_report,
                tolerance_met: None,
                stretches: None,
                off: None,
                explanations,
            })
        }
        Some(spans) => {
            let mut requests = Vec::new();
            let mut trades = Vec::new();
            let mut all = plan_each_span(spans, |targets| -> Result<Plan, PlanError> {
                let request = set_missing_target_peaks_from_level_if_given(
                    table,
                    request.with_selected_targets(targets),
                    options.intensity_db,
                )?;
                let (planned, trade) =
                    crate::planner::trade::plan_and_improve_by_exploring_trade_offs(table, &request)?;
                requests.push(request);
                trades.push(trade);
                Ok(planned.plan)
            })?;
            for (stretch, trade) in all.iter_mut().filter(|stretch| stretch.plan.is_some()).zip(trades) {
                stretch.times = stretch
                    .plan
                    .as_ref()
                    .map(|plan| crate::planner::report::compute_rise_and_decay_times_at_first_target(table, plan));
                stretch.trade = trade;
            }
            let explanations = explain_plans_if_asked(table, options, requests.iter())?;
            // The one in which the first target begins stands for all.
            let first = all.iter().find(|stretch| stretch.span.targets.first() == Some(&0));
            let plan = first.and_then(|stretch| stretch.plan.clone()).ok_or(PlanError::Count { count: 0 })?;
            Ok(PlanAnswer {
                times: crate::planner::report::compute_rise_and_decay_times_at_first_target(table, &plan),
                plan,
                tolerance: tolerance_to_report,
                tolerance_met: None,
                details: None,
                trade: None,
                stretches: Some(all),
                off: None,
                explanations,
            })
        }
    }
}

/// All plans of an answer.
fn list_plans(answer: &PlanAnswer) -> Vec<&Plan> {
    match &answer.stretches {
        Some(all) => all.iter().filter_map(|stretch| stretch.plan.as_ref()).collect(),
        None => vec![&answer.plan],
    }
}

/// Why the plans of these requests are what they are, if that was asked.
fn explain_plans_if_asked<'a>(
    table: &PlanTable,
    options: &PlanOptions,
    requests: impl Iterator<Item = &'a Request>,
) -> Result<Vec<Explanation>, Failure> {
    let mut all = Vec::new();
    for request in requests.filter(|_| options.panel.explain) {
        all.push(crate::planner::explain::explain_plan(table, request).map_err(Failure::runtime_error)?);
    }
    Ok(all)
}

fn make_request(scene: &Scene, options: &PlanOptions) -> Result<Request, Failure> {
    let unit: Unit = options.at.unit;
    let mut request = Request::for_touch(&[make_target_from_at_and_intensity_options(scene, &options.at)?]);
    for also in &options.wishes.also {
        let (x_m, y_m) = convert_point_option_to_m(scene, "--also", also.at.x, also.at.y, unit)?;
        request.targets.push(Target { x_m, y_m, intensity_g: also.intensity_g });
    }
    for spared in &options.wishes.quiet {
        let (x_m, y_m) = convert_point_option_to_m(scene, "--quiet", spared.at.x, spared.at.y, unit)?;
        request.quiet.push(QuietZone { x_m, y_m, radius_m: spared.radius_mm / 1e3, at_most_g: spared.at_most_g });
    }
    request.objective = options.wishes.objective;
    request.grouping = options.wishes.grouping;
    request.weigh = options.wishes.weigh;
    request.zone = convert_zone_to_region(scene, options.zone)?;
    request.work = SearchEffort::Study;
    Ok(request)
}

/// The windows of all targets, if any has one: those that have none last as long as any other.
fn list_target_windows_if_any_given_filling_others_to_latest_end(options: &PlanOptions) -> Option<Vec<Window>> {
    let given: Vec<Option<Window>> =
        std::iter::once(options.wishes.window).chain(options.wishes.also.iter().map(|also| also.window)).collect();
    let to_ms = given.iter().flatten().map(|window| window.to_ms).reduce(f64::max)?;
    Some(given.into_iter().map(|window| window.unwrap_or(Window { from_ms: 0.0, to_ms })).collect())
}

fn format_plan_answer(answer: &PlanAnswer) -> String {
    let mut text = String::new();
    match &answer.stretches {
        None => {
            write_plan(&mut text, &answer.plan);
            if let Some(details) = &answer.details {
                write_predicted_motion_times_and_optimality(&mut text, &answer.plan, details);
            }
            write_trade_off_curves(&mut text, answer.trade.as_ref());
        }
        Some(all) => {
            for stretch in all {
                let _ = write!(text, "{:.0} to {:.0} ms: ", stretch.span.from_ms, stretch.span.to_ms);
                match &stretch.plan {
                    Some(plan) => write_plan(&mut text, plan),
                    None => text.push_str("no drives"),
                }
                if let Some(times) = &stretch.times {
                    write_rise_and_decay_times(&mut text, times);
                }
                write_trade_off_curves(&mut text, stretch.trade.as_ref());
                text.push('\n');
            }
        }
    }
    if let Some(off) = &answer.off {
        let _ = write!(text, "\n{}", off.describe_in_words());
    }
    text.trim_end().to_owned()
}

fn write_plan(text: &mut String, plan: &Plan) {
    let _ = write!(text, "target {:.1} mm, {:.1} mm", 1e3 * plan.target_m[0], 1e3 * plan.target_m[1]);
    for other in plan.targets.iter().skip(1) {
        let _ = write!(text, "; {:.1} mm, {:.1} mm", 1e3 * other.x_m, 1e3 * other.y_m);
    }
    for drive in &plan.drives {
        let _ = write!(
            text,
            "\n  {:12} {:7.2} Hz  {:7.1} V  pulse width {:.3}  {:.4} N",
            drive.actuator, drive.frequency_hz, drive.voltage_v, drive.pulse_width, drive.force_n
        );
        if drive.phase_rad != 0.0 {
            let _ = write!(text, "  phase {:.1} degrees", drive.phase_rad.to_degrees());
        }
    }
    let predicted = plan.predicted;
    let _ = write!(
        text,
        "\npredicted: {:.3} g at the target, {:.3} g on average elsewhere, contrast {:.1} dB",
        predicted.target_peak_g, predicted.mean_elsewhere_g, predicted.contrast_db
    );
    if let Some(bound) = plan.error_bound {
        let _ = write!(text, " (relative model error at the target at most {bound:.0e})");
    }
    if plan.targets.len() > 1 {
        for target in &plan.targets {
            let _ = write!(
                text,
                "\n  target at {:.1} mm, {:.1} mm: {:.3} g ({:.3} g requested)",
                1e3 * target.x_m,
                1e3 * target.y_m,
                target.peak_g,
                target.wanted_g
            );
        }
    }
    for zone in &plan.quiet {
        let _ = write!(
            text,
            "\n  quiet zone at {:.1} mm, {:.1} mm, radius {:.1} mm: peak {:.4} g, allowed {:.4} g; harmonics add at most {:.4} g",
            1e3 * zone.x_m,
            1e3 * zone.y_m,
            1e3 * zone.radius_m,
            zone.peak_g,
            zone.at_most_g,
            zone.harmonics_g
        );
    }
    if let Some(limit) = &plan.limited_by {
        let _ = write!(text, "\nlimited by {limit}");
    }
}

/// A level in dB in words; below the threshold nothing is felt, and how far below says nothing to anybody where it is far.
fn describe_level_or_none_as_not_felt(level_db_unless_at_rest: Option<f64>, threshold_name: &str) -> String {
    match level_db_unless_at_rest {
        Some(db) if db >= 0.0 => format!("{db:.1} dB above {threshold_name}"),
        Some(db) if db >= LEAST_SHOWN_DB => format!("{:.1} dB below {threshold_name}: not felt", -db),
        _ => format!("far below {threshold_name}: not felt"),
    }
}

/// Harmonics are told from this part of the peak on.
const HARMONICS_FRACTION: f64 = 1e-9;

fn write_predicted_motion_times_and_optimality(text: &mut String, plan: &Plan, details: &FirstTargetReport) {
    let _ = write!(text, "\nwith the forces at the actual gaps: {:.3} g at the target", plan.predicted.softened_peak_g);
    let _ = write!(
        text,
        ", {}",
        describe_level_or_none_as_not_felt(plan.predicted.above_threshold_db, "the threshold of feeling")
    );
    let _ = write!(text, "; the peak including harmonics is at most {:.3} g", details.waveform_peak_g);
    // Less is rounding.
    if details.harmonics_g > HARMONICS_FRACTION * details.waveform_peak_g {
        let _ = write!(
            text,
            " (the strongest harmonic is {}",
            describe_level_or_none_as_not_felt(details.strongest_harmonic_db, "its threshold")
        );
        match details.harmonics_error_bound {
            Some(bound) => _ = write!(text, "; relative error of the harmonics at most {:.1e})", bound),
            None => text.push_str("; the error of the harmonics is not known)"),
        }
    }
    write_rise_and_decay_times(text, &details.times);
    if plan.optimality_gap > 0.0 {
        let more = if plan.optimality_gap >= 1.0 {
            format!("{:.1} times as good", 1.0 + plan.optimality_gap)
        } else {
            format!("{:.2} % better", 100.0 * plan.optimality_gap)
        };
        let what = match plan.objective {
            Objective::Reach => "the peak at the weakest place",
            _ if plan.limited_by.is_some() => "the peak at the target",
            Objective::Contrast => "the motion elsewhere",
            Objective::Power => "the power",
        };
        let _ = write!(
            text,
            "\nthis plan is not proven to be the best: another combination of frequencies could be up to {more} \
             (compared by {what})"
        );
    } else {
        let proof = match plan.grouping {
            Grouping::Distinct => {
                "no other frequencies of the grid are better (each actuator has its own frequency, 20 Hz or more from \
                 the others)"
            }
            Grouping::Shared => "no other frequency of the grid is better (all actuators have the same frequency)",
        };
        let _ = write!(text, "\nproven: {proof}");
    }
}

fn write_rise_and_decay_times(text: &mut String, times: &Times) {
    let ms = |time: Option<f64>| time.map_or_else(|| String::from("never"), |ms| format!("after {ms:.0} ms"));
    let _ = write!(
        text,
        "\nthe motion reaches 90 % of the peak {} (counted from the moment when the rails have reached their voltage), \
         and falls to 10 % {} (counted from the end of the drives)",
        ms(times.reaches_90_ms),
        ms(times.decays_to_10_ms)
    );
}

fn write_trade_off_curves(text: &mut String, trade_offs: Option<&TradeOffs>) {
    let Some(trade_offs) = trade_offs else { return };
    let list = |values: &[f64]| values.iter().map(|g| format!("{g:.3}")).collect::<Vec<_>>().join("  ");
    let _ = write!(
        text,
        "\npeak of each target if it were the only target (at most its requested peak): {} g",
        list(&trade_offs.alone_g)
    );
    for curve in &trade_offs.targets {
        let _ = write!(
            text,
            "\ntrade-off between target {} and the others (100 %: the peak of a target if it were the only target). \
             Each line: least percentage for this target, lowest percentage of the others, peaks of all targets in g:",
            curve.target + 1
        );
        for point in &curve.points {
            let parts = format!("{:4.0} %, others {:5.1} %", 100.0 * point.part, 100.0 * point.others_part);
            let _ = write!(text, "\n  {parts}:  {}", list(&point.peaks_g));
        }
    }
    for (i, point) in trade_offs.quiet.iter().enumerate() {
        if i == 0 {
            text.push_str("\npeaks of the targets, for different limits of the quiet zones:");
        }
        let zones = point.at_most_g.as_ref().map_or_else(|| "no limit".into(), |g| format!("{} g", list(g)));
        let _ = write!(
            text,
            "\n  {zones}:  {} g, {:.1} % of the requested peaks",
            list(&point.peaks_g),
            100.0 * point.part
        );
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn levels_are_reported_as_far_as_they_say_something() {
        assert_eq!(describe_level_or_none_as_not_felt(Some(21.7), "its threshold"), "21.7 dB above its threshold");
        assert_eq!(
            describe_level_or_none_as_not_felt(Some(-6.0), "its threshold"),
            "6.0 dB below its threshold: not felt"
        );
        for nothing in [Some(-120.0), None] {
            assert_eq!(
                describe_level_or_none_as_not_felt(nothing, "its threshold"),
                "far below its threshold: not felt"
            );
        }
    }
}
