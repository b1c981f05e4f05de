//! A click's windows for one place or several.

use super::actuator::ClickActuator;
use super::bound::bound_crisp_click_peak_if_solved_m_per_s2;
use super::designer::{BuiltClick, ClickDesigner};
use super::felt::{
    FINE_RECORD, filter_50_us_means_to_felt_motion_at_16_khz, filter_50_us_means_to_motion_below_1_khz_at_16_khz,
};
use super::measures::{
    COUNTED, ClickMeasures, QUIET, find_quiet_start_of_record_s, measure_click, measure_click_from_time,
};
use super::motion::simulate_windows;
use super::options::ClickOptions;
use super::program::TargetResponses;
use super::slots::{
    SlotResponses, compute_slot_responses_of_nominal_and_four_detuned_panels,
    list_spectral_lines_of_force_of_widest_window_s,
};
use super::sound::{SurfaceFigures, compute_click_sound_and_contrast_db_if_anything_moves};
use super::window::{ClickWindow, LEAD_S};
use crate::PlanTable;
use crate::physics::limits::Limit;
use crate::physics::rise::{PanelPoles, PointResidues};
use crate::plan::limitation::{Limitation, add_limitation_if_new};
use nalgebra::DVector;
use num_complex::Complex64;

/// Times that a click is weakened for its travel.
const WEAKENED: usize = 3;
/// Fraction of the wished peak that counts as reached.
const REACHED: f64 = 0.95;

/// A click.
#[derive(Clone, Debug)]
pub struct ClickDesign {
    /// By their begin; empty if no actuator moves the place.
    pub windows: Vec<ClickWindow>,
    /// At the first place in m/s^2, times from the burst's start. Of two clicks: the peak of the first, the time from which on both are quiet, and
    /// the pulse of the second.
    pub measures: ClickMeasures,
    /// Peak at every place in m/s^2; of two clicks, that of the first.
    pub peaks: Vec<f64>,
    /// At the first place, the peak in m/s^2 of the weaker one of two clicks; of a single click its peak.
    pub weakest_peak: f64,
    /// At the first place, felt acceleration in m/s^2 as [`FINE_RECORD`] samples in 1 s, from [`LEAD_S`] after the burst's start on.
    pub felt_motion: Vec<f64>,
    /// Largest acceleration in m/s^2 of all motion below 1 kHz at the first place, felt or not: what an accelerometer shows.
    pub shown_peak: f64,
    /// Largest acceleration after the last window, over the peak, at the first place.
    pub residual: f64,
    /// What keeps it below what was asked for.
    pub limits: Vec<Limitation>,
    /// Largest travel of every actuator's mass in m.
    pub travel_m: Vec<f64>,
    /// For each pole that vibrates: its pole, the largest amplitude while windows are on, and that after them.
    pub amplitudes: Vec<(Complex64, f64, f64)>,
    /// Of a click for one place, the strongest crisp click that these actuators can make there in m/s^2, if it was asked for ([`super::bound`]).
    pub best_possible: Option<f64>,
    /// The largest force in N of each actuator's electrodes for which that was computed, in the order of the scene.
    pub largest_forces_n: Vec<f64>,
    /// What it does to the surface relative to the first place, if anything moves.
    pub surface: Option<SurfaceFigures>,
    /// Whether every place is quiet at the time asked for, and its peak in time, in each click from its beginning.
    pub is_crisp: bool,
}

impl ClickDesign {
    /// End of the last window in s.
    #[must_use]
    pub fn duration_s(&self) -> f64 {
        self.windows.iter().map(|window| window.begin_s + window.width_s).fold(0.0, f64::max)
    }
}

