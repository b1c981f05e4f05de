//! The plan that is shown as the current one, and when it ends.

use super::active::{Active, Shown, Update};
use super::app::App;
use super::thin::Thinned;
use super::view::{PlanView, TouchView};
use crate::device::SessionError;
use crate::planner::Plan;
use std::sync::{Arc, PoisonError};
use std::time::Instant;

impl App {
    /// The plan that is being driven.
    #[must_use]
    pub fn active(&self) -> Option<Arc<Active>> {
        self.shown_now().map(|shown| shown.plan)
    }

    /// The same with when it ends.
    fn shown_now(&self) -> Option<Shown> {
        let mut active = self.active.lock().unwrap_or_else(PoisonError::into_inner);
        active.take_if(|shown| Instant::now() >= shown.until);
        active.clone()
    }

    /// An evenly driven plan as it is shown.
    pub(super) fn shown(&self, id: u64, plan: Plan, touches: &[TouchView], thinned: Option<Thinned>) -> Arc<Active> {
        tokio::task::block_in_place(|| {
            let plan = PlanView::new(&self.table, plan).thinned(thinned);
            Arc::new(Active::new(id, plan, touches.to_vec(), None))
        })
    }

    /// Shows a plan as the current one, unless everything was stopped or something newer was driven meanwhile; says whether it did.
    pub(super) fn activate(&self, plan: &Arc<Active>, until: Instant, stops: u64) -> Result<bool, SessionError> {
        {
            let mut active = self.active.lock().unwrap_or_else(PoisonError::into_inner);
            // Under the lock: `stop` counts first and takes the plan away afterwards.
            if self.session.stops() != stops {
                return Err(SessionError::Stopped);
            }
            if active.as_ref().is_some_and(|known| known.plan.id > plan.id) {
                return Ok(false);
            }
            *active = Some(Shown { plan: Arc::clone(plan), until, stops });
        }
        // Nobody listening is no error.
        let _ = self.updates.send(Update::Plan(Arc::clone(plan)));
        Ok(true)
    }

    /// When what is shown ends; `None` if it has ended or something else is shown.
    pub(super) fn until(&self, shown: &Arc<Active>) -> Option<Instant> {
        self.shown_now().filter(|known| Arc::ptr_eq(&known.plan, shown)).map(|known| known.until)
    }

    /// When what is shown ends, if that is plan `id` or a newer one.
    pub fn end_of(&self, id: u64) -> Option<Instant> {
        self.shown_now().filter(|shown| shown.plan.id >= id).map(|shown| shown.until)
    }

    /// Shows `newer` in place of what is shown, until the same time; `None` if that has ended or something else is shown.
    pub(super) fn replace(&self, shown: &Arc<Active>, newer: &Arc<Active>) -> Option<Instant> {
        let until = {
            let mut active = self.active.lock().unwrap_or_else(PoisonError::into_inner);
            let known = active.as_mut().filter(|known| Arc::ptr_eq(&known.plan, shown))?;
            known.plan = Arc::clone(newer);
            known.until
        };
        let _ = self.updates.send(Update::Plan(Arc::clone(newer)));
        Some(until)
    }

    /// Ends the drive of plan `id` at `when`: its fingers have been lifted.
    pub fn release(&self, id: u64, when: Instant) {
        let ends = self.active.lock().unwrap_or_else(PoisonError::into_inner).as_mut().is_some_and(|shown| {
            let ends = shown.plan.id == id && when < shown.until;
            shown.until = if ends { when } else { shown.until };
            ends
        });
        if ends {
            let _ = self.updates.send(Update::Ends);
        }
        self.session.end_at(id, when);
        self.turns.end_of(id, when);
    }
}
