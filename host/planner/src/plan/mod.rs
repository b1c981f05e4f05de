//! The plan for a touch.

pub(crate) mod bound;
pub(crate) mod derating;
pub mod limitation;
mod reached_limits;

use crate::STANDARD_GRAVITY;
use crate::choose::candidates::Formulation;
use crate::choose::refine::Selection;
use crate::choose::refine::refine_frequencies_between_grid;
use crate::choose::search::PairFilter;
use crate::choose::shared_frequency::drives::choose_drives_at_one_shared_frequency;
use crate::chosen_drive::{
    ChosenDrive, PlanDrives, force_phase_relative_to_windows_rad, fundamental_acceleration_peak_at_point_m_per_s2,
    group_drive_indices_by_frequency, is_one_near_3rd_5th_or_7th_harmonic_of_other,
    window_phase_of_each_drive_keeping_relative_force_phases_rad,
};
use crate::drive::Drive;
use crate::millimetres;
use crate::motion::driven_panel::SettledMotion;
use crate::motion::plan_motion::PlanMotion;
use crate::motion::plan_motion::bound_travel_and_free_motion_of_drives_if_poles_known;
use crate::motion::quiet_limits::derate_drives_to_safety_and_quiet_limits_if_possible;
use crate::motion::settle::settled_peak_acceleration_at_point_m_per_s2;
use crate::motion::strong_softening::solve_motion_with_harmonics_if_pulses_are_narrow;
use crate::perception::level_above_threshold_unless_at_rest_db;
use crate::plan::bound::bound_relative_peak_error_at_first_target;
use crate::plan::reached_limits::find_limits_nearly_reached_before_derating;
use crate::reach::selection::select_surface_or_region_max_min_drives_scaled_down_to_first_target;
use crate::request::quiet_zones::QuietResult;
use crate::request::{Grouping, Objective, PlanError, Request, SearchEffort, Target, Weigh};
use crate::request::{check_request_and_snap_to_surface_returning_wanted_peaks_g, y_or_bar_axis_y_m};
use crate::table::{PlanTable, acceleration_at_point_from_coordinates};
pub use bound::bound_field_error_relative_to_largest_peak;
pub use derating::derate_plan;
use limitation::{Limitation, add_limitation_if_new};
use nalgebra::DVector;
use serde::Serialize;
use std::time::Instant;

/// Largest contrast in dB, either way; more is rounding.
const MOST_CONTRAST_DB: f64 = 200.0;
/// Rounds in which points of quiet zones are added, for a touch and for a study; what is left is scaled away.
const QUIET_ROUNDS: [usize; 2] = [3, 10];
/// Gaps below this are rounding.
const NO_GAP: f64 = 1e-9;
/// Gaps above this say no more than that nothing is known: where next to nothing of the forces is safe.
const MOST_GAP: f64 = 1e6;
/// Part of a wish that counts as met.
pub(crate) const MET_FRACTION: f64 = 1.0 - 1e-6;

/// What the plan should do.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
#[cfg_attr(feature = "schema", derive(utoipa::ToSchema))]
pub struct Predicted {
    /// Peak acceleration at the (first) target in g: equation 23, forces those of masses at rest.
    pub target_peak_g: f64,
    /// Mean over the rest of the surface of the peak acceleration in g.
    pub mean_elsewhere_g: f64,
    /// 10 log10 of the mean square acceleration within 10 mm of the targets over that of the rest.
    pub contrast_db: f64,
    /// The peak at the target with forces as they become when the masses move (electrostatic softening), in g.
    pub softened_peak_g: f64,
    /// How far the target's peak is above the threshold of feeling, in dB: fundamentals over their thresholds, added up.
    /// `null` where nothing moves.
    pub above_threshold_db: Option<f64>,
}

/// One target's share.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
#[cfg_attr(feature = "schema", derive(utoipa::ToSchema))]
pub struct TargetResult {
    /// From the left edge, in the unit of its name.
    #[serde(rename = "x_mm", serialize_with = "millimetres::serialize_length_in_mm")]
    pub x_m: f64,
    /// From the top edge, in the unit of its name.
    #[serde(rename = "y_mm", serialize_with = "millimetres::serialize_length_in_mm")]
    pub y_m: f64,
    /// Wanted in g.
    pub wanted_g: f64,
    /// Predicted in g.
    pub peak_g: f64,
}

