//! Fingers on the controls of a page.

use super::*;
use crate::daemon::live::controls::declaration::{Rectangle, SliderAxis};
use crate::effects::NamedEffect;
use proptest::prelude::*;
use std::time::Duration;

const fn make_rectangle(x: f64, width: f64) -> Rectangle {
    Rectangle { x, y: 100.0, width, height: 100.0 }
}

fn make_control(shape: Shape) -> Control {
    Control { shape, intensity_g: 0.5, is_on: false }
}

fn make_finger(id: i64, x_px: f64) -> Finger {
    Finger { id, x_px, y_px: 150.0, intensity_g: None, effect: None }
}

/// The finger on a surface on which a pixel is a millimetre.
fn attach_target(finger: Finger) -> CheckedFinger {
    let Finger { x_px, y_px, intensity_g, .. } = finger;
    CheckedFinger { finger, target: Target { x_m: x_px / 1e3, y_m: y_px / 1e3, intensity_g } }
}

/// A page whose messages come every 16 ms.
struct Page {
    controls: PageControls,
    now: Instant,
    stops: u64,
}

impl Page {
    fn make_with_controls(shapes: &[Shape]) -> Self {
        let mut controls = PageControls::default();
        controls.replace_controls(shapes.iter().map(|shape| make_control(*shape)).collect());
        Self { controls, now: Instant::now(), stops: 0 }
    }

    fn move_fingers_after_16_ms(&mut self, fingers: &[Finger]) -> Felt {
        self.now += Duration::from_millis(16);
        let checked: Vec<CheckedFinger> = fingers.iter().map(|finger| attach_target(*finger)).collect();
        self.controls.update_fingers_lifting_absent(&checked, self.now, self.stops)
    }

    /// The click of a message with these fingers: its cause, and of each of its fingers the number and the peak.
    fn move_fingers_and_find_click_cause_and_peaks_g(
        &mut self,
        fingers: &[Finger],
    ) -> Option<(ClickCause, Vec<(i64, f64)>)> {
        let FeltClick { fingers, cause } = self.move_fingers_after_16_ms(fingers).click?;
        Some((
            cause,
            fingers
                .iter()
                .map(|CheckedFinger { finger, target }| {
                    assert_eq!(
                        (target.intensity_g, target.x_m),
                        (finger.intensity_g, finger.x_px / 1e3),
                        "the planner's is another"
                    );
                    (finger.id, finger.intensity_g.unwrap())
                })
                .collect(),
        ))
    }
}

#[test]
fn a_button_is_felt_when_it_is_pressed_and_released() {
    let mut page = Page::make_with_controls(&[Shape::Button(make_rectangle(100.0, 100.0))]);
    let (press, release) = (Some((ClickCause::Press, vec![(1, 0.5)])), Some((ClickCause::Release, vec![(1, 0.3)])));
    assert_eq!(page.move_fingers_and_find_click_cause_and_peaks_g(&[make_finger(1, 150.0)]), press);
    assert_eq!(page.move_fingers_and_find_click_cause_and_peaks_g(&[make_finger(1, 190.0)]), None);
    let felt = page.move_fingers_after_16_ms(&[]).click.unwrap();
    assert_eq!((felt.cause, felt.fingers[0].finger.x_px), (ClickCause::Release, 190.0), "where it was lifted");
    // One that has left the button feels nothing more, ...
    assert_eq!(page.move_fingers_and_find_click_cause_and_peaks_g(&[make_finger(1, 150.0)]), press);
    assert_eq!(
        (
            page.move_fingers_and_find_click_cause_and_peaks_g(&[make_finger(1, 250.0)]),
            page.move_fingers_and_find_click_cause_and_peaks_g(&[])
        ),
        (None, None)
    );
    // ... but if it is back when it is lifted.
    page.move_fingers_after_16_ms(&[make_finger(1, 150.0)]);
    page.move_fingers_after_16_ms(&[make_finger(1, 250.0)]);
    page.move_fingers_after_16_ms(&[make_finger(1, 199.0)]);
    assert_eq!(page.move_fingers_and_find_click_cause_and_peaks_g(&[]), release);
    // One that comes onto it from outside does not press it.
    assert_eq!(page.move_fingers_after_16_ms(&[make_finger(1, 50.0)]), Felt { outside: vec![1], ..Felt::default() });
    assert_eq!(page.move_fingers_after_16_ms(&[make_finger(1, 150.0)]), Felt { outside: vec![1], ..Felt::default() });
    assert_eq!(page.move_fingers_after_16_ms(&[]), Felt::default());
}

