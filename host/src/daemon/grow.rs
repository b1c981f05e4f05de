//! Touches that began weaker, for what was left of those before: while they are held they grow with the room there is.

use super::active::Weaker;
use super::app::{App, Begun};
use super::touch::Manner;
use crate::planner::residual::NEXT_LOOK_S;
use std::sync::{Arc, Weak};
use std::time::{Duration, Instant};

impl App {
    /// Drives the whole plan as soon as there is room for that, and before that as much as there is room for.
    pub(super) fn grow_later(self: &Arc<Self>, weaker: Weaker) {
        tokio::spawn(grow(Arc::downgrade(self), weaker));
    }

    /// One look; what there is to look after then, `None` at the end: it is whole, or nobody wants it any more.
    async fn grow(self: &Arc<Self>, mut weaker: Weaker) -> Option<Weaker> {
        let id = weaker.active.id;
        let left = self.until(&weaker.active)?.saturating_duration_since(Instant::now());
        if left.as_secs_f64() <= NEXT_LOOK_S {
            return None;
        }
        let turn = self.turn_again(id, weaker.begun).await?;
        let grown = tokio::task::block_in_place(|| self.grown(&turn, weaker.part, &weaker.whole, Manner::Hold(left)));
        let (part, (plan, prepared)) = match grown {
            Ok(Some(grown)) => grown,
            Ok(None) => return Some(weaker),
            Err(problem) => {
                tracing::info!(plan = id, "stays weaker: {}", problem.detail());
                return None;
            }
        };
        let shown = self.shown(id, plan.clone(), &weaker.active.touches, None);
        // A finger may have been lifted meanwhile; from here to the new drives' end it is looked at again below.
        self.until(&weaker.active)?;
        let Begun { begun, .. } = match self.begun(&turn, weaker.stops, &plan, &prepared).await {
            Ok(begun) => begun,
            Err(problem) => {
                tracing::info!(plan = id, "stays weaker: {}", problem.detail());
                return None;
            }
        };
        let until = self.replace(&weaker.active, &shown);
        // The drives that have just begun do not know of an end that came while they were on their way.
        self.release(id, until.unwrap_or_else(Instant::now));
        drop(turn);
        until?;
        (weaker.begun, weaker.part, weaker.active) = (begun, part, shown);
        (part < 1.0).then_some(weaker)
    }
}

/// Holds the daemon only while it looks, so that it can end in between.
async fn grow(app: Weak<App>, mut weaker: Weaker) {
    loop {
        tokio::time::sleep(Duration::from_secs_f64(NEXT_LOOK_S)).await;
        let Some(app) = app.upgrade() else { return };
        match app.grow(weaker).await {
            Some(left) => weaker = left,
            None => return,
        }
    }
}
