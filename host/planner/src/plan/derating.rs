//! A plan with a fraction of its forces, for the time in which the residual vibration of earlier touches leaves no
//! headroom for all of them.

use crate::choose::candidates::Formulation;
use crate::chosen_drive::{PlanDrives, fundamental_acceleration_peak_at_point_m_per_s2};
use crate::motion::plan_motion::list_voltage_and_pulse_width_of_each_actuator;
use crate::motion::quiet_limits::derate_drives_to_safety_and_quiet_limits_if_possible;
use crate::plan::limitation::{self, Limitation, add_limitation_if_new};
use crate::plan::{Plan, TargetResult};
use crate::plan::{build_drives_with_settled_voltages, predict_target_peak_mean_elsewhere_and_contrast};
use crate::request::{QuietZone, Request, Target};
use crate::table::PlanTable;
use crate::{PlanError, STANDARD_GRAVITY};

/// `plan`, one of this table's, with all forces times `force_fraction`, 0 to 1. Predictions, voltages and quiet zones are
/// computed again, because electrodes soften less. The wishes stay, and `limits` says why they are not met.
///
/// # Errors
/// [`PlanError`], which a plan of this table does not cause.
pub fn derate_plan(table: &PlanTable, plan: &Plan, force_fraction: f64) -> Result<Plan, PlanError> {
    let mut drives = plan.made_of.0.to_vec();
    let applied = list_voltage_and_pulse_width_of_each_actuator(&plan.drives);
    for ((drive, applied), electrodes) in drives.iter_mut().zip(applied).zip(&table.electrodes) {
        drive.force_n *= force_fraction;
        drive.width =
            drive.width.with_pulse_width_keeping_max_force(electrodes, drive.frequency_hz, applied.pulse_width);
    }
    let target =
        |result: &TargetResult| Target { x_m: result.x_m, y_m: result.y_m, intensity_g: Some(result.wanted_g) };
    let quiet = plan.quiet.iter().map(|zone| QuietZone {
        x_m: zone.x_m,
        y_m: zone.y_m,
        radius_m: zone.radius_m,
        at_most_g: zone.at_most_g,
    });
    let request = Request {
        targets: plan.targets.iter().map(target).collect(),
        quiet: quiet.collect(),
        objective: plan.objective,
        grouping: plan.grouping,
        ..Request::default()
    };
    let formulation = Formulation::new(table, &request);
    let (settled, quiet) = derate_drives_to_safety_and_quiet_limits_if_possible(table, &formulation.quiet, &mut drives)
        .ok_or(PlanError::NoFrequencies)?;
    let mut weaker = plan.clone();
    for (target, shape) in weaker.targets.iter_mut().zip(&formulation.zone.targets) {
        target.peak_g = fundamental_acceleration_peak_at_point_m_per_s2(&drives, shape) / STANDARD_GRAVITY;
    }
    let first_g = weaker.targets.first().map_or(0.0, |target| target.peak_g);
    weaker.predicted = predict_target_peak_mean_elsewhere_and_contrast(table, &formulation, &drives, &settled, first_g);
    weaker.drives = build_drives_with_settled_voltages(table, &drives, &settled);
    weaker.made_of = PlanDrives(drives.into());
    weaker.quiet = quiet;
    add_limitation_if_new(&mut weaker.limits, Limitation::StillMoving);
    weaker.limited_by = limitation::join_limitations_as_text_if_any(&weaker.limits);
    Ok(weaker)
}
