//! What has been driven, what is left of it, and what is shown of it. Times are handed in, and nothing is asked of the device.

use super::active::{Active, Current, Sustained};
use super::burst::Burst;
use crate::planner::Drive;
use crate::planner::plan_motion::PlanMotion;
use crate::planner::residual::{Board, Ending, ResidualVibration, Room};
use crate::planner::rise::DecayingMode;
use std::sync::Arc;
use std::time::Instant;

/// State of the drives.
#[derive(Debug)]
pub struct DriveState {
    /// Zero of [`ResidualVibration`]'s time.
    zero: Instant,
    /// The newest plan that has been driven, or for which older ones have been ended.
    newest: u64,
    residual: ResidualVibration,
    burst: Option<Burst>,
    /// What is driven.
    pub current: Option<Current>,
    /// What is looked after.
    pub sustained: Option<Sustained>,
}

impl DriveState {
    /// A panel at rest with these poles.
    #[must_use]
    pub fn new(modes: Vec<DecayingMode>, zero: Instant) -> Self {
        let residual = ResidualVibration::new(modes);
        Self { zero, newest: 0, residual, burst: None, current: None, sustained: None }
    }

    /// The newest plan that has been driven, or for which older ones have been ended.
    #[must_use]
    pub const fn newest(&self) -> u64 {
        self.newest
    }

    /// Takes plan `id` for the newest, if it is; the newest before.
    pub fn raise_newest(&mut self, id: u64) -> u64 {
        let before = self.newest;
        self.newest = before.max(id);
        before
    }

    /// Takes back [`Self::raise_newest`]: the plan has driven nothing, so that it has taken nobody's place.
    pub const fn restore_newest(&mut self, before: u64) {
        self.newest = before;
    }

    /// When a plan may begin on top of what is left of the touches before, and with which fraction of its forces. Of a plan that is
    /// driven evenly, `even` are its drives.
    #[must_use]
    pub fn find_room(&self, motion: &PlanMotion, even: Option<&[Drive]>, board: Board, now: Instant) -> Room {
        self.residual.room(motion, even, self.since_zero_s(now), board)
    }

    /// The fraction of a plan's forces for which there is room now.
    #[must_use]
    pub fn find_fraction(&self, motion: &PlanMotion, even: Option<&[Drive]>, board: Board, now: Instant) -> f64 {
        self.residual.part(motion, even, self.since_zero_s(now), board)
    }

    /// The plan whose drives were the last to begin and have not been ended, even if their time is over.
    #[must_use]
    pub fn find_driven(&self) -> Option<u64> {
        self.residual.driven()
    }

    /// Takes note that a plan's drives have begun and will end at `until`; how many have begun until now.
    pub fn begin(
        &mut self,
        id: u64,
        motion: &PlanMotion,
        even: Option<&[Drive]>,
        board: Board,
        span: [Instant; 2],
    ) -> u64 {
        let [now, until] = span;
        let (now_s, until_s) = (self.since_zero_s(now), self.since_zero_s(until));
        self.residual.begin(id, motion, even, board, now_s, until_s);
        let lowest_hz = motion.lines.iter().map(|line| line.drive_hz).fold(f64::INFINITY, f64::min);
        self.burst = Some(Burst::begun(self.burst, Instant::now(), until, lowest_hz));
        self.residual.begun()
    }

    /// Whether the drives of plan `id` that were the `begun`th to begin are still the last, on a board that has not gone off.
    #[must_use]
    pub fn is_last(&self, id: u64, begun: u64, board: Board) -> bool {
        id >= self.newest && self.residual.begun() == begun && board != Board::Down
    }

    /// Takes note that whatever is driven ends now.
    pub fn end_all(&mut self, how: Ending, now: Instant) {
        self.residual.end(self.since_zero_s(now), how);
        if let Some(burst) = &mut self.burst {
            burst.end_by(now);
        }
    }

