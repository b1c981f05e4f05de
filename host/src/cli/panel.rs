//! Commands that study a panel: response, field; and what others need of a panel.

use super::args::{At, CacheOptions, PanelOptions, Unit};
use super::args_panel::{Band, Response};
use super::cost::Cost;
use super::explain::explain_model_scope_and_mesh_accuracy;
use super::progress::{run_telling_expected_cost_and_showing_progress, run_with_progress};
use super::terminal_messages::tell;
use super::{CommandResult, Failure, print_json, print_text_after_queued_log};
use crate::model::bounded::RefinementLevel;
use crate::model::levels::ReducedLevels;
use crate::model::{Accuracy, Bound, ModelError, validity};
use crate::planner::cache::{self, Cache, PrepareError, Prepared};
use crate::planner::quick::QuickError;
use crate::planner::{Plan, PlanError, PlanTable, TableOptions, Target};
use crate::response;
use crate::scene::{Finger, MAX_ACTUATORS, Scene};
use num_complex::Complex64;
use serde_json::json;
use std::fmt::Write;
use std::time::Instant;

/// Most frequencies in one response.
const MOST_FREQUENCIES: f64 = 1e6;
impl From<ModelError> for Failure {
    fn from(error: ModelError) -> Self {
        match error {
            ModelError::TooFine { .. }
            | ModelError::TooManyModes { .. }
            | ModelError::Frequency { .. }
            | ModelError::Tolerance { .. }
            | ModelError::OtherPanel { .. } => Failure::usage_error(error),
            ModelError::Factorisation { .. } | ModelError::NotConverged { .. } | ModelError::Stopped => {
                Failure::runtime_error(error)
            }
        }
    }
}

impl From<response::CurveError> for Failure {
    fn from(error: response::CurveError) -> Self {
        match error {
            response::CurveError::Model(error) => error.into(),
            response::CurveError::Response(error) => Failure::runtime_error(error),
        }
    }
}

impl From<PrepareError> for Failure {
    fn from(error: PrepareError) -> Self {
        match error {
            PrepareError::Model(error) => error.into(),
            PrepareError::Response(error) => Failure::runtime_error(error),
        }
    }
}

impl From<QuickError> for Failure {
    fn from(error: QuickError) -> Self {
        match error {
            QuickError::Model(error) => error.into(),
            QuickError::Response(error) => Failure::runtime_error(error),
            QuickError::Plan(error) => error.into(),
        }
    }
}

impl From<PlanError> for Failure {
    fn from(error: PlanError) -> Self {
        match error {
            PlanError::NoFrequencies | PlanError::Stopped => Failure::runtime_error(error),
            _ => Failure::usage_error(error),
        }
    }
}

/// Says where thin-plate theory ends.
pub fn warn_if_too_thick_for_thin_plate_theory(scene: &Scene, max_hz: f64) {
    for doubt in validity::list_thin_plate_warnings(scene, max_hz) {
        tracing::warn!("{doubt}");
    }
}

/// Responses are to actuators.
pub fn check_has_actuators(scene: &Scene) -> Result<(), Failure> {
    if scene.actuators.is_empty() {
        return Err(Failure::usage_error(
            "the scene has no [[actuator]], but this command needs at least one actuator",
        ));
    }
    Ok(())
}

/// `--explain`.
pub fn tell_model_scope_and_mesh_accuracy_if_explaining(
    panel: &PanelOptions,
    scene: &Scene,
    accuracy: Accuracy,
    steps: &[RefinementLevel],
) {
    if panel.explain {
        tell!("{}", explain_model_scope_and_mesh_accuracy(scene, accuracy, steps));
    }
}

/// A bound in a table; why there is none is said by [`tell_why_bound_is_missing_or_largest_exceeds_tolerance`].
pub fn format_bound_or_not_known(bound: Bound) -> String {
    bound.limit_if_known().map_or_else(|| String::from("not known"), |bound| format!("{bound:.0e}"))
}

