//! The controls that a page has declared, and what its fingers feel of them: where they come down, move and are lifted, at which time.
//!
//! `declaration` checks what a page declares, `contact` follows one finger on one control, `detents` and `speed` are what it is made of. Nothing here is
//! driven, and no time is asked for: places and times are handed in, and what is felt is handed back.

mod contact;
mod declaration;
mod detents;
mod speed;

pub use declaration::{Control, DeclaredControl, FIELD_RANGES, MOST_CONTROLS, check_controls};

use crate::daemon::touch::check::CheckedFinger;
use crate::daemon::touch::request::Finger;
use crate::planner::Target;
use contact::{Contact, EdgeTracker};
use declaration::Shape;
use std::time::Instant;

/// The controls of a page, and its fingers.
#[derive(Debug, Default)]
pub struct PageControls {
    /// In the order of the page: of two in one place, the later one is on top.
    controls: Vec<Control>,
    fingers: Vec<PageFinger>,
    /// How often everything had been stopped when a finger was looked at last.
    stops: u64,
}

/// A finger that is down, and where it was last.
#[derive(Debug)]
struct PageFinger {
    checked: CheckedFinger,
    role: FingerRole,
}

/// What a finger feels until it is lifted.
#[derive(Debug)]
enum FingerRole {
    /// What it asks for itself, and no controls.
    Own,
    /// Edges that it crosses. One that came down outside of all controls also feels what is asked for it without controls.
    Free { is_outside: bool, edges: Vec<EdgeTracker> },
    /// The control in which it came down.
    On(Contact),
    /// Nothing: its control has gone, or everything was stopped.
    Nothing,
}

/// What fingers feel of the controls now.
#[derive(Debug, Default, PartialEq)]
pub struct Felt {
    /// Numbers of the fingers that are driven as if there were no controls.
    pub outside: Vec<i64>,
    /// Fingers on textures that vibrate, with the peak of each.
    pub textures: Vec<CheckedFinger>,
    /// The click that begins now, if one does.
    pub click: Option<FeltClick>,
}

/// A click that begins now.
#[derive(Debug, PartialEq)]
pub struct FeltClick {
    /// The fingers that it is for, with the peak of each.
    pub fingers: Vec<CheckedFinger>,
    /// Why.
    pub cause: ClickCause,
}

/// Why there is a click. Of several at once, the first of these counts.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum ClickCause {
    /// A button or toggle was pressed: it is felt in any case.
    Press,
    /// A detent was passed, or an edge crossed: a newer click may take its place.
    Move,
    /// A button or toggle was released: the same.
    Release,
}

impl PageControls {
    /// Puts others in the place of all controls. Fingers stay on those that are there again.
    pub fn replace_controls(&mut self, controls: Vec<Control>) {
        self.controls = controls;
        for PageFinger { checked, role } in &mut self.fingers {
            match role {
                FingerRole::On(contact) => {
                    match self.controls.iter().find(|control| control.shape == contact.control.shape) {
                        Some(same) => contact.control = *same,
                        None => *role = FingerRole::Nothing,
                    }
                }
                FingerRole::Free { edges, .. } => *edges = track_edges(&self.controls, &checked.finger),
                FingerRole::Own | FingerRole::Nothing => {}
            }
        }
    }

    /// What the fingers feel that are down now; all others are lifted. `stop_count` is how often everything has been stopped until now.
    pub fn update_fingers_lifting_absent(&mut self, fingers: &[CheckedFinger], now: Instant, stop_count: u64) -> Felt {
        if stop_count != self.stops {
            self.stops = stop_count;
            self.detach_fingers_from_controls_after_stop();
        }
        let mut clicks: Vec<(ClickCause, CheckedFinger)> = Vec::new();
        let is_down = |known: &PageFinger| fingers.iter().any(|down| down.finger.id == known.checked.finger.id);
        for lifted in self.fingers.extract_if(.., |known| !is_down(known)) {
            if let FingerRole::On(contact) = &lifted.role
                && let Finger { x_px, y_px, .. } = lifted.checked.finger
                && let Some(peak_g) = contact.find_release_click_g_if_button_or_toggle_and_still_on_it(x_px, y_px)
            {
                clicks.push((ClickCause::Release, with_peak(lifted.checked, peak_g)));
            }
        }
        let mut felt = Felt::default();
        for checked in fingers {
            let click = match self.fingers.iter_mut().find(|known| known.checked.finger.id == checked.finger.id) {
                Some(known) => known.move_and_find_click_g(*checked, now).map(|peak_g| (ClickCause::Move, peak_g)),
                None => self
                    .put_finger_down_on_control_if_any_and_find_click_g(*checked, now)
                    .map(|peak_g| (ClickCause::Press, peak_g)),
            };
            clicks.extend(click.map(|(cause, peak_g)| (cause, with_peak(*checked, peak_g))));
        }
        for PageFinger { checked, role } in &self.fingers {
            let finger = &checked.finger;
            if role.is_driven_as_if_there_were_no_controls() {
                felt.outside.push(finger.id);
            } else if let FingerRole::On(contact) = role {
                let peak_g = contact.find_texture_g_at_present_speed_if_felt(finger.x_px, finger.y_px);
                felt.textures.extend(peak_g.map(|peak_g| with_peak(*checked, peak_g)));
            }
        }
        felt.click = merge_clicks_of_most_important_cause(clicks);
        felt
    }

