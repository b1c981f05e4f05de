//! The one way from a touch to the board: a place at the planner, the plan, and having it driven.

use super::active::{Active, AskedAt, Touched, Update};
use super::{Controller, Equipment};
use crate::daemon::access::client::{Asker, Client};
use crate::daemon::api::problem::Problem;
use crate::daemon::observe::metrics::Metrics;
use crate::daemon::touch::Touch;
use crate::daemon::touch::admission::Admission;
use crate::daemon::touch::check::DriveMode;
use crate::daemon::touch::request::Finger;
use crate::device::sim::TouchPeak;
use crate::device::{DeviceSnapshot, SessionError};
use crate::planner::residual::Board;
use crate::planner::{Plan, PlanTable, STANDARD_GRAVITY};
use std::sync::Arc;
use std::task::Poll;
use std::time::{Duration, Instant};
use tokio::sync::{broadcast, watch};

/// Everything that a touch needs once it has been checked.
#[derive(Debug)]
pub struct Driver {
    /// The planner's table, with scene and model.
    pub table: Arc<PlanTable>,
    /// Whose turn it is at the planner, and what became of each request.
    pub admission: Admission,
    /// Counters.
    pub metrics: Arc<Metrics>,
    equipment: Arc<Equipment>,
    pub(super) controller: Controller,
    closing: watch::Sender<bool>,
}

impl Driver {
    /// A driver for a panel at rest.
    #[must_use]
    pub fn new(equipment: Equipment, metrics: Arc<Metrics>) -> Self {
        let equipment = Arc::new(equipment);
        Self {
            table: Arc::clone(&equipment.table),
            admission: Admission::default(),
            metrics,
            controller: Controller::new(Arc::clone(&equipment)),
            equipment,
            closing: watch::channel(false).0,
        }
    }

    /// Plans for a touch, the request `id` of `asker`, and drives it, unless everything was stopped since [`Driver::stops`] was
    /// `stops`.
    ///
    /// # Errors
    /// [`Problem`] that names what is wrong; nothing has changed then.
    pub async fn drive_touch(
        self: &Arc<Self>,
        asker: &Asker,
        id: u64,
        stops: u64,
        touch: &Touch,
    ) -> Result<Touched, Problem> {
        let result = self.try_drive_touch(asker, id, stops, touch).await;
        self.metrics.count_touch(result.is_ok());
        result
    }

    async fn try_drive_touch(
        self: &Arc<Self>,
        asker: &Asker,
        id: u64,
        stops: u64,
        touch: &Touch,
    ) -> Result<Touched, Problem> {
        if self.is_closing() {
            return Err(SessionError::Closed.into());
        }
        let breaks = self.breaks();
        let place = self.admission.place(asker.client).await?;
        // A newer touch, or a stop, may have come while this one waited.
        self.controller.check_newest(id)?;
        if self.stops() != stops {
            return Err(SessionError::Stopped.into());
        }
        if let Some(spans) = &touch.spans {
            let asked_at = AskedAt { stops, breaks: Some(breaks) };
            return self.drive_stretches(asker, place, id, touch, spans.clone(), asked_at).await;
        }
        let plan = tokio::task::block_in_place(|| self.plan_request(touch, &touch.request))?;
        drop(place);
        let asked_at = AskedAt { stops, breaks: None };
        let driven = self.drive_plan(id, asked_at, plan.clone(), touch.fingers.clone(), touch.mode).await?;
        let trade = self.compute_trade(asker, id, touch, &touch.request, &plan).await;
        Ok(Touched { trade, ..driven })
    }

    /// Has the board drive a plan, and shows it.
    pub(super) async fn drive_plan(
        &self,
        id: u64,
        asked_at: AskedAt,
        plan: Plan,
        fingers: Vec<Finger>,
        mode: DriveMode,
    ) -> Result<Touched, Problem> {
        let prepare = || self.equipment.prepare_order(id, asked_at, plan, fingers, mode);
        let order = tokio::task::block_in_place(prepare)?;
        self.controller.drive(order).await
    }

    /// What is known of the device, kept up to date.
    #[must_use]
    pub fn device(&self) -> watch::Receiver<DeviceSnapshot> {
        self.equipment.session.subscribe_snapshots()
    }

    /// What is known of the device now.
    #[must_use]
    pub fn known(&self) -> DeviceSnapshot {
        self.equipment.session.current_snapshot()
    }

    /// How long ago the device last answered; `None` if it never did.
    #[must_use]
    pub fn heard_ago(&self) -> Option<Duration> {
        let is_known = self.equipment.session.subscribe_snapshots().borrow().identity.is_some();
        is_known.then(|| self.equipment.session.time_since_last_answer())
    }

    /// Whether the thread that looks after the device does its work.
    #[must_use]
    pub fn is_alive(&self) -> bool {
        self.equipment.session.is_thread_working()
    }

