//! Plans for touches, and what can be had instead.

use super::driver::Driver;
use crate::daemon::access::client::Asker;
use crate::daemon::api::problem::Problem;
use crate::daemon::design::low_priority::{Deadline, do_aside};
use crate::daemon::touch::Touch;
use crate::effects::plan_with;
use crate::planner::trade::Trade;
use crate::planner::{Plan, Request};
use std::sync::Arc;
use std::time::Duration;

/// Longest time for what can be had instead.
const LONGEST_TRADE: Duration = Duration::from_secs(5);

impl Driver {
    /// The plan for some or all targets of a touch.
    pub(super) fn plan_request(&self, touch: &Touch, request: &Request) -> Result<Plan, Problem> {
        let plan = plan_with(&self.table, || self.table.rise(), request, touch.intensity)?;
        self.metrics.plan_time(plan.elapsed_us);
        Ok(plan)
    }

    /// What can be had instead, if that is asked for and the plan falls short. One at a time, and no place at the planner: it takes
    /// seconds, on a thread of its own and until its time is over or its sender gone. The plan is driven by now, so that whatever goes wrong is no
    /// error of the touch; nor is it that too many wait, or that there is a newer touch by the time that it is this one's turn, as then nobody
    /// looks at it any more.
    pub(super) async fn compute_trade(
        self: &Arc<Self>,
        asker: &Asker,
        id: u64,
        touch: &Touch,
        request: &Request,
        plan: &Plan,
    ) -> Option<Trade> {
        if !touch.wants_trade {
            return None;
        }
        let one = self.admission.place_for_trade(asker.client).await?;
        if self.controller.check_newest(id).is_err() {
            return None;
        }
        let (table, request, plan) = (Arc::clone(&self.table), request.clone(), plan.clone());
        let work = move |_: &Deadline| {
            let _one = one;
            Ok(crate::planner::trade::explore_trade(&table, &request, &plan)?)
        };
        match do_aside("trade", LONGEST_TRADE, &asker.sender, work).await {
            Ok(trade) => trade,
            Err(problem) => {
                tracing::info!("what can be had instead is not told: {}", problem.detail());
                None
            }
        }
    }
}
