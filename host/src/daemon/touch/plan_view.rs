//! Plans and fields as JSON.

use crate::effects::EffectDesign;
use crate::planner::{Plan, PlanTable, STANDARD_GRAVITY, Times};
use serde::Serialize;
use utoipa::ToSchema;

/// A plan, with its rise and decay times.
#[derive(Clone, Debug, Serialize, ToSchema)]
#[schema(as = TimedPlan)]
pub struct PlanView {
    #[serde(flatten)]
    plan: Plan,
    /// When the vibration at the first target has risen, and when it has decayed.
    times: Times,
    /// Of an effect: the plan of its even motion, and the part of that which the effect reaches; its map is as much of the even motion's.
    #[serde(skip)]
    even: Option<(Box<Plan>, f64)>,
    /// The fraction of the forces of the plan that is driven, and the reason; absent if all forces are driven.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schema(nullable = false)]
    thinned: Option<Thinned>,
}

impl PlanView {
    /// The view of `plan`, one of this table's.
    #[must_use]
    pub fn new(table: &PlanTable, plan: Plan) -> Self {
        Self {
            times: crate::planner::report::compute_rise_and_decay_times_at_first_target(table, &plan),
            plan,
            even: None,
            thinned: None,
        }
    }

    /// The view of `plan` while an effect designed for it is played: what is told is what the effect does.
    #[must_use]
    pub fn for_effect(plan: Plan, design: &EffectDesign) -> Self {
        let (told, part) =
            (design.plan_with_drives_and_predictions_of_effect(&plan), design.peak_as_fraction_of_steady_peak(&plan));
        Self {
            plan: told,
            times: design.peak_time_from_start_and_decay_time_from_end_at_first_target(),
            even: Some((Box::new(plan), part)),
            thinned: None,
        }
    }

    /// Its field on the table's grid; of an effect that of the even motion, as strong at the target as the effect is.
    #[must_use]
    pub fn compute_peak_acceleration_field(&self, table: &PlanTable, plan_id: u64) -> FieldView {
        match &self.even {
            Some((even, part)) => {
                FieldView::compute_scaled_peak_acceleration_field_zero_without_plan(table, Some(even), plan_id, *part)
            }
            None => FieldView::new(table, Some(&self.plan), plan_id),
        }
    }

    /// The same, driven with less.
    #[must_use]
    pub fn with_note_of_reduced_force(self, thinned: Option<Thinned>) -> Self {
        Self { thinned, ..self }
    }

    /// Whether the board rests in it.
    #[must_use]
    pub fn is_board_resting(&self) -> bool {
        self.thinned == Some(Thinned::RESTS)
    }

    /// The plan itself.
    #[must_use]
    pub const fn plan(&self) -> &Plan {
        &self.plan
    }
}

/// A plan is driven with a fraction of its forces, or not at all during a rest.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, ToSchema)]
pub struct Thinned {
    /// Fraction of the plan's forces that is driven.
    #[schema(minimum = 0, maximum = 1)]
    pub part: f64,
    /// Why the plan is driven with less force.
    pub reason: Reason,
}

/// Why a plan is driven with less force: the credit of a channel, or the rest after a burst.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, ToSchema)]
#[schema(as = ThinnedFor)]
#[serde(rename_all = "lowercase")]
pub enum Reason {
    /// A channel's credit.
    Credit,
    /// The rest after a burst.
    Burst,
}

impl Thinned {
    /// The pause in which a board rests.
    pub const RESTS: Self = Self { part: 0.0, reason: Reason::Burst };

    /// For the credit; `None` where all is driven.
    #[must_use]
    pub fn for_credit_if_below_full_force(force_fraction: f64) -> Option<Self> {
        (force_fraction < 1.0).then_some(Self { part: force_fraction, reason: Reason::Credit })
    }
}

/// Predicted peak acceleration over the surface.
#[derive(Clone, Debug, Serialize, ToSchema)]
#[schema(as = Field)]
pub struct FieldView {
    /// Number of points from left to right.
    nx: usize,
    /// Number of points from top to bottom.
    ny: usize,
    /// Distances of the points from the left edge of the surface in mm.
    x_mm: Vec<f64>,
    /// Distances of the points from the top edge of the surface in mm.
    y_mm: Vec<f64>,
    /// Peak accelerations in g: ny rows of nx values, the top row first; null in cut-outs.
    peak_g: Vec<Option<f64>>,
    /// The largest peak acceleration in g.
    max_g: f64,
    /// Number of the plan; 0 for a plan that is not driven.
    plan_id: u64,
}

impl FieldView {
    /// The field of `plan` on the table's grid, null in cut-outs; zeros without one.
    #[must_use]
    pub fn new(table: &PlanTable, plan: Option<&Plan>, plan_id: u64) -> Self {
        Self::compute_scaled_peak_acceleration_field_zero_without_plan(table, plan, plan_id, 1.0)
    }

    /// The same times `factor`.
    fn compute_scaled_peak_acceleration_field_zero_without_plan(
        table: &PlanTable,
        plan: Option<&Plan>,
        plan_id: u64,
        factor: f64,
    ) -> Self {
        let grid = &table.grid;
        let in_g = |peak: f64| round_to_micro(factor * peak / STANDARD_GRAVITY);
        let peak_g: Vec<Option<f64>> = match plan {
            Some(plan) => {
                table.compute_peak_at_each_grid_point_m_per_s2(plan).into_iter().map(|peak| peak.map(in_g)).collect()
            }
            None => grid.there.iter().map(|there| there.then_some(0.0)).collect(),
        };
        Self {
            nx: grid.x_m.len(),
            ny: grid.y_m.len(),
            x_mm: grid.x_m.iter().map(|x| round_to_micro(x * 1e3)).collect(),
            y_mm: grid.y_m.iter().map(|y| round_to_micro(y * 1e3)).collect(),
            max_g: peak_g.iter().flatten().copied().fold(0.0, f64::max),
            peak_g,
            plan_id,
        }
    }
}

/// Six decimals: a map of 1600 numbers goes over the wire at every touch.
fn round_to_micro(value: f64) -> f64 {
    (value * 1e6).round() / 1e6
}