    /// Resolves when the thread that looks after the device has ended.
    pub async fn session_ended(&self) {
        let mut device = self.equipment.session.subscribe_snapshots();
        while device.changed().await.is_ok() {}
    }

    /// Plans and stops as they happen.
    #[must_use]
    pub fn updates(&self) -> broadcast::Receiver<Update> {
        self.controller.subscribe()
    }

    /// How often everything was stopped so far: what was asked for before a stop is not driven after it.
    #[must_use]
    pub fn stops(&self) -> u64 {
        self.equipment.session.stop_count()
    }

    /// [`DeviceSnapshot::breaks`].
    #[must_use]
    pub fn breaks(&self) -> u64 {
        self.equipment.count_breaks()
    }

    /// Whether the board is off: it has to be armed before it drives.
    #[must_use]
    pub fn is_off(&self) -> bool {
        self.equipment.read_board() == Board::Down
    }

    /// The plan that is being driven.
    #[must_use]
    pub fn active(&self) -> Option<Arc<Active>> {
        self.controller.find_current().map(|current| current.active)
    }

    /// When what is shown ends, if that is plan `id` or a newer one.
    #[must_use]
    pub fn end_of(&self, id: u64) -> Option<Instant> {
        self.controller.find_current().filter(|current| current.active.id >= id).map(|current| current.until)
    }

    /// Ends the drive of plan `id` at `when`: its fingers have been lifted.
    pub fn release(&self, id: u64, when: Instant) {
        self.controller.release(id, when);
    }

    /// Has the drive of plan `id` go on until `until`: its fingers are still down. Whether it is still what is shown.
    pub async fn renew(&self, id: u64, until: Instant) -> bool {
        self.controller.renew(id, until).await
    }

    /// Drops touch `id` if it waits for what is left of those before: there is something newer.
    pub fn withdraw(&self, id: u64) {
        self.controller.withdraw(id);
    }

    /// Switches everything off. What is asked for once this has been polled comes after it.
    ///
    /// # Errors
    /// [`SessionError`]; the board was told to stop all the same where there was a port, and goes off 250 ms after the last frame that
    /// it heard.
    pub async fn stop(&self) -> Result<(), SessionError> {
        // On its way before anything is waited for, a lock as well.
        let mut stopping = std::pin::pin!(self.equipment.session.stop());
        let at_once = std::future::poll_fn(|context| Poll::Ready(stopping.as_mut().poll(context))).await;
        self.controller.end_stopped();
        let result = match at_once {
            Poll::Ready(result) => result,
            Poll::Pending => self.equipment.wait_for_answer(stopping).await,
        };
        self.controller.tell_stopped();
        result
    }

    /// Arms the device, if it is not armed, so that the next touch need not wait for its self-test; it stays armed for the idle time.
    ///
    /// # Errors
    /// [`Problem`]; [`SessionError::Stopped`] if everything was stopped while this waited for its turn.
    pub async fn arm(&self, client: Client) -> Result<(), Problem> {
        let (stops, asked) = (self.stops(), Instant::now());
        let _place = self.admission.place_by_hand(client).await?;
        if self.is_closing() {
            return Err(SessionError::Closed.into());
        }
        Ok(self.equipment.wait_for_answer(self.equipment.session.arm(stops, asked)).await?)
    }

    /// Clears the device's latched fault.
    ///
    /// # Errors
    /// [`Problem`].
    pub async fn clear_faults(&self, client: Client) -> Result<(), Problem> {
        let _place = self.admission.place_by_hand(client).await?;
        Ok(self.equipment.wait_for_answer(self.equipment.session.clear_faults()).await?)
    }

    /// What the sensor has shown under each of the last `most` touches, the newest first; nothing without a simulated sensor.
    #[must_use]
    pub fn touch_peaks(&self, most: usize) -> Vec<TouchPeak> {
        self.equipment.sim.as_ref().map(|sim| sim.touch_peaks(most)).unwrap_or_default()
    }

    /// The largest acceleration under touch `id`, in g; `None` without a simulated sensor.
    #[must_use]
    pub fn touch_peak_g(&self, id: u64) -> Option<f64> {
        self.equipment.sim.as_ref()?.touch_peak(id).map(|peak| peak.peak_m_per_s2 / STANDARD_GRAVITY)
    }

    /// Whether nothing is driven any more because the daemon ends.
    #[must_use]
    pub fn is_closing(&self) -> bool {
        *self.closing.borrow()
    }

    /// Becomes true when the daemon shuts down.
    #[must_use]
    pub fn closing(&self) -> watch::Receiver<bool> {
        self.closing.subscribe()
    }

    /// Drives nothing from here on.
    pub fn begin_closing(&self) {
        self.closing.send_replace(true);
    }
}