/// Says on standard error why bounds are missing, and where they are above what was asked for.
pub fn tell_why_bound_is_missing_or_largest_exceeds_tolerance(bounds: &[Bound], accuracy: Accuracy) {
    if let Some(reason) = bounds.iter().find_map(|bound| bound.reason_if_unknown()) {
        tell!("no bound of the model error is known (error_bound is null), because {reason}");
    }
    let largest = bounds.iter().filter_map(|bound| bound.limit_if_known()).fold(0.0, f64::max);
    if accuracy.time_limit().is_none() && largest > accuracy.relative_tolerance_or_tightest() {
        tell!(
            "error_bound {largest:.1e} is above the tolerance {:.1e}, even with the finest meshes",
            accuracy.relative_tolerance_or_tightest()
        );
    }
}

/// Says on standard error where the bound on a plan's peak is missing or above what was asked for; with `--explain` also that it
/// is not. A plan's target has a bound of its own: the table's mesh is chosen once, for all of them.
pub fn tell_missing_or_exceeded_plan_bounds(plans: &[&Plan], accuracy: Accuracy, tells_if_met: bool) {
    if plans.iter().any(|plan| plan.error_bound.is_none()) {
        tell!(
            "the model error has no known bound (error_bound is null). Possible causes: the drives do not move the \
             target; the results on the three meshes differ too much (try another --tolerance); the model of this \
             panel has no error bound (then `era response` prints the reason)"
        );
    }
    let tolerance = accuracy.relative_tolerance_or_tightest();
    let Some(largest) = plans.iter().filter_map(|plan| plan.error_bound).reduce(f64::max) else { return };
    if largest > tolerance {
        tell!(
            "error_bound {largest:.1e} of the target's peak is above the tolerance {tolerance:.1e}: a plan uses \
             the mesh that usually meets the tolerance; a smaller --tolerance uses a finer mesh, if there is one"
        );
    } else if tells_if_met {
        tell!("tolerance {tolerance:.0e} met: the relative error of the target's peak is at most {largest:.0e}");
    }
}

/// The bounds of plans.
pub fn collect_plan_bounds(plans: &[&Plan]) -> Vec<Bound> {
    let bound = |plan: &&Plan| plan.error_bound.map_or(Bound::Unknown("of a plan"), Bound::AtMost);
    plans.iter().map(bound).collect()
}

pub fn compute_and_print_frequency_response_at_point(options: &Response) -> CommandResult {
    let started = Instant::now();
    let scene = options.panel.load_scene()?;
    let frequencies_hz = list_frequencies_hz(&options.band)?;
    let (x_m, y_m) = convert_at_option_to_m(&scene, options.at.x, options.at.y, options.unit)?;
    let accuracy = options.panel.accuracy_from_time_limit_or_options(options.time)?;
    check_has_actuators(&scene)?;
    warn_if_too_thick_for_thin_plate_theory(&scene, options.band.to);
    tell_assumed_finger_if_explaining(&options.panel, &scene);
    let scene = scene.replace_finger_by_masses_and_supports_at_places(&[(x_m, y_m)]);
    let cost =
        Cost::estimate_for_responses_unless_time_limited(&scene, accuracy, options.band.to, (frequencies_hz.len(), 1))?;
    let found = run_telling_expected_cost_and_showing_progress("computing the response", cost, || {
        response::compute_acceleration_curves_per_newton_with_error_bounds(
            &scene,
            accuracy,
            (x_m, y_m),
            &frequencies_hz,
        )
    })?;
    let elapsed_ms = started.elapsed().as_secs_f64() * 1e3;
    let curves = &found.answer;
    tell_model_scope_and_mesh_accuracy_if_explaining(&options.panel, &scene, accuracy, &found.steps);
    tell_why_bound_is_missing_or_largest_exceeds_tolerance(&found.bounds, accuracy);
    if options.json {
        let actuators: Vec<_> = scene
            .actuators
            .iter()
            .zip(curves)
            .zip(&found.bounds)
            .map(|((actuator, curve), bound)| {
                json!({
                    "id": actuator.id,
                    "error_bound": bound.limit_if_known(),
                    "acceleration_re": curve.iter().map(|z| z.re).collect::<Vec<_>>(),
                    "acceleration_im": curve.iter().map(|z| z.im).collect::<Vec<_>>(),
                })
            })
            .collect();
        // One number for all curves; none without curves.
        let bound = found.bounds.iter().map(|bound| bound.limit_if_known()).reduce(|a, b| Some(a?.max(b?))).flatten();
        return print_json(&json!({
            "dofs": found.model.count_unknowns(), "elapsed_ms": elapsed_ms, "error_bound": bound, "tolerance": accuracy.tolerance_unless_time_limit_given(),
            "tolerance_met": Bound::all_meet_tolerance_if_given_and_decidable(&found.bounds, accuracy), "frequency_hz": frequencies_hz, "actuators": actuators,
        }));
    }
    print_text_after_queued_log(&format_response_csv(&scene, &frequencies_hz, curves, &found.bounds))
}

