//! Touches that began weaker, for what was left of those before: while they are held they grow with the room there is.

use super::app::App;
use super::touch::Manner;
use crate::planner::Plan;
use crate::planner::moving::{NEXT_LOOK_S, grows};
use std::sync::{Arc, Weak};
use std::time::{Duration, Instant};

impl App {
    /// Drives plan `id`, which has begun with less, as `whole` as soon as there is room for that.
    pub(super) fn grow_later(self: &Arc<Self>, id: u64, stops: u64, whole: Plan) {
        tokio::spawn(grow(Arc::downgrade(self), id, stops, whole));
    }

    /// One look; whether there is to be another.
    async fn grow(self: &Arc<Self>, id: u64, stops: u64, whole: &Plan) -> bool {
        let Some((active, until)) = self.active_until().filter(|(active, _)| active.id == id) else { return false };
        let left = until.saturating_duration_since(Instant::now());
        if left.as_secs_f64() <= NEXT_LOOK_S {
            return false;
        }
        let Some(turn) = self.turn_again(id).await else { return false };
        let hold = Manner::Hold(left);
        let fitted = tokio::task::block_in_place(|| {
            let prepared = self.prepared(whole, 1.0, hold)?;
            self.fitted(&turn, whole.clone(), prepared, hold)
        });
        let Ok((plan, prepared)) = fitted else { return false };
        let is_whole = plan.drives == whole.drives;
        if !grows([active.plan.plan(), &plan, whole].map(|plan| plan.drives.as_slice())) {
            return true;
        }
        let begun = self.begun(&turn, stops, &plan, &prepared).await;
        drop(turn);
        if begun.is_err() {
            return false;
        }
        let shown = self.shown(id, plan, &active.touches, None);
        // A finger may have been lifted meanwhile.
        let lifted = match self.active_until() {
            Some((active, now)) if active.id == id => now,
            _ => Instant::now(),
        };
        if lifted < until {
            self.release(id, lifted);
        }
        self.activate(&shown, until, stops).is_ok() && !is_whole
    }
}

/// Holds the daemon only while it looks, so that it can end in between.
async fn grow(app: Weak<App>, id: u64, stops: u64, whole: Plan) {
    loop {
        tokio::time::sleep(Duration::from_secs_f64(NEXT_LOOK_S)).await;
        let Some(app) = app.upgrade() else { return };
        if !app.grow(id, stops, &whole).await {
            return;
        }
    }
}