    /// Takes note that the last drives end, of which the burst counts on until newer ones begin.
    pub fn end_residual(&mut self, now: Instant) {
        self.residual.end(self.since_zero_s(now), Ending::AtItsBoundary);
    }

    /// Takes note that the drives of plan `id` end at `when`; whether what is shown ends sooner by it.
    pub fn end_plan(&mut self, id: u64, when: Instant) -> bool {
        self.residual.end_of(id, self.since_zero_s(when));
        if self.residual.driven() == Some(id)
            && let Some(burst) = &mut self.burst
        {
            burst.end_by(when);
        }
        let current = self.current.as_mut().filter(|current| current.active.id == id && when < current.until);
        current.map(|current| current.until = when).is_some()
    }

    /// Takes note that the drives of plan `id`, if they are on, go on until `until`.
    pub fn prolong_plan(&mut self, id: u64, now: Instant, until: Instant) {
        self.residual.prolong(id, self.since_zero_s(now), self.since_zero_s(until));
        if self.residual.driven() == Some(id)
            && let Some(burst) = &mut self.burst
        {
            burst.go_on(until);
        }
    }

    /// When the board has to rest, if what is driven goes on until `until`.
    #[must_use]
    pub fn find_rest_due(&self, until: Instant) -> Option<Instant> {
        self.burst.as_ref().and_then(|burst| burst.due(until))
    }

    /// When the board has rested, if nothing is driven from the last end on; `None` if nothing was driven.
    #[must_use]
    pub fn find_rest_end(&self) -> Option<Instant> {
        self.burst.as_ref().map(Burst::rested)
    }

    /// When what is shown ends; `None` if it has ended, or something else is shown.
    #[must_use]
    pub fn find_end(&self, active: &Arc<Active>, now: Instant) -> Option<Instant> {
        let is_it = |current: &&Current| Arc::ptr_eq(&current.active, active) && now < current.until;
        self.current.as_ref().filter(is_it).map(|current| current.until)
    }

    fn since_zero_s(&self, when: Instant) -> f64 {
        when.saturating_duration_since(self.zero).as_secs_f64()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::MAX_ACTUATORS;
    use std::time::Duration;

    fn rest() -> (DriveState, PlanMotion, [Instant; 2]) {
        let (none, one) = ([0.0; MAX_ACTUATORS], [1.0; MAX_ACTUATORS]);
        let limit_m = [f64::INFINITY; MAX_ACTUATORS];
        let motion =
            PlanMotion { limit_m, steady_m: none, at_once_m: none, soft_m: none, growth: one, lines: Vec::new() };
        let now = Instant::now();
        (DriveState::new(Vec::new(), now), motion, [now, now + Duration::from_secs(9)])
    }

    /// A touch with two time windows drives twice under one number: what began weaker in the first must not come back in the second,
    /// nor on a board that has gone off.
    #[test]
    fn only_the_last_drives_are_changed_again() {
        let (mut state, motion, span) = rest();
        let drive = |state: &mut DriveState, id: u64| {
            state.raise_newest(id);
            state.begin(id, &motion, Some(&[]), Board::Driving, span)
        };
        let first = drive(&mut state, 1);
        assert!(state.is_last(1, first, Board::Driving) && !state.is_last(1, first, Board::Down));
        let second = drive(&mut state, 1);
        assert!(!state.is_last(1, first, Board::Driving) && state.is_last(1, second, Board::Driving));
        drive(&mut state, 2);
        assert!(!state.is_last(1, second, Board::Driving));
    }

    /// A newer one that is refused leaves the older one what it was: there to be looked after.
    #[test]
    fn one_that_drives_nothing_takes_nobodys_place() {
        let (mut state, motion, span) = rest();
        state.raise_newest(5);
        let begun = state.begin(5, &motion, Some(&[]), Board::Driving, span);
        let before = state.raise_newest(7);
        assert!(!state.is_last(5, begun, Board::Driving));
        state.restore_newest(before);
        assert!(state.is_last(5, begun, Board::Driving));
    }
}
