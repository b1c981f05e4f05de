//! Strengths in g, or in dB above the threshold of feeling.

use crate::perception;
use crate::physics::rise::PanelPoles;
use crate::scene::SurfaceKind;
use crate::transient::panel::SwitchedForce;
use crate::{Plan, PlanError, PlanTable, Request, STANDARD_GRAVITY};
use nalgebra::DVector;
use num_complex::Complex64;
use std::f64::consts::FRAC_PI_2;

/// Range of a level above threshold in dB: from where nothing is felt to some 300 g.
pub const MIN_DB: f64 = -20.0;
/// See [`MIN_DB`].
pub const MAX_DB: f64 = 80.0;
/// Rounds of planning for a level: the second has the frequencies of the right strength, unless a limit changes them.
const PLANNING_ROUNDS: usize = 4;
/// Difference in dB that is none; fingers tell 1 dB at best.
const CLOSE_DB: f64 = 0.01;

/// How strong.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Intensity {
    /// Peak acceleration in g, 0 or more.
    G(f64),
    /// Above the threshold of feeling, in dB ([`perception::level_above_threshold_unless_at_rest_db`]), [`MIN_DB`] to [`MAX_DB`].
    AboveThresholdDb(f64),
}

/// Mode shapes at a target; a bar's points lie on its axis.
#[must_use]
pub fn mode_shape_values_at_point_or_on_bar_axis(table: &PlanTable, x_m: f64, y_m: f64) -> DVector<f64> {
    let y_m = match table.scene.surface.kind {
        SurfaceKind::Bar => table.scene.surface.width_m / 2.0,
        SurfaceKind::Plate => y_m,
    };
    table.model.shape_deflections_at(x_m, y_m)
}

/// The drives of a plan as harmonic forces, each a sine that begins at a boundary of its own period, like the board
/// starts them.
#[must_use]
pub fn list_switched_forces_of_plan(table: &PlanTable, plan: &Plan) -> Vec<SwitchedForce> {
    let index = |id: &str| table.scene.actuators.iter().position(|actuator| actuator.id == id);
    plan.drives
        .iter()
        .filter_map(|drive| {
            Some(SwitchedForce {
                actuator: index(&drive.actuator)?,
                frequency_hz: drive.frequency_hz,
                force_n: drive.force_n,
                phase_rad: drive.force_phase_rad - FRAC_PI_2,
            })
        })
        .collect()
}

/// Level of a plan above the threshold where `shape` holds the mode shapes, in dB; `None` where nothing moves. Drives of one
/// frequency add as phasors before they are compared with its threshold.
#[must_use]
pub fn level_above_threshold_at_point_if_any_motion_db(
    rise: &PanelPoles,
    shape: &DVector<f64>,
    drives: &[SwitchedForce],
) -> Option<f64> {
    let ringings = rise.transient_response_per_n_of_each_drive_if_finite(shape, drives)?;
    let mut sums: Vec<(f64, Complex64)> = Vec::with_capacity(drives.len());
    for (drive, ringing) in drives.iter().zip(&ringings) {
        let phasor = ringing.steady * drive.force_n;
        match sums.iter_mut().find(|(hz, _)| *hz == drive.frequency_hz) {
            Some((_, sum)) => *sum += phasor,
            None => sums.push((drive.frequency_hz, phasor)),
        }
    }
    let components: Vec<(f64, f64)> = sums.into_iter().map(|(hz, sum)| (hz, sum.norm())).collect();
    perception::level_above_threshold_unless_at_rest_db(&components)
}

/// Plans `request`, with `intensity_of_open_targets` for those of its targets that have none. A level in dB is met by planning for a
/// peak, computing its level at the chosen frequencies (with the poles of `rise`, which are requested only then), and
/// planning again: below the limits a plan is proportional to its wish.
///
/// # Errors
/// [`PlanError`]; out of range levels name `intensity_db`.
pub fn plan_request_with_intensity_for_targets_without_one<'a>(
    table: &PlanTable,
    rise: impl FnOnce() -> Option<&'a PanelPoles>,
    request: &Request,
    intensity_of_open_targets: Option<Intensity>,
) -> Result<Plan, PlanError> {
    let mut request = request.clone();
    let wanted_db = match intensity_of_open_targets {
        None => return table.plan_request(&request),
        Some(Intensity::G(g)) => {
            for target in &mut request.targets {
                target.intensity_g = target.intensity_g.or(Some(g));
            }
            return table.plan_request(&request);
        }
        Some(Intensity::AboveThresholdDb(db)) => db,
    };
    if !(MIN_DB..=MAX_DB).contains(&wanted_db) {
        return Err(PlanError::Range { field: "intensity_db", value: wanted_db, min: MIN_DB, max: MAX_DB });
    }
    let is_open: Vec<bool> = request.targets.iter().map(|target| target.intensity_g.is_none()).collect();
    let mut plan = table.plan_request(&request)?;
    let Some(rise) = rise() else { return Ok(plan) };
    let shapes: Vec<_> = request
        .targets
        .iter()
        .map(|target| mode_shape_values_at_point_or_on_bar_axis(table, target.x_m, target.y_m))
        .collect();
    for _ in 0..PLANNING_ROUNDS {
        let drives = list_switched_forces_of_plan(table, &plan);
        let mut furthest_db = 0.0_f64;
        let all = request.targets.iter_mut().zip(&shapes).zip(&plan.targets).zip(&is_open);
        for ((target, shape), result) in all.filter(|(_, is_open)| **is_open).map(|(all, _)| all) {
            // A target that nothing moves has no level, and keeps its wish.
            let Some(db) = level_above_threshold_at_point_if_any_motion_db(rise, shape, &drives) else { continue };
            furthest_db = furthest_db.max((wanted_db - db).abs());
            let g = result.peak_g * 10_f64.powf((wanted_db - db) / 20.0);
            target.intensity_g = Some(g.min(1e6 / STANDARD_GRAVITY));
        }
        if furthest_db < CLOSE_DB {
            break;
        }
        plan = table.plan_request(&request)?;
        if plan.limited_by.is_some() {
            break;
        }
    }
    Ok(plan)
}