/// Designs the windows of a click for the places whose mode shapes are `shapes`, with the peak of each in m/s^2 in `wishes`. All peaks come at the
/// same time and in the same proportion to their wishes. Of several places, each peak is in the direction with which the surface moves least
/// elsewhere or, if the wish is not reached with any, the weakest peak is strongest. `None` if a programme does not
/// end, or several places have no common click: one of them wants none, or the actuators do not move it.
#[must_use]
pub fn design_click_windows(
    table: &PlanTable,
    poles: &PanelPoles,
    shapes: &[DVector<f64>],
    wishes: &[f64],
    options: ClickOptions,
) -> Option<ClickDesign> {
    let asked = *wishes.first()?;
    let has_several = wishes.len() > 1;
    if has_several && wishes.iter().any(|wish| *wish <= 0.0) {
        return None;
    }
    let residues: Vec<PointResidues> = shapes.iter().map(|shape| poles.residues_at_shape(shape)).collect();
    let actuators: Vec<ClickActuator> =
        table.electrodes.iter().enumerate().map(|(i, own)| ClickActuator::new(table, i, own)).collect();
    let spectra: Vec<Vec<Complex64>> =
        actuators.iter().map(|own| list_spectral_lines_of_force_of_widest_window_s(own.charging)).collect();
    let panels: Vec<Vec<SlotResponses>> =
        residues.iter().map(|own| compute_slot_responses_of_nominal_and_four_detuned_panels(own, &spectra)).collect();
    let factors = wishes.iter().map(|wish| if has_several { asked / wish } else { 1.0 });
    let targets =
        panels.iter().zip(factors).map(|(panels, factor)| TargetResponses { panels, factor, besides: &[] }).collect();
    let mut designer = ClickDesigner { table, poles, shapes, targets, actuators: &actuators, options };
    let target = residues.first()?;
    let (built, travel_limit) = if has_several {
        build_click_with_peak_signs_of_least_surface_motion_and_limiting_actuator(&mut designer, target, wishes)?
    } else {
        build_scaled_click_within_travel_and_limiting_actuator_if_solved(&designer, asked)?
    };
    if has_several && built.windows.is_empty() {
        return None;
    }
    let (built, second_limit) = match options.second_click_after_s {
        Some(after_s) => designer.repeat_click_within_travel_and_get_limiting_actuator(&built, after_s),
        None => (built, None),
    };
    let travel_limit = travel_limit.or(second_limit);
    let built = if options.force_fraction < 1.0 {
        designer.scale_window_voltages_of_built_click_to_force_fraction(&built, options.force_fraction)
    } else {
        built
    };
    let felt = list_felt_motion_of_each_place(&built);
    // Of two clicks, the first one as if no second one followed.
    let first = match options.second_click_after_s {
        Some(after_s) => {
            let alone = designer.keep_windows_of_first_click(&built, after_s);
            measure_click_at_each_place(&list_felt_motion_of_each_place(&alone))
        }
        None => measure_click_at_each_place(&felt),
    };
    let second: Vec<ClickMeasures> = match options.second_click_after_s {
        Some(after_s) => felt
            .iter()
            .map(|felt| measure_click_from_time(felt, after_s).shift_times_to_count_from_burst_start())
            .collect(),
        None => Vec::new(),
    };
    let means = built.motion.mean_acceleration.first().map_or(&[][..], Vec::as_slice);
    let shown_peak =
        filter_50_us_means_to_motion_below_1_khz_at_16_khz(means).iter().fold(0.0_f64, |most, x| most.max(x.abs()));
    let felt = felt.into_iter().next()?;
    let mut measures = *first.first()?;
    let mut weakest_peak = measures.peak;
    if let Some(second) = second.first() {
        weakest_peak = weakest_peak.min(second.peak);
        measures = ClickMeasures {
            quiet_s: find_quiet_start_of_record_s(&felt, QUIET * measures.peak).map(|quiet_s| quiet_s + LEAD_S),
            pulse_s: second.pulse_s,
            pulse_to_ring_db: second.pulse_to_ring_db,
            ..measures
        };
    }
    let is_short = first.iter().zip(wishes).any(|(own, wish)| own.peak < REACHED * options.force_fraction * wish);
    let end_s = built.windows.iter().map(|window| window.begin_s + window.width_s).fold(0.0, f64::max);
    let after =
        felt.iter().take(COUNTED).enumerate().filter(|(k, _)| index_to_time_s(*k) >= end_s).map(|(_, x)| x.abs());
    // What precedes the beginning is at the record's end.
    let residual =
        if measures.peak > 0.0 { after.take(felt.len() / 2).fold(0.0, f64::max) / measures.peak } else { 0.0 };
    let mut limits = Vec::new();
    if is_short {
        if built.saturated.is_empty() && travel_limit.is_none() && !built.lacks.current && !built.lacks.windows {
            add_limitation_if_new(
                &mut limits,
                if built.windows.is_empty() { Limitation::Node } else { Limitation::TooShort },
            );
        }
        for (actuator, limit) in &built.saturated {
            add_limitation_if_new(&mut limits, Limitation::for_actuator(table, *limit, *actuator));
        }
        if built.lacks.current {
            add_limitation_if_new(&mut limits, Limitation::Supply);
        }
        if built.lacks.windows {
            add_limitation_if_new(&mut limits, Limitation::Windows);
        }
    }
    if let Some(actuator) = travel_limit.filter(|_| is_short) {
        add_limitation_if_new(&mut limits, Limitation::for_actuator(table, Limit::Travel, actuator));
    }
    let alone = residues.first().filter(|_| options.with_best_possible && !has_several);
    let largest_forces_n: Vec<f64> = actuators.iter().map(|own| own.plateau_n).collect();
    let best_possible = alone
        .and_then(|residues| bound_crisp_click_peak_if_solved_m_per_s2(residues, &largest_forces_n, options.crisp_s));
    let mut windows = built.windows;
    windows.iter_mut().for_each(|window| window.begin_s += LEAD_S);
    windows.sort_by(|a, b| a.begin_s.total_cmp(&b.begin_s));
    let surface = compute_click_sound_and_contrast_db_if_anything_moves(table, poles, target, &built.motion.forces_n);
    Some(ClickDesign {
        windows,
        measures,
        peaks: first.iter().map(|own| own.peak).collect(),
        weakest_peak,
        felt_motion: felt,
        shown_peak,
        residual,
        limits,
        travel_m: built.motion.travel_m,
        amplitudes: built.motion.amplitudes,
        best_possible,
        largest_forces_n,
        surface,
        is_crisp: first.iter().chain(&second).all(|own| options.does_motion_peak_and_become_quiet_in_time(own)),
    })
}

