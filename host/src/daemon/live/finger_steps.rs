//! What the fingers of one page have done and is not driven yet, in order.

use crate::daemon::api::problem::Problem;
use crate::daemon::drive::superseded_problem;
use crate::daemon::touch::Touch;
use crate::daemon::touch::check::CheckedFinger;
use crate::daemon::touch::request::Finger;
use crate::effects::NamedEffect;
use std::collections::VecDeque;
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::Instant;
use tokio::sync::Notify;

/// Most taps that wait to be driven: the last of them for some 1.3 s. More than ten fingers make at once.
const MOST_STEPS: usize = 32;

/// Fingers that went down or moved, and whether they have been lifted since.
#[derive(Clone, Debug)]
pub struct FingerStep {
    /// Without fingers where those before are lifted.
    pub touch: Touch,
    /// Whether all fingers have been lifted since.
    pub lifted: bool,
    /// Fingers that have come since the step before, even if they had been there until shortly before.
    pub newly_down: Vec<i64>,
    /// Whether it is driven though fingers have moved since: one that came in it has been lifted, others are still down.
    pub is_tap: bool,
    /// Whether its effect begins with it; if not, it has been begun by an earlier message, of which this one only moves the fingers.
    pub starts_effect: bool,
    /// The fingers that its effect is for.
    pub effect_fingers: Vec<i64>,
    /// Whether it is a click of a control: what follows it does not end it, and does not lift it.
    pub is_control_click: bool,
    /// Whether all of its fingers are on textures, which end as soon as they rest, and not after the least time of a tap.
    pub is_texture: bool,
    /// [`TouchDriver::stop_count`](crate::daemon::drive::TouchDriver::stop_count) when it was said: a stop from then on means that it is not driven.
    pub stops: u64,
}

/// What a page's fingers have done and is not driven yet. Of fingers that move only the newest place counts; those that were
/// lifted stay, so that every tap is driven.
#[derive(Debug, Default)]
pub struct PageFingers {
    state: Mutex<PageFingersState>,
    changed: Notify,
    /// Whether a tap that waits makes way for any newer one.
    only_newest_tap: bool,
}

#[derive(Debug, Default)]
struct PageFingersState {
    /// Those that wait to be driven.
    steps: VecDeque<FingerStep>,
    /// The fingers that are down by the last message, without those on controls that do not vibrate.
    down: Option<Touch>,
    /// Those of them that are on textures.
    on_textures: Vec<i64>,
    is_page_gone: bool,
}

impl FingerStep {
    /// Whether `newer` stands in its place. A tap is driven in any case. An effect is replaced by one that begins later, so that the detents of
    /// a fast finger do not queue; fingers that only move do not replace it.
    fn makes_way_for(&self, newer: &Self) -> bool {
        let is_replaced = newer.starts_effect || !self.is_control_click && newer.touch.haptics == self.touch.haptics;
        !self.lifted && !self.is_tap && (!self.starts_effect || is_replaced)
    }

