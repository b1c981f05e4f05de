//! The fingers of one page: what they do, in order, and driving it.

use super::build_error_message;
use crate::daemon::access::client::{Asker, Client};
use crate::daemon::api::problem::Problem;
use crate::daemon::app::App;
use crate::daemon::drive::superseded_problem;
use crate::daemon::touch::Touch;
use crate::daemon::touch::check::{CheckedFinger, DriveMode};
use crate::daemon::touch::request::{Finger, MAX_DURATION_MS};
use crate::effects::NamedEffect;
use serde_json::{Value, json};
use std::collections::VecDeque;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};
use tokio::sync::{Notify, mpsc};

/// Least time for which a tap vibrates, however short the finger was down.
const TAP: Duration = Duration::from_millis(400);
/// Least time that a tap has to itself before the next one takes its place: some periods of any drive and all of a click, so that it is
/// felt, and shorter than fingers tap after each other (a trill of two has some 60 ms), so that nobody's taps fall behind.
const LEAST: Duration = Duration::from_millis(40);
/// Between two looks whether a touch that nobody wants any more has begun to wait for its turn.
const AGAIN: Duration = Duration::from_millis(10);
/// Between two looks at a finger that rests: well before its drive ends ([`MAX_DURATION_MS`]).
const RENEW: Duration = Duration::from_secs(1);
/// Most taps that wait to be driven: the last of them for some 1.3 s ([`LEAST`]). More than ten fingers make at once.
const MOST_STEPS: usize = 32;

/// Fingers that went down or moved, and whether they have been lifted since.
#[derive(Clone, Debug)]
struct FingerStep {
    /// Without fingers where those before are lifted.
    touch: Touch,
    lifted: bool,
    /// Fingers that have come since the step before, even if they had been there until shortly before.
    newly_down: Vec<i64>,
    /// Whether it is driven though fingers have moved since: one that came in it has been lifted, others are still down.
    is_tap: bool,
    /// Whether its effect begins with it; if not, it has been begun by an earlier message, of which this one only moves the fingers.
    starts_effect: bool,
    /// The fingers that its effect is for.
    effect_fingers: Vec<i64>,
    /// [`TouchDriver::stop_count`](crate::daemon::drive::TouchDriver::stop_count) when it was said: a stop from then on means that it is not driven.
    stops: u64,
}

/// What a page's fingers have done and is not driven yet. Of fingers that move only the newest place counts; those that were
/// lifted stay, so that every tap is driven.
#[derive(Debug, Default)]
pub struct PageFingers {
    steps: Mutex<VecDeque<FingerStep>>,
    /// Those that are down by the last message.
    down: Mutex<Option<Touch>>,
    changed: Notify,
    gone: Mutex<bool>,
    /// Whether a tap that waits makes way for any newer one.
    only_newest_tap: bool,
}

impl FingerStep {
    /// Whether `newer` stands in its place. A tap is driven in any case. An effect is replaced by one that begins later, so that the detents of
    /// a fast finger do not queue; fingers that only move do not replace it.
    fn makes_way_for(&self, newer: &Self) -> bool {
        let is_replaced = newer.starts_effect || newer.touch.feel == self.touch.feel;
        !self.lifted && !self.is_tap && (!self.starts_effect || is_replaced)
    }

    /// Whether its fingers have only moved, or stayed.
    fn is_only_move(&self) -> bool {
        self.newly_down.is_empty() && !self.starts_effect
    }
}

impl PageFingers {
    /// Those of a new page. `only_newest_tap`: of taps that wait only the newest is driven, and not each.
    #[must_use]
    pub fn new(only_newest_tap: bool) -> Self {
        Self { only_newest_tap, ..Self::default() }
    }