/// Felt acceleration in m/s^2 at every place, as [`FINE_RECORD`] samples in 1 s from the first slot on.
fn list_felt_motion_of_each_place(built: &BuiltClick) -> Vec<Vec<f64>> {
    built.motion.mean_acceleration.iter().map(|means| filter_50_us_means_to_felt_motion_at_16_khz(means)).collect()
}

/// The figures of a click at every place, from its felt motion; times from the burst's start.
fn measure_click_at_each_place(felt: &[Vec<f64>]) -> Vec<ClickMeasures> {
    felt.iter().map(|felt| measure_click(felt).shift_times_to_count_from_burst_start()).collect()
}

/// The click for the first wish, weakened until no mass goes too far, and the actuator that it was weakened for.
fn build_scaled_click_within_travel_and_limiting_actuator_if_solved(
    designer: &ClickDesigner,
    asked: f64,
) -> Option<(BuiltClick, Option<usize>)> {
    let mut part = 1.0;
    let mut travel_limit = None;
    let mut built = designer.design_click_for_peak_or_best_weaker_if_solved(asked)?;
    for _ in 0..WEAKENED {
        let Some((actuator, excess)) =
            designer.find_actuator_and_ratio_of_largest_travel_above_usable_travel(&built.motion)
        else {
            break;
        };
        travel_limit = Some(actuator);
        part *= (0.97 / excess).min(0.97);
        built = designer.design_click_for_peak_or_best_weaker_if_solved(asked * part)?;
    }
    if let Some((_, excess)) = designer.find_actuator_and_ratio_of_largest_travel_above_usable_travel(&built.motion) {
        built = designer.scale_window_voltages_of_built_click_to_force_fraction(&built, 0.9 / excess);
    }
    Some((built, travel_limit))
}

