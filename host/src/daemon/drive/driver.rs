//! The one way from a touch to the board: a place at the planner, the plan, and having it driven.

use super::active::Update;
use super::{DriveController, DriveEquipment};
use crate::daemon::access::client::{Asker, Client};
use crate::daemon::api::problem::Problem;
use crate::daemon::design::slots::Slots;
use crate::daemon::observe::metrics::Metrics;
use crate::daemon::touch::Touch;
use crate::daemon::touch::active_plan::ActivePlan;
use crate::daemon::touch::admission::Admission;
use crate::daemon::touch::answer::TouchedView;
use crate::daemon::touch::check::DriveMode;
use crate::daemon::touch::request::Finger;
use crate::device::sim::TouchPeak;
use crate::device::{AskedAt, DeviceSnapshot, SessionError};
use crate::planner::residual::RailState;
use crate::planner::{Plan, PlanTable, STANDARD_GRAVITY};
use std::sync::{Arc, Mutex, PoisonError};
use std::task::Poll;
use std::time::{Duration, Instant};
use tokio::sync::{broadcast, watch};

/// Effect files that are designed at once, each of another client.
const EFFECTS_AT_ONCE: usize = 2;
/// Clients whose effect file may wait for one.
const MOST_EFFECTS_WAITING: usize = 16;

/// Everything that a touch needs once it has been checked.
#[derive(Debug)]
pub struct TouchDriver {
    /// The planner's table, with scene and model.
    pub table: Arc<PlanTable>,
    /// Whose turn it is at the planner, and what became of each request.
    pub admission: Admission,
    /// Counters.
    pub metrics: Arc<Metrics>,
    pub(super) equipment: Arc<DriveEquipment>,
    pub(super) controller: DriveController,
    /// For effect files, which take no place from touches.
    pub(super) effect_slots: Arc<Slots>,
    later: Mutex<Option<PendingTouchParts>>,
    closing: watch::Sender<bool>,
}

/// Parts of a touch that have not begun yet.
#[derive(Clone, Copy, Debug)]
struct PendingTouchParts {
    /// Of which touch.
    id: u64,
    /// [`AskedAt::stops`] of the touch.
    stops: u64,
    /// When the last of them begins.
    last_begin: Instant,
}

impl TouchDriver {
    /// A driver for a panel at rest.
    #[must_use]
    pub fn new(equipment: DriveEquipment, metrics: Arc<Metrics>) -> Self {
        let equipment = Arc::new(equipment);
        Self {
            table: Arc::clone(&equipment.table),
            admission: Admission::default(),
            metrics,
            controller: DriveController::new(Arc::clone(&equipment)),
            equipment,
            effect_slots: Slots::new(EFFECTS_AT_ONCE, MOST_EFFECTS_WAITING),
            later: Mutex::default(),
            closing: watch::channel(false).0,
        }
    }

    /// Takes note that touch `id`, asked for when [`TouchDriver::stop_count`] was `stop_count`, has parts that begin later, the last at `last_begin`;
    /// nothing if a newer touch has such parts, because that touch has replaced this one.
    pub(super) fn note_later_parts(&self, id: u64, stop_count: u64, last_begin: Instant) {
        let mut later = self.later.lock().unwrap_or_else(PoisonError::into_inner);
        if later.is_none_or(|noted| noted.id <= id) {
            *later = Some(PendingTouchParts { id, stops: stop_count, last_begin });
        }
    }

    /// Whether parts of the newest touch are still to come: it pauses.
    #[must_use]
    pub fn does_newest_touch_have_parts_yet_to_begin(&self) -> bool {
        let later = *self.later.lock().unwrap_or_else(PoisonError::into_inner);
        later.is_some_and(|later| {
            Instant::now() < later.last_begin
                && self.check_neither_superseded_nor_stopped(later.id, later.stops).is_ok()
        })
    }

    /// Plans for a touch, the request `request_id` of `asker`, and drives it, unless everything was stopped since [`TouchDriver::stop_count`] was
    /// `stop_count_at_arrival`.
    ///
    /// # Errors
    /// [`Problem`] that names what is wrong; nothing has changed then.
    pub async fn plan_and_drive_touch_counting_outcome(
        self: &Arc<Self>,
        asker: &Asker,
        request_id: u64,
        stop_count_at_arrival: u64,
        touch: &Touch,
    ) -> Result<TouchedView, Problem> {
        let result = self.plan_and_drive_touch(asker, request_id, stop_count_at_arrival, touch).await;
        self.metrics.count_touch(result.is_ok());
        result
    }

