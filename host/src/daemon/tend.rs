//! Even drives that are held: they grow with the room there is beside what is left of the touches before, are thinned out
//! where a channel's credit falls, and are interrupted by a rest before the board would end its burst.

use super::active::Held;
use super::app::{App, Begun, Prepared};
use super::problem::Problem;
use super::thin::{Thinned, is_worth_it};
use super::touch::Manner;
use super::turns::{Turn, board};
use crate::planner::Plan;
use crate::planner::residual::{Board, NEXT_LOOK_S};
use std::sync::atomic::Ordering;
use std::sync::{Arc, PoisonError, Weak};
use std::time::{Duration, Instant};
use tokio::sync::watch;

/// Between two looks at the credit: the largest force loses 0.6 % meanwhile.
const CREDIT_LOOK: Duration = Duration::from_millis(250);
/// Between two looks whether the board has ended a drive that it was told to.
const REST_LOOK: Duration = Duration::from_millis(2);
/// How often it is looked at: 1 s, which is as long as the lowest period.
const REST_LOOKS: u32 = 500;

impl App {
    /// Looks after a drive from now on, in place of any older one.
    pub(super) fn tend(self: &Arc<Self>, held: Held) {
        if !self.tends.swap(true, Ordering::SeqCst) {
            tokio::spawn(tend(Arc::downgrade(self), self.held.subscribe()));
        }
        self.held.send_if_modified(|known| {
            let is_newer = known.as_ref().is_none_or(|known| known.begun < held.begun);
            if is_newer {
                *known = Some(held);
            }
            is_newer
        });
    }

    /// The drive of plan `id` goes on until `until`: its fingers are still down. Whether it is still what is shown; one that the
    /// board does not drive is not told to.
    pub fn prolong(&self, id: u64, until: Instant) -> bool {
        // Looked at before the plan is locked: one that is held while the device's thread waits to publish would wait for it too.
        let is_driven = board(&self.session.snapshots().borrow()) == Board::Driving;
        let mut active = self.active.lock().unwrap_or_else(PoisonError::into_inner);
        let Some(shown) = active.as_mut().filter(|shown| shown.plan.id == id && Instant::now() < shown.until) else {
            return false;
        };
        if is_driven || shown.plan.plan.rests() {
            shown.until = until.max(shown.until);
            self.session.hold_until(id, shown.until);
            self.turns.prolong(id, shown.until);
        }
        true
    }

    /// Whether the board is off: it has to be armed before it drives.
    pub fn is_off(&self) -> bool {
        board(&self.session.snapshots().borrow()) == Board::Down
    }

    /// When this has to be looked at next; `None` if it is over.
    fn next_look(&self, held: &Held) -> Option<Instant> {
        let (until, now) = (self.until(&held.active)?, Instant::now());
        let look = now + if held.part < 1.0 { Duration::from_secs_f64(NEXT_LOOK_S) } else { CREDIT_LOOK };
        Some(self.turns.rest_due(until).map_or(look, |due| look.min(due)))
    }

    /// One look; what there is to look after then, `None` if nobody wants it any more.
    async fn look_after(self: &Arc<Self>, held: Held) -> Option<Held> {
        let (until, now) = (self.until(&held.active)?, Instant::now());
        if self.turns.rest_due(until).is_some_and(|due| now >= due) {
            return self.rest(held).await;
        }
        if until.saturating_duration_since(now).as_secs_f64() <= NEXT_LOOK_S {
            return Some(held);
        }
        let thin = tokio::task::block_in_place(|| self.part_by_credit(&held.whole));
        if is_worth_it(held.thin, thin) {
            let turn = self.turn_again(held.active.id, held.begun).await?;
            return self.fitted_again(turn, Held { thin, ..held }).await;
        }
        if held.part >= 1.0 {
            return Some(held);
        }
        let turn = self.turn_again(held.active.id, held.begun).await?;
        let manner = self.manner(&held)?;
        match tokio::task::block_in_place(|| self.grown(&turn, &held, manner)) {
            Ok(Some((part, driven))) => self.driven_again(turn, Held { part, ..held }, driven).await,
            Ok(None) => Some(held),
            Err(problem) => stays(&held, &problem),
        }
    }

