//! The fingers of one page: what they do, in order, and driving it.

use super::error_message;
use crate::daemon::access::client::{Asker, Client};
use crate::daemon::api::problem::Problem;
use crate::daemon::app::App;
use crate::daemon::drive::say_superseded;
use crate::daemon::touch::Touch;
use crate::daemon::touch::check::DriveMode;
use crate::daemon::touch::request::Finger;
use crate::daemon::touch::request::{Feel, MAX_DURATION_MS};
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
struct Step {
    /// Without fingers where those before are lifted.
    touch: Touch,
    lifted: bool,
    /// Fingers that have come since the step before, even if they had been there until shortly before.
    came: Vec<i64>,
    /// Whether it is driven though fingers have moved since: one that came in it has been lifted, others are still down.
    is_tap: bool,
    /// [`App::stops`] when it was said: a stop from then on means that it is not driven.
    stops: u64,
}

/// What a page's fingers have done and is not driven yet. Of fingers that move only the newest place counts; those that were
/// lifted stay, so that every tap is driven.
#[derive(Debug, Default)]
pub struct Fingers {
    steps: Mutex<VecDeque<Step>>,
    /// Those that are down by the last message.
    down: Mutex<Option<Touch>>,
    changed: Notify,
    gone: Mutex<bool>,
}

impl Fingers {
    /// All fingers that are down now, none if they are lifted.
    ///
    /// # Errors
    /// [`Problem`]: too many taps wait, of which the oldest is not driven any more.
    pub fn are(&self, touch: Touch, stops: u64) -> Result<(), Problem> {
        let mut dropped = None;
        let ids: Vec<i64> = touch.fingers.iter().map(|finger| finger.id).collect();
        let mut steps = self.steps();
        let before = self.down.lock().unwrap_or_else(PoisonError::into_inner).replace(touch.clone());
        let was_down = |id: &&i64| before.iter().flat_map(|touch| &touch.fingers).any(|finger| finger.id == **id);
        let mut came: Vec<i64> = ids.iter().filter(|id| !was_down(id)).copied().collect();
        if touch.fingers.is_empty() {
            match steps.back_mut() {
                Some(last) if !last.lifted => last.lifted = true,
                Some(_) => {}
                None => steps.push_back(Step { touch, lifted: true, came, is_tap: false, stops }),
            }
        } else {
            if let Some(last) = steps.back_mut().filter(|last| !last.lifted) {
                last.is_tap |= last.came.iter().any(|id| !ids.contains(id));
            }
            // A device slower than the page skips what came in between.
            if steps.back().is_some_and(|last| !last.lifted && !last.is_tap)
                && let Some(skipped) = steps.pop_back()
            {
                came.extend(skipped.came.into_iter().filter(|id| ids.contains(id)));
            }
            if steps.len() >= MOST_STEPS {
                dropped = steps.pop_front().filter(|step| !step.touch.fingers.is_empty());
            }
            steps.push_back(Step { touch, lifted: false, came, is_tap: false, stops });
        }
        drop(steps);
        self.changed.notify_one();
        dropped.map_or(Ok(()), |_| Err(say_superseded()))
    }

    /// The fingers that are down by the last message.
    pub fn ids_down(&self) -> Vec<i64> {
        let down = self.down.lock().unwrap_or_else(PoisonError::into_inner);
        down.iter().flat_map(|touch| &touch.fingers).map(|finger| finger.id).collect()
    }

    /// All but these are lifted; those of them that are down stay as they were.
    ///
    /// # Errors
    /// As [`Self::are`].
    pub fn keep_only(&self, ids: &[i64], stops: u64) -> Result<(), Problem> {
        let Some(before) = self.down.lock().unwrap_or_else(PoisonError::into_inner).clone() else { return Ok(()) };
        let count = before.fingers.len();
        let kept = before.with_only(ids);
        if kept.fingers.len() == count { Ok(()) } else { self.are(kept, stops) }
    }

    fn are_lifted(&self) {
        // What is lifted takes nobody's place.
        let _ = self.are(Touch::without_fingers(), 0);
    }

    /// Whatever they have done is not wanted any more.
    pub fn forget(&self) {
        self.steps().clear();
        self.are_lifted();
    }

    /// The page has gone away: its fingers are lifted.
    pub fn go(&self) {
        self.are_lifted();
        *self.gone.lock().unwrap_or_else(PoisonError::into_inner) = true;
        self.changed.notify_one();
    }

