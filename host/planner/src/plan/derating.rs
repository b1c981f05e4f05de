//! A plan with a part of its forces: what is driven where the motion that is left of earlier touches leaves no room for all of it.

use crate::choose::candidates::Formulation;
use crate::chosen_drive::{MadeOf, peak};
use crate::motion::plan_motion::applied;
use crate::motion::quiet_limits::settle_within_quiet_zones;
use crate::plan::limitation::{self, Limitation, add};
use crate::plan::{Plan, TargetResult};
use crate::plan::{build_drives, predict_accelerations};
use crate::request::{Quiet, Request, Target};
use crate::table::PlanTable;
use crate::{PlanError, STANDARD_GRAVITY};

/// `plan`, one of this table's, with all forces times `part`, 0 to 1: predictions, voltages and quiet zones are worked out anew,
/// as electrodes soften less. Its wishes stay, and `limits` says why they are not met.
///
/// # Errors
/// [`PlanError`], which a plan of this table does not cause.
pub fn derate_plan(table: &PlanTable, plan: &Plan, part: f64) -> Result<Plan, PlanError> {
    let mut drives = plan.made_of.0.to_vec();
    for (drive, applied) in drives.iter_mut().zip(applied(&plan.drives)) {
        drive.force_n *= part;
        drive.width.pulse_width = applied.pulse_width;
    }
    let target =
        |result: &TargetResult| Target { x_m: result.x_m, y_m: result.y_m, intensity_g: Some(result.wanted_g) };
    let quiet = plan.quiet.iter().map(|zone| Quiet {
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
    let (settled, quiet) =
        settle_within_quiet_zones(table, &formulation.quiet, &mut drives).ok_or(PlanError::NoFrequencies)?;
    let mut weaker = plan.clone();
    for (target, shape) in weaker.targets.iter_mut().zip(&formulation.zone.targets) {
        target.peak_g = peak(&drives, shape) / STANDARD_GRAVITY;
    }
    let first_g = weaker.targets.first().map_or(0.0, |target| target.peak_g);
    weaker.predicted = predict_accelerations(table, &formulation, &drives, &settled, first_g);
    weaker.drives = build_drives(table, &drives, &settled);
    weaker.made_of = MadeOf(drives.into());
    weaker.quiet = quiet;
    add(&mut weaker.limits, Limitation::StillMoving);
    weaker.limited_by = limitation::text(&weaker.limits);
    Ok(weaker)
}
