//! From a plan to what the session takes: as much of its forces as the channels' credit allows, and as there is room for.

use super::active::AskedAt;
use super::credit;
use super::equipment::Equipment;
use super::order::{Drivable, Mode, Order};
use crate::daemon::api::kinds::Kind;
use crate::daemon::api::problem::Problem;
use crate::daemon::touch::check::DriveMode;
use crate::daemon::touch::request::Finger;
use crate::effects::{DesignError, design};
use crate::planner::Plan;
use crate::planner::drive::on_channels;
use crate::planner::limitation::Limitation;

impl Equipment {
    /// Prepares a plan for the board: an even drive as strong as the channels' credit allows for as long as it may be held.
    ///
    /// # Errors
    /// [`Problem`]: an effect that cannot be designed, or a plan of which nobody can tell what it leaves.
    pub fn prepare_order(
        &self,
        id: u64,
        since: AskedAt,
        whole: Plan,
        touches: Vec<Finger>,
        manner: DriveMode,
    ) -> Result<Order, Problem> {
        let thin = if matches!(manner, DriveMode::Hold(_)) { self.find_credit_fraction(&whole) } else { 1.0 };
        let first = self.prepare_fraction(&whole, thin, 1.0, manner)?;
        Ok(Order { id, since, touches, manner, whole, thin, first })
    }

    /// The fraction of a plan's forces that the channels' credit allows ([`credit::part`]), as far as the credit is known.
    #[must_use]
    pub fn find_credit_fraction(&self, plan: &Plan) -> f64 {
        let snapshots = self.session.subscribe_snapshots();
        let snapshot = snapshots.borrow();
        let (Some(credit), Some(identity)) = (&snapshot.credit, &snapshot.identity) else { return 1.0 };
        let most_v: Vec<f64> =
            identity.channels.iter().map(|channel| f64::from(channel.max_voltage_millivolts) / 1e3).collect();
        credit::part(&on_channels(&plan.drives), &most_v, credit)
    }

    /// Prepares the fraction `thin` of a plan's forces, which credit allows, and of these the fraction `part`, for which there is room.
    ///
    /// # Errors
    /// As [`Self::prepare_order`].
    pub fn prepare_fraction(&self, whole: &Plan, thin: f64, part: f64, manner: DriveMode) -> Result<Drivable, Problem> {
        let mut plan = if thin * part < 1.0 {
            crate::planner::plan::derate_plan(&self.table, whole, thin * part)?
        } else {
            whole.clone()
        };
        if part >= 1.0 {
            // Nothing is left of the touches before that would be in its way.
            (plan.limits, plan.limited_by) = (whole.limits.clone(), whole.limited_by.clone());
        }
        self.prepare_plan(plan, part, manner)
    }

    /// Works out what it takes to drive a plan that has the fraction `part` of the forces first planned.
    fn prepare_plan(&self, plan: Plan, part: f64, manner: DriveMode) -> Result<Drivable, Problem> {
        let (motion, mode) = match manner {
            DriveMode::Hold(hold) => (self.table.predict_motion(&plan), Mode::Hold(hold)),
            DriveMode::Effect(request) => {
                let rise = self.table.rise().ok_or(DesignError::Unbounded)?;
                let mut wished = plan.clone();
                wished.targets.iter_mut().for_each(|target| target.wanted_g *= part);
                let mut design = design(&self.table, rise, &wished, request)?;
                if part < 1.0 {
                    design.add_limit(Limitation::StillMoving);
                }
                (design.motion(&self.table), Mode::Effect(Box::new(design)))
            }
        };
        let untold = || {
            let detail =
                "what the plan leaves when it ends cannot be told: a drive meets the resonance of an undamped mode";
            Problem::new(Kind::NoPlan, detail)
        };
        Ok(Drivable { plan, motion: motion.ok_or_else(untold)?, mode })
    }
}