/// The plan for a touch.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[cfg_attr(feature = "schema", derive(utoipa::ToSchema))]
pub struct Plan {
    /// The (first) target from the left and top edges, in the unit of its name.
    #[serde(rename = "target_mm", serialize_with = "millimetres::serialize_position_in_mm")]
    #[cfg_attr(feature = "schema", schema(min_items = 2, max_items = 2))]
    pub target_m: [f64; 2],
    /// All targets.
    pub targets: Vec<TargetResult>,
    /// The quiet zones, with the largest peak in each.
    pub quiet: Vec<QuietResult>,
    /// Time it took, in us.
    pub elapsed_us: f64,
    /// One per actuator.
    pub drives: Vec<Drive>,
    /// What it should do.
    pub predicted: Predicted,
    /// What keeps the intensity below what was asked for, as `voltage of left`; `null` if nothing does.
    pub limited_by: Option<String>,
    /// The same for programs; empty if nothing does.
    pub limits: Vec<Limitation>,
    /// Upper bound on the relative error of `target_peak_g`; `null` where there is none.
    pub error_bound: Option<f64>,
    /// By which part of its cost, or of its reach where the wishes are not met, another combination of the grid's frequencies
    /// could be better at most: 0 where the plan is proven to be the best. Of the problem with forces of masses at rest and
    /// the limits of actuators and quiet zones; what safety under moving masses took away counts as what another might have
    /// kept. Not part of it: frequencies between the grid's, ones of which an odd harmonic meets another drive, and the
    /// supply's current.
    pub optimality_gap: f64,
    /// What is made least, or most.
    pub objective: Objective,
    /// Which actuators share a frequency.
    pub grouping: Grouping,
    /// The drives with their responses, for what is asked of the plan afterwards: how its masses move, and a part of it.
    #[serde(skip)]
    pub(crate) made_of: PlanDrives,
}

/// A plan with what it was made from, for those who want to know more of it.
#[derive(Clone, Debug)]
pub struct Planned {
    /// Plans the drives for `targets`: the most contrast, each actuator at its own frequency.
    pub plan: Plan,
    /// The drives with their responses.
    pub drives: Vec<ChosenDrive>,
    /// Their steady motion.
    pub settled: SettledMotion,
    /// Mode shapes at the targets.
    pub shapes: Vec<DVector<f64>>,
}

impl PlanTable {
    /// The drives for `targets`: the most contrast, each actuator at its own frequency.
    ///
    /// # Errors
    /// [`PlanError`].
    pub fn plan(&self, targets: &[Target]) -> Result<Plan, PlanError> {
        self.plan_request(&Request::for_touch(targets))
    }

    /// Plans the drives for a request.
    ///
    /// # Errors
    /// [`PlanError`].
    pub fn plan_request(&self, request: &Request) -> Result<Plan, PlanError> {
        self.plan_with_details(request).map(|planned| planned.plan)
    }

