//! Fingers that wait to be driven.

use super::*;
use crate::daemon::touch::request::RequestedHaptics;
use crate::planner::Target;

fn make_touch_at(ids: &[i64], x_px: f64, haptics: RequestedHaptics) -> Touch {
    let target = Target { x_m: 0.0, y_m: 0.0, intensity_g: None };
    let checked = |id: &i64| {
        let finger = Finger { id: *id, x_px, y_px: 0.0, intensity_g: None, effect: None };
        CheckedFinger { finger, target }
    };
    Touch::from_fingers(&ids.iter().map(checked).collect::<Vec<_>>(), haptics).unwrap()
}

/// Fingers that came, of each step that waits; whether it is a tap; and where its first finger is.
fn take_steps(fingers: &PageFingers) -> Vec<(Vec<i64>, bool, f64)> {
    let of = |step: FingerStep| {
        (step.newly_down, step.lifted || step.is_tap, step.touch.fingers.first().map_or(f64::NAN, |finger| finger.x_px))
    };
    std::iter::from_fn(|| fingers.lock_state().steps.pop_front()).map(of).collect()
}

#[test]
fn a_finger_that_comes_again_is_another_one() {
    let fingers = PageFingers::default();
    let say = |ids: &[i64], x_px| {
        fingers
            .queue_fingers_down_with_error_if_oldest_step_dropped(
                make_touch_at(ids, x_px, RequestedHaptics::default()),
                0,
            )
            .unwrap()
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
fn of_too_many_taps_the_oldest_are_dropped() {
    let fingers = PageFingers::default();
    let tap = |x_px: f64| {
        let result = fingers.queue_fingers_down_with_error_if_oldest_step_dropped(
            make_touch_at(&[1], x_px, RequestedHaptics::default()),
            0,
        );
        fingers.queue_fingers_down_with_error_if_oldest_step_dropped(Touch::without_fingers(), 0).unwrap();
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
    std::iter::from_fn(|| fingers.lock_state().steps.pop_front()).map(of).collect()
}

#[test]
fn an_effect_begins_with_its_finger_and_again_after_a_message_without_it() {
    let fingers = PageFingers::default();
    let click = RequestedHaptics { effect: Some(NamedEffect::Click), ..RequestedHaptics::default() };
    let say = |ids: &[i64], x_px, haptics| {
        fingers.queue_fingers_down_with_error_if_oldest_step_dropped(make_touch_at(ids, x_px, haptics), 0).unwrap()
    };
    say(&[1], 0.0, click);
    assert_eq!(take_effects(&fingers), [(0.0, true, vec![1])]);
    say(&[1], 1.0, click);
    assert_eq!(take_effects(&fingers), [(1.0, false, vec![1])], "its finger moves");
    say(&[1, 2], 2.0, click);
    say(&[1, 2], 3.0, click);
    assert_eq!(take_effects(&fingers), [(3.0, true, vec![1, 2])], "another finger, at its newest place");
    // A slider: the moves between two detents do not take their place, and of two detents that wait the newer one is played.
    let still = RequestedHaptics { intensity_g: Some(0.0), ..RequestedHaptics::default() };
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
        let effect = fingers.choose_effect_of_newest_finger_else_ongoing_else_first(down);
        let haptics = RequestedHaptics { effect, ..RequestedHaptics::default() };
        fingers
            .queue_fingers_down_with_error_if_oldest_step_dropped(Touch::from_fingers(down, haptics).unwrap(), 0)
            .unwrap();
        take_effects(&fingers).pop().map(|(_, starts, ids)| (effect, starts, ids)).unwrap()
    };
    let (click, buzz) = (Some(NamedEffect::Click), Some(NamedEffect::Buzz));
    assert_eq!(say(&[checked(1, click)]), (click, true, vec![1]));
    assert_eq!(say(&[checked(1, click), checked(2, buzz)]), (buzz, true, vec![2]));
    assert_eq!(say(&[checked(1, click), checked(2, buzz)]), (buzz, false, vec![2]), "they move");
    assert_eq!(say(&[checked(1, click), checked(2, buzz), checked(3, click)]), (click, true, vec![1, 3]), "together");
    assert_eq!(say(&[checked(4, None), checked(3, click)]), (click, false, vec![3]));
}

/// A page that asks for that: a tap that waits makes way for the next one.
#[test]
fn only_the_newest_tap_waits_where_a_page_asks_for_that() {
    let fingers = PageFingers::new(true);
    for x_px in [0.0, 1.0, 2.0] {
        fingers
            .queue_fingers_down_with_error_if_oldest_step_dropped(
                make_touch_at(&[1], x_px, RequestedHaptics::default()),
                0,
            )
            .unwrap();
        fingers.queue_fingers_down_with_error_if_oldest_step_dropped(Touch::without_fingers(), 0).unwrap();
    }
    assert_eq!(take_steps(&fingers), [(vec![1], true, 2.0)]);
}

/// A click of a control for finger 7 at this place.
fn queue_control_click_of_finger_7(fingers: &PageFingers, x_px: f64, is_press: bool) {
    let haptics = RequestedHaptics { effect: Some(NamedEffect::Click), ..RequestedHaptics::default() };
    fingers
        .queue_control_click_with_error_if_oldest_step_dropped(make_touch_at(&[7], x_px, haptics), vec![7], is_press, 0)
        .unwrap();
}

#[test]
fn of_clicks_of_controls_the_newest_waits_and_each_press() {
    let fingers = PageFingers::default();
    (0..3).for_each(|i| queue_control_click_of_finger_7(&fingers, f64::from(i), false));
    assert_eq!(take_effects(&fingers), [(2.0, true, vec![7])]);
    queue_control_click_of_finger_7(&fingers, 3.0, true);
    (4..6).for_each(|i| queue_control_click_of_finger_7(&fingers, f64::from(i), false));
    queue_control_click_of_finger_7(&fingers, 6.0, true);
    assert_eq!(take_effects(&fingers).iter().map(|it| it.0).collect::<Vec<_>>(), [3.0, 6.0]);
    // That the other fingers move, have an effect of the same kind already, or are lifted, takes no click away.
    for haptics in [
        RequestedHaptics::default(),
        RequestedHaptics { effect: Some(NamedEffect::Click), ..RequestedHaptics::default() },
    ] {
        for only_newest_tap in [false, true] {
            let fingers = PageFingers::new(only_newest_tap);
            let say = |ids: &[i64], x_px| {
                fingers
                    .queue_fingers_down_with_error_if_oldest_step_dropped(make_touch_at(ids, x_px, haptics), 0)
                    .unwrap()
            };
            say(&[1], 0.0);
            take_steps(&fingers);
            queue_control_click_of_finger_7(&fingers, 1.0, false);
            say(&[1], 2.0);
            say(&[1], 3.0);
            assert_eq!(take_steps(&fingers), [(vec![], false, 1.0), (vec![], false, 3.0)], "{haptics:?}");
            queue_control_click_of_finger_7(&fingers, 4.0, false);
            say(&[], 5.0);
            let steps: Vec<FingerStep> = fingers.lock_state().steps.drain(..).collect();
            assert_eq!(
                steps.iter().map(|step| (step.lifted, step.is_control_click)).collect::<Vec<_>>(),
                [(true, false), (false, true)]
            );
        }
    }
}

#[test]
fn only_a_newer_press_takes_the_place_of_a_press() {
    let fingers = PageFingers::new(true);
    queue_control_click_of_finger_7(&fingers, 0.0, true);
    queue_control_click_of_finger_7(&fingers, 1.0, true);
    queue_control_click_of_finger_7(&fingers, 2.0, false);
    queue_control_click_of_finger_7(&fingers, 3.0, false);
    assert_eq!(take_effects(&fingers).iter().map(|it| it.0).collect::<Vec<_>>(), [1.0, 3.0]);
}

#[test]
fn a_finger_that_comes_beside_a_click_of_a_control_is_felt() {
    let fingers = PageFingers::default();
    let say = |ids: &[i64], x_px| {
        fingers
            .queue_fingers_down_with_error_if_oldest_step_dropped(
                make_touch_at(ids, x_px, RequestedHaptics::default()),
                0,
            )
            .unwrap()
    };
    say(&[1], 0.0);
    queue_control_click_of_finger_7(&fingers, 1.0, false);
    say(&[], 2.0);
    assert_eq!(take_steps(&fingers), [(vec![1], true, 0.0), (vec![], false, 1.0)]);
    // What only moves makes way for a click, and is driven on after it.
    say(&[1], 3.0);
    take_steps(&fingers);
    say(&[1], 4.0);
    queue_control_click_of_finger_7(&fingers, 5.0, false);
    say(&[1], 6.0);
    assert_eq!(take_steps(&fingers), [(vec![], false, 5.0), (vec![], false, 6.0)]);
}

#[test]
fn a_texture_makes_no_tap() {
    let fingers = PageFingers::default();
    let say = |ids: &[i64], x_px, on_textures: &[i64]| {
        let touch = make_touch_at(ids, x_px, RequestedHaptics::default());
        fingers.queue_fingers_and_textures_with_error_if_oldest_step_dropped(touch, on_textures, 0).unwrap();
    };
    say(&[1], 0.0, &[1]);
    say(&[1], 1.0, &[1]);
    say(&[], 2.0, &[]);
    let steps: Vec<FingerStep> = fingers.lock_state().steps.drain(..).collect();
    assert!(steps.len() == 1 && steps[0].touch.fingers.is_empty(), "it has ended before it was driven: {steps:?}");
    say(&[1, 2], 3.0, &[1]);
    let steps: Vec<FingerStep> = fingers.lock_state().steps.drain(..).collect();
    assert_eq!((steps[0].newly_down.as_slice(), steps[0].is_texture), (&[2][..], false));
    fingers.lift_all_except_with_error_if_oldest_step_dropped(&[1], 0).unwrap();
    let steps: Vec<FingerStep> = fingers.lock_state().steps.drain(..).collect();
    assert!(steps[0].is_texture && steps[0].newly_down.is_empty(), "{steps:?}");
}