    /// Of fingers that have effects of their own, the effect that is played: that of the newest finger; if none is new, the one that began
    /// last, or that of the first finger.
    #[must_use]
    pub fn choose_effect_of_newest_finger(&self, fingers: &[CheckedFinger]) -> Option<NamedEffect> {
        let before = self.down.lock().unwrap_or_else(PoisonError::into_inner);
        let had = |checked: &CheckedFinger| {
            let mut before = before.iter().flat_map(|touch| &touch.fingers);
            before.any(|finger| (finger.id, finger.effect) == (checked.finger.id, checked.finger.effect))
        };
        let newest = fingers.iter().rfind(|checked| checked.finger.effect.is_some() && !had(checked));
        let last = before.as_ref().and_then(|touch| touch.feel.effect);
        let going_on =
            || fingers.iter().find(|checked| checked.finger.effect.is_some() && checked.finger.effect == last);
        let first = || fingers.iter().find(|checked| checked.finger.effect.is_some());
        newest.or_else(going_on).or_else(first)?.finger.effect
    }

    /// All fingers that are down now, none if they are lifted.
    ///
    /// # Errors
    /// [`Problem`]: too many taps wait, of which the oldest is not driven any more.
    pub fn queue_fingers_down_dropping_oldest_if_full(
        &self,
        touch: Touch,
        stop_count_at_arrival: u64,
    ) -> Result<(), Problem> {
        let mut dropped = None;
        let ids: Vec<i64> = touch.fingers.iter().map(|finger| finger.id).collect();
        let mut steps = self.lock_steps();
        let before = self.down.lock().unwrap_or_else(PoisonError::into_inner).replace(touch.clone());
        let was_down = |id: &&i64| before.iter().flat_map(|touch| &touch.fingers).any(|finger| finger.id == **id);
        let newly_down: Vec<i64> = ids.iter().filter(|id| !was_down(id)).copied().collect();
        // A message without an effect in between, or another effect, and a held finger feels it again.
        let feels_other = before.as_ref().is_none_or(|before| before.feel != touch.feel);
        let is_own_effect = touch.fingers.iter().any(|finger| finger.effect == touch.feel.effect);
        let plays = |finger: &&Finger| !is_own_effect || finger.effect == touch.feel.effect;
        let effect_fingers: Vec<i64> = touch.fingers.iter().filter(plays).map(|finger| finger.id).collect();
        let is_new_effect_finger = newly_down.iter().any(|id| effect_fingers.contains(id));
        let starts_effect = touch.feel.effect.is_some() && (feels_other || is_new_effect_finger);
        let mut step = FingerStep {
            lifted: touch.fingers.is_empty(),
            touch,
            newly_down,
            is_tap: false,
            starts_effect,
            effect_fingers,
            stops: stop_count_at_arrival,
        };
        if step.touch.fingers.is_empty() {
            match steps.back_mut() {
                Some(last) if !last.lifted => last.lifted = true,
                Some(_) => {}
                None => steps.push_back(step),
            }
        } else {
            if let Some(last) = steps.back_mut().filter(|last| !last.lifted) {
                last.is_tap |= last.newly_down.iter().any(|id| !ids.contains(id));
            }
            // A device slower than the page skips what came in between.
            while let Some(skipped) = steps.pop_back_if(|last| self.only_newest_tap || last.makes_way_for(&step)) {
                let come =
                    skipped.newly_down.into_iter().filter(|id| ids.contains(id) && !step.newly_down.contains(id));
                let come: Vec<i64> = come.collect();
                step.newly_down.extend(come);
                step.starts_effect |= skipped.starts_effect && skipped.touch.feel == step.touch.feel;
            }
            if steps.len() >= MOST_STEPS {
                dropped = steps.pop_front().filter(|step| !step.touch.fingers.is_empty());
            }
            steps.push_back(step);
        }
        drop(steps);
        self.changed.notify_one();
        dropped.map_or(Ok(()), |_| Err(superseded_problem()))
    }

