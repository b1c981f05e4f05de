//! Carries out what a page says.

use super::controls::{ClickCause, Felt, FeltClick, PageControls, check_controls};
use super::finger_steps::PageFingers;
use super::incoming::{CheckedFingers, IncomingMessage, list_values_of_top_level_type_keys_in_possibly_invalid_json};
use super::{MAX_MESSAGE, PageMessage, PageMessageKind, build_error_message};
use crate::daemon::access::client::Peer;
use crate::daemon::access::permissions::Role;
use crate::daemon::api::problem::Problem;
use crate::daemon::app::App;
use crate::daemon::touch::Touch;
use crate::daemon::touch::check::CheckedFinger;
use crate::daemon::touch::request::RequestedHaptics;
use crate::effects::NamedEffect;
use crate::planner::click::Preference;
use futures_util::FutureExt;
use serde_json::{Value, json};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Instant;
use tokio::sync::mpsc;

/// Longest time in ms until the click of a control that is released is quiet: the `tick` of effect files, as the primitive `release` is one.
const RELEASE_CRISP_MS: f64 = 30.0;

/// Who is at the other end.
#[derive(Clone, Copy, Debug)]
pub struct PageIdentity {
    /// In recordings.
    pub number: u64,
    /// What its token opens.
    pub role: Role,
    /// Whose messages are read at one pace.
    pub peer: Option<Peer>,
}

impl PageIdentity {
    /// That of a new page.
    #[must_use]
    pub fn new(role: Role, peer: Option<Peer>) -> Self {
        static PAGES: AtomicU64 = AtomicU64::new(0);
        Self { number: PAGES.fetch_add(1, Ordering::Relaxed) + 1, role, peer }
    }
}

/// What carries out the messages of one page, one after the other.
#[derive(Debug)]
pub struct PageReader {
    app: Arc<App>,
    page: PageIdentity,
    fingers: Arc<PageFingers>,
    controls: PageControls,
    replies: mpsc::Sender<Value>,
}

impl PageReader {
    /// That of a page without controls, and without fingers.
    #[must_use]
    pub fn new(app: Arc<App>, page: PageIdentity, fingers: Arc<PageFingers>, replies: mpsc::Sender<Value>) -> Self {
        Self { app, page, fingers, controls: PageControls::default(), replies }
    }

    /// Carries out a message as far as that goes, and tells the page what is wrong with it, if anything is.
    pub fn handle_text_and_report_problem_to_page(&mut self, text: &str) {
        if let Err(problem) = self.handle_page_message(text) {
            self.queue_error_message_to_page(&problem);
        }
    }

    /// The same for a message that is no text.
    pub fn refuse_binary_message_after_stop_and_lifts(&mut self, bytes: &[u8]) {
        self.stop_device_if_message_asks_and_page_may_touch(bytes);
        if self.page.role >= Role::Touch
            && let Ok(text) = std::str::from_utf8(bytes)
        {
            self.lift_fingers_left_out(&IncomingMessage::from_text(text));
        }
        self.queue_error_message_to_page(&Problem::bad_body(
            "the message is binary, but must be text with JSON".into(),
        ));
    }

    /// When a finger comes to rest on a texture, if the page says nothing before.
    #[must_use]
    pub fn find_next_time_when_a_stroke_will_rest(&self) -> Option<Instant> {
        self.controls.find_next_time_when_a_stroke_will_rest()
    }

    /// Ends the vibration of fingers that have come to rest, or whose texture has gone.
    pub fn end_textures_without_motion(&mut self) {
        let stops = self.app.driver.stop_count();
        let felt = self.controls.update_felt_with_fingers_unmoved(Instant::now(), stops);
        self.queue_felt_click_and_lift_fingers_without_drive(felt, stops);
    }

    /// A page that reads nothing misses what is wrong with what it says.
    fn queue_error_message_to_page(&self, problem: &Problem) {
        let _ = self.replies.try_send(build_error_message(problem));
    }

