//! Even drives that go on: they grow with the headroom beside what is left of the touches before, are thinned out where a
//! channel's credit falls, and are interrupted by a rest before the board would end its burst.

use super::active::{SustainedDrive, Update};
use super::activity::{BoardActivity, DrivePurpose, SentDrive};
use super::credit::is_force_change_worthwhile;
use super::equipment::DriveEquipment;
use super::order::PreparedPlan;
use super::task::{DriveTask, build_active_plan_of_steady_drive, compute_catching_panics};
use crate::daemon::api::problem::Problem;
use crate::daemon::touch::check::DriveMode;
use crate::daemon::touch::plan_view::Thinned;
use crate::planner::Plan;
use crate::planner::residual::{Ending, NEXT_LOOK_S, RailState, find_larger_fraction_and_plan_within_headroom_if_any};
use std::sync::Arc;
use std::time::{Duration, Instant};

/// Between two looks at the credit, of which the largest force loses 0.6 % meanwhile, and at whether the board still drives what is shown.
const CREDIT_LOOK: Duration = Duration::from_millis(250);
/// Between two looks whether the board has ended a drive that it was told to.
const REST_LOOK: Duration = Duration::from_millis(2);
/// How often it is looked at: 1 s, which is as long as the lowest period.
const REST_LOOKS: u32 = 500;

impl DriveTask {
    /// When what is shown has to be looked at next; `None` if nothing is shown.
    pub(super) fn find_next_supervision_time_of_active_plan(&self) -> Option<Instant> {
        let now = Instant::now();
        let current = self.state.current.as_ref().filter(|current| now < current.until)?;
        let Some(held) = self.state.sustained.as_ref().filter(|held| Arc::ptr_eq(&held.active, &current.active)) else {
            return Some(self.last_look + CREDIT_LOOK);
        };
        let look =
            self.last_look + if held.force_fraction < 1.0 { Duration::from_secs_f64(NEXT_LOOK_S) } else { CREDIT_LOOK };
        Some(self.state.start_of_rest_needed_if_driven_until(current.until).map_or(look, |due| look.min(due)))
    }

    /// Ends what is shown if a fault, an outage or a restart has ended its drive on the board.
    pub(super) fn end_active_plan_that_board_no_longer_drives(&mut self, equipment: &DriveEquipment) {
        let now = Instant::now();
        self.last_look = now;
        let Some(current) = self.state.current.as_ref().filter(|current| now < current.until) else { return };
        let interruptions = equipment.count_unrequested_disarms_faults_and_outages_of_board();
        if equipment.read_rail_state_down_up_or_driving() != RailState::Driving
            && current.asked_at.interruptions.is_some_and(|before| before != interruptions)
        {
            self.end_touch_at(equipment, current.active.id, now);
        }
    }

    /// Looks once after what goes on. It is looked after no more if nobody wants it any more.
    pub(super) fn rest_or_adjust_sustained_drive_if_due(&mut self, equipment: &Arc<DriveEquipment>) {
        let (now, board) = (Instant::now(), equipment.read_rail_state_down_up_or_driving());
        let Some(held) = self.state.sustained.take() else { return };
        let Some(until) = self.find_remaining_hold_time_if_still_driven(equipment, &held).map(|hold| now + hold) else {
            return;
        };
        let is_last = self.state.is_newest_drive_and_board_not_down(held.active.id, held.begun, board);
        if self.state.start_of_rest_needed_if_driven_until(until).is_some_and(|due| now >= due) {
            if is_last {
                self.begin_board_rest(equipment, held);
            }
            return;
        }
        if until.saturating_duration_since(now).as_secs_f64() <= NEXT_LOOK_S {
            self.state.sustained = Some(held);
            return;
        }
        let credit_fraction = equipment.find_force_fraction_allowed_by_credit(&held.whole_plan);
        let is_thinned = is_force_change_worthwhile(held.credit_fraction, credit_fraction);
        if (is_thinned || held.force_fraction < 1.0) && !is_last {
            return;
        }
        if is_thinned {
            self.resend_drive_refit_to_credit_and_headroom(
                equipment,
                SustainedDrive { credit_fraction, ..held },
                false,
            );
        } else if held.force_fraction < 1.0 {
            self.increase_drive_force_if_headroom(equipment, held, (board, now));
        } else {
            self.state.sustained = Some(held);
        }
    }

