//! The task that owns what is driven.
//!
//! It does one thing at a time with the board, which is its lane: a touch waits for what is left of those before, or is on its way to
//! the board, or the board rests. Commands are taken meanwhile: a newer touch takes the place of one that waits; a release, or more time,
//! goes to the session at once. A stop goes to the session first and is told here afterwards, so that nothing here can hold it up.

use super::active::{CurrentPlan, SustainedDrive, Update};
use super::activity::{BoardActivity, DrivePurpose, SentDrive};
use super::command::{
    DriveCommand, DriveRequest, NextRequest, PublishedDriveState, is_plan_neither_over_nor_stopped, superseded_problem,
};
use super::equipment::{DriveEquipment, RefusedDrive, StartedDrive};
use super::order::{PreparedMode, PreparedPlan, TouchOrder};
use super::state::DriveState;
use crate::daemon::api::kinds::ProblemKind;
use crate::daemon::api::problem::Problem;
use crate::daemon::touch::active_plan::ActivePlan;
use crate::daemon::touch::answer::{Achieved, TouchedView};
use crate::daemon::touch::check::DriveMode;
use crate::daemon::touch::plan_view::{PlanView, Thinned};
use crate::daemon::touch::request::Finger;
use crate::device::{AskedAt, SessionError};
use crate::planner::Plan;
use crate::planner::residual::{Ending, RailState, StartHeadroom, find_fraction_and_plan_within_headroom};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::{Arc, Weak};
use std::time::{Duration, Instant};
use tokio::sync::{broadcast, mpsc, watch};

/// The task.
#[derive(Debug)]
pub struct DriveTask {
    /// Of the daemon, which may end in between.
    equipment: Weak<DriveEquipment>,
    inbox: mpsc::UnboundedReceiver<DriveCommand>,
    publish: watch::Sender<PublishedDriveState>,
    updates: broadcast::Sender<Update>,
    pub(super) state: DriveState,
    pub(super) activity: BoardActivity,
    /// What waits for the lane: the newest.
    next: Option<NextRequest>,
    /// When what goes on was looked at last.
    pub(super) last_look: Instant,
}

impl DriveTask {
    /// A task for a panel at rest.
    #[must_use]
    pub fn new(
        equipment: &Arc<DriveEquipment>,
        inbox: mpsc::UnboundedReceiver<DriveCommand>,
        publish: watch::Sender<PublishedDriveState>,
        updates: broadcast::Sender<Update>,
    ) -> Self {
        let state = DriveState::new(equipment.table.decay_rate_and_travel_of_each_pole(), Instant::now());
        let equipment = Arc::downgrade(equipment);
        Self {
            equipment,
            inbox,
            publish,
            updates,
            state,
            activity: BoardActivity::Free,
            next: None,
            last_look: Instant::now(),
        }
    }

    /// Carries out commands until nobody is there to send any.
    pub async fn run_until_closed(mut self) {
        loop {
            let due = self.find_next_due_time();
            let sleep = async {
                match due {
                    Some(due) => tokio::time::sleep_until(due.into()).await,
                    None => std::future::pending().await,
                }
            };
            // What the board has answered comes before what is said next, and what is due before that: however much is said, it is done in time.
            let is_due = due.is_some_and(|due| due <= Instant::now());
            let (command, answer) = tokio::select! {
                biased;
                answer = self.activity.await_board_answer_or_forever_if_none_is_due() => (None, Some(answer)),
                () = std::future::ready(()), if is_due => (None, None),
                command = self.inbox.recv() => match command {
                    Some(command) => (Some(command), None),
                    None => return,
                },
                () = sleep => (None, None),
            };
            // Held only meanwhile, so that the daemon can end in between.
            let Some(equipment) = self.equipment.upgrade() else { return };
            match (command, answer) {
                (_, Some(answer)) => self.record_and_report_board_answer_freeing_board(&equipment, answer),
                (Some(command), _) => self.carry_out_command(&equipment, command),
                (None, None) => self.carry_out_due_activity(&equipment),
            }
            self.start_queued_request_if_board_is_free(&equipment);
            self.publish_state();
        }
    }

