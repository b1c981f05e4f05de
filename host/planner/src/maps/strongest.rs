//! The strongest drive at each of many points.

use crate::PlanTable;
use crate::reach::setting::derate_setting_to_safe_fraction_if_any;
use crate::reach::{ReachSpace, search};
use crate::request::SearchEffort;
use crate::stop::StopRequest;
use crate::table::ActuatorSetting;
use rayon::prelude::*;

/// Neighbouring points that are searched in turn, each with the one before as a hint.
const RUN: usize = 16;

/// The strongest drive at a point.
#[derive(Clone, Debug)]
pub struct StrongestDrive {
    /// As it is commanded.
    pub setting: Vec<ActuatorSetting>,
    /// Its peak there, in the space's unit.
    pub peak: f64,
}

/// The strongest drive at each point of a space, each with frequencies and forces of its own. Points are `None` once
/// the search is stopped ([`StopRequest`]).
#[must_use]
pub fn strongest_drive_at_each_point_unless_stopped(
    table: &PlanTable,
    space: &ReachSpace,
) -> Vec<Option<StrongestDrive>> {
    let stop = StopRequest::current_request_of_thread();
    let points: Vec<usize> = (0..space.points).collect();
    let runs: Vec<Vec<Option<StrongestDrive>>> = points
        .par_chunks(RUN)
        .map(|run| {
            let mut hint: Option<Vec<usize>> = None;
            let each = run.iter().map(|point| {
                if stop.is_stop_requested_or_deadline_over() {
                    return None;
                }
                let best = search::find_frequencies_with_largest_least_gain_if_spacing_possible(
                    space,
                    &[*point],
                    SearchEffort::Study,
                    hint.as_deref(),
                )?;
                let mut setting = best.to_setting(table, space);
                let peak = best.least * derate_setting_to_safe_fraction_if_any(table, &mut setting)?;
                hint = Some(best.choice);
                Some(StrongestDrive { setting, peak })
            });
            each.collect()
        })
        .collect();
    runs.into_iter().flatten().collect()
}
