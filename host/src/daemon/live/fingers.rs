//! Drives what the fingers of one page do ([`super::finger_steps`]).

use super::build_error_message;
use super::finger_steps::{FingerStep, PageFingers};
use crate::daemon::access::client::{Asker, Client};
use crate::daemon::api::problem::Problem;
use crate::daemon::app::App;
use crate::daemon::touch::check::DriveMode;
use crate::daemon::touch::request::{Finger, MAX_DURATION_MS};
use serde_json::{Value, json};
use std::sync::Arc;
use std::time::{Duration, Instant};
use tokio::sync::mpsc;

/// Least time for which a tap vibrates, however short the finger was down.
const TAP: Duration = Duration::from_millis(400);
/// For so long rails settle at another voltage that is not much higher: a discharge switch takes 13 ms.
const RAILS_CHANGE: Duration = Duration::from_millis(15);
/// Least time that a tap has to itself before the next one takes its place: some periods of any drive and all of a click, so that it is
/// felt, and shorter than fingers tap after each other (a trill of two has some 60 ms), so that nobody's taps fall behind.
const LEAST: Duration = Duration::from_millis(40);
/// Between two looks whether a touch that nobody wants any more has begun to wait for its turn.
const AGAIN: Duration = Duration::from_millis(10);
/// Between two looks at a finger that rests: well before its drive ends ([`MAX_DURATION_MS`]).
const RENEW: Duration = Duration::from_secs(1);

/// Drives what the fingers ask for until the page is gone.
pub async fn drive_fingers_until_page_is_gone(
    app: Arc<App>,
    client: Client,
    fingers: Arc<PageFingers>,
    replies: mpsc::Sender<Value>,
) {
    let mut held_fingers = TouchingFingers { client, ..TouchingFingers::default() };
    loop {
        let step = tokio::select! {
            step = fingers.wait_for_oldest_due_step(|step| held_fingers.find_earliest_drive_time_or_none_if_now(&app, step)) => step,
            () = tokio::time::sleep(RENEW), if held_fingers.still.is_some() => {
                held_fingers.extend_drive_of_resting_fingers_or_restart(&app, &fingers, &replies).await;
                continue;
            }
        };
        let Some(step) = step else { return };
        let lifted = step.lifted;
        held_fingers.forget_lifted_fingers(&step.touch.fingers);
        if !step.touch.fingers.is_empty()
            && !held_fingers.is_covered_by_effect(&app, &step)
            && let Err(problem) =
                held_fingers.plan_and_drive_touch_of_step_and_record_outcome(&app, &fingers, step.clone()).await
        {
            // The page reads nothing: it has missed older news than this.
            let _ = replies.try_send(build_error_message(&problem));
            held_fingers.schedule_end_of_held_drive_if_any_finger_lifted(&app, &step.touch.fingers);
        }
        if lifted {
            held_fingers.end_held_drive_after_least_time_and_forget_fingers(&app);
        }
    }
}

/// The fingers that are down, and what is driven for them.
#[derive(Debug, Default)]
struct TouchingFingers {
    client: Client,
    down: Vec<i64>,
    /// The plan of the effect that was played last, if nothing else has been driven for these fingers since.
    effect_plan: Option<u64>,
    held: Option<FingerDrive>,
    /// The fingers that it is for.
    held_for: Vec<i64>,
    /// What it was driven for, if that goes on for as long as they are.
    still: Option<FingerStep>,
    /// [`TouchDriver::count_unrequested_disarms_faults_and_outages_of_board`](crate::daemon::drive::TouchDriver::count_unrequested_disarms_faults_and_outages_of_board) when that began.
    interruptions: u64,
    /// Since when the newest of the fingers is felt for which something was driven last.
    newly_down: Option<Instant>,
}

/// An even drive.
#[derive(Clone, Copy, Debug)]
struct FingerDrive {
    plan: u64,
    /// Since when its fingers are down.
    since: Instant,
    /// For how long it is felt at least.
    least: Duration,
}

impl FingerDrive {
    /// The drive `plan` of a step, in place of the one before.
    fn replace_plan_keeping_start_if_same_kind(before: Option<Self>, plan: u64, step: &FingerStep) -> Self {
        // A texture is felt while its finger moves; it is no tap.
        let least = if step.is_texture { Duration::ZERO } else { TAP };
        let since = before.filter(|before| before.least == least).map_or_else(Instant::now, |before| before.since);
        Self { plan, since, least }
    }

    fn end_after_least_time(self, app: &App) {
        app.driver.end_touch_at(self.plan, self.since + self.least);
    }
}

impl TouchingFingers {
    /// When a step may be driven: not before a finger that is lifted by then, or an effect, has been felt for a while; fingers that only move not
    /// before their effect has come to its end.
    fn find_earliest_drive_time_or_none_if_now(&self, app: &App, step: &FingerStep) -> Option<Instant> {
        if step.touch.fingers.is_empty() || self.is_covered_by_effect(app, step) {
            return None;
        }
        if step.is_only_move()
            && let Some(effect_end) = self.find_end_of_own_effect(app)
        {
            return Some(effect_end);
        }
        let is_down =
            |id: &i64| step.touch.fingers.iter().any(|finger| finger.id == *id) && !step.newly_down.contains(id);
        let goes_on = !step.starts_effect && !self.down.is_empty() && self.down.iter().all(is_down);
        self.newly_down.filter(|_| !goes_on).map(|newly_down| newly_down + LEAST)
    }

    /// When the effect ends that plays for these fingers, if one does.
    fn find_end_of_own_effect(&self, app: &App) -> Option<Instant> {
        let (current, end) = app.driver.find_id_and_end_of_current_plan()?;
        (Some(current) == self.effect_plan).then_some(end)
    }