    fn handle_page_message(&mut self, text: &str) -> Result<(), Problem> {
        if self.page.role < Role::Touch {
            return Err(self.page.role.insufficient_role_problem(Role::Touch));
        }
        if text.len() > MAX_MESSAGE {
            self.stop_device_if_message_asks_and_page_may_touch(text.as_bytes());
            self.lift_fingers_left_out(&IncomingMessage::from_text(text));
            return Err(Problem::bad_body(format!(
                "the message has {} bytes, but may have at most {MAX_MESSAGE}",
                text.len()
            )));
        }
        let message = IncomingMessage::from_text(text);
        match &message.rest {
            Ok(rest @ PageMessage { kind: PageMessageKind::Touch, touches: Some(_), .. }) => {
                if let Err(problem) = rest.refuse_keys_of_other_types() {
                    self.lift_fingers_left_out(&message);
                    return Err(problem);
                }
                self.record_and_queue_touch_of_message_reporting_wrong_fingers(text, &message, rest)
            }
            Ok(PageMessage { kind: PageMessageKind::Touch, touches: None, .. }) => {
                Err(IncomingMessage::missing_fingers_problem())
            }
            Ok(rest @ PageMessage { kind: PageMessageKind::Controls, .. }) => {
                rest.refuse_keys_of_other_types()?;
                self.replace_controls(text, rest)
            }
            Ok(rest @ PageMessage { kind: PageMessageKind::Stop, .. }) => {
                self.discard_finger_steps_and_stop_device_for_page();
                let has_more = message.count_fingers().is_some_and(|count| count > 0);
                if has_more {
                    let detail = "`touches` is given, but is allowed only in a message of the type `touch`; the daemon stopped the device";
                    return Err(Problem::bad_body(detail.into()).with_field("touches".into()));
                }
                rest.refuse_keys_of_other_types()
            }
            Err(problem) => {
                self.stop_device_if_message_asks_and_page_may_touch(text.as_bytes());
                self.lift_fingers_left_out(&message);
                Err(problem.clone())
            }
        }
    }

    /// Puts the controls of a message in the place of all others.
    fn replace_controls(&mut self, text: &str, rest: &PageMessage) -> Result<(), Problem> {
        // As what fingers do: a replay says it again.
        self.record_message(text);
        let declared = rest.controls.as_deref().ok_or_else(IncomingMessage::problem_that_controls_field_is_missing)?;
        self.controls.replace_controls(check_controls(declared, &self.app.table.scene.screen)?);
        self.end_textures_without_motion();
        Ok(())
    }

    fn record_message(&self, text: &str) {
        self.app.record_line("fingers", || {
            // What is no JSON is kept as it came.
            let message = serde_json::from_str::<Value>(text).unwrap_or_else(|_| text.into());
            json!({"socket": self.page.number, "message": message})
        });
    }

    /// Has the fingers of a message driven; each one that is wrong is told, and takes nothing from the others. What is wrong with the whole is given
    /// back; of the fingers only those that are lifted count then.
    fn record_and_queue_touch_of_message_reporting_wrong_fingers(
        &mut self,
        text: &str,
        message: &IncomingMessage,
        rest: &PageMessage,
    ) -> Result<(), Problem> {
        self.record_message(text);
        let stops = self.app.driver.stop_count();
        let mut ids_down = self.fingers.list_ids_of_fingers_down();
        ids_down.extend(self.controls.list_ids_of_fingers_on_or_detached_from_controls());
        let CheckedFingers { fingers: mut down, problems } = message.check_fingers(&self.app.table.scene, &ids_down);
        problems.iter().for_each(|problem| self.queue_error_message_to_page(problem));
        let felt = self.controls.update_fingers_lifting_absent(&down, Instant::now(), stops);
        down.retain(|checked| felt.outside.contains(&checked.finger.id));
        loop {
            let own_effect = if rest.effect.is_none() {
                self.fingers.choose_effect_of_newest_finger_else_ongoing_else_first(&down)
            } else {
                None
            };
            let haptics = RequestedHaptics {
                intensity_g: rest.intensity_g,
                intensity_db: rest.intensity_db,
                duration_ms: rest.duration_ms,
                effect: rest.effect.or(own_effect),
                count: rest.count,
                period_ms: rest.period_ms,
                crisp_ms: rest.crisp_ms,
                prefer: rest.prefer,
            };
            let problem = match Touch::from_fingers(&down, haptics) {
                Ok(touch) => return self.queue_fingers_and_what_is_felt(touch, felt, stops),
                Err(problem) => problem,
            };
            let (refused, others): (Vec<CheckedFinger>, Vec<CheckedFinger>) =
                down.iter().partition(|checked| own_effect.is_some() && checked.finger.effect == own_effect);
            if refused.is_empty() || others.is_empty() {
                let outside = down.iter().map(|checked| checked.finger.id).collect();
                self.queue_felt_click_and_lift_fingers_without_drive(Felt { outside, click: None, ..felt }, stops);
                return Err(problem);
            }
            // The effect that these fingers have of their own does not go with the message: that is wrong with them alone.
            for checked in &refused {
                self.queue_error_message_to_page(&problem.clone().with_finger_id_and_detail_prefix(checked.finger.id));
            }
            down = others;
        }
    }