    /// Plans a request, and returns the plan with the drives, their motion and the mode shapes at the targets.
    ///
    /// # Errors
    /// [`PlanError`].
    pub fn plan_with_details(&self, request: &Request) -> Result<Planned, PlanError> {
        let started = Instant::now();
        let (request, wanted_g) = check_request_and_snap_to_surface_returning_wanted_peaks_g(self, request)?;
        let request = &request;
        let mut formulation = Formulation::new(self, request);
        let wanted: Vec<f64> = wanted_g
            .iter()
            .enumerate()
            .map(|(t, g)| formulation.limit_wanted_to_million_times_reach_m_per_s2(g * STANDARD_GRAVITY, t))
            .collect();
        let mut selection = match request.grouping {
            Grouping::Distinct if request.objective == Objective::Reach => {
                select_surface_or_region_max_min_drives_scaled_down_to_first_target(
                    self,
                    &formulation,
                    request.zone,
                    &wanted,
                )?
            }
            Grouping::Distinct => {
                choose_distinct_frequency_drives_and_add_quiet_zone_limits(self, &mut formulation, request, &wanted)?
            }
            Grouping::Shared => choose_drives_at_one_shared_frequency(self, &formulation, &wanted)?,
        };
        let settled =
            derate_drives_to_safety_and_quiet_limits_if_possible(self, &formulation.quiet, &mut selection.drives);
        let (settled, quiet) = settled.ok_or(PlanError::NoFrequencies)?;
        let peaks_g: Vec<f64> = formulation
            .zone
            .targets
            .iter()
            .map(|shape| fundamental_acceleration_peak_at_point_m_per_s2(&selection.drives, shape) / STANDARD_GRAVITY)
            .collect();
        let targets: Vec<TargetResult> = request
            .targets
            .iter()
            .zip(wanted_g.iter().zip(&peaks_g))
            .map(|(target, (wanted_g, peak_g))| TargetResult {
                x_m: target.x_m,
                y_m: y_or_bar_axis_y_m(self, target.y_m),
                wanted_g: *wanted_g,
                peak_g: *peak_g,
            })
            .collect();
        let first = *targets.first().ok_or(PlanError::Count { count: 0 })?;
        let limits = find_reasons_for_unmet_wishes(self, request, &selection, &settled, &targets);
        let plan = Plan {
            target_m: [first.x_m, first.y_m],
            predicted: predict_target_peak_mean_elsewhere_and_contrast(
                self,
                &formulation,
                &selection.drives,
                &settled,
                first.peak_g,
            ),
            limited_by: limitation::join_limitations_as_text_if_any(&limits),
            limits,
            error_bound: bound_relative_peak_error_at_first_target(self, &selection.drives, &first).limit_if_known(),
            targets,
            quiet,
            drives: build_drives_with_settled_voltages(self, &selection.drives, &settled),
            optimality_gap: bound_relative_optimality_gap_after_derating(&selection, &settled),
            objective: request.objective,
            grouping: request.grouping,
            made_of: PlanDrives(selection.drives.as_slice().into()),
            elapsed_us: started.elapsed().as_secs_f64() * 1e6,
        };
        Ok(Planned { plan, drives: selection.drives, settled, shapes: formulation.zone.targets })
    }

    /// Predicts how far `plan`, one of this table's, moves the masses and which free motions it leaves. `None` at an
    /// undamped resonance, or without poles.
    #[must_use]
    pub fn predict_travel_and_free_motion_of_plan_if_poles_known(&self, plan: &Plan) -> Option<PlanMotion> {
        bound_travel_and_free_motion_of_drives_if_poles_known(self, &plan.made_of.0, &plan.drives)
    }

    /// Peak acceleration (equation 23) at every point of the grid in m/s^2; `None` in cut-outs.
    #[must_use]
    pub fn compute_peak_at_each_grid_point_m_per_s2(&self, plan: &Plan) -> Vec<Option<f64>> {
        let mut sums: Vec<(f64, Vec<num_complex::Complex64>)> = Vec::new();
        for (actuator, drive) in plan.drives.iter().enumerate().filter(|(_, drive)| drive.force_n > 0.0) {
            let Ok(row) = self.compute_entries_of_all_actuators_at_hz(drive.frequency_hz) else { continue };
            let Some(entry) = row.get(actuator) else { continue };
            let force = num_complex::Complex64::from_polar(drive.force_n, drive.force_phase_rad);
            let own = self.grid.evaluate_at_each_grid_point(&(&entry.acceleration * force));
            match sums.iter_mut().find(|(hz, _)| *hz == drive.frequency_hz) {
                Some((_, sum)) => sum.iter_mut().zip(own).for_each(|(sum, own)| *sum += own),
                None => sums.push((drive.frequency_hz, own)),
            }
        }
        let peak = |point: usize| sums.iter().map(|(_, field)| field[point].norm()).sum();
        self.grid.there.iter().enumerate().map(|(point, there)| there.then(|| peak(point))).collect()
    }
}

/// The best combination of distinct frequencies, refined between those of the grid. Points of quiet zones are added
/// until none is too strong.
fn choose_distinct_frequency_drives_and_add_quiet_zone_limits(
    table: &PlanTable,
    formulation: &mut Formulation<'_>,
    request: &Request,
    wanted: &[f64],
) -> Result<Selection, PlanError> {
    let mut selection = choose_drives_within_present_quiet_zone_limits(table, formulation, request, wanted)?;
    let [touch, study] = QUIET_ROUNDS;
    for _ in 1..if request.work == SearchEffort::Touch { touch } else { study } {
        if !formulation.quiet.add_limit_at_worst_point_of_each_violated_zone(&selection.drives) {
            break;
        }
        selection = choose_drives_within_present_quiet_zone_limits(table, formulation, request, wanted)?;
    }
    Ok(selection)
}