#[test]
fn a_control_without_strength_is_not_felt() {
    let mut page = Page::make_with_controls(&[]);
    page.controls.replace_controls(vec![Control {
        intensity_g: 0.0,
        ..make_control(Shape::Button(make_rectangle(100.0, 100.0)))
    }]);
    assert_eq!(
        (page.move_fingers_after_16_ms(&[make_finger(1, 150.0)]), page.move_fingers_after_16_ms(&[])),
        (Felt::default(), Felt::default())
    );
}

#[test]
fn a_toggle_changes_at_each_press() {
    let mut page = Page::make_with_controls(&[Shape::Toggle(make_rectangle(100.0, 100.0))]);
    let mut peaks = Vec::new();
    for _ in 0..4 {
        peaks.push(page.move_fingers_and_find_click_cause_and_peaks_g(&[make_finger(1, 150.0)]).unwrap().1[0].1);
        page.move_fingers_after_16_ms(&[]);
    }
    assert_eq!(peaks, [0.5, 0.3, 0.5, 0.3], "on, off, on, off");
    // What a page declares is its state from then on.
    page.controls
        .replace_controls(vec![Control { is_on: true, ..make_control(Shape::Toggle(make_rectangle(100.0, 100.0))) }]);
    assert_eq!(page.move_fingers_and_find_click_cause_and_peaks_g(&[make_finger(1, 150.0)]).unwrap().1, [(1, 0.3)]);
}

#[test]
fn the_last_control_of_the_list_is_on_top() {
    let slider = Shape::Slider { area: make_rectangle(100.0, 100.0), axis: SliderAxis::X, detents: 11 };
    let mut page = Page::make_with_controls(&[slider, Shape::Button(make_rectangle(150.0, 100.0))]);
    assert_eq!(
        page.move_fingers_and_find_click_cause_and_peaks_g(&[make_finger(1, 175.0)]).unwrap().0,
        ClickCause::Press
    );
    page.move_fingers_after_16_ms(&[]);
    // The finger belongs to the slider, also where the button is.
    assert_eq!(page.move_fingers_and_find_click_cause_and_peaks_g(&[make_finger(1, 125.0)]), None);
    assert_eq!(
        page.move_fingers_and_find_click_cause_and_peaks_g(&[make_finger(1, 180.0)]),
        Some((ClickCause::Move, vec![(1, 0.5)]))
    );
    assert_eq!(page.move_fingers_and_find_click_cause_and_peaks_g(&[]), None);
}

#[test]
fn an_edge_is_felt_by_all_fingers_that_are_on_nothing_else() {
    let mut page = Page::make_with_controls(&[
        Shape::Edge(make_rectangle(100.0, 100.0)),
        Shape::Edge(make_rectangle(200.0, 100.0)),
        Shape::Button(make_rectangle(280.0, 20.0)),
    ]);
    let crossed = Some((ClickCause::Move, vec![(1, 0.5)]));
    // One that came down outside is driven as without controls besides.
    assert_eq!(page.move_fingers_after_16_ms(&[make_finger(1, 50.0)]).outside, [1]);
    let felt = page.move_fingers_after_16_ms(&[make_finger(1, 120.0)]);
    assert!(felt.outside == [1] && felt.click.is_some(), "{felt:?}");
    // From one into the other: a common border is felt once.
    assert_eq!(page.move_fingers_and_find_click_cause_and_peaks_g(&[make_finger(1, 230.0)]), crossed);
    assert_eq!(
        page.move_fingers_and_find_click_cause_and_peaks_g(&[make_finger(1, 290.0)]),
        None,
        "a button that it did not come down on"
    );
    assert_eq!(page.move_fingers_and_find_click_cause_and_peaks_g(&[make_finger(1, 310.0)]), crossed);
    page.move_fingers_after_16_ms(&[]);
    // One that came down inside is not.
    assert_eq!(page.move_fingers_after_16_ms(&[make_finger(1, 150.0)]), Felt::default());
    assert_eq!(page.move_fingers_and_find_click_cause_and_peaks_g(&[make_finger(1, 50.0)]), crossed);
    page.move_fingers_after_16_ms(&[]);
    page.move_fingers_after_16_ms(&[make_finger(1, 290.0)]);
    assert_eq!(
        page.move_fingers_and_find_click_cause_and_peaks_g(&[make_finger(1, 150.0)]),
        None,
        "it belongs to the button"
    );
}