    /// Has fingers outside of the controls driven, and what those on controls feel.
    fn queue_fingers_and_what_is_felt(&self, outside: Touch, felt: Felt, stop_count: u64) -> Result<(), Problem> {
        // As for fingers without controls: while one has an effect, nothing else vibrates.
        let on_textures = if outside.haptics.effect.is_none() { felt.textures } else { Vec::new() };
        let ids: Vec<i64> = on_textures.iter().map(|checked| checked.finger.id).collect();
        let steady = if on_textures.is_empty() {
            outside
        } else {
            let textures = Touch::from_fingers(&on_textures, RequestedHaptics::default())?;
            // What the message says of its fingers is not about them.
            if outside.fingers.is_empty() { textures } else { outside.with_added_fingers_of(&textures) }
        };
        let clicked = felt.click.map_or(Ok(()), |click| self.queue_click(click, &steady, stop_count));
        let are_all_on_controls = self.controls.list_ids_of_fingers_on_or_detached_from_controls().next().is_some()
            && steady.fingers.is_empty();
        if are_all_on_controls && self.fingers.list_ids_of_fingers_down().is_empty() {
            return clicked;
        }
        clicked.and(self.fingers.queue_fingers_and_textures_with_error_if_oldest_step_dropped(steady, &ids, stop_count))
    }

    /// Has a click of controls played; `steady` is what goes on after it.
    fn queue_click(&self, click: FeltClick, steady: &Touch, stop_count: u64) -> Result<(), Problem> {
        let FeltClick { fingers, cause } = click;
        let mut haptics = RequestedHaptics { effect: Some(NamedEffect::Click), ..RequestedHaptics::default() };
        if cause == ClickCause::Release {
            (haptics.crisp_ms, haptics.prefer) = (Some(RELEASE_CRISP_MS), Some(Preference::Crispness));
        }
        let ids: Vec<i64> = fingers.iter().map(|checked| checked.finger.id).collect();
        let others: Vec<i64> = steady.fingers.iter().map(|finger| finger.id).filter(|id| !ids.contains(id)).collect();
        let touch =
            Touch::from_fingers(&fingers, haptics)?.with_added_fingers_of(&steady.clone().keep_only_fingers(&others));
        self.fingers.queue_control_click_with_error_if_oldest_step_dropped(
            touch,
            ids,
            cause == ClickCause::Press,
            stop_count,
        )
    }

    /// Where nothing new is driven: ends the drive of all fingers but those that still have one, and plays what is felt of those that were lifted.
    fn queue_felt_click_and_lift_fingers_without_drive(&self, felt: Felt, stop_count: u64) {
        if let Some(click) = felt.click {
            let _ = self.queue_click(click, &Touch::without_fingers(), stop_count);
        }
        let on_textures = felt.textures.iter().map(|checked| checked.finger.id);
        let ids: Vec<i64> = felt.outside.iter().copied().chain(on_textures).collect();
        // What is lifted takes nobody's place.
        let _ = self.fingers.lift_all_except_with_error_if_oldest_step_dropped(&ids, stop_count);
    }

    /// The fingers that a message which cannot be used leaves out are lifted all the same, if it is about fingers at all.
    fn lift_fingers_left_out(&mut self, message: &IncomingMessage) {
        if message.is_touch && message.count_fingers().is_some() {
            let stops = self.app.driver.stop_count();
            let felt = self.controls.lift_all_except(&message.list_finger_ids(), Instant::now(), stops);
            self.queue_felt_click_and_lift_fingers_without_drive(felt, stops);
        }
    }

    /// Stops everything.
    fn discard_finger_steps_and_stop_device_for_page(&self) {
        self.app.record_line("stop", || json!({"socket": self.page.number}));
        self.fingers.discard_steps_and_lift_all();
        let (app, replies) = (Arc::clone(&self.app), self.replies.clone());
        let mut stopping = Box::pin(async move {
            if let Err(error) = app.stop_device().await {
                let _ = replies.try_send(build_error_message(&error.into()));
            }
        });
        // Counted and on its way here, so that what the page says next comes after it; the answer is waited for in a task of its own, so
        // that the next message is read whatever the device does.
        if (&mut stopping).now_or_never().is_none() {
            tokio::spawn(stopping);
        }
    }

    /// The same for a message that cannot be used, but says that it is a stop: whatever else is wrong with it is told besides.
    fn stop_device_if_message_asks_and_page_may_touch(&self, message: &[u8]) {
        if self.page.role >= Role::Touch
            && list_values_of_top_level_type_keys_in_possibly_invalid_json(message).iter().any(|kind| kind == "stop")
        {
            self.discard_finger_steps_and_stop_device_for_page();
        }
    }
}