/// The best combination with the present rows of the quiet zones.
fn choose_drives_within_present_quiet_zone_limits(
    table: &PlanTable,
    formulation: &Formulation<'_>,
    request: &Request,
    wanted: &[f64],
) -> Result<Selection, PlanError> {
    let is_plain = wanted.len() == 1
        && request.quiet.is_empty()
        && request.objective == Objective::Contrast
        && request.weigh == Weigh::Equal;
    let choices_for = |fits: &dyn Fn(f64, f64) -> bool| match wanted {
        [wanted] if is_plain => formulation.shortlist_for_one_target_estimating_energies_if_wish_unmet(*wanted, fits),
        _ => formulation.list_candidates_at_all_table_frequencies(wanted),
    };
    // Where another's harmonic meets a drive it changes, by an amount that no one asked for, what is felt there.
    let best = |fits: PairFilter<'_>| {
        formulation.find_best_combination_replacing_estimated_energies_at_most_once(choices_for(fits), fits)
    };
    let (choices, found) = best(&|a, b| !is_one_near_3rd_5th_or_7th_harmonic_of_other(a, b))
        .or_else(|| best(&|_, _| true))
        .ok_or(PlanError::NoFrequencies)?;
    Ok(refine_frequencies_between_grid(table, formulation, &choices, &found))
}

/// The drives with the voltages and pulse widths of the settled motion.
pub(super) fn build_drives_with_settled_voltages(
    table: &PlanTable,
    chosen: &[ChosenDrive],
    settled: &SettledMotion,
) -> Vec<Drive> {
    let window_phases = window_phase_of_each_drive_keeping_relative_force_phases_rad(chosen, &settled.applied);
    chosen
        .iter()
        .zip(window_phases)
        .zip(table.scene.actuators.iter().zip(&settled.applied))
        .enumerate()
        .map(|(i, ((chosen, phase_rad), (actuator, applied)))| Drive {
            actuator: actuator.id.clone(),
            frequency_hz: chosen.frequency_hz,
            voltage_v: applied.voltage_v,
            pulse_width: applied.pulse_width,
            phase_rad,
            force_phase_rad: phase_rad + force_phase_relative_to_windows_rad(chosen, i, applied.pulse_width),
            force_n: chosen.force_n,
        })
        .collect()
}

/// Predicts what the drives do at the target and elsewhere.
pub(super) fn predict_target_peak_mean_elsewhere_and_contrast(
    table: &PlanTable,
    formulation: &Formulation<'_>,
    drives: &[ChosenDrive],
    settled: &SettledMotion,
    target_peak_g: f64,
) -> Predicted {
    let zone = &formulation.zone;
    let (mut near, mut all, mut near_mean, mut mean) = (0.0, 0.0, 0.0, 0.0);
    for group in group_drive_indices_by_frequency(drives) {
        match group.as_slice() {
            [i] => {
                let Some(entry) = drives[*i].row.get(*i) else { continue };
                let force = drives[*i].force_n;
                near += zone.mean_square_over_zone(&entry.acceleration) * force * force;
                all += entry.mean_square * force * force;
                near_mean += zone.mean_magnitude_over_zone(&entry.acceleration) * force;
                // Off the grid what the table has is an estimate, 2 % off where a resonance is between two frequencies.
                let of_one = if drives[*i].on_grid.is_some() {
                    entry.mean
                } else {
                    table.grid.mean_magnitude_over_surface(&entry.acceleration)
                };
                mean += of_one * force;
            }
            members => {
                let sum = sum_acceleration_coordinates_of_drives(table, drives, members);
                near += zone.mean_square_over_zone(&sum);
                all += table.mean_square_over_surface(&sum);
                near_mean += zone.mean_magnitude_over_zone(&sum);
                mean += table.grid.mean_magnitude_over_surface(&sum);
            }
        }
    }
    let components = |shape: &DVector<f64>| -> Vec<(f64, f64)> {
        group_drive_indices_by_frequency(drives)
            .map(|group| {
                let hz = drives[group[0]].frequency_hz;
                (
                    hz,
                    acceleration_at_point_from_coordinates(
                        shape,
                        &sum_acceleration_coordinates_of_drives(table, drives, &group),
                    )
                    .norm(),
                )
            })
            .collect()
    };
    let shape = zone.targets.first();
    let closer = solve_motion_with_harmonics_if_pulses_are_narrow(table, drives, settled);
    let settled = closer.as_ref().unwrap_or(settled);
    Predicted {
        target_peak_g,
        mean_elsewhere_g: ((mean - zone.part * near_mean) / (1.0 - zone.part)).max(0.0) / STANDARD_GRAVITY,
        contrast_db: clamped_contrast_db(near, if all > 0.0 { zone.mean_square_elsewhere(all, near) } else { 0.0 }),
        softened_peak_g: shape.map_or(0.0, |shape| settled_peak_acceleration_at_point_m_per_s2(drives, settled, shape))
            / STANDARD_GRAVITY,
        above_threshold_db: shape.and_then(|shape| level_above_threshold_unless_at_rest_db(&components(shape))),
    }
}