    /// Has the board rest, and goes on.
    async fn rest(self: &Arc<Self>, held: Held) -> Option<Held> {
        let id = held.active.id;
        let turn = self.turn_again(id, held.begun).await?;
        let rested = turn.rest()?;
        self.session.end_at(id, Instant::now());
        let plan = held.active.plan.clone().thinned(Some(Thinned::RESTS));
        let resting = Arc::new(held.active.shown_as(plan));
        self.replace(&held.active, &resting)?;
        // Nobody drives anything else meanwhile: the turn is this one's. A stop gets through.
        for _ in 0..REST_LOOKS {
            if board(&self.session.snapshots().borrow()) != Board::Driving {
                break;
            }
            tokio::time::sleep(REST_LOOK).await;
        }
        tokio::time::sleep_until(rested.into()).await;
        if self.is_off() {
            // Whatever has come in between, a touch that is made then arms it, and no drive of before.
            self.release(id, Instant::now());
            return None;
        }
        let turn = turn.later(board(&self.session.snapshots().borrow()));
        let thin = tokio::task::block_in_place(|| self.part_by_credit(&held.whole));
        let again = self.fitted_again(turn, Held { thin, active: Arc::clone(&resting), ..held }).await;
        if again.is_none() && self.until(&resting).is_some() {
            // The board did not want to: what is not driven is not shown either.
            self.release(id, Instant::now());
        }
        again
    }

    /// Drives what credit allows, and what there is room for.
    async fn fitted_again(self: &Arc<Self>, turn: Turn<'_>, held: Held) -> Option<Held> {
        let manner = self.manner(&held)?;
        let fitted = tokio::task::block_in_place(|| {
            let first = self.of_part(&held.whole, held.thin, 1.0, manner)?;
            self.fitted(&turn, first, &held.whole, held.thin, manner)
        });
        match fitted {
            Ok((part, driven)) => self.driven_again(turn, Held { part, ..held }, driven).await,
            Err(problem) => stays(&held, &problem),
        }
    }

    async fn driven_again(
        self: &Arc<Self>,
        turn: Turn<'_>,
        mut held: Held,
        (plan, prepared): (Plan, Prepared),
    ) -> Option<Held> {
        let id = held.active.id;
        let shown = self.shown(id, plan.clone(), &held.active.touches, Thinned::by_credit(held.thin));
        // A finger may have been lifted meanwhile; from here to the new drives' end it is looked at again below.
        self.until(&held.active)?;
        match self.begun(&turn, held.since, &plan, &prepared).await {
            Ok(Begun { begun, .. }) => held.begun = begun,
            Err(problem) => {
                tracing::info!(plan = id, "is not driven anew: {}", problem.detail());
                return None;
            }
        }
        let until = self.replace(&held.active, &shown);
        // The drives that have just begun do not know of an end, or of more time, that came while they were on their way.
        if until.is_none() || !self.prolong(id, Instant::now()) {
            self.release(id, Instant::now());
            return None;
        }
        drop(turn);
        held.active = shown;
        Some(held)
    }

    /// For as long as it is still to be held.
    fn manner(&self, held: &Held) -> Option<Manner> {
        Some(Manner::Hold(self.until(&held.active)?.saturating_duration_since(Instant::now())))
    }
}

#[expect(clippy::unnecessary_wraps, reason = "what its callers return")]
fn stays(held: &Held, problem: &Problem) -> Option<Held> {
    tracing::info!(plan = held.active.id, "stays as it is: {}", problem.detail());
    Some(held.clone())
}

/// Looks after the newest drive. Holds the daemon only while it looks, so that it can end in between.
async fn tend(app: Weak<App>, mut newest: watch::Receiver<Option<Held>>) {
    let mut held: Option<Held> = newest.borrow_and_update().clone();
    loop {
        let look = held.as_ref().zip(app.upgrade()).and_then(|(held, app)| app.next_look(held));
        let changed = match look {
            Some(look) => tokio::select! {
                changed = newest.changed() => Some(changed),
                () = tokio::time::sleep_until(look.into()) => None,
            },
            None => Some(newest.changed().await),
        };
        held = match changed {
            Some(Ok(())) => newest.borrow_and_update().clone(),
            Some(Err(_)) => return,
            None => match (app.upgrade(), held) {
                (Some(app), Some(held)) => app.look_after(held).await,
                _ => None,
            },
        };
    }
}