    /// The fingers that are down by the last message.
    pub fn list_ids_of_fingers_down(&self) -> Vec<i64> {
        let down = self.down.lock().unwrap_or_else(PoisonError::into_inner);
        down.iter().flat_map(|touch| &touch.fingers).map(|finger| finger.id).collect()
    }

    /// All but these are lifted; those of them that are down stay as they were.
    ///
    /// # Errors
    /// As [`Self::queue_fingers_down_dropping_oldest_if_full`].
    pub fn lift_all_except_dropping_oldest_if_full(
        &self,
        ids: &[i64],
        stop_count_at_arrival: u64,
    ) -> Result<(), Problem> {
        let Some(before) = self.down.lock().unwrap_or_else(PoisonError::into_inner).clone() else { return Ok(()) };
        let count = before.fingers.len();
        let kept = before.keep_only_fingers(ids);
        if kept.fingers.len() == count {
            Ok(())
        } else {
            self.queue_fingers_down_dropping_oldest_if_full(kept, stop_count_at_arrival)
        }
    }

    fn lift_all_fingers(&self) {
        // What is lifted takes nobody's place.
        let _ = self.queue_fingers_down_dropping_oldest_if_full(Touch::without_fingers(), 0);
    }

    /// Whatever they have done is not wanted any more.
    pub fn discard_steps_and_lift_all(&self) {
        self.lock_steps().clear();
        self.lift_all_fingers();
    }

    /// The page has gone away: its fingers are lifted.
    pub fn lift_all_as_page_is_gone(&self) {
        self.lift_all_fingers();
        *self.gone.lock().unwrap_or_else(PoisonError::into_inner) = true;
        self.changed.notify_one();
    }

    /// The next step, once it is `find_earliest_drive_time`; `None` once the page is gone and all is done.
    async fn wait_for_oldest_due_step(
        &self,
        find_earliest_drive_time: impl Fn(&FingerStep) -> Option<Instant>,
    ) -> Option<FingerStep> {
        loop {
            let changed = self.changed.notified();
            let waits = self
                .lock_steps()
                .front()
                .map(|step| find_earliest_drive_time(step).filter(|due| Instant::now() < *due));
            match waits {
                // Looked at again then: a stop may have taken it away.
                Some(Some(due_time)) => {
                    tokio::select! {
                        () = changed => {}
                        () = tokio::time::sleep_until(due_time.into()) => {}
                    }
                    continue;
                }
                Some(None) => {
                    if let Some(step) = self.lock_steps().pop_front() {
                        return Some(step);
                    }
                }
                None => {}
            }
            if *self.gone.lock().unwrap_or_else(PoisonError::into_inner) {
                return None;
            }
            changed.await;
        }
    }

    /// Whether fingers have moved or come that stand in place of `driven`.
    fn has_step_in_place_of(&self, driven: &FingerStep) -> bool {
        let is_in_place =
            |step: &FingerStep| driven.makes_way_for(step) && (step.starts_effect || !driven.starts_effect);
        self.lock_steps().front().is_some_and(|step| !step.touch.fingers.is_empty() && is_in_place(step))
    }