    /// When something is to be done without being told.
    fn find_next_due_time(&self) -> Option<Instant> {
        match &self.activity {
            BoardActivity::Free => self.find_next_supervision_time_of_active_plan(),
            BoardActivity::Settling { until, .. } | BoardActivity::Resting { until, .. } => Some(*until),
            BoardActivity::Ordered { .. } => None,
        }
    }

    fn carry_out_due_activity(&mut self, equipment: &Arc<DriveEquipment>) {
        match std::mem::replace(&mut self.activity, BoardActivity::Free) {
            BoardActivity::Free => {
                self.end_active_plan_that_board_no_longer_drives(equipment);
                self.rest_or_adjust_sustained_drive_if_due(equipment);
            }
            BoardActivity::Settling { request, since, .. } => {
                if request.order.asked_at.stops == equipment.session.stop_count() {
                    self.send_touch_to_board(equipment, request, Some(since));
                } else {
                    request.refuse(SessionError::Stopped);
                }
            }
            BoardActivity::Resting { held, looks, .. } => {
                self.resume_drive_once_board_stopped_driving_or_end_it_if_disarmed(equipment, held, looks)
            }
            ordered @ BoardActivity::Ordered { .. } => self.activity = ordered,
        }
    }

    fn carry_out_command(&mut self, equipment: &Arc<DriveEquipment>, command: DriveCommand) {
        match command {
            // Nobody waits for a place that a newer one has.
            DriveCommand::Queue(next) if next.touch_id() < self.find_newest_driven_or_waiting_touch_id() => {
                next.refuse_as_superseded();
            }
            DriveCommand::Queue(next) => self.queue_request_superseding_waiting(next),
            DriveCommand::Release { id, when } => self.end_touch_at(equipment, id, when),
            DriveCommand::Renew { id, until, reply } => {
                let _ = reply.send(self.extend_touch_and_check_if_still_active(equipment, id, until));
            }
            DriveCommand::Withdraw { id } => {
                if matches!(&self.activity, BoardActivity::Settling { request, .. } if request.order.id == id) {
                    self.refuse_waiting_touch(superseded_problem);
                }
            }
            DriveCommand::Stopped { when } => {
                self.state.note_all_drives_ended(Ending::AtOnce, when);
                self.refuse_waiting_touch(|| SessionError::Stopped.into());
                if matches!(self.activity, BoardActivity::Resting { .. }) {
                    self.activity = BoardActivity::Free;
                }
                self.state.current.take_if(|current| current.asked_at.stops != equipment.session.stop_count());
            }
        }
    }

    /// The newest touch that is driven, or is to be.
    fn find_newest_driven_or_waiting_touch_id(&self) -> u64 {
        let waiting = match &self.activity {
            BoardActivity::Settling { request, .. } => request.order.id,
            _ => 0,
        };
        self.state.newest_plan_id().max(self.next.as_ref().map_or(0, NextRequest::touch_id)).max(waiting)
    }

    fn queue_request_superseding_waiting(&mut self, next: NextRequest) {
        self.refuse_waiting_touch(superseded_problem);
        if let Some(older) = self.next.replace(next) {
            older.refuse_as_superseded();
        }
    }

    fn refuse_waiting_touch(&mut self, make_problem: impl Fn() -> Problem) {
        match std::mem::replace(&mut self.activity, BoardActivity::Free) {
            BoardActivity::Settling { request, .. } => request.refuse(make_problem()),
            other => self.activity = other,
        }
    }

    fn start_queued_request_if_board_is_free(&mut self, equipment: &Arc<DriveEquipment>) {
        while matches!(self.activity, BoardActivity::Free)
            && let Some(next) = self.next.take()
        {
            match next {
                NextRequest::Drive(request) => {
                    self.drive_touch_or_end_earlier_drives_and_wait_for_decay(equipment, request)
                }
                NextRequest::Overtake { id, reply } => {
                    self.state.raise_newest_and_return_previous_id(id);
                    let older =
                        self.state.current.as_ref().map(|current| current.active.id).filter(|older| *older < id);
                    if let Some(older) = older {
                        self.end_touch_at(equipment, older, Instant::now());
                    }
                    let _ = reply.send(());
                }
            }
        }
    }