/// Acceleration coordinates of several drives of one frequency together, with their phases.
fn sum_acceleration_coordinates_of_drives(
    table: &PlanTable,
    drives: &[ChosenDrive],
    drive_indices: &[usize],
) -> DVector<num_complex::Complex64> {
    let mut sum = DVector::zeros(table.model.count_coordinates());
    for i in drive_indices {
        if let Some(entry) = drives[*i].row.get(*i) {
            let force = num_complex::Complex64::from_polar(drives[*i].force_n, drives[*i].force_phase_rad);
            sum += &entry.acceleration * force;
        }
    }
    sum
}

/// The reasons why the wishes are not met; empty if they are.
fn find_reasons_for_unmet_wishes(
    table: &PlanTable,
    request: &Request,
    selection: &Selection,
    settled: &SettledMotion,
    targets: &[TargetResult],
) -> Vec<Limitation> {
    let is_met = match request.weigh {
        Weigh::Equal => targets.iter().all(|target| target.peak_g >= target.wanted_g * MET_FRACTION),
        // In weighed accelerations, which are not the targets' own.
        Weigh::Felt => selection.allocation.met * settled.scale >= MET_FRACTION,
    };
    if is_met {
        return Vec::new();
    }
    let mut found = Vec::new();
    if let Some((actuator, limit)) = settled.limited {
        add_limitation_if_new(&mut found, Limitation::for_actuator(table, limit, actuator));
    }
    if settled.is_quieted {
        add_limitation_if_new(&mut found, Limitation::QuietZone);
    }
    if selection.allocation.met < 1.0 {
        for (i, drive) in selection.drives.iter().enumerate() {
            if drive.force_n >= drive.width.max_force_n * settled.scale * MET_FRACTION && drive.width.max_force_n > 0.0
            {
                add_limitation_if_new(&mut found, Limitation::for_actuator(table, drive.width.limit, i));
            }
        }
        for row in &selection.active {
            let limit = table.limits.actuator_and_limit_of_row_if_in_range(*row);
            let of = |(actuator, limit)| Limitation::for_actuator(table, limit, actuator);
            add_limitation_if_new(&mut found, limit.map_or(Limitation::QuietZone, of));
        }
    }
    if found.is_empty() {
        found = find_limits_nearly_reached_before_derating(table, selection, settled.scale);
    }
    if found.is_empty() { vec![Limitation::Node] } else { found }
}

/// The relative gap by which another combination could be better; what safety took away counts as what another might
/// have kept.
fn bound_relative_optimality_gap_after_derating(selection: &Selection, settled: &SettledMotion) -> f64 {
    let gap = (1.0 + selection.gap) / settled.scale.max(f64::MIN_POSITIVE) - 1.0;
    if gap > NO_GAP { gap.min(MOST_GAP) } else { 0.0 }
}

/// 10 log10(near / rest), within 200 dB either way; 0 where nothing moves.
pub(super) fn clamped_contrast_db(near_mean_square: f64, rest_mean_square: f64) -> f64 {
    if near_mean_square <= 0.0 && rest_mean_square <= 0.0 {
        return 0.0;
    }
    (10.0 * (near_mean_square / rest_mean_square).log10()).clamp(-MOST_CONTRAST_DB, MOST_CONTRAST_DB)
}