    /// Drives more of a plan's forces, if there is headroom for that.
    fn increase_drive_force_if_headroom(
        &mut self,
        equipment: &Arc<DriveEquipment>,
        held: SustainedDrive,
        (board, now): (RailState, Instant),
    ) {
        let Some(hold) = self.find_remaining_hold_time_if_still_driven(equipment, &held) else { return };
        let of_part = |force_fraction: f64| {
            equipment.prepare_scaled_plan(
                &held.whole_plan,
                held.credit_fraction,
                force_fraction,
                &DriveMode::Hold(hold),
            )
        };
        let max_fraction = |prepared: &PreparedPlan| {
            self.state.max_force_fraction_beside_earlier_touches(&prepared.motion, prepared.steady_drives(), board, now)
        };
        match compute_catching_panics(|| {
            find_larger_fraction_and_plan_within_headroom_if_any(held.force_fraction, of_part, max_fraction)
        }) {
            Ok(Some((force_fraction, prepared))) => {
                self.send_sustained_drive_again(equipment, held, force_fraction, prepared, (board, now), false)
            }
            Ok(None) => self.state.sustained = Some(held),
            Err(problem) => self.keep_drive_unchanged(held, &problem),
        }
    }

    /// Has the board rest.
    fn begin_board_rest(&mut self, equipment: &DriveEquipment, held: SustainedDrive) {
        let (id, now) = (held.active.id, Instant::now());
        self.state.note_all_drives_ended(Ending::AtItsBoundary, now);
        let Some(until) = self.state.find_end_of_rest() else { return };
        equipment.session.end_drive_no_later_than(id, now);
        let plan = held.active.plan.clone().with_note_of_reduced_force(Some(Thinned::RESTS));
        let resting = Arc::new(held.active.with_plan_view(plan));
        if let Some(current) = &mut self.state.current {
            current.active = Arc::clone(&resting);
        }
        self.publish_state_and_send_update_to_pages(Update::Plan(Arc::clone(&resting)));
        self.activity = BoardActivity::Resting {
            held: Box::new(SustainedDrive { active: resting, ..held }),
            until,
            looks: REST_LOOKS,
        };
    }

    /// Goes on after a rest, once the board drives no more.
    pub(super) fn resume_drive_once_board_stopped_driving_or_end_it_if_disarmed(
        &mut self,
        equipment: &Arc<DriveEquipment>,
        held: Box<SustainedDrive>,
        checks_before_resuming_anyway: u32,
    ) {
        match equipment.read_rail_state_down_up_or_driving() {
            RailState::Driving if checks_before_resuming_anyway > 0 => {
                self.activity = BoardActivity::Resting {
                    held,
                    until: Instant::now() + REST_LOOK,
                    looks: checks_before_resuming_anyway - 1,
                };
            }
            // Whatever has come in between, a touch that is made then arms it, and no drive of before.
            RailState::Down => self.end_touch_at(equipment, held.active.id, Instant::now()),
            RailState::Driving | RailState::Up => {
                let credit_fraction = equipment.find_force_fraction_allowed_by_credit(&held.whole_plan);
                self.resend_drive_refit_to_credit_and_headroom(
                    equipment,
                    SustainedDrive { credit_fraction, ..*held },
                    true,
                );
            }
        }
    }

