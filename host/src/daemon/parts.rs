//! Parts of a plan's forces: as many as the channels' credit allows, and as there is room for.

use super::active::Held;
use super::app::{App, Kind, Prepared};
use super::problem::Problem;
use super::thin;
use super::touch::Manner;
use super::turns::Turn;
use crate::effects::{DesignError, design};
use crate::planner::Plan;
use crate::planner::drive::on_channels;
use crate::planner::limitation::Limitation;
use crate::planner::residual::{fitted, grown};

/// A part of a plan's forces, the plan with these, and what it takes to drive it.
pub type PartOfPlan = (f64, (Plan, Prepared));

impl App {
    /// An even drive as strong as the credit of the channels allows for as long as it may be held, with the part of its
    /// forces that this is.
    pub(super) fn thinned(&self, plan: Plan, prepared: Prepared, manner: Manner) -> Result<PartOfPlan, Problem> {
        let thin = if matches!(manner, Manner::Hold(_)) { self.part_by_credit(&plan) } else { 1.0 };
        let thinned = if thin < 1.0 { self.of_part(&plan, thin, 1.0, manner)? } else { (plan, prepared) };
        Ok((thin, thinned))
    }

    /// The part of a plan's forces that the channels' credit allows ([`thin::part`]), as far as that is known.
    pub(super) fn part_by_credit(&self, plan: &Plan) -> f64 {
        let snapshots = self.session.snapshots();
        let snapshot = snapshots.borrow();
        let (Some(credit), Some(identity)) = (&snapshot.credit, &snapshot.identity) else { return 1.0 };
        let most_v: Vec<f64> =
            identity.channels.iter().map(|channel| f64::from(channel.max_voltage_millivolts) / 1e3).collect();
        thin::part(&on_channels(&plan.drives), &most_v, credit)
    }

    /// As much of `first`, the part `thin` of a `whole` plan, as there is room for on top of what is left of the touches before,
    /// and the part of its forces that this is.
    pub(super) fn fitted(
        &self,
        turn: &Turn<'_>,
        first: (Plan, Prepared),
        whole: &Plan,
        thin: f64,
        manner: Manner,
    ) -> Result<PartOfPlan, Problem> {
        let weaker = |part: f64| {
            tracing::info!(plan = turn.id(), part, "weaker, for what is left of the touches before");
            self.of_part(whole, thin, part, manner)
        };
        fitted(first, weaker, |(plan, prepared)| turn.part(&prepared.motion, prepared.drives(plan)))
    }

    /// More than the part of its forces that is driven of a held plan, if there is room for that ([`grown`]).
    pub(super) fn grown(&self, turn: &Turn<'_>, held: &Held, manner: Manner) -> Result<Option<PartOfPlan>, Problem> {
        let of_part = |part: f64| self.of_part(&held.whole, held.thin, part, manner);
        grown(held.part, of_part, |(plan, prepared)| turn.part(&prepared.motion, prepared.drives(plan)))
    }

    /// A plan with the part of its forces that credit allows, and of these the part for which there is room.
    pub(super) fn of_part(
        &self,
        whole: &Plan,
        thin: f64,
        part: f64,
        manner: Manner,
    ) -> Result<(Plan, Prepared), Problem> {
        let mut plan = if thin * part < 1.0 { self.table.weaker(whole, thin * part)? } else { whole.clone() };
        if part >= 1.0 {
            // Nothing is left of the touches before that would be in its way.
            (plan.limits, plan.limited_by) = (whole.limits.clone(), whole.limited_by.clone());
        }
        let prepared = self.prepared(&plan, part, manner)?;
        Ok((plan, prepared))
    }

    /// What it takes to drive a plan that has `part` of the forces first planned.
    pub(super) fn prepared(&self, plan: &Plan, part: f64, manner: Manner) -> Result<Prepared, Problem> {
        let (motion, kind) = match manner {
            Manner::Hold(hold) => (self.table.motion(plan), Kind::Hold(hold)),
            Manner::Effect(request) => {
                let rise = self.table.rise().ok_or(DesignError::Unbounded)?;
                let mut wished = plan.clone();
                wished.targets.iter_mut().for_each(|target| target.wanted_g *= part);
                let mut design = design(&self.table, rise, &wished, request)?;
                if part < 1.0 {
                    design.add_limit(Limitation::StillMoving);
                }
                (design.motion(&self.table), Kind::Effect(Box::new(design)))
            }
        };
        let untold = || {
            let detail =
                "what the plan leaves when it ends cannot be told: a drive meets the resonance of an undamped mode";
            Problem::new(super::kinds::Kind::NoPlan, detail)
        };
        Ok(Prepared { motion: motion.ok_or_else(untold)?, kind })
    }
}