/// The click for several targets. Fingers do not feel the directions of peaks: of those with which the wishes are reached, the ones that move the
/// surface least, whichever target is `target`, the first.
fn build_click_with_peak_signs_of_least_surface_motion_and_limiting_actuator(
    designer: &mut ClickDesigner,
    target: &PointResidues,
    wishes: &[f64],
) -> Option<(BuiltClick, Option<usize>)> {
    let asked = *wishes.first()?;
    let mut best = None;
    for factors in list_factors_of_peak_signs_that_reach_wish_or_largest_peak(designer, asked) {
        designer.set_factors_of_targets(&factors);
        let Some((built, travel_limit)) =
            build_scaled_click_within_travel_and_limiting_actuator_if_solved(designer, asked)
        else {
            continue;
        };
        let means = built.motion.mean_acceleration.iter();
        let felt: Vec<Vec<f64>> = means.map(|means| filter_50_us_means_to_felt_motion_at_16_khz(means)).collect();
        let is_good = |(own, wish): (&Vec<f64>, &f64)| {
            let own = measure_click(own);
            own.peak >= REACHED * wish
                && designer
                    .options
                    .does_motion_peak_and_become_quiet_in_time(&own.shift_times_to_count_from_burst_start())
        };
        let is_good = felt.iter().zip(wishes).all(is_good);
        let surface = compute_click_sound_and_contrast_db_if_anything_moves(
            designer.table,
            designer.poles,
            target,
            &built.motion.forces_n,
        );
        // The contrast is that of the first target: what is left without its own motion is the surface's.
        let of_target_db = 10.0 * felt.first()?.iter().map(|x| x * x).sum::<f64>().log10();
        let stillness_db = surface.map_or(f64::NEG_INFINITY, |surface| surface.contrast_db - of_target_db);
        let rank = (is_good, stillness_db);
        if best.as_ref().is_none_or(|(least, _)| rank > *least) {
            best = Some((rank, (built, travel_limit)));
        }
    }
    best.map(|(_, found)| found)
}

/// What targets' accelerations are multiplied by, for each choice of the directions of all peaks but the first with which a crisp click may have
/// the peak that is asked for; if there is none, for that of the largest crisp peak.
fn list_factors_of_peak_signs_that_reach_wish_or_largest_peak(
    designer: &mut ClickDesigner,
    asked: f64,
) -> Vec<Vec<f64>> {
    let sizes: Vec<f64> = designer.targets.iter().map(|target| target.factor.abs()).collect();
    let others = sizes.len().saturating_sub(1);
    let mut best = (0.0, sizes.clone());
    let mut reaching = Vec::new();
    for choice in 0..1_u32 << others {
        let is_reversed = |target: usize| target > 0 && choice >> (target - 1) & 1 == 1;
        let direct = |(target, size): (usize, &f64)| if is_reversed(target) { -size } else { *size };
        let factors: Vec<f64> = sizes.iter().enumerate().map(direct).collect();
        designer.set_factors_of_targets(&factors);
        let peak = designer.find_largest_crisp_peak_or_0_m_per_s2();
        if peak >= asked {
            reaching.push(factors);
        } else if peak > best.0 {
            best = (peak, factors);
        }
    }
    if reaching.is_empty() { vec![best.1] } else { reaching }
}

/// Felt acceleration in m/s^2 at the places whose mode shapes are `shapes`, as [`FINE_RECORD`] samples in 1 s from the burst's start on:
/// what windows do on a panel, which may be another than they were designed for.
#[must_use]
pub fn simulate_felt_acceleration_of_windows_m_per_s2(
    table: &PlanTable,
    poles: &PanelPoles,
    shapes: &[DVector<f64>],
    windows: &[ClickWindow],
) -> Vec<Vec<f64>> {
    let motion = simulate_windows(table, poles, shapes, windows);
    motion.mean_acceleration.iter().map(|means| filter_50_us_means_to_felt_motion_at_16_khz(means)).collect()
}

#[expect(clippy::cast_precision_loss, reason = "some thousand samples")]
fn index_to_time_s(sample: usize) -> f64 {
    sample as f64 / FINE_RECORD as f64
}