    async fn plan_and_drive_touch(
        self: &Arc<Self>,
        asker: &Asker,
        request_id: u64,
        stop_count_at_arrival: u64,
        touch: &Touch,
    ) -> Result<TouchedView, Problem> {
        if self.is_closing() {
            return Err(SessionError::Closed.into());
        }
        let interruptions = self.count_unrequested_disarms_faults_and_outages_of_board();
        let place = self.admission.wait_for_planner_place_unless_queue_full(asker.client).await?;
        // A newer touch, or a stop, may have come while this one waited.
        self.check_neither_superseded_nor_stopped(request_id, stop_count_at_arrival)?;
        if let Some(spans) = &touch.spans {
            let asked_at = AskedAt { stops: stop_count_at_arrival, interruptions: Some(interruptions) };
            return self.plan_and_drive_time_spans(asker, place, request_id, touch, spans.clone(), asked_at).await;
        }
        let asked_at = AskedAt { stops: stop_count_at_arrival, interruptions: None };
        // An effect is designed in the planner's place, too: a click takes longer than its plan.
        let (plan, order) = tokio::task::block_in_place(|| -> Result<_, Problem> {
            let plan = self.plan_request_of_touch_and_count_plan_time(touch, &touch.request)?;
            let (fingers, mode) = (touch.fingers.clone(), touch.mode.clone());
            let order = self.equipment.prepare_touch_order(request_id, asked_at, plan.clone(), fingers, mode)?;
            Ok((plan, order))
        })?;
        drop(place);
        let driven = self.controller.queue_touch_order_and_wait_until_begun(order).await?;
        let trade = self.compute_trade_off_if_wanted_and_needed(asker, request_id, touch, &touch.request, &plan).await;
        Ok(TouchedView { trade, ..driven })
    }

    /// Has the board drive a plan, and shows it.
    pub(super) async fn drive_plan(
        &self,
        id: u64,
        asked_at: AskedAt,
        plan: Plan,
        fingers: Vec<Finger>,
        mode: DriveMode,
    ) -> Result<TouchedView, Problem> {
        let prepare = || self.equipment.prepare_touch_order(id, asked_at, plan, fingers, mode);
        let order = tokio::task::block_in_place(prepare)?;
        self.controller.queue_touch_order_and_wait_until_begun(order).await
    }

    /// What is known of the device, kept up to date.
    #[must_use]
    pub fn subscribe_device_snapshots(&self) -> watch::Receiver<DeviceSnapshot> {
        self.equipment.session.subscribe_snapshots()
    }

    /// What is known of the device now.
    #[must_use]
    pub fn current_device_snapshot_marked_disconnected_if_thread_hung(&self) -> DeviceSnapshot {
        self.equipment.session.current_snapshot_marked_disconnected_if_thread_hung()
    }

    /// How long ago the device last answered; `None` if it never did.
    #[must_use]
    pub fn time_since_last_answer(&self) -> Option<Duration> {
        let is_known = self.equipment.session.subscribe_snapshots().borrow().identity.is_some();
        is_known.then(|| self.equipment.session.time_since_last_answer())
    }

    /// Whether the thread that looks after the device does its work.
    #[must_use]
    pub fn is_session_thread_working(&self) -> bool {
        self.equipment.session.is_thread_running_and_recently_active()
    }

    /// Resolves when the thread that looks after the device has ended.
    pub async fn wait_for_session_end(&self) {
        let mut device = self.equipment.session.subscribe_snapshots();
        while device.changed().await.is_ok() {}
    }

    /// Plans and stops as they happen.
    #[must_use]
    pub fn subscribe_updates(&self) -> broadcast::Receiver<Update> {
        self.controller.subscribe_updates()
    }

    /// How often everything was stopped so far: what was asked for before a stop is not driven after it.
    #[must_use]
    pub fn stop_count(&self) -> u64 {
        self.equipment.session.stop_count()
    }

    /// [`DeviceSnapshot::interruptions`].
    #[must_use]
    pub fn count_unrequested_disarms_faults_and_outages_of_board(&self) -> u64 {
        self.equipment.count_unrequested_disarms_faults_and_outages_of_board()
    }

    /// Whether the board is off: it has to be armed before it drives.
    #[must_use]
    pub fn is_board_known_to_be_disarmed(&self) -> bool {
        self.equipment.read_rail_state_down_up_or_driving() == RailState::Down
    }

    /// The plan that is being driven.
    #[must_use]
    pub fn find_active_plan(&self) -> Option<Arc<ActivePlan>> {
        self.controller.find_current_plan().map(|current| current.active)
    }

    /// The number of the plan that is driven, and when its drive ends.
    #[must_use]
    pub fn find_id_and_end_of_current_plan(&self) -> Option<(u64, Instant)> {
        self.controller.find_current_plan().map(|current| (current.active.id, current.until))
    }

