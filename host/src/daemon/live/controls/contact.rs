//! What one finger feels of the control in which it came down.

use super::declaration::{Control, Rectangle, Shape, SliderAxis};
use super::detents::DetentTracker;
use super::speed::SpeedTracker;
use std::f64::consts::TAU;
use std::time::Instant;

/// Strength of what is felt when a finger is lifted, of that when it came down: that of the primitive `release` of effect files.
const RELEASE_FRACTION: f64 = 0.6;
/// Strength of a toggle that is switched off, of that of one that is switched on: the least difference that is told apart at once is some 20 %.
const SWITCH_OFF_INTENSITY_FRACTION: f64 = 0.6;
/// How far inside of a slider's ends its first and its last detent are, in px: a screen of 1920 px has no finger at 1920.
const INSET_PX: f64 = 2.0;
/// The same at most, as a part of the distance between two detents.
const INSET_FRACTION: f64 = 0.125;
/// How far behind its last detent a finger behind the end of a slider is taken to be, in steps: less than the hysteresis.
const BEHIND_END: f64 = 0.01;
/// Within this part of a dial's radius a finger has no angle that means anything.
const HUB_FRACTION: f64 = 0.15;
/// How far from the border of an edge a finger must be before it can cross the border again, in px: more than a resting finger trembles.
const EDGE_HYSTERESIS_PX: f64 = 4.0;
/// Part of its speed for the full intensity below which a texture is not felt: a vibration as weak as this is not worth a drive.
const MIN_TEXTURE_FRACTION: f64 = 0.05;

/// A finger on a control, from when it came down until it is lifted.
#[derive(Clone, Debug, PartialEq)]
pub struct Contact {
    /// The control.
    pub control: Control,
    track: Track,
}

#[derive(Clone, Debug, PartialEq)]
enum Track {
    /// With the strength of the press.
    Press {
        intensity_g: f64,
    },
    Slide(DetentTracker),
    /// With the position in detents, which goes on from turn to turn, and the angle in rad; without angle in the hub.
    Turn {
        tracker: Option<DetentTracker>,
        position: f64,
        angle: Option<f64>,
    },
    Stroke(SpeedTracker),
}

impl Contact {
    /// A finger that comes down on a control; a toggle is in its new state. `None` for an edge, which is felt by fingers on no control as well
    /// ([`EdgeTracker`]).
    #[must_use]
    pub fn new(control: Control, x: f64, y: f64, now: Instant) -> Option<Self> {
        let track = match control.shape {
            Shape::Button(_) => Track::Press { intensity_g: control.intensity_g },
            Shape::Toggle(_) => {
                let part = if control.is_on { 1.0 } else { SWITCH_OFF_INTENSITY_FRACTION };
                Track::Press { intensity_g: part * control.intensity_g }
            }
            Shape::Slider { area, axis, detents } => {
                Track::Slide(DetentTracker::new(find_slider_position_in_detents(&area, axis, detents, x, y)))
            }
            Shape::Dial { .. } => {
                let mut turn = Track::Turn { tracker: None, position: 0.0, angle: None };
                turn.turn_dial_and_check_if_detent_passed(&control.shape, x, y);
                turn
            }
            Shape::Texture { .. } => Track::Stroke(SpeedTracker::new(x, y, now)),
            Shape::Edge(_) => return None,
        };
        Some(Self { control, track })
    }

    /// What is felt when it comes down, in g.
    #[must_use]
    pub const fn find_press_click_g_if_button_or_toggle(&self) -> Option<f64> {
        match self.track {
            Track::Press { intensity_g } => Some(intensity_g),
            _ => None,
        }
    }

    /// What is felt when it is lifted at a place, in g.
    #[must_use]
    pub fn find_release_click_g_if_button_or_toggle_and_still_on_it(&self, x: f64, y: f64) -> Option<f64> {
        self.find_press_click_g_if_button_or_toggle()
            .filter(|_| self.control.contains(x, y))
            .map(|intensity_g| RELEASE_FRACTION * intensity_g)
    }

    /// Moves on; the peak in g of the click that it feels, if it passes a detent.
    pub fn move_finger_and_find_click_g_if_detent_passed(&mut self, x: f64, y: f64, now: Instant) -> Option<f64> {
        let passes = match (&mut self.track, &self.control.shape) {
            (Track::Slide(tracker), Shape::Slider { area, axis, detents }) => {
                let ends = Some([0.0, f64::from(detents - 1)]);
                tracker.move_to_position_and_check_if_detent_passed(
                    find_slider_position_in_detents(area, *axis, *detents, x, y),
                    ends,
                )
            }
            (turn @ Track::Turn { .. }, shape) => turn.turn_dial_and_check_if_detent_passed(shape, x, y),
            (Track::Stroke(tracker), _) => {
                tracker.move_finger(x, y, now);
                false
            }
            _ => false,
        };
        passes.then_some(self.control.intensity_g)
    }

