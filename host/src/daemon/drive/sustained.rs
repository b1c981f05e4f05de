//! Even drives that go on: they grow with the room there is beside what is left of the touches before, are thinned out where a
//! channel's credit falls, and are interrupted by a rest before the board would end its burst.

use super::active::{Sustained, Update};
use super::credit::is_worth_it;
use super::equipment::Equipment;
use super::order::Drivable;
use super::task::{Lane, Purpose, Sent, Task, compute, show_even};
use crate::daemon::api::problem::Problem;
use crate::daemon::touch::check::DriveMode;
use crate::daemon::touch::plan_view::Thinned;
use crate::planner::Plan;
use crate::planner::residual::{Board, Ending, NEXT_LOOK_S, grown};
use std::sync::Arc;
use std::time::{Duration, Instant};

/// Between two looks at the credit: the largest force loses 0.6 % meanwhile.
const CREDIT_LOOK: Duration = Duration::from_millis(250);
/// Between two looks whether the board has ended a drive that it was told to.
const REST_LOOK: Duration = Duration::from_millis(2);
/// How often it is looked at: 1 s, which is as long as the lowest period.
const REST_LOOKS: u32 = 500;

impl Task {
    /// When what goes on has to be looked at next; `None` if nothing does.
    pub(super) fn find_next_look(&self) -> Option<Instant> {
        let (held, now) = (self.state.sustained.as_ref()?, Instant::now());
        let until = self.state.find_end(&held.active, now)?;
        let look = self.looked + if held.part < 1.0 { Duration::from_secs_f64(NEXT_LOOK_S) } else { CREDIT_LOOK };
        Some(self.state.find_rest_due(until).map_or(look, |due| look.min(due)))
    }

    /// Looks once after what goes on. It is looked after no more if nobody wants it any more.
    pub(super) fn look_after(&mut self, equipment: &Arc<Equipment>) {
        let (now, board) = (Instant::now(), equipment.read_board());
        let Some(held) = self.state.sustained.take() else { return };
        let Some(until) = self.find_hold(equipment, &held).map(|hold| now + hold) else { return };
        let is_last = self.state.is_last(held.active.id, held.begun, board);
        self.looked = now;
        if self.state.find_rest_due(until).is_some_and(|due| now >= due) {
            if is_last {
                self.begin_rest(equipment, held);
            }
            return;
        }
        if until.saturating_duration_since(now).as_secs_f64() <= NEXT_LOOK_S {
            self.state.sustained = Some(held);
            return;
        }
        let thin = equipment.find_credit_fraction(&held.whole);
        let is_thinned = is_worth_it(held.thin, thin);
        if (is_thinned || held.part < 1.0) && !is_last {
            return;
        }
        if is_thinned {
            self.fit_again(equipment, Sustained { thin, ..held }, false);
        } else if held.part < 1.0 {
            self.grow_drive(equipment, held, (board, now));
        } else {
            self.state.sustained = Some(held);
        }
    }

    /// Drives more of a plan's forces, if there is room for that.
    fn grow_drive(&mut self, equipment: &Arc<Equipment>, held: Sustained, (board, now): (Board, Instant)) {
        let Some(hold) = self.find_hold(equipment, &held) else { return };
        let of_part = |part: f64| equipment.prepare_fraction(&held.whole, held.thin, part, DriveMode::Hold(hold));
        let room = |drivable: &Drivable| self.state.find_fraction(&drivable.motion, drivable.even_drives(), board, now);
        match compute(|| grown(held.part, of_part, room)) {
            Ok(Some((part, drivable))) => self.drive_again(equipment, held, part, drivable, (board, now), false),
            Ok(None) => self.state.sustained = Some(held),
            Err(problem) => self.keep_unchanged(held, &problem),
        }
    }

    /// Has the board rest.
    fn begin_rest(&mut self, equipment: &Equipment, held: Sustained) {
        let (id, now) = (held.active.id, Instant::now());
        self.state.end_all(Ending::AtItsBoundary, now);
        let Some(until) = self.state.find_rest_end() else { return };
        equipment.session.end_drive_at(id, now);
        let plan = held.active.plan.clone().thinned(Some(Thinned::RESTS));
        let resting = Arc::new(held.active.shown_as(plan));
        if let Some(current) = &mut self.state.current {
            current.active = Arc::clone(&resting);
        }
        self.tell_pages(Update::Plan(Arc::clone(&resting)));
        self.lane = Lane::Resting { held: Box::new(Sustained { active: resting, ..held }), until, looks: REST_LOOKS };
    }