    /// The next step, once it is `due`; `None` once the page is gone and all is done.
    async fn next(&self, due: impl Fn(&Step) -> Option<Instant>) -> Option<Step> {
        loop {
            let changed = self.changed.notified();
            let waits = self.steps().front().map(|step| due(step).filter(|due| Instant::now() < *due));
            match waits {
                // Looked at again then: a stop may have taken it away.
                Some(Some(due)) => {
                    tokio::select! {
                        () = changed => {}
                        () = tokio::time::sleep_until(due.into()) => {}
                    }
                    continue;
                }
                Some(None) => {
                    if let Some(step) = self.steps().pop_front() {
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

    /// Whether fingers have moved or come that stand in place of those that are being driven: a tap is never replaced.
    fn is_replaced(&self) -> bool {
        self.steps().front().is_some_and(|step| !step.touch.fingers.is_empty())
    }

    fn steps(&self) -> MutexGuard<'_, VecDeque<Step>> {
        self.steps.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// Drives what the fingers ask for until the page is gone.
pub async fn drive(app: Arc<App>, client: Client, fingers: Arc<Fingers>, replies: mpsc::Sender<Value>) {
    let mut hand = Hand { client, ..Hand::default() };
    loop {
        let step = tokio::select! {
            step = fingers.next(|step| hand.due(step)) => step,
            () = tokio::time::sleep(RENEW), if hand.still.is_some() => {
                hand.renew(&app, &fingers, &replies).await;
                continue;
            }
        };
        let Some(step) = step else { return };
        let lifted = step.lifted;
        hand.keep(&step.touch.fingers);
        if !step.touch.fingers.is_empty()
            && !hand.has_played(&step)
            && let Err(problem) = hand.drive(&app, &fingers, step.clone()).await
        {
            // The page reads nothing: it has missed older news than this.
            let _ = replies.try_send(error_message(&problem));
            hand.end_lifted(&app, &step.touch.fingers);
        }
        if lifted {
            hand.lift(&app);
        }
    }
}

/// The fingers that are down, and what is driven for them.
#[derive(Debug, Default)]
struct Hand {
    client: Client,
    down: Vec<i64>,
    feel: Feel,
    /// The even drive, and since when its fingers are down.
    held: Option<(Instant, u64)>,
    /// The fingers that it is for.
    held_for: Vec<i64>,
    /// What it was driven for, if that goes on for as long as they are.
    still: Option<Step>,
    /// [`App::breaks`] when that began.
    breaks: u64,
    /// Since when the newest of the fingers is felt for which something was driven last.
    came: Option<Instant>,
}

impl Hand {
    /// When a step may be driven: not before a finger that is lifted by then has been felt for a while.
    fn due(&self, step: &Step) -> Option<Instant> {
        let is_down = |id: &i64| step.touch.fingers.iter().any(|finger| finger.id == *id) && !step.came.contains(id);
        let goes_on = step.touch.fingers.is_empty() || (!self.down.is_empty() && self.down.iter().all(is_down));
        self.came.filter(|_| !goes_on).map(|came| came + LEAST)
    }

    /// Whether an effect has been played for all of these fingers: it is not begun again by one that moves.
    fn has_played(&self, step: &Step) -> bool {
        let Step { touch: Touch { fingers, feel, .. }, came, .. } = step;
        let is_known = |finger: &Finger| self.down.contains(&finger.id) && !came.contains(&finger.id);
        feel.effect.is_some() && self.feel == *feel && fingers.iter().all(is_known)
    }

    /// Fingers that rest are felt for as long as they are down: their drive is given more time, and begun again where it was
    /// ended by a touch of somebody else's that is over, or by the board. Not after a stop, nor once the board has gone off.
    async fn renew(&mut self, app: &Arc<App>, fingers: &Fingers, replies: &mpsc::Sender<Value>) {
        let Some((step, (_, plan))) = self.still.clone().zip(self.held) else { return };
        let until = Instant::now() + Duration::from_millis(u64::from(MAX_DURATION_MS));
        if app.driver.stops() != step.stops || app.driver.breaks() != self.breaks || app.driver.is_off() {
            self.still = None;
        } else if !app.driver.renew(plan, until).await
            && app.driver.active().is_none()
            // What is being planned is somebody's touch, and would be older than this.
            && app.driver.admission.is_idle()
            && let Err(problem) = self.drive(app, fingers, step).await
            && !["busy", "superseded", "device-refused"].iter().any(|kind| problem.is(kind))
        {
            self.still = None;
            let _ = replies.try_send(error_message(&problem));
        }
    }

    /// Forgets fingers that are not down any more: when they come again, their effect does.
    fn keep(&mut self, touches: &[Finger]) {
        self.down.retain(|id| touches.iter().any(|touch| touch.id == *id));
    }

    async fn drive(&mut self, app: &Arc<App>, fingers: &Fingers, step: Step) -> Result<(), Problem> {
        let is_even = step.touch.feel.effect.is_none() && step.touch.feel.duration_ms.is_none();
        let again = (is_even && !step.lifted).then(|| Step { came: Vec::new(), is_tap: false, ..step.clone() });
        let Step { touch, lifted, came, is_tap, stops } = step;
        let is_tap = lifted || is_tap;
        let ids = touch.fingers.iter().map(|finger| finger.id).collect();
        let asker = Asker { client: self.client, ..Asker::default() };
        let (id, breaks) = (app.driver.admission.number(), app.driver.breaks());
        let mut driving = std::pin::pin!(app.driver.drive_touch(&asker, id, stops, &touch));
        // To its end in any case, but without waiting for its turn once newer fingers stand in its place.
        let done = loop {
            tokio::select! {
                done = &mut driving => break done,
                () = tokio::time::sleep(AGAIN), if !is_tap => {}
            }
            if fingers.is_replaced() {
                app.driver.withdraw(id);
            }
        };
        app.note("outcome", || match &done {
            Ok(done) => json!({
                "id": id, "status": 200, "plan": done.active.plan, "device": done.device,
            }),
            Err(problem) => json!({"id": id, "status": problem.status().as_u16(), "problem": problem}),
        });
        match done {
            Ok(done) => {
                self.held_for.clone_from(&ids);
                (self.down, self.feel, self.still, self.breaks) = (ids, touch.feel, again, breaks);
                if !came.is_empty() {
                    self.came = Some(Instant::now());
                }
                self.held = match touch.mode {
                    // An effect ends by itself, whatever the fingers do meanwhile.
                    DriveMode::Effect(_) => None,
                    DriveMode::Hold(_) => {
                        Some((self.held.map_or_else(Instant::now, |(since, _)| since), done.active.id))
                    }
                };
                Ok(())
            }
            // The page itself has asked for something newer.
            Err(problem) if problem.is("superseded") && fingers.is_replaced() => Ok(()),
            Err(problem) => Err(problem),
        }
    }

    /// Ends the drive that is held if one of its fingers is not among these any more: what was to take its place has not, and a finger that is
    /// lifted must not vibrate on.
    fn end_lifted(&mut self, app: &App, touches: &[Finger]) {
        let is_down = |id: &i64| touches.iter().any(|touch| touch.id == *id);
        if !self.held_for.iter().all(is_down) {
            self.still = None;
            if let Some((since, plan)) = self.held.take() {
                app.driver.release(plan, since + TAP);
            }
        }
    }

    fn lift(&mut self, app: &App) {
        self.down.clear();
        self.still = None;
        if let Some((since, plan)) = self.held.take() {
            app.driver.release(plan, since + TAP);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::daemon::touch::check::CheckedFinger;
    use crate::effects::NamedEffect;
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
    fn steps(fingers: &Fingers) -> Vec<(Vec<i64>, bool, f64)> {
        let of = |step: Step| {
            (step.came, step.lifted || step.is_tap, step.touch.fingers.first().map_or(f64::NAN, |finger| finger.x_px))
        };
        std::iter::from_fn(|| fingers.steps().pop_front()).map(of).collect()
    }

    #[test]
    fn a_finger_that_comes_again_is_another_one() {
        let fingers = Fingers::default();
        let say = |ids: &[i64], x_px| fingers.are(make_touch_at(ids, x_px, Feel::default()), 0).unwrap();
        say(&[1], 0.0);
        say(&[1, 2], 1.0);
        assert_eq!(steps(&fingers), [(vec![2, 1], false, 1.0)]);
        // Lifted and back before anything is driven.
        say(&[1], 2.0);
        say(&[1, 2], 3.0);
        say(&[1, 2], 4.0);
        assert_eq!(steps(&fingers), [(vec![2], false, 4.0)]);
        // A tap beside a finger that stays; the newest place of what follows.
        say(&[1, 2, 3], 5.0);
        say(&[1, 2], 6.0);
        say(&[1, 2], 7.0);
        assert_eq!(steps(&fingers), [(vec![3], true, 5.0), (vec![], false, 7.0)]);
    }

    /// So many that nobody can have made them: the newest are driven, and the page is told of the others.
    #[test]
    fn of_too_many_taps_the_oldest_make_way() {
        let fingers = Fingers::default();
        let tap = |x_px: f64| {
            let result = fingers.are(make_touch_at(&[1], x_px, Feel::default()), 0);
            fingers.are(Touch::without_fingers(), 0).unwrap();
            result.is_ok()
        };
        let most = f64::from(u8::try_from(MOST_STEPS).unwrap());
        for i in 0..MOST_STEPS {
            assert!(tap(f64::from(u8::try_from(i).unwrap())));
        }
        assert!(!tap(most));
        let left = steps(&fingers);
        assert_eq!((left.len(), left[0].2, left[MOST_STEPS - 1].2), (MOST_STEPS, 1.0, most));
        assert!(left.iter().all(|(_, is_tap, _)| *is_tap));
    }

    #[test]
    fn an_effect_is_played_again_for_a_finger_that_comes_again() {
        let feel = Feel { effect: Some(NamedEffect::Click), ..Feel::default() };
        let hand = Hand { down: vec![1, 2], feel, ..Hand::default() };
        let step = |came: &[i64]| Step {
            touch: make_touch_at(&[1, 2], 0.0, feel),
            lifted: false,
            came: came.to_vec(),
            is_tap: false,
            stops: 0,
        };
        assert!(hand.has_played(&step(&[])));
        assert!(!hand.has_played(&step(&[2])));
    }
}