    /// Has a touch wait for as long as that makes its drives much stronger on top of what is left of the touches before, which end then;
    /// or drives it.
    fn drive_touch_or_end_earlier_drives_and_wait_for_decay(
        &mut self,
        equipment: &Arc<DriveEquipment>,
        request: Box<DriveRequest>,
    ) {
        if request.order.asked_at.stops != equipment.session.stop_count() {
            return request.refuse(SessionError::Stopped);
        }
        let (id, now, first) = (request.order.id, Instant::now(), &request.order.first);
        let board = equipment.read_rail_state_down_up_or_driving();
        let begin = request.order.effect_start_no_earlier_than(now);
        let find_headroom = || {
            Ok(self.state.find_wait_and_force_fraction_beside_earlier_touches(
                &first.motion,
                first.steady_drives(),
                board,
                begin,
            ))
        };
        let StartHeadroom { wait_s, force_fraction, goes_on } = match compute_catching_panics(find_headroom) {
            Ok(room) => room,
            Err(problem) => return request.refuse(problem),
        };
        if wait_s <= 0.0 {
            return self.send_touch_to_board(equipment, request, None);
        }
        if !goes_on {
            if let Some(driven) = self.state.last_plan_id_unless_all_drives_ended_even_if_time_over() {
                self.end_touch_at(equipment, driven, now);
            }
            self.state.note_drives_ended_but_burst_continuing(now);
        }
        tracing::info!(
            plan = id,
            wait_ms = wait_s * 1e3,
            force_fraction,
            "the touch waits until the vibration of earlier touches has decayed"
        );
        // Whatever becomes of it, those before have made way.
        self.state.raise_newest_and_return_previous_id(id);
        self.activity = BoardActivity::Settling { request, since: now, until: begin + Duration::from_secs_f64(wait_s) };
    }

    /// Has the board drive a touch that has waited `waiting_since` then, with as much of its forces as there is room for.
    fn send_touch_to_board(
        &mut self,
        equipment: &Arc<DriveEquipment>,
        request: Box<DriveRequest>,
        waiting_since: Option<Instant>,
    ) {
        let (board, now) = (equipment.read_rail_state_down_up_or_driving(), Instant::now());
        let TouchOrder { id, credit_fraction, ref drive_mode, ref whole_plan, ref first, .. } = request.order;
        match self.scale_plan_to_headroom_beside_earlier_touches(
            equipment,
            (id, first.clone()),
            whole_plan,
            credit_fraction,
            drive_mode,
            (board, request.order.effect_start_no_earlier_than(now)),
        ) {
            Err(problem) => request.refuse(problem),
            Ok((force_fraction, prepared)) => {
                equipment.place_simulated_sensor_under_first_target(id, &prepared.plan);
                // Until it goes to the board: what that takes to answer is no wait.
                let waited = waiting_since.map(|waiting_since| waiting_since.elapsed());
                let purpose = DrivePurpose::Touch { request, waited };
                self.send_drive_to_board(equipment, SentDrive { purpose, prepared, force_fraction, board, since: now });
            }
        }
    }

    /// As much of `first`, the fraction `credit_fraction` of a `whole_plan` plan, as there is room for on top of what is left of the touches before,
    /// and the fraction of its forces that this is.
    pub(super) fn scale_plan_to_headroom_beside_earlier_touches(
        &self,
        equipment: &DriveEquipment,
        (id, first): (u64, PreparedPlan),
        whole_plan: &Plan,
        credit_fraction: f64,
        drive_mode: &DriveMode,
        (board, now): (RailState, Instant),
    ) -> Result<(f64, PreparedPlan), Problem> {
        let weaker = |force_fraction: f64| {
            tracing::info!(
                plan = id,
                force_fraction,
                "the touch is driven with less force because earlier touches still vibrate"
            );
            equipment.prepare_scaled_plan(whole_plan, credit_fraction, force_fraction, drive_mode)
        };
        let room = |prepared: &PreparedPlan| {
            self.state.max_force_fraction_beside_earlier_touches(&prepared.motion, prepared.steady_drives(), board, now)
        };
        compute_catching_panics(|| find_fraction_and_plan_within_headroom(first, weaker, room))
    }

