//! Plans for touches, and what can be had instead.

use super::driver::TouchDriver;
use crate::daemon::access::client::Asker;
use crate::daemon::api::problem::Problem;
use crate::daemon::design::low_priority::{Deadline, run_low_priority_until_deadline};
use crate::daemon::touch::Touch;
use crate::effects::plan_request_with_intensity_for_targets_without_one;
use crate::planner::trade::TradeOffs;
use crate::planner::{Plan, Request};
use std::sync::Arc;
use std::time::Duration;

/// Longest time for what can be had instead.
const LONGEST_TRADE: Duration = Duration::from_secs(5);

impl TouchDriver {
    /// The plan for some or all targets of a touch.
    pub(super) fn plan_request_of_touch_and_count_plan_time(
        &self,
        touch: &Touch,
        request: &Request,
    ) -> Result<Plan, Problem> {
        let plan = plan_request_with_intensity_for_targets_without_one(
            &self.table,
            || self.table.panel_poles(),
            request,
            touch.intensity,
        )?;
        self.metrics.count_plan_and_time(plan.elapsed_us);
        Ok(plan)
    }

    /// What can be had instead, if that is asked for and the plan falls short. One at a time, and no place at the planner: it takes
    /// seconds, on a thread of its own and until its time is over or its sender gone. The plan is driven by now, so that whatever goes wrong is no
    /// error of the touch; nor is it that too many wait, or that there is a newer touch by the time that it is this one's turn, as then nobody
    /// looks at it any more.
    pub(super) async fn compute_trade_off_if_wanted_and_needed(
        self: &Arc<Self>,
        asker: &Asker,
        id: u64,
        touch: &Touch,
        request: &Request,
        plan: &Plan,
    ) -> Option<TradeOffs> {
        if !touch.wants_trade {
            return None;
        }
        let one = self.admission.wait_for_trade_off_place_or_none_if_queue_full(asker.client).await?;
        if self.controller.check_not_superseded(id).is_err() {
            return None;
        }
        let (table, request, plan) = (Arc::clone(&self.table), request.clone(), plan.clone());
        let work = move |_: &Deadline| {
            let _one = one;
            Ok(crate::planner::trade::explore_trade_offs_if_wishes_conflict(&table, &request, &plan)?)
        };
        match run_low_priority_until_deadline("trade", LONGEST_TRADE, &asker.sender, work).await {
            Ok(trade) => trade,
            Err(problem) => {
                tracing::info!(
                    "the answer to the touch request has no field `trade`, because the alternative plans (for requested peaks and quiet zones \
                    that conflict) could not be computed: {}",
                    problem.detail()
                );
                None
            }
        }
    }
}