    /// Whether there is nothing to drive for a step: its effect has begun before, or its fingers are lifted before their effect has ended.
    fn is_covered_by_effect(&self, app: &App, step: &FingerStep) -> bool {
        let is_effect = step.touch.haptics.effect.is_some();
        step.is_only_move() && (is_effect || step.lifted && self.find_end_of_own_effect(app).is_some())
    }

    /// Fingers that rest are felt for as long as they are down: their drive is given more time, and begun again where it was
    /// ended by a touch of somebody else's that is over, or by the board. Not after a stop, nor once the board has gone off.
    async fn extend_drive_of_resting_fingers_or_restart(
        &mut self,
        app: &Arc<App>,
        fingers: &PageFingers,
        replies: &mpsc::Sender<Value>,
    ) {
        let Some((step, FingerDrive { plan, .. })) = self.still.clone().zip(self.held) else { return };
        let until = Instant::now() + Duration::from_millis(u64::from(MAX_DURATION_MS));
        if app.driver.stop_count() != step.stops
            || app.driver.count_unrequested_disarms_faults_and_outages_of_board() != self.interruptions
            || app.driver.is_board_known_to_be_disarmed()
        {
            self.still = None;
        } else if !app.driver.extend_touch_and_check_if_still_active(plan, until).await
            && app.driver.find_active_plan().is_none()
            && !app.driver.does_newest_touch_have_parts_yet_to_begin()
            // What is being planned is somebody's touch, and would be older than this.
            && app.driver.admission.is_planner_idle()
            && let Err(problem) = self.plan_and_drive_touch_of_step_and_record_outcome(app, fingers, step).await
            && !["busy", "superseded", "device-refused"].iter().any(|kind| problem.is_kind(kind))
        {
            self.still = None;
            let _ = replies.try_send(build_error_message(&problem));
        }
    }

    /// Forgets fingers that are not down any more: when they come again, their effect does.
    fn forget_lifted_fingers(&mut self, fingers_down: &[Finger]) {
        self.down.retain(|id| fingers_down.iter().any(|touch| touch.id == *id));
    }

    async fn plan_and_drive_touch_of_step_and_record_outcome(
        &mut self,
        app: &Arc<App>,
        fingers: &PageFingers,
        step: FingerStep,
    ) -> Result<(), Problem> {
        let is_even = step.touch.haptics.effect.is_none() && step.touch.haptics.duration_ms.is_none();
        let again =
            (is_even && !step.lifted).then(|| FingerStep { newly_down: Vec::new(), is_tap: false, ..step.clone() });
        let ids = step.touch.fingers.iter().map(|finger| finger.id).collect();
        let is_effect = step.touch.haptics.effect.is_some();
        let touch =
            if is_effect { step.touch.clone().keep_only_fingers(&step.effect_fingers) } else { step.touch.clone() };
        let asker = Asker { client: self.client, ..Asker::default() };
        let (id, interruptions) = (
            app.driver.admission.allocate_request_number(),
            app.driver.count_unrequested_disarms_faults_and_outages_of_board(),
        );
        let mut driving =
            std::pin::pin!(app.driver.plan_and_drive_touch_counting_outcome(&asker, id, step.stops, &touch));
        // To its end in any case, but without waiting for its turn once newer fingers stand in its place.
        let done = loop {
            tokio::select! {
                done = &mut driving => break done,
                () = tokio::time::sleep(AGAIN), if !step.lifted && !step.is_tap => {}
            }
            if fingers.has_step_in_place_of(&step) {
                app.driver.drop_waiting_touch(id);
            }
        };
        app.record_line("outcome", || match &done {
            Ok(done) => json!({
                "id": id, "status": 200, "plan": done.plan, "device": done.device,
            }),
            Err(problem) => json!({"id": id, "status": problem.status().as_u16(), "problem": problem}),
        });
        match done {
            Ok(done) => {
                self.held_for.clone_from(&ids);
                (self.down, self.still, self.interruptions) = (ids, again, interruptions);
                self.effect_plan = is_effect.then_some(done.plan_id);
                if !step.is_only_move() {
                    // An effect waits for its rails. The next one waits for them as well, where they only change.
                    let wait = done.device.time_from_answer_to_effect_start_or_zero().saturating_sub(RAILS_CHANGE);
                    self.newly_down = Some(Instant::now() + wait);
                }
                self.held = match touch.mode {
                    // An effect ends by itself, whatever the fingers do meanwhile.
                    DriveMode::Effect(_) | DriveMode::Designed(_) => None,
                    DriveMode::Hold(_) => {
                        Some(FingerDrive::replace_plan_keeping_start_if_same_kind(self.held, done.plan_id, &step))
                    }
                };
                Ok(())
            }
            // The page itself has asked for something newer.
            Err(problem) if problem.is_kind("superseded") && fingers.has_step_in_place_of(&step) => Ok(()),
            Err(problem) => Err(problem),
        }
    }

    /// Ends the drive that is held if one of its fingers is not among these any more: what was to take its place has not, and a finger that is
    /// lifted must not vibrate on.
    fn schedule_end_of_held_drive_if_any_finger_lifted(&mut self, app: &App, fingers_down: &[Finger]) {
        let is_down = |id: &i64| fingers_down.iter().any(|touch| touch.id == *id);
        if !self.held_for.iter().all(is_down) {
            self.still = None;
            if let Some(held) = self.held.take() {
                held.end_after_least_time(app);
            }
        }
    }

    fn end_held_drive_after_least_time_and_forget_fingers(&mut self, app: &App) {
        self.down.clear();
        self.still = None;
        if let Some(held) = self.held.take() {
            held.end_after_least_time(app);
        }
    }
}