    /// Goes on after a rest, once the board drives no more.
    pub(super) fn end_rest(&mut self, equipment: &Arc<Equipment>, held: Box<Sustained>, looks: u32) {
        match equipment.read_board() {
            Board::Driving if looks > 0 => {
                self.lane = Lane::Resting { held, until: Instant::now() + REST_LOOK, looks: looks - 1 };
            }
            // Whatever has come in between, a touch that is made then arms it, and no drive of before.
            Board::Down => self.release(equipment, held.active.id, Instant::now()),
            Board::Driving | Board::Up => {
                let thin = equipment.find_credit_fraction(&held.whole);
                self.fit_again(equipment, Sustained { thin, ..*held }, true);
            }
        }
    }

    /// Drives what credit allows, and what there is room for.
    fn fit_again(&mut self, equipment: &Arc<Equipment>, held: Sustained, has_rested: bool) {
        let (board, now) = (equipment.read_board(), Instant::now());
        let Some(hold) = self.find_hold(equipment, &held) else { return };
        let manner = DriveMode::Hold(hold);
        let id = held.active.id;
        let first = compute(|| equipment.prepare_fraction(&held.whole, held.thin, 1.0, manner));
        let fitted =
            first.and_then(|first| self.fit(equipment, (id, first), &held.whole, held.thin, manner, (board, now)));
        match fitted {
            Ok((part, drivable)) => self.drive_again(equipment, held, part, drivable, (board, now), has_rested),
            // What is not driven is not shown either.
            Err(_) if has_rested => self.release(equipment, id, Instant::now()),
            Err(problem) => self.keep_unchanged(held, &problem),
        }
    }

    fn drive_again(
        &mut self,
        equipment: &Arc<Equipment>,
        held: Sustained,
        part: f64,
        drivable: Drivable,
        (board, since): (Board, Instant),
        has_rested: bool,
    ) {
        let asked = (held.active.id, held.since);
        let purpose = Purpose::Again { held: Box::new(held), has_rested };
        self.send(equipment, asked, Sent { purpose, drivable, part, board, since, newest: 0 });
    }

    /// Shows what is driven anew, and looks after it from then on.
    pub(super) fn go_on(
        &mut self,
        equipment: &Equipment,
        held: Sustained,
        plan: Plan,
        part: f64,
        begun: Result<u64, Problem>,
        has_rested: bool,
    ) {
        let (id, now) = (held.active.id, Instant::now());
        let is_shown = self.find_hold(equipment, &held).is_some();
        let shown = begun.and_then(|begun| {
            let touches = held.active.touches.clone();
            Ok((begun, show_even(equipment, id, plan, touches, Thinned::by_credit(held.thin))?))
        });
        let (begun, shown) = match shown {
            Ok(shown) => shown,
            Err(problem) => {
                tracing::info!(plan = id, "is not driven again: {}", problem.detail());
                // The board did not want to: what is not driven is not shown either.
                if has_rested && is_shown {
                    self.release(equipment, id, now);
                }
                return;
            }
        };
        if is_shown && let Some(current) = &mut self.state.current {
            current.active = Arc::clone(&shown);
            self.tell_pages(Update::Plan(Arc::clone(&shown)));
        }
        // The drives that have just begun do not know of an end, or of more time, that came while they were on their way.
        if !is_shown || !self.renew(equipment, id, now) {
            return self.release(equipment, id, now);
        }
        self.state.sustained = Some(Sustained { begun, part, active: shown, ..held });
        self.looked = now;
    }

    fn keep_unchanged(&mut self, held: Sustained, problem: &Problem) {
        tracing::info!(plan = held.active.id, "stays as it is: {}", problem.detail());
        self.state.sustained = Some(held);
    }

    /// For how long a drive is still to be held; `None` if it has ended, was stopped, or something else is shown.
    fn find_hold(&self, equipment: &Equipment, held: &Sustained) -> Option<Duration> {
        let now = Instant::now();
        let until = self.state.find_end(&held.active, now)?;
        (held.since.stops == equipment.session.stop_count()).then(|| until.saturating_duration_since(now))
    }
}