    /// Tells the board.
    pub(super) fn send_drive_to_board(&mut self, equipment: &Arc<DriveEquipment>, sent: SentDrive) {
        let (id, asked_at) = sent.purpose.touch_id_and_asked_at();
        let newest_before = self.state.raise_newest_and_return_previous_id(id);
        let is_soft = sent.board == RailState::Down;
        let start = sent.purpose.wanted_start();
        let answer = Arc::clone(equipment).begin_drive_retrying_once_after_required_rest(
            (id, asked_at),
            start,
            sent.prepared.clone(),
            is_soft,
        );
        self.activity = BoardActivity::Ordered { sent: Box::new(sent), newest_before, answer: Box::pin(answer) };
    }

    fn record_and_report_board_answer_freeing_board(
        &mut self,
        equipment: &Arc<DriveEquipment>,
        answer: Result<StartedDrive, RefusedDrive>,
    ) {
        let BoardActivity::Ordered { sent, newest_before, .. } =
            std::mem::replace(&mut self.activity, BoardActivity::Free)
        else {
            return;
        };
        let SentDrive { purpose, prepared, force_fraction, board, since } = *sent;
        let (id, _) = purpose.touch_id_and_asked_at();
        let begin = |state: &mut DriveState, until: Instant| {
            state.note_begun_drives_and_return_their_serial_number(
                id,
                &prepared.motion,
                prepared.steady_drives(),
                board,
                [since, until],
            )
        };
        let begun = match answer {
            Ok(StartedDrive { achieved, until }) => Ok((achieved, until, begin(&mut self.state, until))),
            Err(RefusedDrive { error, may_drive }) => {
                if may_drive {
                    begin(&mut self.state, Instant::now());
                } else {
                    self.state.restore_newest_plan_id(newest_before);
                }
                Err(Problem::from(error))
            }
        };
        match (purpose, begun) {
            (DrivePurpose::Touch { request, .. }, Err(problem)) => {
                if let Some(current) = self
                    .state
                    .current
                    .as_ref()
                    .filter(|it| is_plan_neither_over_nor_stopped(it, equipment, Instant::now()))
                {
                    // What was driven before goes on, and so does its measurement.
                    equipment.place_simulated_sensor_under_first_target(current.active.id, current.active.plan.plan());
                }
                request.refuse(problem);
            }
            (DrivePurpose::Touch { request, waited }, Ok((achieved, until, begun))) => {
                let achieved = achieved.with_delay(waited);
                let DriveRequest { order, reply } = *request;
                let touched = self.publish_begun_touch_unless_stopped(
                    equipment,
                    order,
                    prepared,
                    force_fraction,
                    (begun, until),
                    achieved,
                );
                // Before its sender hears of it.
                self.publish_state();
                let _ = reply.send(touched);
            }
            (DrivePurpose::Again { held, has_rested }, begun) => {
                let begun = begun.map(|(_, _, begun)| begun);
                self.show_and_sustain_restarted_drive(
                    equipment,
                    *held,
                    prepared.plan,
                    force_fraction,
                    begun,
                    has_rested,
                );
            }
        }
    }

