//! Fingers, plans and fields as JSON.

use crate::daemon::drive::credit::Thinned;
use crate::effects::{Design, NamedEffect};
use crate::planner::{Plan, PlanTable, STANDARD_GRAVITY, Times};
use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

/// One finger.
#[derive(Clone, Copy, Debug, Serialize, Deserialize, ToSchema)]
#[schema(as = Finger)]
#[serde(deny_unknown_fields)]
pub struct TouchView {
    /// The page's number for it.
    #[serde(default, deserialize_with = "crate::daemon::api::whole_numbers::read_whole")]
    pub id: i64,
    /// In pixels of the scene's screen.
    pub x_px: f64,
    /// In pixels of the scene's screen.
    pub y_px: f64,
    /// Peak wanted for it alone, in g.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub intensity_g: Option<f64>,
    /// Played when it goes down; one panel plays one effect, the first finger's that has one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub effect: Option<NamedEffect>,
}

/// A plan as sent to clients.
#[derive(Clone, Debug, Serialize, ToSchema)]
#[schema(as = TimedPlan)]
pub struct PlanView {
    #[serde(flatten)]
    plan: Plan,
    /// When the first target vibrates under it, and when it has stopped.
    times: Times,
    /// Of an effect: the plan of its even motion, and the part of that which the effect reaches; its map is as much of the even motion's.
    #[serde(skip)]
    even: Option<(Box<Plan>, f64)>,
    /// What part of its forces is driven, and why, where that is not all.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schema(nullable = false)]
    thinned: Option<Thinned>,
}

impl PlanView {
    /// The view of `plan`, one of this table's.
    #[must_use]
    pub fn new(table: &PlanTable, plan: Plan) -> Self {
        Self { times: crate::planner::report::compute_times(table, &plan), plan, even: None, thinned: None }
    }

    /// The view of `plan` while an effect designed for it is played: what is told is what the effect does.
    #[must_use]
    pub fn played(plan: Plan, design: &Design) -> Self {
        let (told, part) = (design.plan_as_played(&plan), design.part_of_even(&plan));
        Self { plan: told, times: design.times(), even: Some((Box::new(plan), part)), thinned: None }
    }

    /// Its field on the table's grid; of an effect that of the even motion, as strong at the target as the effect is.
    #[must_use]
    pub fn field(&self, table: &PlanTable, plan_id: u64) -> FieldView {
        match &self.even {
            Some((even, part)) => FieldView::of(table, Some(even), plan_id, *part),
            None => FieldView::new(table, Some(&self.plan), plan_id),
        }
    }

    /// The same, driven with less.
    #[must_use]
    pub fn thinned(self, thinned: Option<Thinned>) -> Self {
        Self { thinned, ..self }
    }

    /// Whether the board rests in it.
    #[must_use]
    pub fn rests(&self) -> bool {
        self.thinned == Some(Thinned::RESTS)
    }

    /// The plan itself.
    #[must_use]
    pub const fn plan(&self) -> &Plan {
        &self.plan
    }
}

/// Predicted peak acceleration over the surface.
#[derive(Clone, Debug, Serialize, ToSchema)]
#[schema(as = Field)]
pub struct FieldView {
    /// Points from left to right.
    nx: usize,
    /// Points from top to bottom.
    ny: usize,
    /// Their places from the left edge in mm.
    x_mm: Vec<f64>,
    /// Their places from the top edge in mm.
    y_mm: Vec<f64>,
    /// Peaks in g: ny rows of nx, y down; null in cut-outs.
    peak_g: Vec<Option<f64>>,
    /// The largest of them in g.
    max_g: f64,
    /// The plan's number; 0 where nothing is driven.
    plan_id: u64,
}

impl FieldView {
    /// The field of `plan` on the table's grid, null in cut-outs; zeros without one.
    #[must_use]
    pub fn new(table: &PlanTable, plan: Option<&Plan>, plan_id: u64) -> Self {
        Self::of(table, plan, plan_id, 1.0)
    }

    /// The same times `part`.
    fn of(table: &PlanTable, plan: Option<&Plan>, plan_id: u64, part: f64) -> Self {
        let grid = &table.grid;
        let in_g = |peak: f64| round(part * peak / STANDARD_GRAVITY);
        let peak_g: Vec<Option<f64>> = match plan {
            Some(plan) => table.compute_peak_field(plan).into_iter().map(|peak| peak.map(in_g)).collect(),
            None => grid.there.iter().map(|there| there.then_some(0.0)).collect(),
        };
        Self {
            nx: grid.x_m.len(),
            ny: grid.y_m.len(),
            x_mm: grid.x_m.iter().map(|x| round(x * 1e3)).collect(),
            y_mm: grid.y_m.iter().map(|y| round(y * 1e3)).collect(),
            max_g: peak_g.iter().flatten().copied().fold(0.0, f64::max),
            peak_g,
            plan_id,
        }
    }
}

/// Six decimals: a map of 1600 numbers goes over the wire at every touch.
fn round(value: f64) -> f64 {
    (value * 1e6).round() / 1e6
}