    /// Whether its fingers have only moved, or stayed.
    pub fn is_only_move(&self) -> bool {
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
    pub fn choose_effect_of_newest_finger_else_ongoing_else_first(
        &self,
        fingers: &[CheckedFinger],
    ) -> Option<NamedEffect> {
        let state = self.lock_state();
        let before = &state.down;
        let had = |checked: &CheckedFinger| {
            let mut before = before.iter().flat_map(|touch| &touch.fingers);
            before.any(|finger| (finger.id, finger.effect) == (checked.finger.id, checked.finger.effect))
        };
        let newest = fingers.iter().rfind(|checked| checked.finger.effect.is_some() && !had(checked));
        let last = before.as_ref().and_then(|touch| touch.haptics.effect);
        let going_on =
            || fingers.iter().find(|checked| checked.finger.effect.is_some() && checked.finger.effect == last);
        let first = || fingers.iter().find(|checked| checked.finger.effect.is_some());
        newest.or_else(going_on).or_else(first)?.finger.effect
    }

    /// All fingers that are down now, none if they are lifted.
    ///
    /// # Errors
    /// [`Problem`]: too many taps wait, of which the oldest is not driven any more.
    pub fn queue_fingers_down_with_error_if_oldest_step_dropped(
        &self,
        touch: Touch,
        stop_count_at_arrival: u64,
    ) -> Result<(), Problem> {
        self.queue_fingers_and_textures_with_error_if_oldest_step_dropped(touch, &[], stop_count_at_arrival)
    }

    /// The same, with some of the fingers on textures: a finger that begins to vibrate there has not come down, and makes no tap.
    ///
    /// # Errors
    /// As [`Self::queue_fingers_down_with_error_if_oldest_step_dropped`].
    pub fn queue_fingers_and_textures_with_error_if_oldest_step_dropped(
        &self,
        touch: Touch,
        on_textures: &[i64],
        stop_count_at_arrival: u64,
    ) -> Result<(), Problem> {
        let mut dropped = Ok(());
        let ids: Vec<i64> = touch.fingers.iter().map(|finger| finger.id).collect();
        let mut state = self.lock_state();
        on_textures.clone_into(&mut state.on_textures);
        let before = state.down.replace(touch.clone());
        let steps = &mut state.steps;
        let was_down = |id: &&i64| before.iter().flat_map(|touch| &touch.fingers).any(|finger| finger.id == **id);
        let newly_down: Vec<i64> =
            ids.iter().filter(|id| !was_down(id) && !on_textures.contains(id)).copied().collect();
        // A message without an effect in between, or another effect, and a held finger feels it again.
        let feels_other = before.as_ref().is_none_or(|before| before.haptics != touch.haptics);
        let is_own_effect = touch.fingers.iter().any(|finger| finger.effect == touch.haptics.effect);
        let plays = |finger: &&Finger| !is_own_effect || finger.effect == touch.haptics.effect;
        let effect_fingers: Vec<i64> = touch.fingers.iter().filter(plays).map(|finger| finger.id).collect();
        let is_new_effect_finger = newly_down.iter().any(|id| effect_fingers.contains(id));
        let starts_effect = touch.haptics.effect.is_some() && (feels_other || is_new_effect_finger);
        let mut step = FingerStep {
            lifted: touch.fingers.is_empty(),
            touch,
            newly_down,
            is_tap: false,
            starts_effect,
            effect_fingers,
            is_control_click: false,
            is_texture: !ids.is_empty() && ids.iter().all(|id| on_textures.contains(id)),
            stops: stop_count_at_arrival,
        };
        let last = steps.iter_mut().rfind(|waiting| !waiting.is_control_click);
        if step.touch.fingers.is_empty() {
            match last {
                // What has ended before it was driven is not felt at all.
                Some(last) if last.is_texture => *last = step,
                Some(last) if !last.lifted => last.lifted = true,
                Some(_) => {}
                // Clicks of controls that wait come after the end of what they take the place of.
                None => steps.push_front(step),
            }
        } else {
            if let Some(last) = last.filter(|last| !last.lifted) {
                last.is_tap |= last.newly_down.iter().any(|id| !ids.contains(id));
            }
            // A device slower than the page skips what came in between.
            while let Some(skipped) = steps.pop_back_if(|last| self.skips(last, &step)) {
                let come =
                    skipped.newly_down.into_iter().filter(|id| ids.contains(id) && !step.newly_down.contains(id));
                let come: Vec<i64> = come.collect();
                step.newly_down.extend(come);
                step.starts_effect |= skipped.starts_effect && skipped.touch.haptics == step.touch.haptics;
            }
            dropped = push_step_with_error_if_oldest_step_dropped(steps, step);
        }
        drop(state);
        self.changed.notify_one();
        dropped
    }

    /// A click of controls for the fingers of `touch` that have these numbers; its other fingers are driven on after it. One that `is_press` is
    /// played in any case; of the others that wait, the newest.
    ///
    /// # Errors
    /// As [`Self::queue_fingers_down_with_error_if_oldest_step_dropped`].
    pub fn queue_control_click_with_error_if_oldest_step_dropped(
        &self,
        touch: Touch,
        ids: Vec<i64>,
        is_press: bool,
        stop_count_at_arrival: u64,
    ) -> Result<(), Problem> {
        let step = FingerStep {
            touch,
            lifted: false,
            newly_down: Vec::new(),
            is_tap: is_press,
            starts_effect: true,
            effect_fingers: ids,
            is_control_click: true,
            is_texture: false,
            stops: stop_count_at_arrival,
        };
        let mut state = self.lock_state();
        let steps = &mut state.steps;
        // Fingers outside of the controls that have just come are felt first.
        let has_come = |last: &FingerStep| !last.starts_effect && !last.lifted && !last.newly_down.is_empty();
        while steps.pop_back_if(|last| self.skips(last, &step) && !has_come(last)).is_some() {}
        let dropped = push_step_with_error_if_oldest_step_dropped(steps, step);
        drop(state);
        self.changed.notify_one();
        dropped
    }

    /// Whether a step that waits is not driven any more once there is a newer one.
    fn skips(&self, waiting: &FingerStep, newer: &FingerStep) -> bool {
        // Neither a click of a control that is no press, nor fingers that move beside one, are a newer tap.
        let is_no_tap = newer.is_control_click && !newer.is_tap || waiting.is_control_click && newer.is_only_move();
        self.only_newest_tap && !is_no_tap || waiting.makes_way_for(newer)
    }

    /// The fingers that are down by the last message.
    pub fn list_ids_of_fingers_down(&self) -> Vec<i64> {
        self.lock_state().down.iter().flat_map(|touch| &touch.fingers).map(|finger| finger.id).collect()
    }

    /// All but these are lifted; those of them that are down stay as they were.
    ///
    /// # Errors
    /// As [`Self::queue_fingers_down_with_error_if_oldest_step_dropped`].
    pub fn lift_all_except_with_error_if_oldest_step_dropped(
        &self,
        ids: &[i64],
        stop_count_at_arrival: u64,
    ) -> Result<(), Problem> {
        let (down, on_textures) = {
            let state = self.lock_state();
            (state.down.clone(), state.on_textures.clone())
        };
        let Some(before) = down else { return Ok(()) };
        let count = before.fingers.len();
        let kept = before.keep_only_fingers(ids);
        if kept.fingers.len() == count {
            Ok(())
        } else {
            self.queue_fingers_and_textures_with_error_if_oldest_step_dropped(kept, &on_textures, stop_count_at_arrival)
        }
    }

    fn lift_all_fingers(&self) {
        // What is lifted takes nobody's place.
        let _ = self.queue_fingers_down_with_error_if_oldest_step_dropped(Touch::without_fingers(), 0);
    }

    /// Whatever they have done is not wanted any more.
    pub fn discard_steps_and_lift_all(&self) {
        self.lock_state().steps.clear();
        self.lift_all_fingers();
    }

    /// The page has gone away: its fingers are lifted.
    pub fn lift_all_as_page_is_gone(&self) {
        self.lift_all_fingers();
        self.lock_state().is_page_gone = true;
        self.changed.notify_one();
    }

    /// The next step, once it is `find_earliest_drive_time_or_none_if_now`; `None` once the page is gone and all is done.
    pub async fn wait_for_oldest_due_step(
        &self,
        find_earliest_drive_time_or_none_if_now: impl Fn(&FingerStep) -> Option<Instant>,
    ) -> Option<FingerStep> {
        loop {
            let changed = self.changed.notified();
            let waits = self
                .lock_state()
                .steps
                .front()
                .map(|step| find_earliest_drive_time_or_none_if_now(step).filter(|due| Instant::now() < *due));
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
                    if let Some(step) = self.lock_state().steps.pop_front() {
                        return Some(step);
                    }
                }
                None => {}
            }
            if self.lock_state().is_page_gone {
                return None;
            }
            changed.await;
        }
    }

    /// Whether fingers have moved or come that stand in place of `driven`.
    pub fn has_step_in_place_of(&self, driven: &FingerStep) -> bool {
        let is_in_place =
            |step: &FingerStep| driven.makes_way_for(step) && (step.starts_effect || !driven.starts_effect);
        self.lock_state().steps.front().is_some_and(|step| !step.touch.fingers.is_empty() && is_in_place(step))
    }

    fn lock_state(&self) -> MutexGuard<'_, PageFingersState> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

fn push_step_with_error_if_oldest_step_dropped(
    steps: &mut VecDeque<FingerStep>,
    step: FingerStep,
) -> Result<(), Problem> {
    let oldest = if steps.len() >= MOST_STEPS { steps.pop_front() } else { None };
    steps.push_back(step);
    match oldest {
        Some(oldest) if !oldest.touch.fingers.is_empty() => Err(superseded_problem()),
        _ => Ok(()),
    }
}

#[cfg(test)]
mod tests;