    /// How strongly a texture vibrates under it at a place, in g; `None` where it does not.
    #[must_use]
    pub fn find_texture_g_at_present_speed_if_felt(&self, x: f64, y: f64) -> Option<f64> {
        let (Track::Stroke(tracker), Shape::Texture { speed_px_s, .. }) = (&self.track, self.control.shape) else {
            return None;
        };
        let part = (tracker.speed_px_s() / speed_px_s).min(1.0);
        let is_felt = part >= MIN_TEXTURE_FRACTION && self.control.contains(x, y) && self.control.intensity_g > 0.0;
        is_felt.then_some(part * self.control.intensity_g)
    }

    /// From when on a finger on a texture rests, if it does not move before; `None` if it rests.
    #[must_use]
    pub fn find_time_when_moving_stroke_will_rest(&self) -> Option<Instant> {
        match &self.track {
            Track::Stroke(tracker) if tracker.speed_px_s() > 0.0 => {
                Some(tracker.find_time_when_moving_stroke_will_rest())
            }
            _ => None,
        }
    }
}

impl Track {
    fn turn_dial_and_check_if_detent_passed(&mut self, shape: &Shape, x: f64, y: f64) -> bool {
        let (Self::Turn { tracker, position, angle }, Shape::Dial { x_px, y_px, radius_px, detents }) = (self, shape)
        else {
            return false;
        };
        let (dx, dy) = (x - x_px, y - y_px);
        if dx.hypot(dy) < HUB_FRACTION * radius_px {
            // The angle at which it comes out again is a new one.
            (*tracker, *angle) = (None, None);
            return false;
        }
        let (now, per_rad) = (dy.atan2(dx), f64::from(*detents) / TAU);
        // By the shorter way round.
        let turned = angle.map_or(0.0, |before| (now - before + TAU / 2.0).rem_euclid(TAU) - TAU / 2.0);
        *position = if angle.is_some() { *position + turned * per_rad } else { now * per_rad };
        *angle = Some(now);
        tracker
            .get_or_insert_with(|| DetentTracker::new(*position))
            .move_to_position_and_check_if_detent_passed(*position, None)
    }
}

/// Where a finger is along a slider: 0 at the first detent, `detents - 1` at the last one, and hardly more behind them.
fn find_slider_position_in_detents(area: &Rectangle, axis: SliderAxis, detents: u32, x: f64, y: f64) -> f64 {
    let (along, start, length) = match axis {
        SliderAxis::X => (x, area.x, area.width),
        SliderAxis::Y => (y, area.y, area.height),
    };
    let last = f64::from(detents - 1);
    let inset_px = INSET_PX.min(INSET_FRACTION * length / last);
    let step_px = (length - 2.0 * inset_px) / last;
    ((along - start - inset_px) / step_px).clamp(-BEHIND_END, last + BEHIND_END)
}

/// Follows a finger across the border of an edge: the border is a detent.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct EdgeTracker {
    area: Rectangle,
    intensity_g: f64,
    tracker: DetentTracker,
}

impl EdgeTracker {
    /// That of a finger at a place; `None` if the control is no edge.
    #[must_use]
    pub fn new(control: &Control, x: f64, y: f64) -> Option<Self> {
        let Shape::Edge(area) = control.shape else { return None };
        let tracker = DetentTracker::new(find_signed_border_distance_in_detent_steps(&area, x, y));
        Some(Self { area, intensity_g: control.intensity_g, tracker })
    }

    /// Moves on; the peak in g of the click that is felt, if the finger crosses the border.
    pub fn move_finger_and_find_click_g_if_border_crossed(&mut self, x: f64, y: f64) -> Option<f64> {
        let crosses = self.tracker.move_to_position_and_check_if_detent_passed(
            find_signed_border_distance_in_detent_steps(&self.area, x, y),
            None,
        );
        crosses.then_some(self.intensity_g)
    }
}