    /// Shows what has begun for a touch, unless everything was stopped meanwhile.
    fn publish_begun_touch_unless_stopped(
        &mut self,
        equipment: &DriveEquipment,
        order: TouchOrder,
        prepared: PreparedPlan,
        force_fraction: f64,
        (begun, until): (u64, Instant),
        device: Achieved,
    ) -> Result<TouchedView, Problem> {
        let TouchOrder { id, asked_at, touches, drive_mode, whole_plan, credit_fraction, .. } = order;
        if equipment.session.stop_count() != asked_at.stops {
            // The stop came after the board's answer: what was entered since then is not driven.
            self.state.note_plan_end_and_check_if_current_ends_sooner(id, Instant::now());
            return Err(SessionError::Stopped.into());
        }
        let PreparedPlan { plan, mode, .. } = prepared;
        let active = match mode {
            PreparedMode::Hold(_) => build_active_plan_of_steady_drive(
                equipment,
                id,
                plan,
                touches,
                Thinned::for_credit_if_below_full_force(credit_fraction),
            ),
            // What is told is what the effect does, and not the even motion that it was designed from.
            PreparedMode::Effect(design) => {
                let plan = compute_catching_panics(|| Ok(PlanView::for_effect(plan, &design)));
                plan.map(|plan| Arc::new(ActivePlan::new(id, plan, touches, device.played_effect().cloned())))
            }
        };
        // What cannot be shown is not driven on.
        let active = active.inspect_err(|_| self.end_touch_at(equipment, id, Instant::now()))?;
        let interruptions =
            asked_at.interruptions.or_else(|| Some(equipment.count_unrequested_disarms_faults_and_outages_of_board()));
        let asked_at = AskedAt { interruptions, ..asked_at };
        self.state.current = Some(CurrentPlan { active: Arc::clone(&active), until, asked_at });
        self.publish_state_and_send_update_to_pages(Update::Plan(Arc::clone(&active)));
        self.last_look = Instant::now();
        self.state.sustained = matches!(drive_mode, DriveMode::Hold(_)).then(|| SustainedDrive {
            begun,
            asked_at,
            whole_plan,
            credit_fraction,
            force_fraction,
            active: Arc::clone(&active),
        });
        Ok(TouchedView { plan: active.plan.clone(), plan_id: active.id, device, stretches: None, trade: None })
    }

    /// Ends the drive of touch `id` at `when`.
    pub(super) fn end_touch_at(&mut self, equipment: &DriveEquipment, id: u64, when: Instant) {
        equipment.session.end_drive_no_later_than(id, when);
        if self.state.note_plan_end_and_check_if_current_ends_sooner(id, when) {
            self.publish_state_and_send_update_to_pages(Update::Ends);
        }
    }

    /// Has the drive of touch `id` go on until `until`; whether it is still what is shown.
    pub(super) fn extend_touch_and_check_if_still_active(
        &mut self,
        equipment: &DriveEquipment,
        id: u64,
        until: Instant,
    ) -> bool {
        let (board, now) = (equipment.read_rail_state_down_up_or_driving(), Instant::now());
        let is_silent = self.state.is_newest_drive_without_voltage();
        let Some(current) = self.state.current.as_mut() else { return false };
        if current.active.id != id || !is_plan_neither_over_nor_stopped(current, equipment, now) {
            return false;
        }
        // A plan without forces has no drives, whatever the board does.
        if board == RailState::Driving || is_silent || current.active.plan.is_board_resting() {
            current.until = until.max(current.until);
            let until = current.until;
            equipment.session.move_drive_end_to(id, until);
            self.state.note_plan_extended(id, now, until);
        }
        true
    }

    /// Publishes first what is told: whoever is told of it may ask for it.
    pub(super) fn publish_state_and_send_update_to_pages(&self, update: Update) {
        self.publish_state();
        // Nobody listening is no error.
        let _ = self.updates.send(update);
    }

    fn publish_state(&self) {
        self.publish.send_replace(PublishedDriveState {
            newest: self.find_newest_driven_or_waiting_touch_id(),
            current: self.state.current.clone(),
        });
    }
}

/// An evenly driven plan as it is shown.
pub(super) fn build_active_plan_of_steady_drive(
    equipment: &DriveEquipment,
    id: u64,
    plan: Plan,
    touches: Vec<Finger>,
    thinned: Option<Thinned>,
) -> Result<Arc<ActivePlan>, Problem> {
    compute_catching_panics(|| {
        let plan = PlanView::new(&equipment.table, plan).with_note_of_reduced_force(thinned);
        Ok(Arc::new(ActivePlan::new(id, plan, touches, None)))
    })
}

/// Works something out. A mistake there takes the one touch with it, and not the task.
pub(super) fn compute_catching_panics<T>(work: impl FnOnce() -> Result<T, Problem>) -> Result<T, Problem> {
    tokio::task::block_in_place(|| catch_unwind(AssertUnwindSafe(work))).unwrap_or_else(|_| {
        Err(Problem::new(
            ProblemKind::Internal,
            "the computation of the drives failed; the daemon's log has the details",
        ))
    })
}
