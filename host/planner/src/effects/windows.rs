//! A click of single windows as an effect ([`crate::click`]).
//!
//! With several fingers their peaks come together, and the same conditions of quiet hold at all of them.

use super::design::{EffectDesign, EffectPrediction, design_effect};
use super::effect_window::EffectWindow;
use super::error::DesignError;
use super::intensity::mode_shape_values_at_point_or_on_bar_axis;
use super::named::{EffectRequest, NamedEffect};
use crate::click::{ClickDesign, ClickOptions, design_click_windows, simulate_felt_acceleration_of_windows_m_per_s2};
use crate::physics::rise::PanelPoles;
use crate::plan::limitation::join_limitations_as_text_if_any;
use crate::{Plan, PlanTable, STANDARD_GRAVITY, TargetResult};
use nalgebra::DVector;

/// Most fingers of a click of single windows: for more, two to four actuators have no common click.
const MOST_FINGERS: usize = 3;

/// Designs an effect for a board that plays single windows: a click or a double click for up to three fingers without quiet zones is a burst
/// of them, if the fingers have a common one, and everything else is as [`design_effect`] has it.
///
/// # Errors
/// [`DesignError`].
pub fn design_effect_of_windows_if_common_click_exists_else_of_drives(
    table: &PlanTable,
    rise: &PanelPoles,
    plan: &Plan,
    request: EffectRequest,
    options: ClickOptions,
) -> Result<EffectDesign, DesignError> {
    let options = ClickOptions { second_click_after_s: request.click_options().second_click_after_s, ..options };
    let design_of_drives = || {
        let mut weaker = plan.clone();
        weaker.targets.iter_mut().for_each(|target| target.wanted_g *= options.force_fraction);
        design_effect(table, rise, &weaker, request)
    };
    if !is_click_for_up_to_three_targets_without_quiet_zones(plan, request) {
        return design_of_drives();
    }
    request.check_parameters_and_choose_clicks_or_fixed_envelope()?;
    let shape = |own: &&TargetResult| mode_shape_values_at_point_or_on_bar_axis(table, own.x_m, own.y_m);
    let clicking = list_targets_that_want_motion_or_all_if_none(plan);
    let shapes: Vec<DVector<f64>> = clicking.iter().map(shape).collect();
    let wishes: Vec<f64> = clicking.iter().map(|own| own.wanted_g * STANDARD_GRAVITY).collect();
    let Some(click) = design_click_windows(table, rise, &shapes, &wishes, options) else {
        return design_of_drives();
    };
    let mut peaks = click.peaks.clone().into_iter();
    let find_peak = |own: &TargetResult| {
        if clicking.iter().any(|clicking| std::ptr::eq(*clicking, own)) {
            return peaks.next().unwrap_or_default();
        }
        let shapes = [shape(&own)];
        let felt = simulate_felt_acceleration_of_windows_m_per_s2(table, rise, &shapes, &click.windows);
        felt.iter().flatten().fold(0.0_f64, |most, x| most.max(x.abs()))
    };
    let peaks_g = plan.targets.iter().map(find_peak).map(|peak| peak / STANDARD_GRAVITY).collect();
    Ok(EffectDesign { peaks_g, ..effect_from_click(table, request, click) })
}

/// The targets that are to feel something: a finger that rests with 0 g takes nothing from the click of another one. All, if none is.
fn list_targets_that_want_motion_or_all_if_none(plan: &Plan) -> Vec<&TargetResult> {
    let clicking: Vec<&TargetResult> = plan.targets.iter().filter(|own| own.wanted_g > 0.0).collect();
    if clicking.is_empty() { plan.targets.iter().collect() } else { clicking }
}

/// Whether an effect for a plan is a click of single windows on boards that play them.
#[must_use]
pub fn is_click_for_up_to_three_targets_without_quiet_zones(plan: &Plan, request: EffectRequest) -> bool {
    let fingers = list_targets_that_want_motion_or_all_if_none(plan).len();
    let is_click = matches!(request.effect, NamedEffect::Click | NamedEffect::DoubleClick);
    is_click && (1..=MOST_FINGERS).contains(&fingers) && plan.quiet.is_empty()
}

fn effect_from_click(table: &PlanTable, request: EffectRequest, click: ClickDesign) -> EffectDesign {
    let us = |time_s: f64| (time_s * 1e7).round() / 10.0;
    let windows = click.windows.iter().map(|window| EffectWindow {
        actuator: table.scene.actuators.get(window.actuator).map_or_else(String::new, |own| own.id.clone()),
        channel: window.actuator,
        electrode: window.electrode,
        begin_us: us(window.begin_s),
        width_us: us(window.width_s),
        voltage_v: window.voltage_v,
    });
    let windows: Vec<EffectWindow> = windows.collect();
    let measures = click.measures;
    let peak_g = measures.peak / STANDARD_GRAVITY;
    let predicted = EffectPrediction {
        peak_g,
        peak_least_g: click.weakest_peak / STANDARD_GRAVITY,
        peak_most_g: click.shown_peak.max(measures.peak) / STANDARD_GRAVITY,
        peak_at_ms: 1e3 * measures.peak_s,
        residual: click.residual,
        left: click.residual,
        quiet_ms: measures.quiet_s.map(|quiet_s| 1e3 * quiet_s),
        crisp: Some(click.is_crisp),
        quiet_unbraked_ms: None,
        best_possible_g: click.best_possible.map(|best| best / STANDARD_GRAVITY),
        pulse_ms: Some(1e3 * measures.pulse_s),
        pulse_to_ring_db: measures.pulse_to_ring_db,
        sharpness_db_per_ms: measures.sharpness_db_per_ms_if_pulse_to_ring_ratio_known(),
        contrast_db: click.surface.map(|surface| surface.contrast_db),
        sound_db: click.surface.map(|surface| surface.sound_db),
    };
    EffectDesign {
        effect: request.effect,
        drives: Vec::new(),
        predicted,
        limited_by: join_limitations_as_text_if_any(&click.limits),
        length_ms: 1e3 * click.duration_s(),
        peaks_g: click.peaks.iter().map(|peak| peak / STANDARD_GRAVITY).collect(),
        limits: click.limits,
        travel_m: click.travel_m,
        windows,
        best_possible_forces_n: click.best_possible.map_or_else(Vec::new, |_| click.largest_forces_n),
        pole_amplitudes: click.amplitudes.into_iter().map(|(_, most, left)| (most, left)).collect(),
    }
}
