//! Plans for what is asked for, and what can be had instead.

use super::app::App;
use super::asked::Asked;
use super::client::Client;
use super::problem::Problem;
use crate::effects::plan_with;
use crate::planner::trade::Trade;
use crate::planner::{Plan, Request};

impl App {
    /// The plan for some or all of what is asked for.
    pub(super) fn plan(&self, asked: &Asked, request: &Request) -> Result<Plan, Problem> {
        let plan = plan_with(&self.table, || self.table.rise(), request, asked.intensity)?;
        self.metrics.plan_time(plan.elapsed_us);
        Ok(plan)
    }

    /// What can be had instead, if that is asked for and the plan falls short. One at a time, and no place at the planner: it takes
    /// seconds. The plan is driven by now, so that whatever goes wrong is no error of the touch; nor is it that too many wait, or
    /// that there is a newer touch by the time that it is this one's turn, as then nobody looks at it any more.
    pub(super) async fn trade(
        &self,
        client: Client,
        id: u64,
        asked: &Asked,
        request: &Request,
        plan: &Plan,
    ) -> Option<Trade> {
        if !asked.with_trade {
            return None;
        }
        let _one = self.admission.place_for_trade(client).await?;
        if self.turns.check(id).is_err() {
            return None;
        }
        match tokio::task::block_in_place(|| self.table.trade(request, plan)) {
            Ok(trade) => trade,
            Err(error) => {
                tracing::warn!(%error, "what can be had instead cannot be told");
                None
            }
        }
    }
}