/// A line for each frequency: of every actuator amplitude and phase, then the bounds, each the same in all lines, so that
/// whatever reads CSV reads them; `nan` where there is none.
fn format_response_csv(scene: &Scene, frequencies_hz: &[f64], curves: &[Vec<Complex64>], bounds: &[Bound]) -> String {
    let mut text = String::from("frequency_hz");
    for actuator in &scene.actuators {
        let _ = write!(text, ",{0}_m_per_s2_per_n,{0}_phase_deg", actuator.id);
    }
    for actuator in &scene.actuators {
        let _ = write!(text, ",{}_error_bound", actuator.id);
    }
    let bounds: Vec<String> = bounds
        .iter()
        .map(|bound| bound.limit_if_known().map_or_else(|| "nan".into(), |bound| format!("{bound:.2e}")))
        .collect();
    for (i, frequency) in frequencies_hz.iter().enumerate() {
        let _ = write!(text, "\n{frequency}");
        for curve in curves {
            let _ = write!(text, ",{:.6e},{:.2}", curve[i].norm(), curve[i].arg().to_degrees());
        }
        for bound in &bounds {
            let _ = write!(text, ",{bound}");
        }
    }
    text
}

#[allow(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    clippy::cast_precision_loss,
    reason = "counts up to 1e6"
)]
pub fn list_frequencies_hz(options: &Band) -> Result<Vec<f64>, Failure> {
    let (from, to, step) = (options.from, options.to, options.step);
    if !(from >= 0.0 && from.is_finite()) {
        return Err(Failure::usage_error(format!("--from is {from}, but must be 0 Hz or more")));
    }
    if !(to >= from && to.is_finite()) {
        return Err(Failure::usage_error(format!("--to is {to}, but must be {from} Hz (--from) or more")));
    }
    if !(step > 0.0 && step.is_finite()) {
        return Err(Failure::usage_error(format!("--step is {step}, but must be above 0 Hz")));
    }
    let count = ((to - from) / step + 1e-9).floor();
    if count >= MOST_FREQUENCIES {
        return Err(Failure::usage_error(format!(
            "--step is {step}, which gives {count} frequencies, but at most {MOST_FREQUENCIES} are allowed"
        )));
    }
    Ok((0..=count as usize).map(|i| from + i as f64 * step).collect())
}

/// The point of `--at` on the surface, in m.
pub fn convert_at_option_to_m(scene: &Scene, x: f64, y: f64, unit: Unit) -> Result<(f64, f64), Failure> {
    convert_point_option_to_m(scene, "--at", x, y, unit)
}

/// The point of an option on the surface, in m.
pub fn convert_point_option_to_m(
    scene: &Scene,
    option: &str,
    x: f64,
    y: f64,
    unit: Unit,
) -> Result<(f64, f64), Failure> {
    let place = match unit {
        Unit::Px => scene.surface_point_at_px(x, y),
        Unit::Mm => scene.surface_or_bar_axis_point_outside_cutouts(x / 1e3, y / 1e3).map_err(Into::into),
    };
    Ok(place.map_err(|error| Failure::usage_error(format!("{option}: {error}")))?.coordinates_m())
}

/// The planner's table for a scene.
pub fn load_or_compute_plan_table(
    panel: &PanelOptions,
    keep: CacheOptions,
    scene: &Scene,
) -> Result<PlanTable, Failure> {
    Ok(load_or_compute_plan_table_with_origin(panel, keep, scene)?.table)
}

