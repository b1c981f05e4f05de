//! What has been driven, what is left of it, and what is shown of it. Times are handed in, and nothing is asked of the device.

use super::active::{CurrentPlan, SustainedDrive};
use super::burst::Burst;
use crate::daemon::touch::active_plan::ActivePlan;
use crate::planner::Drive;
use crate::planner::plan_motion::PlanMotion;
use crate::planner::residual::{Ending, RailState, ResidualVibration, StartHeadroom};
use crate::planner::rise::PoleDecayAndTravel;
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
    /// Whether the last drives to begin have no voltage, as of a finger of 0 g: the board rests meanwhile.
    is_silent: bool,
    /// What is driven.
    pub current: Option<CurrentPlan>,
    /// What is looked after.
    pub sustained: Option<SustainedDrive>,
}

impl DriveState {
    /// Whether the newest plan has no forces.
    pub const fn is_newest_drive_without_voltage(&self) -> bool {
        self.is_silent
    }

    /// A panel at rest with these poles.
    #[must_use]
    pub fn new(modes: Vec<PoleDecayAndTravel>, zero: Instant) -> Self {
        let residual = ResidualVibration::new(modes);
        Self { zero, newest: 0, residual, burst: None, is_silent: false, current: None, sustained: None }
    }

    /// The newest plan that has been driven, or for which older ones have been ended.
    #[must_use]
    pub const fn newest_plan_id(&self) -> u64 {
        self.newest
    }

    /// Takes plan `id` for the newest, if it is; the newest before.
    pub fn raise_newest_and_return_previous_id(&mut self, id: u64) -> u64 {
        let before = self.newest;
        self.newest = before.max(id);
        before
    }

    /// Takes back [`Self::raise_newest_and_return_previous_id`]: the plan has driven nothing, so that it has taken nobody's place.
    pub const fn restore_newest_plan_id(&mut self, previous_id: u64) {
        self.newest = previous_id;
    }

    /// When a plan may begin on top of what is left of the touches before, and with which fraction of its forces. Of a plan that is
    /// driven evenly, `steady_drives` are its drives.
    #[must_use]
    pub fn find_wait_and_force_fraction_beside_earlier_touches(
        &self,
        motion: &PlanMotion,
        steady_drives: Option<&[Drive]>,
        board: RailState,
        now: Instant,
    ) -> StartHeadroom {
        self.residual.find_wait_and_force_fraction_within_travel_limits(
            motion,
            steady_drives,
            self.seconds_since_start(now),
            board,
        )
    }

    /// The fraction of a plan's forces for which there is room now.
    #[must_use]
    pub fn max_force_fraction_beside_earlier_touches(
        &self,
        motion: &PlanMotion,
        steady_drives: Option<&[Drive]>,
        board: RailState,
        now: Instant,
    ) -> f64 {
        self.residual.max_force_fraction_that_fits_without_wait(
            motion,
            steady_drives,
            self.seconds_since_start(now),
            board,
        )
    }

    /// The plan whose drives were the last to begin and have not been ended, even if their time is over.
    #[must_use]
    pub fn last_plan_id_unless_all_drives_ended_even_if_time_over(&self) -> Option<u64> {
        self.residual.current_drive_id_even_if_past_its_end()
    }

    /// Takes note that a plan's drives have begun and will end at `until`; how many have begun until now.
    pub fn note_begun_drives_and_return_their_serial_number(
        &mut self,
        id: u64,
        motion: &PlanMotion,
        steady_drives: Option<&[Drive]>,
        board: RailState,
        span: [Instant; 2],
    ) -> u64 {
        let [now, until] = span;
        let (now_s, until_s) = (self.seconds_since_start(now), self.seconds_since_start(until));
        self.residual.record_drives_that_begin_in_place_of_others(id, motion, steady_drives, board, now_s, until_s);
        self.is_silent = steady_drives.is_some_and(|drives| drives.iter().all(|drive| drive.voltage_v == 0.0));
        if !self.is_silent {
            let lowest_hz = motion.lines.iter().map(|line| line.drive_hz).fold(f64::INFINITY, f64::min);
            self.burst = Some(Burst::continue_unless_rested_else_begin(self.burst, now, until, lowest_hz));
        } else if let Some(burst) = &mut self.burst {
            burst.end_no_later_than(now);
        }
        self.residual.count_begun_drives()
    }

    /// Whether the drives of plan `id` that were the `begun_count`th to begin are still the last, on a board that has not gone off.
    #[must_use]
    pub fn is_newest_drive_and_board_not_down(&self, id: u64, begun_count: u64, board: RailState) -> bool {
        id >= self.newest && self.residual.count_begun_drives() == begun_count && board != RailState::Down
    }

    /// Takes note that whatever is driven ends now.
    pub fn note_all_drives_ended(&mut self, ending: Ending, now: Instant) {
        self.residual.record_end_of_current_drives(self.seconds_since_start(now), ending);
        if let Some(burst) = &mut self.burst {
            burst.end_no_later_than(now);
        }
    }

    /// Takes note that the last drives end, of which the burst counts on until newer ones begin.
    pub fn note_drives_ended_but_burst_continuing(&mut self, now: Instant) {
        self.residual.record_end_of_current_drives(self.seconds_since_start(now), Ending::AtItsBoundary);
    }