/// The request with peaks in g that have the given level above the threshold of feeling.
///
/// # Errors
/// As [`plan_request_with_intensity_for_targets_without_one`].
pub fn set_missing_target_peaks_from_level_if_given(
    table: &PlanTable,
    mut request: Request,
    level_db: Option<f64>,
) -> Result<Request, PlanError> {
    let Some(db) = level_db else { return Ok(request) };
    let plan = plan_request_with_intensity_for_targets_without_one(
        table,
        || table.panel_poles(),
        &request,
        Some(Intensity::AboveThresholdDb(db)),
    )?;
    for (target, found) in request.targets.iter_mut().zip(&plan.targets) {
        target.intensity_g = target.intensity_g.or(Some(found.wanted_g));
    }
    Ok(request)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::{Accuracy, PanelModel};
    use crate::scene::{STARTING_PLATE, Scene};
    use crate::{TableOptions, Target};

    #[test]
    fn a_level_is_met() {
        let scene = Scene::parse("plate", STARTING_PLATE).unwrap();
        let model = PanelModel::build(&scene, Accuracy::FAST, 400.0)
            .unwrap()
            .reduce_with_residual_shapes_of_actuators_damping_and_points(400.0, &[])
            .unwrap();
        let table = PlanTable::build(&scene, model, TableOptions::default()).unwrap();
        let rise = PanelPoles::find_poles_if_converged(&table.model);
        for (x_m, y_m, db) in [(0.05, 0.04, 12.0), (0.15, 0.1, 20.0), (0.28, 0.02, 6.0)] {
            let target = Target { x_m, y_m, intensity_g: None };
            let plan = plan_request_with_intensity_for_targets_without_one(
                &table,
                || rise.as_ref(),
                &Request::for_touch(&[target]),
                Some(Intensity::AboveThresholdDb(db)),
            )
            .unwrap();
            assert_eq!(plan.limited_by, None, "at {x_m}");
            let shape = mode_shape_values_at_point_or_on_bar_axis(&table, x_m, y_m);
            let found = level_above_threshold_at_point_if_any_motion_db(
                rise.as_ref().unwrap(),
                &shape,
                &list_switched_forces_of_plan(&table, &plan),
            )
            .unwrap();
            assert!((found - db).abs() < 0.1, "{db} dB wanted at {x_m}, {y_m}: {found}");
        }
        let target = Target { x_m: 0.1, y_m: 0.1, intensity_g: None };
        let error = plan_request_with_intensity_for_targets_without_one(
            &table,
            || rise.as_ref(),
            &Request::for_touch(&[target]),
            Some(Intensity::AboveThresholdDb(99.0)),
        )
        .unwrap_err();
        assert!(error.to_string().contains("intensity_db"), "{error}");

        // Two equal drives of one frequency a third of a turn apart are as strong as one; of two frequencies, stronger.
        let shape = mode_shape_values_at_point_or_on_bar_axis(&table, 0.1, 0.1);
        let drive = |frequency_hz, phase_rad| SwitchedForce { actuator: 0, frequency_hz, force_n: 0.02, phase_rad };
        let level = |drives: &[SwitchedForce]| {
            level_above_threshold_at_point_if_any_motion_db(rise.as_ref().unwrap(), &shape, drives).unwrap()
        };
        let alone = level(&[drive(150.0, 0.0)]);
        let apart = level(&[drive(150.0, 0.3), drive(150.0, 0.3 + std::f64::consts::TAU / 3.0)]);
        assert!((apart - alone).abs() < 1e-9, "{apart} {alone}");
        assert!((level(&[drive(150.0, 0.0), drive(150.0, 0.0)]) - alone - 20.0 * 2.0_f64.log10()).abs() < 1e-9);
        assert!(level(&[drive(150.0, 0.0), drive(150.1, 2.0)]) > alone + 5.9);
    }
}
