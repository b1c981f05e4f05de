//! Touches with time windows: planned all at once, driven one stretch after the other at their times.

use super::active::{Active, AskedAt, Touched};
use super::driver::Driver;
use crate::daemon::access::client::Asker;
use crate::daemon::api::problem::Problem;
use crate::daemon::touch::Touch;
use crate::daemon::touch::admission::Place;
use crate::daemon::touch::answer::Achieved;
use crate::daemon::touch::check::DriveMode;
use crate::daemon::touch::plan_view::PlanView;
use crate::daemon::touch::request::Finger;
use crate::planner::schedule::{Span, Stretch, stretches};
use crate::planner::{Plan, PlanError};
use std::sync::{Arc, Weak};
use std::time::Duration;
use tokio::time::Instant;

/// A stretch that another follows at once is held for so much longer: whatever comes in between, there is no gap.
const OVERLAP: Duration = Duration::from_millis(50);

/// One stretch that drives.
#[derive(Debug)]
struct Act {
    from: Duration,
    hold: Duration,
    plan: Plan,
    touches: Vec<Finger>,
}

impl Driver {
    /// Plans all spans, begins with what is to be felt at once, and leaves the rest to a task. A stop or a newer touch ends it, and so
    /// does a board that has gone off, faulted or been away: whoever makes it ready again does not do so for a touch of before.
    pub(super) async fn drive_stretches(
        self: &Arc<Self>,
        asker: &Asker,
        place: Place,
        id: u64,
        touch: &Touch,
        spans: Vec<Span>,
        since: AskedAt,
    ) -> Result<Touched, Problem> {
        let mut all = tokio::task::block_in_place(|| {
            stretches(spans, |targets| self.plan_request(touch, &touch.request.only(targets)))
        })?;
        drop(place);
        let acts = list_board_acts(&all, &touch.fingers);
        let first = all.iter().find(|stretch| stretch.span.targets.first() == Some(&0));
        let shown = first.and_then(|stretch| stretch.plan.clone()).ok_or(PlanError::Count { count: 0 })?;
        let begun = Instant::now();
        let (mut at_once, later): (Vec<Act>, Vec<Act>) = acts.into_iter().partition(|act| act.from.is_zero());
        let device = match at_once.pop() {
            Some(Act { hold, plan, touches, .. }) => {
                self.drive_plan(id, since, plan, touches, DriveMode::Hold(hold)).await?.device
            }
            None => {
                self.controller.overtake(id).await;
                Achieved::nothing()
            }
        };
        tokio::spawn(drive_later(Arc::downgrade(self), id, since, begun, later));
        for stretch in &mut all {
            if let Some(plan) = &stretch.plan {
                stretch.times = Some(crate::planner::report::compute_times(&self.table, plan));
                stretch.trade =
                    self.compute_trade(asker, id, touch, &touch.request.only(&stretch.span.targets), plan).await;
            }
        }
        let plan = tokio::task::block_in_place(|| PlanView::new(&self.table, shown));
        let active = Arc::new(Active::new(id, plan, touch.fingers.clone(), None));
        Ok(Touched { active, device, stretches: Some(all), trade: None })
    }
}

fn list_board_acts(all: &[Stretch], touches: &[Finger]) -> Vec<Act> {
    let after = |i: usize| all.get(i + 1).is_some_and(|next| next.plan.is_some());
    let act = |(i, stretch): (usize, &Stretch)| {
        let Span { from_ms, to_ms, targets } = &stretch.span;
        let overlap = if after(i) { OVERLAP } else { Duration::ZERO };
        Some(Act {
            from: Duration::from_secs_f64(from_ms / 1e3),
            hold: Duration::from_secs_f64((to_ms - from_ms) / 1e3) + overlap,
            plan: stretch.plan.clone()?,
            touches: targets.iter().filter_map(|t| touches.get(*t).copied()).collect(),
        })
    };
    all.iter().enumerate().filter_map(act).collect()
}

/// Holds the daemon only while it drives, so that it can end in between.
async fn drive_later(driver: Weak<Driver>, id: u64, since: AskedAt, begun: Instant, acts: Vec<Act>) {
    for Act { from, hold, plan, touches } in acts {
        tokio::time::sleep_until(begun + from).await;
        let Some(driver) = driver.upgrade() else { return };
        if let Err(problem) = driver.drive_plan(id, since, plan, touches, DriveMode::Hold(hold)).await {
            tracing::info!(plan = id, from_ms = from.as_secs_f64() * 1e3, "not driven: {}", problem.detail());
            return;
        }
    }
}
