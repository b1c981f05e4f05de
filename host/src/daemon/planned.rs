//! Plans for what is asked for, what can be had instead, and what tolerances do to them.

use super::app::App;
use super::asked::Asked;
use super::client::Client;
use super::preview::{Planned, PreviewRequest};
use super::problem::Problem;
use super::tolerances::{TolerancesRequest, TolerancesView};
use crate::device::SessionError;
use crate::effects::plan_with;
use crate::planner::trade::Trade;
use crate::planner::{Plan, Request, Target};

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

    /// Begins to look at what tolerances do to the plan for a touch; drives nothing.
    ///
    /// # Errors
    /// [`Problem`]: a touch, tolerance, scene or move that cannot be used, a scene without a plan, or work that is under way.
    pub async fn begin_tolerances(
        &self,
        client: Client,
        request: TolerancesRequest,
    ) -> Result<TolerancesView, Problem> {
        let tolerances = request.checked()?;
        if *self.closing().borrow() {
            return Err(SessionError::Closed.into());
        }
        // First: whoever comes while another is under way costs nothing.
        let taken = self.looks.take()?;
        let TolerancesRequest { x_px, y_px, intensity_g, scene, moves, .. } = request;
        if scene.is_none() && moves.is_none() {
            let (x_m, y_m) = self.table.scene.place_px(x_px, y_px)?.xy_m();
            let place = self.admission.place(client).await?;
            let plan = tokio::task::block_in_place(|| self.table.plan(&[Target { x_m, y_m, intensity_g }]))?;
            drop(place);
            return self.looks.begin(taken, &self.table, plan, tolerances);
        }
        let request = PreviewRequest { x_px, y_px, intensity_g, scene, moves: moves.unwrap_or_default() };
        let Planned { table, plan, .. } = self.previews.planned(request).await?;
        self.looks.begin(taken, &table, plan, tolerances)
    }
}