/// The planner's table for what is steady. If the table of all frequencies is stored, it is that one; otherwise it has the ends of the band only,
/// because what is steady depends on no frequency, and a table of all of them takes minutes on large panels.
pub fn load_full_plan_table_or_compute_band_ends_only(
    panel: &PanelOptions,
    keep: CacheOptions,
    scene: &Scene,
) -> Result<PlanTable, Failure> {
    let (whole, cache) = (TableOptions::default(), keep.open_table_cache_unless_disabled_or_without_folder());
    if cache::has_table_file(cache.as_ref(), scene, panel.accuracy()?, whole) {
        return load_or_compute_plan_table(panel, keep, scene);
    }
    let ends = TableOptions { step_hz: whole.to_hz - whole.from_hz, ..whole };
    Ok(prepare_table_showing_progress_and_warnings(panel, None, scene, ends)?.table)
}

/// The planner's table for a scene, and where it came from.
pub fn load_or_compute_plan_table_with_origin(
    panel: &PanelOptions,
    keep: CacheOptions,
    scene: &Scene,
) -> Result<Prepared, Failure> {
    prepare_table_showing_progress_and_warnings(
        panel,
        keep.open_table_cache_unless_disabled_or_without_folder(),
        scene,
        TableOptions::default(),
    )
}

fn prepare_table_showing_progress_and_warnings(
    panel: &PanelOptions,
    cache: Option<Cache>,
    scene: &Scene,
    options: TableOptions,
) -> Result<Prepared, Failure> {
    if scene.actuators.len() > MAX_ACTUATORS {
        // Before minutes are spent on a table that no plan comes from.
        return Err(PlanError::Actuators { count: scene.actuators.len() }.into());
    }
    let (accuracy, cache) = (panel.accuracy()?, cache.as_ref());
    warn_if_too_thick_for_thin_plate_theory(scene, options.to_hz);
    let prepare = || cache::prepare_table(cache, scene, accuracy, options);
    let what = "computing modes and the response of every actuator";
    let prepared = if cache::has_table_file(cache, scene, accuracy, options) {
        run_with_progress(what, prepare)
    } else {
        run_telling_expected_cost_and_showing_progress(
            what,
            Some(Cost::estimate_for_table(scene, accuracy, options)?),
            prepare,
        )
    }?;
    tell_model_scope_and_mesh_accuracy_if_explaining(panel, scene, accuracy, &prepared.steps);
    for warning in crate::planner::press_bounds::list_warnings_of_actuators_not_withstanding_press(&prepared.table) {
        tracing::warn!("{warning}");
    }
    Ok(prepared)
}

/// The planner's table for touches of these places (m): of the panel with the scene's finger on them, where it has one.
pub fn prepare_table_with_scene_finger_if_any_at_places(
    panel: &PanelOptions,
    keep: CacheOptions,
    scene: &Scene,
    places_m: &[(f64, f64)],
) -> Result<PlanTable, Failure> {
    let table = load_or_compute_plan_table(panel, keep, scene)?;
    if scene.finger.is_none() {
        return Ok(table);
    }
    let (accuracy, options, touched) =
        (panel.accuracy()?, TableOptions::default(), scene.replace_finger_by_masses_and_supports_at_places(places_m));
    tell_assumed_finger_if_explaining(panel, scene);
    let cost = Cost::estimate_for_table(&touched, accuracy, options)?;
    run_telling_expected_cost_and_showing_progress(
        "computing the panel with the finger on it",
        Some(cost),
        || -> Result<_, Failure> {
            table
                .build_for_scene_with_fingers_keeping_press_effects(
                    &touched,
                    ReducedLevels::build(&touched, accuracy, options.to_hz)?,
                    options,
                )
                .map_err(Failure::runtime_error)
        },
    )
}

/// What an answer has of the finger, to those who want to know.
fn tell_assumed_finger_if_explaining(panel: &PanelOptions, scene: &Scene) {
    if let Some(Finger { mass_kg, damping_n_s_per_m, stiffness_n_per_m }) = scene.finger.filter(|_| panel.explain) {
        let mass_g = mass_kg * 1e3;
        tell!(
            "the model includes a finger at the requested place: mass {mass_g} g, damping {damping_n_s_per_m} N s/m, \
             stiffness {stiffness_n_per_m} N/m"
        );
    }
}

pub fn make_target_from_at_and_intensity_options(scene: &Scene, at: &At) -> Result<Target, Failure> {
    let (x_m, y_m) = convert_at_option_to_m(scene, at.at.x, at.at.y, at.unit)?;
    Ok(Target { x_m, y_m, intensity_g: at.intensity_g })
}