    /// Drives what credit allows, and what there is headroom for.
    fn resend_drive_refit_to_credit_and_headroom(
        &mut self,
        equipment: &Arc<DriveEquipment>,
        held: SustainedDrive,
        has_rested: bool,
    ) {
        let (board, now) = (equipment.read_rail_state_down_up_or_driving(), Instant::now());
        let Some(hold) = self.find_remaining_hold_time_if_still_driven(equipment, &held) else { return };
        let drive_mode = &DriveMode::Hold(hold);
        let id = held.active.id;
        let first = compute_catching_panics(|| {
            equipment.prepare_scaled_plan(&held.whole_plan, held.credit_fraction, 1.0, drive_mode)
        });
        let fitted = first.and_then(|first| {
            self.scale_plan_to_headroom_beside_earlier_touches(
                equipment,
                (id, first),
                &held.whole_plan,
                held.credit_fraction,
                drive_mode,
                (board, now),
            )
        });
        match fitted {
            Ok((force_fraction, prepared)) => {
                self.send_sustained_drive_again(equipment, held, force_fraction, prepared, (board, now), has_rested)
            }
            // What is not driven is not shown either.
            Err(_) if has_rested => self.end_touch_at(equipment, id, Instant::now()),
            Err(problem) => self.keep_drive_unchanged(held, &problem),
        }
    }

    fn send_sustained_drive_again(
        &mut self,
        equipment: &Arc<DriveEquipment>,
        held: SustainedDrive,
        force_fraction: f64,
        prepared: PreparedPlan,
        (board, since): (RailState, Instant),
        has_rested: bool,
    ) {
        let purpose = DrivePurpose::Again { held: Box::new(held), has_rested };
        self.send_drive_to_board(equipment, SentDrive { purpose, prepared, force_fraction, board, since });
    }

    /// Shows what is driven anew, and looks after it from then on.
    pub(super) fn show_and_sustain_restarted_drive(
        &mut self,
        equipment: &DriveEquipment,
        held: SustainedDrive,
        plan: Plan,
        force_fraction: f64,
        begun: Result<u64, Problem>,
        has_rested: bool,
    ) {
        let (id, now) = (held.active.id, Instant::now());
        let is_shown = self.find_remaining_hold_time_if_still_driven(equipment, &held).is_some();
        let shown = begun.and_then(|begun| {
            let touches = held.active.touches.clone();
            Ok((
                begun,
                build_active_plan_of_steady_drive(
                    equipment,
                    id,
                    plan,
                    touches,
                    Thinned::for_credit_if_below_full_force(held.credit_fraction),
                )?,
            ))
        });
        let (begun, shown) = match shown {
            Ok(shown) => shown,
            Err(problem) => {
                tracing::info!(
                    plan = id,
                    "the daemon computed new forces for the running drive (from the credit of the channels and the \
                     vibration of earlier touches), but could not start the drive with these forces: {}",
                    problem.detail()
                );
                // The board did not want to: what is not driven is not shown either.
                if has_rested && is_shown {
                    self.end_touch_at(equipment, id, now);
                }
                return;
            }
        };
        if is_shown && let Some(current) = &mut self.state.current {
            current.active = Arc::clone(&shown);
            self.publish_state_and_send_update_to_pages(Update::Plan(Arc::clone(&shown)));
        }
        // The drives that have just begun do not know of an end, or of more time, that came while they were on their way.
        if !is_shown || !self.extend_touch_and_check_if_still_active(equipment, id, now) {
            return self.end_touch_at(equipment, id, now);
        }
        self.state.sustained = Some(SustainedDrive { begun, force_fraction, active: shown, ..held });
        self.last_look = now;
    }

    fn keep_drive_unchanged(&mut self, held: SustainedDrive, problem: &Problem) {
        tracing::info!(
            plan = held.active.id,
            "the forces of the drive could not be computed again, so the drive continues with its present forces: {}",
            problem.detail()
        );
        self.state.sustained = Some(held);
    }

    /// For how long a drive is still to be held; `None` if it has ended, was stopped, or something else is shown.
    fn find_remaining_hold_time_if_still_driven(
        &self,
        equipment: &DriveEquipment,
        held: &SustainedDrive,
    ) -> Option<Duration> {
        let now = Instant::now();
        let until = self.state.find_end_of_plan_if_still_active(&held.active, now)?;
        (held.asked_at.stops == equipment.session.stop_count()).then(|| until.saturating_duration_since(now))
    }
}