/// The distance from the border such that the tracker's hysteresis is [`EDGE_HYSTERESIS_PX`], and far from all detents but that at 0.
fn find_signed_border_distance_in_detent_steps(area: &Rectangle, x: f64, y: f64) -> f64 {
    (area.signed_distance_inside_border_px(x, y) * super::detents::HYSTERESIS / EDGE_HYSTERESIS_PX).clamp(-0.5, 0.5)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use std::time::Duration;

    const AREA: Rectangle = Rectangle { x: 100.0, y: 200.0, width: 300.0, height: 60.0 };

    fn make_control(shape: Shape) -> Control {
        Control { shape, intensity_g: 0.5, is_on: false }
    }

    fn count_clicks(shape: Shape, path: &[(f64, f64)]) -> usize {
        let now = Instant::now();
        let mut contact = Contact::new(make_control(shape), path[0].0, path[0].1, now).unwrap();
        path.iter()
            .filter(|(x, y)| contact.move_finger_and_find_click_g_if_detent_passed(*x, *y, now).is_some())
            .count()
    }

    /// From one place to another in so many messages.
    fn move_evenly(from: f64, to: f64, messages: u32) -> impl Iterator<Item = f64> {
        (0..=messages).map(move |i| from + (to - from) * f64::from(i) / f64::from(messages))
    }

    #[test]
    fn a_slider_has_its_detents_from_end_to_end() {
        let slider = |axis| Shape::Slider { area: AREA, axis, detents: 11 };
        // One every 29.6 px, at 102, 131.6, ..., 398.
        let x_path: Vec<_> = move_evenly(115.0, 390.0, 100).map(|x| (x, 220.0)).collect();
        assert_eq!(count_clicks(slider(SliderAxis::X), &x_path), 9);
        // Beyond the end, outside of the rectangle, and back: the end is felt once.
        let there: Vec<_> = move_evenly(115.0, 700.0, 200).map(|x| (x, 900.0)).collect();
        assert_eq!(count_clicks(slider(SliderAxis::X), &there), 10);
        let back: Vec<_> = there.iter().chain(there.iter().rev()).copied().collect();
        assert_eq!(count_clicks(slider(SliderAxis::X), &back), 19);
        // The last place that a screen reports is the end.
        assert_eq!(count_clicks(slider(SliderAxis::X), &[(385.0, 220.0), (399.0, 220.0)]), 1);
        // One every 5.85 px along y.
        let y_path: Vec<_> = move_evenly(203.0, 257.0, 100).map(|y| (250.0, y)).collect();
        assert_eq!(
            (count_clicks(slider(SliderAxis::Y), &y_path), count_clicks(slider(SliderAxis::Y), &x_path)),
            (9, 0)
        );
        // Of two positions, each is an end.
        let switch = Shape::Slider { area: AREA, axis: SliderAxis::X, detents: 2 };
        assert_eq!(count_clicks(switch, &back), 1);
    }

    #[test]
    fn a_dial_goes_on_from_turn_to_turn() {
        let dial = Shape::Dial { x_px: 500.0, y_px: 500.0, radius_px: 100.0, detents: 12 };
        let at = |degrees: f64, radius: f64| {
            (500.0 + radius * degrees.to_radians().cos(), 500.0 + radius * degrees.to_radians().sin())
        };
        let turn =
            |from: f64, to: f64| -> Vec<_> { move_evenly(from, to, 400).map(|degrees| at(degrees, 80.0)).collect() };
        assert_eq!(count_clicks(dial, &turn(15.0, 15.0 + 720.0)), 24);
        assert_eq!(count_clicks(dial, &turn(15.0, 15.0 - 720.0)), 24);
        // Two messages by the shorter way, over the place where angles begin anew.
        assert_eq!(count_clicks(dial, &[at(170.0, 80.0), at(-170.0, 80.0)]), 1);
        // Through the hub to the other side, nothing is turned.
        let through: Vec<_> = move_evenly(-80.0, 80.0, 100).map(|x| (500.0 + x, 503.0)).collect();
        assert_eq!(count_clicks(dial, &through), 0);
        // Around it outside of its circle.
        let outside: Vec<_> = move_evenly(15.0, 135.0, 100).map(|degrees| at(degrees, 300.0)).collect();
        assert_eq!(count_clicks(dial, &outside), 4);
    }

    #[test]
    fn a_toggle_is_stronger_when_it_is_switched_on() {
        let press = |shape, is_on| {
            Contact::new(Control { is_on, ..make_control(shape) }, 110.0, 210.0, Instant::now()).unwrap()
        };
        let (on, off) = (press(Shape::Toggle(AREA), true), press(Shape::Toggle(AREA), false));
        assert_eq!(
            (on.find_press_click_g_if_button_or_toggle(), off.find_press_click_g_if_button_or_toggle()),
            (Some(0.5), Some(0.3))
        );
        let button = press(Shape::Button(AREA), false);
        assert_eq!(
            (
                button.find_press_click_g_if_button_or_toggle(),
                button.find_release_click_g_if_button_or_toggle_and_still_on_it(400.0, 260.0)
            ),
            (Some(0.5), Some(0.3))
        );
        assert_eq!(
            button.find_release_click_g_if_button_or_toggle_and_still_on_it(401.0, 260.0),
            None,
            "it has left the button"
        );
        assert!(
            off.find_release_click_g_if_button_or_toggle_and_still_on_it(110.0, 210.0)
                < off.find_press_click_g_if_button_or_toggle()
        );
    }

    #[test]
    fn a_texture_grows_with_the_speed_inside_of_it() {
        let texture = make_control(Shape::Texture { area: AREA, speed_px_s: 500.0 });
        let start = Instant::now();
        let felt_at = |speed_px_s: f64| {
            let mut contact = Contact::new(texture, 100.0, 210.0, start).unwrap();
            let mut x = 100.0;
            for ms in (0..=200).step_by(16) {
                x = 100.0 + speed_px_s * f64::from(ms) / 1e3;
                contact.move_finger_and_find_click_g_if_detent_passed(
                    x,
                    210.0,
                    start + Duration::from_millis(u64::try_from(ms).unwrap()),
                );
            }
            contact.find_texture_g_at_present_speed_if_felt(x, 210.0)
        };
        let half = felt_at(250.0).unwrap();
        assert!((half - 0.25).abs() < 0.01, "{half}");
        assert!((felt_at(1000.0).unwrap() - 0.5).abs() < 1e-9, "never more than its intensity");
        assert_eq!((felt_at(0.0), felt_at(10.0)), (None, None));
        assert_eq!(felt_at(2000.0), None, "it has left the texture");
    }

    proptest! {
        /// Whatever the rate of the messages: a slow slide over any slider clicks at each detent.
        #[test]
        fn a_slow_slide_clicks_at_each_detent(
            detents in 2..=200_u32, from in 0.02..0.98, to in 0.02..0.98, messages_per_step in 1.1..20.0_f64,
        ) {
            let inset_px = 2.0_f64.min(AREA.width / f64::from(detents - 1) / 8.0);
            let step_px = (AREA.width - 2.0 * inset_px) / f64::from(detents - 1);
            let steps = |part: f64| (part * AREA.width - inset_px) / step_px;
            // Where rounding decides, either number is right.
            let is_clear = |part: f64| (4.0 * steps(part) - (4.0 * steps(part)).round()).abs() > 1e-6;
            prop_assume!(is_clear(from) && is_clear(to));
            let messages = ((steps(to) - steps(from)).abs() * messages_per_step).ceil().max(1.0);
            let place = |part: f64| (AREA.x + part * AREA.width, 0.0);
            let path: Vec<_> = (0..5000)
                .map(f64::from)
                .take_while(|i| *i <= messages)
                .map(|i| place(from + (to - from) * i / messages))
                .collect();
            let is_passed = |detent: &u32| {
                let (before, after) = (steps(from) - f64::from(*detent), steps(to) - f64::from(*detent));
                // That on which it came down is not felt.
                before * after < 0.0 && before.abs() > 0.25
            };
            let shape = Shape::Slider { area: AREA, axis: SliderAxis::X, detents };
            prop_assert_eq!(count_clicks(shape, &path), (0..detents).filter(is_passed).count());
        }

        /// A finger that trembles anywhere on anything.
        #[test]
        fn a_trembling_finger_feels_nothing(
            x in 100.0..400.0, y in 200.0..260.0, noise in prop::collection::vec((0.0..0.7, 0.0..0.7), 1..60),
        ) {
            let path: Vec<_> = noise.iter().map(|(dx, dy)| (x + dx, y + dy)).collect();
            for shape in [
                Shape::Slider { area: AREA, axis: SliderAxis::X, detents: 101 },
                Shape::Dial { x_px: 250.0, y_px: 230.0, radius_px: 150.0, detents: 24 },
            ] {
                prop_assert_eq!(count_clicks(shape, &path), 0, "{:?}", shape);
            }
            let mut edge = EdgeTracker::new(&make_control(Shape::Edge(AREA)), path[0].0, path[0].1).unwrap();
            prop_assert!(path.iter().all(|(x, y)| edge.move_finger_and_find_click_g_if_border_crossed(*x, *y).is_none()));
        }

        /// The border is crossed as often as the finger is on the other side of it, by the hysteresis or more.
        #[test]
        fn each_crossing_of_an_edge_is_felt_once(places in prop::collection::vec((0.0..500.0, 100.0..400.0), 2..60)) {
            let is_clear = |place: &&(f64, f64)| AREA.signed_distance_inside_border_px(place.0, place.1).abs() >= EDGE_HYSTERESIS_PX;
            let clear: Vec<(f64, f64)> = places.iter().filter(is_clear).copied().collect();
            prop_assume!(clear.len() >= 2);
            let crossings = clear.windows(2).filter(|pair| AREA.contains(pair[0].0, pair[0].1) != AREA.contains(pair[1].0, pair[1].1)).count();
            let mut edge = EdgeTracker::new(&make_control(Shape::Edge(AREA)), clear[0].0, clear[0].1).unwrap();
            let clicks = clear.iter().filter(|(x, y)| edge.move_finger_and_find_click_g_if_border_crossed(*x, *y).is_some()).count();
            prop_assert_eq!(clicks, crossings);
        }
    }
}