    fn lock_steps(&self) -> MutexGuard<'_, VecDeque<FingerStep>> {
        self.steps.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// Drives what the fingers ask for until the page is gone.
pub async fn drive_fingers_until_page_is_gone(
    app: Arc<App>,
    client: Client,
    fingers: Arc<PageFingers>,
    replies: mpsc::Sender<Value>,
) {
    let mut hand = HeldFingers { client, ..HeldFingers::default() };
    loop {
        let step = tokio::select! {
            step = fingers.wait_for_oldest_due_step(|step| hand.find_earliest_drive_time(&app, step)) => step,
            () = tokio::time::sleep(RENEW), if hand.still.is_some() => {
                hand.extend_drive_of_resting_fingers_or_restart(&app, &fingers, &replies).await;
                continue;
            }
        };
        let Some(step) = step else { return };
        let lifted = step.lifted;
        hand.forget_lifted_fingers(&step.touch.fingers);
        if !step.touch.fingers.is_empty()
            && !hand.is_covered_by_effect(&app, &step)
            && let Err(problem) = hand.drive_step(&app, &fingers, step.clone()).await
        {
            // The page reads nothing: it has missed older news than this.
            let _ = replies.try_send(build_error_message(&problem));
            hand.end_lifted_drive_after_minimum_tap(&app, &step.touch.fingers);
        }
        if lifted {
            hand.end_drive(&app);
        }
    }
}

/// The fingers that are down, and what is driven for them.
#[derive(Debug, Default)]
struct HeldFingers {
    client: Client,
    down: Vec<i64>,
    /// The plan of the effect that was played last, if nothing else has been driven for these fingers since.
    effect_plan: Option<u64>,
    /// The even drive, and since when its fingers are down.
    held: Option<(Instant, u64)>,
    /// The fingers that it is for.
    held_for: Vec<i64>,
    /// What it was driven for, if that goes on for as long as they are.
    still: Option<FingerStep>,
    /// [`TouchDriver::count_unrequested_board_interruptions`](crate::daemon::drive::TouchDriver::count_unrequested_board_interruptions) when that began.
    interruptions: u64,
    /// Since when the newest of the fingers is felt for which something was driven last.
    newly_down: Option<Instant>,
}

impl HeldFingers {
    /// When a step may be driven: not before a finger that is lifted by then, or an effect, has been felt for a while; fingers that only move not
    /// before their effect has come to its end.
    fn find_earliest_drive_time(&self, app: &App, step: &FingerStep) -> Option<Instant> {
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
        let is_effect = step.touch.feel.effect.is_some();
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
        let Some((step, (_, plan))) = self.still.clone().zip(self.held) else { return };
        let until = Instant::now() + Duration::from_millis(u64::from(MAX_DURATION_MS));
        if app.driver.stop_count() != step.stops
            || app.driver.count_unrequested_board_interruptions() != self.interruptions
            || app.driver.is_board_known_to_be_disarmed()
        {
            self.still = None;
        } else if !app.driver.extend_touch_and_check_if_still_shown(plan, until).await
            && app.driver.find_active_plan().is_none()
            // What is being planned is somebody's touch, and would be older than this.
            && app.driver.admission.is_planner_idle()
            && let Err(problem) = self.drive_step(app, fingers, step).await
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

    async fn drive_step(&mut self, app: &Arc<App>, fingers: &PageFingers, step: FingerStep) -> Result<(), Problem> {
        let is_even = step.touch.feel.effect.is_none() && step.touch.feel.duration_ms.is_none();
        let again =
            (is_even && !step.lifted).then(|| FingerStep { newly_down: Vec::new(), is_tap: false, ..step.clone() });
        let ids = step.touch.fingers.iter().map(|finger| finger.id).collect();
        let is_effect = step.touch.feel.effect.is_some();
        let touch =
            if is_effect { step.touch.clone().keep_only_fingers(&step.effect_fingers) } else { step.touch.clone() };
        let asker = Asker { client: self.client, ..Asker::default() };
        let (id, interruptions) =
            (app.driver.admission.allocate_request_number(), app.driver.count_unrequested_board_interruptions());
        let mut driving = std::pin::pin!(app.driver.drive_touch(&asker, id, step.stops, &touch));
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
                    self.newly_down = Some(Instant::now());
                }
                self.held = match touch.mode {
                    // An effect ends by itself, whatever the fingers do meanwhile.
                    DriveMode::Effect(_) | DriveMode::Designed(_) => None,
                    DriveMode::Hold(_) => Some((self.held.map_or_else(Instant::now, |(since, _)| since), done.plan_id)),
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
    fn end_lifted_drive_after_minimum_tap(&mut self, app: &App, fingers_down: &[Finger]) {
        let is_down = |id: &i64| fingers_down.iter().any(|touch| touch.id == *id);
        if !self.held_for.iter().all(is_down) {
            self.still = None;
            if let Some((since, plan)) = self.held.take() {
                app.driver.end_touch_at(plan, since + TAP);
            }
        }
    }

    fn end_drive(&mut self, app: &App) {
        self.down.clear();
        self.still = None;
        if let Some((since, plan)) = self.held.take() {
            app.driver.end_touch_at(plan, since + TAP);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::daemon::touch::request::Feel;
    use crate::planner::Target;

    fn make_touch_at(ids: &[i64], x_px: f64, feel: Feel) -> Touch {
        let target = Target { x_m: 0.0, y_m: 0.0, intensity_g: None };
        let checked = |id: &i64| {
            let finger = Finger { id: *id, x_px, y_px: 0.0, intensity_g: None, effect: None };
            CheckedFinger { finger, target }
        };
        Touch::from_fingers(&ids.iter().map(checked).collect::<Vec<_>>(), feel).unwrap()
    }

    /// Fingers that came, of each step that waits; whether it is a tap; and where its first finger is.
    fn take_steps(fingers: &PageFingers) -> Vec<(Vec<i64>, bool, f64)> {
        let of = |step: FingerStep| {
            (
                step.newly_down,
                step.lifted || step.is_tap,
                step.touch.fingers.first().map_or(f64::NAN, |finger| finger.x_px),
            )
        };
        std::iter::from_fn(|| fingers.lock_steps().pop_front()).map(of).collect()
    }

    #[test]
    fn a_finger_that_comes_again_is_another_one() {
        let fingers = PageFingers::default();
        let say = |ids: &[i64], x_px| {
            fingers.queue_fingers_down_dropping_oldest_if_full(make_touch_at(ids, x_px, Feel::default()), 0).unwrap()
        };
        say(&[1], 0.0);
        say(&[1, 2], 1.0);
        assert_eq!(take_steps(&fingers), [(vec![2, 1], false, 1.0)]);
        // Lifted and back before anything is driven.
        say(&[1], 2.0);
        say(&[1, 2], 3.0);
        say(&[1, 2], 4.0);
        assert_eq!(take_steps(&fingers), [(vec![2], false, 4.0)]);
        // A tap beside a finger that stays; the newest place of what follows.
        say(&[1, 2, 3], 5.0);
        say(&[1, 2], 6.0);
        say(&[1, 2], 7.0);
        assert_eq!(take_steps(&fingers), [(vec![3], true, 5.0), (vec![], false, 7.0)]);
    }

    /// So many that nobody can have made them: the newest are driven, and the page is told of the others.
    #[test]
    fn of_too_many_taps_the_oldest_make_way() {
        let fingers = PageFingers::default();
        let tap = |x_px: f64| {
            let result =
                fingers.queue_fingers_down_dropping_oldest_if_full(make_touch_at(&[1], x_px, Feel::default()), 0);
            fingers.queue_fingers_down_dropping_oldest_if_full(Touch::without_fingers(), 0).unwrap();
            result.is_ok()
        };
        let most = f64::from(u8::try_from(MOST_STEPS).unwrap());
        for i in 0..MOST_STEPS {
            assert!(tap(f64::from(u8::try_from(i).unwrap())));
        }
        assert!(!tap(most));
        let left = take_steps(&fingers);
        assert_eq!((left.len(), left[0].2, left[MOST_STEPS - 1].2), (MOST_STEPS, 1.0, most));
        assert!(left.iter().all(|(_, is_tap, _)| *is_tap));
    }

    /// Numbers of the fingers, whether an effect begins, and for which fingers, of each step that waits.
    fn take_effects(fingers: &PageFingers) -> Vec<(f64, bool, Vec<i64>)> {
        let of = |step: FingerStep| (step.touch.fingers[0].x_px, step.starts_effect, step.effect_fingers);
        std::iter::from_fn(|| fingers.lock_steps().pop_front()).map(of).collect()
    }

    #[test]
    fn an_effect_begins_with_its_finger_and_again_after_a_message_without_it() {
        let fingers = PageFingers::default();
        let click = Feel { effect: Some(NamedEffect::Click), ..Feel::default() };
        let say = |ids: &[i64], x_px, feel| {
            fingers.queue_fingers_down_dropping_oldest_if_full(make_touch_at(ids, x_px, feel), 0).unwrap()
        };
        say(&[1], 0.0, click);
        assert_eq!(take_effects(&fingers), [(0.0, true, vec![1])]);
        say(&[1], 1.0, click);
        assert_eq!(take_effects(&fingers), [(1.0, false, vec![1])], "its finger moves");
        say(&[1, 2], 2.0, click);
        say(&[1, 2], 3.0, click);
        assert_eq!(take_effects(&fingers), [(3.0, true, vec![1, 2])], "another finger, at its newest place");
        // A slider: the moves between two detents do not take their place, and of two detents that wait the newer one is played.
        let still = Feel { intensity_g: Some(0.0), ..Feel::default() };
        say(&[1], 4.0, still);
        say(&[1], 5.0, click);
        say(&[1], 6.0, still);
        say(&[1], 7.0, still);
        assert_eq!(take_effects(&fingers), [(5.0, true, vec![1]), (7.0, false, vec![1])]);
        for x_px in [8.0, 9.0] {
            say(&[1], x_px, click);
            say(&[1], x_px, still);
        }
        assert_eq!(take_effects(&fingers), [(9.0, true, vec![1]), (9.0, false, vec![1])]);
    }

    #[test]
    fn the_newest_finger_has_its_effect() {
        let fingers = PageFingers::default();
        let checked = |id: i64, effect: Option<NamedEffect>| {
            let finger = Finger { id, x_px: 0.0, y_px: 0.0, intensity_g: None, effect };
            CheckedFinger { finger, target: Target { x_m: 0.0, y_m: 0.0, intensity_g: None } }
        };
        let say = |down: &[CheckedFinger]| {
            let effect = fingers.choose_effect_of_newest_finger(down);
            let feel = Feel { effect, ..Feel::default() };
            fingers.queue_fingers_down_dropping_oldest_if_full(Touch::from_fingers(down, feel).unwrap(), 0).unwrap();
            take_effects(&fingers).pop().map(|(_, starts, ids)| (effect, starts, ids)).unwrap()
        };
        let (click, buzz) = (Some(NamedEffect::Click), Some(NamedEffect::Buzz));
        assert_eq!(say(&[checked(1, click)]), (click, true, vec![1]));
        assert_eq!(say(&[checked(1, click), checked(2, buzz)]), (buzz, true, vec![2]));
        assert_eq!(say(&[checked(1, click), checked(2, buzz)]), (buzz, false, vec![2]), "they move");
        assert_eq!(
            say(&[checked(1, click), checked(2, buzz), checked(3, click)]),
            (click, true, vec![1, 3]),
            "together"
        );
        assert_eq!(say(&[checked(4, None), checked(3, click)]), (click, false, vec![3]));
    }

    /// A page that asks for that: a tap that waits makes way for the next one.
    #[test]
    fn only_the_newest_tap_waits_where_a_page_asks_for_that() {
        let fingers = PageFingers::new(true);
        for x_px in [0.0, 1.0, 2.0] {
            fingers.queue_fingers_down_dropping_oldest_if_full(make_touch_at(&[1], x_px, Feel::default()), 0).unwrap();
            fingers.queue_fingers_down_dropping_oldest_if_full(Touch::without_fingers(), 0).unwrap();
        }
        assert_eq!(take_steps(&fingers), [(vec![1], true, 2.0)]);
    }
}
