//! Plans for what is asked for, what can be had instead, and what tolerances do to them.

use crate::daemon::access::client::Asker;
use crate::daemon::api::problem::Problem;
use crate::daemon::app::App;
use crate::daemon::design::low_priority::{Deadline, do_aside};
use crate::daemon::design::preview::{LONGEST, Planned, PreviewRequest, planned};
use crate::daemon::design::tolerances::{TolerancesRequest, TolerancesView};
use crate::daemon::touch::check::Asked;
use crate::device::SessionError;
use crate::effects::plan_with;
use crate::planner::trade::Trade;
use crate::planner::{Plan, Request, Target};
use std::sync::Arc;
use std::time::Duration;

/// Longest time for what can be had instead.
const LONGEST_TRADE: Duration = Duration::from_secs(5);

impl App {
    /// The plan for some or all of what is asked for.
    pub(in crate::daemon) fn plan(&self, asked: &Asked, request: &Request) -> Result<Plan, Problem> {
        let plan = plan_with(&self.table, || self.table.rise(), request, asked.intensity)?;
        self.metrics.plan_time(plan.elapsed_us);
        Ok(plan)
    }

    /// What can be had instead, if that is asked for and the plan falls short. One at a time, and no place at the planner: it takes
    /// seconds, on a thread of its own and until its time is over or its sender gone. The plan is driven by now, so that whatever goes wrong is no
    /// error of the touch; nor is it that too many wait, or that there is a newer touch by the time that it is this one's turn, as then nobody
    /// looks at it any more.
    pub(in crate::daemon) async fn trade(
        self: &Arc<Self>,
        asker: &Asker,
        id: u64,
        asked: &Asked,
        request: &Request,
        plan: &Plan,
    ) -> Option<Trade> {
        if !asked.with_trade {
            return None;
        }
        let one = self.admission.place_for_trade(asker.client).await?;
        if self.drive.check_newest(id).is_err() {
            return None;
        }
        let (app, request, plan) = (Arc::clone(self), request.clone(), plan.clone());
        let work = move |_: &Deadline| {
            let _one = one;
            Ok(crate::planner::trade::explore_trade(&app.table, &request, &plan)?)
        };
        match do_aside("trade", LONGEST_TRADE, &asker.sender, work).await {
            Ok(trade) => trade,
            Err(problem) => {
                tracing::info!("what can be had instead is not told: {}", problem.detail());
                None
            }
        }
    }

    /// Begins to look at what tolerances do to the plan for a touch; drives nothing. `read` gives what was asked for.
    ///
    /// # Errors
    /// [`Problem`]: a touch, tolerance, scene or move that cannot be used, a scene without a plan, or work that is under way.
    pub async fn begin_tolerances(
        self: &Arc<Self>,
        asker: &Asker,
        read: impl FnOnce() -> Result<TolerancesRequest, Problem> + Send + 'static,
    ) -> Result<TolerancesView, Problem> {
        if *self.closing().borrow() {
            return Err(SessionError::Closed.into());
        }
        // First: whoever comes while another is under way costs nothing.
        let taken = self.looks.take()?;
        let app = Arc::clone(self);
        let work = move |deadline: &Deadline| {
            let request = read()?;
            let tolerances = request.checked()?;
            let TolerancesRequest { x_px, y_px, intensity_g, scene, moves, .. } = request;
            if scene.is_none() && moves.is_none() {
                let (x_m, y_m) = app.table.scene.place_px(x_px, y_px)?.xy_m();
                let plan = app.table.plan(&[Target { x_m, y_m, intensity_g }])?;
                deadline.check()?;
                return app.looks.begin(taken, &app.table, plan, tolerances);
            }
            let request = PreviewRequest { x_px, y_px, intensity_g, scene, moves: moves.unwrap_or_default() };
            let Planned { table, plan, .. } = planned(&request, &app.previews.own(), deadline)?;
            deadline.check()?;
            app.looks.begin(taken, &table, plan, tolerances)
        };
        do_aside("tolerances", LONGEST, &asker.sender, work).await
    }
}
