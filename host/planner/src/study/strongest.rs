//! The strongest drive at each of many points.

use crate::PlanTable;
use crate::reach::setting::command;
use crate::reach::{Space, search};
use crate::request::Work;
use crate::stop::StopRequest;
use crate::table::Part;
use rayon::prelude::*;

/// Neighbouring points that are searched in turn, each with the one before as a hint.
const RUN: usize = 16;

/// The strongest drive at a point.
#[derive(Clone, Debug)]
pub struct Strongest {
    /// As it is commanded.
    pub setting: Vec<Part>,
    /// Its peak there, in the space's unit.
    pub peak: f64,
}

/// The strongest drive at each point of a space, each with frequencies and forces of its own; none from when nobody waits on ([`StopRequest`]).
#[must_use]
pub fn strongest(table: &PlanTable, space: &Space) -> Vec<Option<Strongest>> {
    let stop = StopRequest::current_request_of_thread();
    let points: Vec<usize> = (0..space.points).collect();
    let runs: Vec<Vec<Option<Strongest>>> = points
        .par_chunks(RUN)
        .map(|run| {
            let mut hint: Option<Vec<usize>> = None;
            let each = run.iter().map(|point| {
                if stop.is_stop_requested() {
                    return None;
                }
                let best = search::best(space, &[*point], Work::Study, hint.as_deref())?;
                let mut setting = best.setting(table, space);
                let peak = best.least * command(table, &mut setting)?;
                hint = Some(best.choice);
                Some(Strongest { setting, peak })
            });
            each.collect()
        })
        .collect();
    runs.into_iter().flatten().collect()
}
