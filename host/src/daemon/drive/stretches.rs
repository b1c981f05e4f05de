//! Touches with time windows: planned all at once, driven one stretch after the other at their times.

use super::driver::TouchDriver;
use crate::daemon::access::client::Asker;
use crate::daemon::api::problem::Problem;
use crate::daemon::touch::Touch;
use crate::daemon::touch::admission::PlannerPlaceGuard;
use crate::daemon::touch::answer::{Achieved, TouchedView};
use crate::daemon::touch::check::DriveMode;
use crate::daemon::touch::plan_view::PlanView;
use crate::daemon::touch::request::Finger;
use crate::device::AskedAt;
use crate::planner::schedule::{Span, Stretch, plan_each_span};
use crate::planner::{Plan, PlanError};
use std::sync::{Arc, Weak};
use std::time::Duration;
use tokio::time::Instant;

/// A stretch that another follows at once is held for so much longer: whatever comes in between, there is no gap.
const OVERLAP: Duration = Duration::from_millis(50);

/// One stretch that drives.
#[derive(Debug)]
struct TimedDrive {
    from: Duration,
    hold: Duration,
    plan: Plan,
    touches: Vec<Finger>,
}

impl TouchDriver {
    /// Plans all spans, begins with what is to be felt at once, and leaves the rest to a task. A stop or a newer touch ends it, and so
    /// does a board that has gone off, faulted or been away: whoever makes it ready again does not do so for a touch of before.
    pub(super) async fn plan_and_drive_time_spans(
        self: &Arc<Self>,
        asker: &Asker,
        place: PlannerPlaceGuard,
        id: u64,
        touch: &Touch,
        spans: Vec<Span>,
        asked_at: AskedAt,
    ) -> Result<TouchedView, Problem> {
        let mut all = tokio::task::block_in_place(|| {
            plan_each_span(spans, |targets| {
                self.plan_request_of_touch_and_count_plan_time(touch, &touch.request.with_selected_targets(targets))
            })
        })?;
        drop(place);
        let acts = build_timed_drives(&all, &touch.fingers);
        let first = all.iter().find(|stretch| stretch.span.targets.first() == Some(&0));
        let shown = first.and_then(|stretch| stretch.plan.clone()).ok_or(PlanError::Count { count: 0 })?;
        let begun = Instant::now();
        let (mut at_once, later): (Vec<TimedDrive>, Vec<TimedDrive>) =
            acts.into_iter().partition(|act| act.from.is_zero());
        let device = match at_once.pop() {
            Some(TimedDrive { hold, plan, touches, .. }) => {
                self.drive_plan(id, asked_at, plan, touches, DriveMode::Hold(hold)).await?.device
            }
            None => {
                self.controller.end_drives_of_touches_before(id).await;
                Achieved::without_drive()
            }
        };
        if let Some(last) = later.last() {
            self.note_later_parts(id, asked_at.stops, (begun + last.from).into_std());
        }
        tokio::spawn(carry_out_timed_drives(Arc::downgrade(self), id, asked_at, begun, later));
        for stretch in &mut all {
            if let Some(plan) = &stretch.plan {
                stretch.times =
                    Some(crate::planner::report::compute_rise_and_decay_times_at_first_target(&self.table, plan));
                stretch.trade = self
                    .compute_trade_off_if_wanted_and_needed(
                        asker,
                        id,
                        touch,
                        &touch.request.with_selected_targets(&stretch.span.targets),
                        plan,
                    )
                    .await;
            }
        }
        let plan = tokio::task::block_in_place(|| PlanView::new(&self.table, shown));
        Ok(TouchedView { plan, plan_id: id, device, stretches: Some(all), trade: None })
    }
}

fn build_timed_drives(stretches: &[Stretch], fingers: &[Finger]) -> Vec<TimedDrive> {
    let after = |i: usize| stretches.get(i + 1).is_some_and(|next| next.plan.is_some());
    let act = |(i, stretch): (usize, &Stretch)| {
        let Span { from_ms, to_ms, targets } = &stretch.span;
        let overlap = if after(i) { OVERLAP } else { Duration::ZERO };
        Some(TimedDrive {
            from: Duration::from_secs_f64(from_ms / 1e3),
            hold: Duration::from_secs_f64((to_ms - from_ms) / 1e3) + overlap,
            plan: stretch.plan.clone()?,
            touches: targets.iter().filter_map(|t| fingers.get(*t).copied()).collect(),
        })
    };
    stretches.iter().enumerate().filter_map(act).collect()
}

/// Holds the daemon only while it drives, so that it can end in between.
async fn carry_out_timed_drives(
    driver: Weak<TouchDriver>,
    id: u64,
    asked_at: AskedAt,
    start: Instant,
    timed_drives: Vec<TimedDrive>,
) {
    for TimedDrive { from, hold, plan, touches } in timed_drives {
        tokio::time::sleep_until(start + from).await;
        let Some(driver) = driver.upgrade() else { return };
        if let Err(problem) = driver.drive_plan(id, asked_at, plan, touches, DriveMode::Hold(hold)).await {
            tracing::info!(
                plan = id,
                from_ms = from.as_secs_f64() * 1e3,
                "this time window of the touch and all later windows of the touch are not driven: {}",
                problem.detail()
            );
            return;
        }
    }
}