    /// Takes note that the drives of plan `id` end at `when`; whether what is shown ends sooner by it.
    pub fn note_plan_end_and_check_if_current_ends_sooner(&mut self, id: u64, when: Instant) -> bool {
        self.residual.record_end_of_drives_with_id(id, self.seconds_since_start(when));
        if self.residual.current_drive_id_even_if_past_its_end() == Some(id)
            && let Some(burst) = &mut self.burst
        {
            burst.end_no_later_than(when);
        }
        let current = self.current.as_mut().filter(|current| current.active.id == id && when < current.until);
        current.map(|current| current.until = when).is_some()
    }

    /// Takes note that the drives of plan `id`, if they are on, go on until `until`.
    pub fn note_plan_extended(&mut self, id: u64, now: Instant, until: Instant) {
        self.residual.record_extension_of_drives_with_id(
            id,
            self.seconds_since_start(now),
            self.seconds_since_start(until),
        );
        if self.residual.current_drive_id_even_if_past_its_end() == Some(id)
            && !self.is_silent
            && let Some(burst) = &mut self.burst
        {
            burst.end_no_earlier_than(until);
        }
    }

    /// When the board has to rest, if what is driven goes on until `drive_end`.
    #[must_use]
    pub fn start_of_rest_needed_if_driven_until(&self, drive_end: Instant) -> Option<Instant> {
        let burst = self.burst.as_ref().filter(|_| !self.is_silent);
        burst.and_then(|burst| burst.start_of_rest_needed_if_driven_until(drive_end))
    }

    /// When the board has rested, if nothing is driven from the last end on; `None` if nothing was driven.
    #[must_use]
    pub fn find_end_of_rest(&self) -> Option<Instant> {
        self.burst.as_ref().map(Burst::find_end_of_rest)
    }

    /// When what is shown ends; `None` if it has ended, or something else is shown.
    #[must_use]
    pub fn find_end_of_plan_if_still_active(&self, active: &Arc<ActivePlan>, now: Instant) -> Option<Instant> {
        let is_it = |current: &&CurrentPlan| Arc::ptr_eq(&current.active, active) && now < current.until;
        self.current.as_ref().filter(is_it).map(|current| current.until)
    }

    fn seconds_since_start(&self, when: Instant) -> f64 {
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
            state.raise_newest_and_return_previous_id(id);
            state.note_begun_drives_and_return_their_serial_number(id, &motion, Some(&[]), RailState::Driving, span)
        };
        let first = drive(&mut state, 1);
        assert!(
            state.is_newest_drive_and_board_not_down(1, first, RailState::Driving)
                && !state.is_newest_drive_and_board_not_down(1, first, RailState::Down)
        );
        let second = drive(&mut state, 1);
        assert!(
            !state.is_newest_drive_and_board_not_down(1, first, RailState::Driving)
                && state.is_newest_drive_and_board_not_down(1, second, RailState::Driving)
        );
        drive(&mut state, 2);
        assert!(!state.is_newest_drive_and_board_not_down(1, second, RailState::Driving));
    }

    /// A newer one that is refused leaves the older one what it was: there to be looked after.
    #[test]
    fn one_that_drives_nothing_takes_nobodys_place() {
        let (mut state, motion, span) = rest();
        state.raise_newest_and_return_previous_id(5);
        let begun =
            state.note_begun_drives_and_return_their_serial_number(5, &motion, Some(&[]), RailState::Driving, span);
        let before = state.raise_newest_and_return_previous_id(7);
        assert!(!state.is_newest_drive_and_board_not_down(5, begun, RailState::Driving));
        state.restore_newest_plan_id(before);
        assert!(state.is_newest_drive_and_board_not_down(5, begun, RailState::Driving));
    }

    /// Between the detents of a slider its finger has 0 g, and may rest on it for long: the board rests meanwhile, and needs no other rest.
    #[test]
    fn drives_without_voltage_are_a_rest() {
        let (mut state, motion, [begin, far]) = rest();
        let of_voltage = |voltage_v| {
            let actuator = "left".into();
            [Drive {
                actuator,
                frequency_hz: 200.0,
                voltage_v,
                pulse_width: 0.5,
                phase_rad: 0.0,
                force_phase_rad: 0.0,
                force_n: 0.0,
            }]
        };
        let click_end = begin + Duration::from_millis(40);
        state.note_begun_drives_and_return_their_serial_number(
            1,
            &motion,
            None,
            RailState::Driving,
            [begin, click_end],
        );
        let rested = state.find_end_of_rest();
        state.note_begun_drives_and_return_their_serial_number(
            2,
            &motion,
            Some(&of_voltage(0.0)),
            RailState::Driving,
            [click_end, far],
        );
        state.note_plan_extended(2, click_end, far + Duration::from_secs(9));
        assert_eq!(state.find_end_of_rest(), rested);
        assert_eq!(state.start_of_rest_needed_if_driven_until(far + Duration::from_secs(9)), None);
        state.note_begun_drives_and_return_their_serial_number(
            3,
            &motion,
            Some(&of_voltage(100.0)),
            RailState::Driving,
            [click_end, far],
        );
        assert!(state.find_end_of_rest() > Some(far));
        assert!(state.start_of_rest_needed_if_driven_until(far + Duration::from_secs(9)).is_some());
    }
}