    /// Ends the drive of plan `id` at `when`: its fingers have been lifted.
    pub fn end_touch_at(&self, id: u64, when: Instant) {
        self.controller.end_touch_at(id, when);
    }

    /// Has the drive of plan `id` go on until `until`: its fingers are still down. Whether it is still what is shown.
    pub async fn extend_touch_and_check_if_still_active(&self, id: u64, until: Instant) -> bool {
        self.controller.extend_touch_and_check_if_still_active(id, until).await
    }

    /// Drops touch `id` if it waits for what is left of those before: there is something newer.
    pub fn drop_waiting_touch(&self, id: u64) {
        self.controller.drop_waiting_touch(id);
    }

    /// Switches everything off. What is asked for once this has been polled comes after it.
    ///
    /// # Errors
    /// [`SessionError`]; the board was told to stop all the same where there was a port, and goes off 250 ms after the last frame that
    /// it heard.
    pub async fn stop_device(&self) -> Result<(), SessionError> {
        // On its way before anything is waited for, a lock as well.
        let mut stopping = std::pin::pin!(self.equipment.session.stop_and_disarm_board());
        let at_once = std::future::poll_fn(|context| Poll::Ready(stopping.as_mut().poll(context))).await;
        self.controller.tell_task_all_stopped();
        let result = match at_once {
            Poll::Ready(result) => result,
            Poll::Pending => self.equipment.await_session_answer_unless_thread_hangs(stopping).await,
        };
        self.controller.tell_pages_all_stopped();
        result
    }

    /// Arms the device, if it is not armed, so that the next touch need not wait for its self-test; it stays armed for the idle time.
    ///
    /// # Errors
    /// [`Problem`]; [`SessionError::Stopped`] if everything was stopped while this waited for its turn.
    pub async fn arm_device(&self, client: Client) -> Result<(), Problem> {
        let (stops, asked) = (self.stop_count(), Instant::now());
        let _place = self.admission.wait_for_place_to_arm_or_clear_fault_unless_queue_full(client).await?;
        if self.is_closing() {
            return Err(SessionError::Closed.into());
        }
        Ok(self
            .equipment
            .await_session_answer_unless_thread_hangs(
                self.equipment.session.arm_on_person_request_unless_stopped_since(stops, asked),
            )
            .await?)
    }

    /// Clears the device's latched fault.
    ///
    /// # Errors
    /// [`Problem`].
    pub async fn clear_faults(&self, client: Client) -> Result<(), Problem> {
        let _place = self.admission.wait_for_place_to_arm_or_clear_fault_unless_queue_full(client).await?;
        Ok(self.equipment.await_session_answer_unless_thread_hangs(self.equipment.session.clear_faults()).await?)
    }

    /// What the sensor has shown under each of the last `max_count` touches, the newest first; nothing without a simulated sensor.
    #[must_use]
    pub fn list_simulated_sensor_peaks_of_newest_touches(&self, max_count: usize) -> Vec<TouchPeak> {
        self.equipment.sim.as_ref().map(|sim| sim.peaks_of_newest_touches(max_count)).unwrap_or_default()
    }

    /// The largest acceleration under touch `id`, in g; `None` without a simulated sensor.
    #[must_use]
    pub fn find_simulated_sensor_peak_of_touch_g(&self, id: u64) -> Option<f64> {
        self.equipment.sim.as_ref()?.peak_of_touch_if_kept(id).map(|peak| peak.peak_m_per_s2 / STANDARD_GRAVITY)
    }

    /// Whether nothing is driven any more because the daemon ends.
    #[must_use]
    pub fn is_closing(&self) -> bool {
        *self.closing.borrow()
    }

    /// Becomes true when the daemon shuts down.
    #[must_use]
    pub fn subscribe_closing(&self) -> watch::Receiver<bool> {
        self.closing.subscribe()
    }

    /// Drives nothing from here on.
    pub fn begin_closing(&self) {
        self.closing.send_replace(true);
    }

    /// Checks that a touch may still be driven.
    ///
    /// # Errors
    /// [`Problem`]: a newer touch has come than request `id`, or a stop since [`TouchDriver::stop_count`] was `stop_count_at_arrival`.
    pub(super) fn check_neither_superseded_nor_stopped(
        &self,
        id: u64,
        stop_count_at_arrival: u64,
    ) -> Result<(), Problem> {
        self.controller.check_not_superseded(id)?;
        if self.stop_count() == stop_count_at_arrival { Ok(()) } else { Err(SessionError::Stopped.into()) }
    }
}