    /// The same where none of the fingers moves, and all but those with these numbers are lifted.
    pub fn lift_all_except(&mut self, ids: &[i64], now: Instant, stop_count: u64) -> Felt {
        let kept: Vec<CheckedFinger> = self.list_fingers().filter(|down| ids.contains(&down.finger.id)).collect();
        self.update_fingers_lifting_absent(&kept, now, stop_count)
    }

    /// The same where all fingers stay where they are.
    pub fn update_felt_with_fingers_unmoved(&mut self, now: Instant, stop_count: u64) -> Felt {
        let all: Vec<CheckedFinger> = self.list_fingers().collect();
        self.update_fingers_lifting_absent(&all, now, stop_count)
    }

    /// When a finger comes to rest on a texture, if it does not move before: what is felt has to be looked at again then.
    #[must_use]
    pub fn find_next_time_when_a_stroke_will_rest(&self) -> Option<Instant> {
        let rest_time = |known: &PageFinger| match &known.role {
            FingerRole::On(contact) => contact.find_time_when_moving_stroke_will_rest(),
            _ => None,
        };
        self.fingers.iter().filter_map(rest_time).min()
    }

    /// Fingers that are down and are not driven as if there were no controls.
    pub fn list_ids_of_fingers_on_or_detached_from_controls(&self) -> impl Iterator<Item = i64> {
        self.fingers
            .iter()
            .filter(|known| !known.role.is_driven_as_if_there_were_no_controls())
            .map(|known| known.checked.finger.id)
    }

    fn list_fingers(&self) -> impl Iterator<Item = CheckedFinger> {
        self.fingers.iter().map(|known| known.checked)
    }

    fn put_finger_down_on_control_if_any_and_find_click_g(
        &mut self,
        checked: CheckedFinger,
        now: Instant,
    ) -> Option<f64> {
        let finger = &checked.finger;
        let top = self.controls.iter_mut().rfind(|control| control.contains(finger.x_px, finger.y_px));
        let is_outside = top.is_none();
        let contact = top.filter(|_| !has_own_effect_or_intensity(finger)).and_then(|control| {
            if let Shape::Toggle(_) = control.shape {
                control.is_on = !control.is_on;
            }
            Contact::new(*control, finger.x_px, finger.y_px, now)
        });
        let click_g = contact.as_ref().and_then(Contact::find_press_click_g_if_button_or_toggle);
        let role = match contact {
            _ if has_own_effect_or_intensity(finger) => FingerRole::Own,
            Some(contact) => FingerRole::On(contact),
            None => FingerRole::Free { is_outside, edges: track_edges(&self.controls, finger) },
        };
        self.fingers.push(PageFinger { checked, role });
        click_g
    }

    /// A finger that was down at a stop feels no more of the controls, so that nothing is driven by it when it is lifted: it may have pressed a
    /// button that stops everything. What is asked for a finger outside of all controls counts as new.
    fn detach_fingers_from_controls_after_stop(&mut self) {
        let on_controls = self.fingers.iter_mut().filter(|known| !known.role.is_driven_as_if_there_were_no_controls());
        on_controls.for_each(|known| known.role = FingerRole::Nothing);
    }
}

impl FingerRole {
    /// Whether its finger is driven as if there were no controls.
    const fn is_driven_as_if_there_were_no_controls(&self) -> bool {
        matches!(self, Self::Own | Self::Free { is_outside: true, .. })
    }
}

impl PageFinger {
    fn move_and_find_click_g(&mut self, checked: CheckedFinger, now: Instant) -> Option<f64> {
        self.checked = checked;
        let finger = &checked.finger;
        if has_own_effect_or_intensity(finger) {
            self.role = FingerRole::Own;
        }
        match &mut self.role {
            FingerRole::On(contact) => {
                contact.move_finger_and_find_click_g_if_detent_passed(finger.x_px, finger.y_px, now)
            }
            FingerRole::Free { edges, .. } => {
                let crossed = edges
                    .iter_mut()
                    .filter_map(|edge| edge.move_finger_and_find_click_g_if_border_crossed(finger.x_px, finger.y_px));
                crossed.reduce(f64::max)
            }
            FingerRole::Own | FingerRole::Nothing => None,
        }
    }
}

/// What a page says of one finger is more than what it has declared for all.
const fn has_own_effect_or_intensity(finger: &Finger) -> bool {
    finger.effect.is_some() || finger.intensity_g.is_some()
}

fn track_edges(controls: &[Control], finger: &Finger) -> Vec<EdgeTracker> {
    controls.iter().filter_map(|control| EdgeTracker::new(control, finger.x_px, finger.y_px)).collect()
}

const fn with_peak(checked: CheckedFinger, peak_g: f64) -> CheckedFinger {
    let intensity_g = Some(peak_g);
    CheckedFinger { finger: Finger { intensity_g, ..checked.finger }, target: Target { intensity_g, ..checked.target } }
}

/// The panel plays one thing at a time: the click of the first cause, for all fingers that have it. One without strength is none.
fn merge_clicks_of_most_important_cause(mut clicks: Vec<(ClickCause, CheckedFinger)>) -> Option<FeltClick> {
    clicks.retain(|(_, checked)| checked.finger.intensity_g > Some(0.0));
    let cause = clicks.iter().map(|(cause, _)| *cause).min()?;
    let fingers = clicks.into_iter().filter(|(other, _)| *other == cause).map(|(_, checked)| checked).collect();
    Some(FeltClick { fingers, cause })
}

#[cfg(test)]
mod tests;