#[test]
fn a_texture_ends_when_its_finger_rests() {
    let mut page =
        Page::make_with_controls(&[Shape::Texture { area: make_rectangle(100.0, 300.0), speed_px_s: 500.0 }]);
    assert_eq!(
        (
            page.move_fingers_after_16_ms(&[make_finger(1, 110.0)]),
            page.controls.find_next_time_when_a_stroke_will_rest()
        ),
        (Felt::default(), None)
    );
    let peaks: Vec<f64> = (1..=20)
        .flat_map(|i| page.move_fingers_after_16_ms(&[make_finger(1, 110.0 + 4.0 * f64::from(i))]).textures)
        .map(|it| it.finger.intensity_g.unwrap())
        .collect();
    // 4 px in 16 ms are half of its speed.
    assert!(peaks.len() >= 19 && peaks.is_sorted() && (0.24..=0.25).contains(peaks.last().unwrap()), "{peaks:?}");
    let rests = page.controls.find_next_time_when_a_stroke_will_rest().unwrap();
    assert_eq!(rests - page.now, Duration::from_millis(50));
    assert_eq!(page.controls.update_felt_with_fingers_unmoved(rests, 0), Felt::default());
    assert_eq!(page.controls.find_next_time_when_a_stroke_will_rest(), None);
    // The messages of another finger do not keep it moving.
    page.now = rests;
    page.move_fingers_after_16_ms(&[make_finger(1, 200.0), make_finger(2, 900.0)]);
    for i in 1..=4 {
        page.move_fingers_after_16_ms(&[make_finger(1, 200.0), make_finger(2, 900.0 + f64::from(i))]);
    }
    assert_eq!(
        page.move_fingers_after_16_ms(&[make_finger(1, 200.0), make_finger(2, 900.0)]),
        Felt { outside: vec![2], ..Felt::default() }
    );
}

#[test]
fn a_finger_that_asks_for_something_itself_leaves_the_controls() {
    let slider = Shape::Slider { area: make_rectangle(100.0, 100.0), axis: SliderAxis::X, detents: 11 };
    let mut page = Page::make_with_controls(&[Shape::Button(make_rectangle(300.0, 100.0)), slider]);
    let outside = Felt { outside: vec![1], ..Felt::default() };
    let own = Finger { effect: Some(NamedEffect::Buzz), ..make_finger(1, 350.0) };
    assert_eq!(
        (
            page.move_fingers_after_16_ms(&[own]),
            page.move_fingers_after_16_ms(&[make_finger(1, 350.0)]),
            page.move_fingers_after_16_ms(&[])
        ),
        (outside, Felt { outside: vec![1], ..Felt::default() }, Felt::default())
    );
    page.move_fingers_after_16_ms(&[make_finger(1, 125.0)]);
    let felt = page.move_fingers_after_16_ms(&[Finger { intensity_g: Some(0.1), ..make_finger(1, 180.0) }]);
    assert_eq!(felt, Felt { outside: vec![1], ..Felt::default() });
    assert_eq!(page.move_fingers_after_16_ms(&[make_finger(1, 125.0)]).click, None, "until it is lifted");
    page.move_fingers_after_16_ms(&[]);
    page.move_fingers_after_16_ms(&[make_finger(1, 125.0)]);
    assert!(page.move_fingers_after_16_ms(&[make_finger(1, 180.0)]).click.is_some());
}

/// Also that which stops everything by a button: it is lifted then, and drives nothing.
#[test]
fn a_finger_that_is_down_at_a_stop_feels_nothing_more() {
    let mut page = Page::make_with_controls(&[
        Shape::Button(make_rectangle(100.0, 100.0)),
        Shape::Edge(make_rectangle(300.0, 100.0)),
    ]);
    page.move_fingers_after_16_ms(&[make_finger(1, 150.0), make_finger(2, 50.0), make_finger(3, 350.0)]);
    page.stops = 1;
    let felt = page.move_fingers_after_16_ms(&[
        make_finger(1, 150.0),
        make_finger(2, 50.0),
        make_finger(3, 500.0),
        make_finger(4, 150.0),
    ]);
    assert_eq!(
        (felt.outside.as_slice(), felt.click.unwrap().fingers[0].finger.id),
        (&[2][..], 4),
        "one that comes then is new"
    );
    let felt = page.move_fingers_after_16_ms(&[]);
    assert_eq!(felt.click.map(|click| click.fingers.len()), Some(1));
    assert!(page.move_fingers_and_find_click_cause_and_peaks_g(&[make_finger(1, 150.0)]).is_some());
}

#[test]
fn fingers_stay_on_controls_that_are_declared_again() {
    let slider = Shape::Slider { area: make_rectangle(100.0, 100.0), axis: SliderAxis::X, detents: 11 };
    let mut page = Page::make_with_controls(&[slider]);
    page.move_fingers_after_16_ms(&[make_finger(1, 125.0)]);
    page.controls.replace_controls(vec![
        make_control(Shape::Button(make_rectangle(100.0, 100.0))),
        Control { intensity_g: 0.2, ..make_control(slider) },
    ]);
    assert_eq!(
        page.move_fingers_and_find_click_cause_and_peaks_g(&[make_finger(1, 140.0)]),
        Some((ClickCause::Move, vec![(1, 0.2)]))
    );
    page.controls.replace_controls(Vec::new());
    assert_eq!(page.move_fingers_after_16_ms(&[make_finger(1, 180.0)]), Felt::default());
    page.controls.replace_controls(vec![make_control(slider)]);
    assert_eq!(page.move_fingers_after_16_ms(&[make_finger(1, 140.0)]), Felt::default(), "it was lifted from it");
    page.move_fingers_after_16_ms(&[]);
    assert_eq!(page.move_fingers_after_16_ms(&[make_finger(1, 125.0)]), Felt::default());
    assert!(page.move_fingers_after_16_ms(&[make_finger(1, 180.0)]).click.is_some());
}

#[test]
fn of_several_clicks_at_once_a_press_counts_first() {
    let slider = Shape::Slider { area: make_rectangle(300.0, 100.0), axis: SliderAxis::X, detents: 11 };
    let mut page = Page::make_with_controls(&[Shape::Button(make_rectangle(100.0, 100.0)), slider]);
    page.move_fingers_after_16_ms(&[make_finger(1, 150.0), make_finger(2, 325.0)]);
    assert_eq!(
        page.move_fingers_and_find_click_cause_and_peaks_g(&[make_finger(2, 380.0)]),
        Some((ClickCause::Move, vec![(2, 0.5)])),
        "and not the release"
    );
    let pressed = page.move_fingers_and_find_click_cause_and_peaks_g(&[
        make_finger(2, 325.0),
        make_finger(3, 110.0),
        make_finger(4, 190.0),
    ]);
    assert_eq!(pressed, Some((ClickCause::Press, vec![(3, 0.5), (4, 0.5)])));
    let felt = page.controls.lift_all_except(&[2], page.now, 0);
    assert_eq!(felt.click.map(|click| (click.cause, click.fingers.len())), Some((ClickCause::Release, 2)));
}

proptest! {
    /// Whatever fingers do: one feels a press only when it comes, and a release only after a press; without controls, none feels any.
    #[test]
    fn each_release_has_its_press(
        steps in prop::collection::vec((0..3_i64, 0.0..600.0, prop::bool::ANY), 1..80),
    ) {
        let shapes = [
            Shape::Button(make_rectangle(100.0, 100.0)),
            Shape::Toggle(make_rectangle(300.0, 100.0)),
            Shape::Edge(make_rectangle(50.0, 500.0)),
        ];
        let (mut page, mut plain) = (Page::make_with_controls(&shapes), Page::make_with_controls(&[]));
        let (mut down, mut pressed): (Vec<Finger>, Vec<i64>) = (Vec::new(), Vec::new());
        for (id, x, is_down) in steps {
            let is_new = down.iter().all(|known| known.id != id);
            down.retain(|known| known.id != id);
            if is_down {
                down.push(make_finger(id, x));
            }
            let felt = plain.move_fingers_after_16_ms(&down);
            prop_assert!(felt.click.is_none() && felt.textures.is_empty() && felt.outside.len() == down.len());
            let Some(FeltClick { fingers, cause }) = page.move_fingers_after_16_ms(&down).click else { continue };
            prop_assert_eq!(fingers.iter().map(|one| one.finger.id).collect::<Vec<_>>(), [id]);
            match cause {
                ClickCause::Press => {
                    prop_assert!(is_new && is_down);
                    pressed.push(id);
                }
                ClickCause::Move => prop_assert!(!is_new && is_down && !pressed.contains(&id)),
                ClickCause::Release => {
                    prop_assert!(!is_down && pressed.contains(&id));
                    pressed.retain(|other| *other != id);
                }
            }
            if !is_down {
                pressed.retain(|other| *other != id);
            }
        }
    }
}
