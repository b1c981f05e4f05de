//! What a touch needs, and what it does.

use crate::daemon::access::client::{Asker, Client};
use crate::daemon::access::limits::Limits;
use crate::daemon::access::pace::Pace;
use crate::daemon::access::permissions::Access;
use crate::daemon::api::problem::Problem;
use crate::daemon::design::background::Place;
use crate::daemon::design::preview::{Preview, PreviewRequest, Previews};
use crate::daemon::design::studies::Studies;
use crate::daemon::design::tolerances::Looks;
use crate::daemon::drive::active::{Active, AskedAt, Touched, Update};
use crate::daemon::drive::{Controller, Equipment};
use crate::daemon::observe::metrics::Metrics;
use crate::daemon::observe::recording::Recorder;
use crate::daemon::observe::scene::{SceneTexts, SceneView};
use crate::daemon::touch::admission::Admission;
use crate::daemon::touch::check::Asked;
use crate::daemon::touch::plan_view::TouchView;
use crate::daemon::touch::request::{Manner, TouchRequest};
use crate::device::session::policy::{Needs, Policy};
use crate::device::{OpenDevice, Session, SessionError, Snapshot};
use crate::effects::Intensity;
use crate::planner::residual::Board;
use crate::planner::{Plan, PlanTable};
use std::sync::Arc;
use std::task::Poll;
use std::time::{Duration, Instant};
use tokio::sync::{Semaphore, broadcast, watch};

/// Pages' sockets at once.
pub const SOCKETS: usize = 64;
/// Longest wait for the last stop's answer: a board that is silent has been told by then.
const LAST_STOP: Duration = Duration::from_secs(1);

/// What the daemon works with.
#[derive(Debug)]
pub struct App {
    /// The planner's table, with scene and model.
    pub table: Arc<PlanTable>,
    /// The scene as sent to pages.
    pub(super) scene: SceneTexts,
    /// Counters.
    pub metrics: Metrics,
    /// When the daemon started.
    pub started: Instant,
    /// Who may do what.
    pub access: Arc<Access>,
    /// How often each client is answered.
    pub pace: Arc<Pace>,
    /// Writes down what is asked and what becomes of it, where that is wanted.
    pub record: Option<Recorder>,
    /// What connections may take.
    pub limits: Limits,
    /// Who is next, and what became of whom.
    pub admission: Admission,
    /// Places for pages' sockets.
    pub sockets: Arc<Semaphore>,
    /// The same for those whose token only looks: they take no place from those that touch.
    pub watchers: Arc<Semaphore>,
    pub(super) equipment: Arc<Equipment>,
    pub(super) drive: Controller,
    pub(super) previews: Previews,
    /// Small design studies.
    pub studies: Arc<Studies>,
    /// What tolerances do to plans.
    pub looks: Looks,
    closing: watch::Sender<bool>,
}

impl App {
    /// Starts a session with `device` for the scene of `table`, whose file's text is `scene_toml`.
    ///
    /// # Errors
    /// If the session's thread cannot be started.
    pub fn new(table: PlanTable, device: OpenDevice, scene_toml: String) -> std::io::Result<Self> {
        Self::with(table, device, scene_toml, Policy::default(), Access::default())
    }

    /// The same with what the session does without being asked, and who may do what.
    ///
    /// # Errors
    /// If the session's thread cannot be started.
    pub fn with(
        table: PlanTable,
        device: OpenDevice,
        scene_toml: String,
        policy: Policy,
        access: Access,
    ) -> std::io::Result<Self> {
        let max_voltages_v = table.scene.actuators.iter().map(|actuator| actuator.max_voltage_v).collect();
        let (sim, ready_v) = (device.sim(), table.ready_v());
        let session = Session::start(device, Needs { max_voltages_v, ready_v }, policy)?;
        let table = Arc::new(table);
        let equipment = Arc::new(Equipment { table: Arc::clone(&table), session, sim });
        let place = Place::default();
        let scene_toml: Arc<str> = scene_toml.into();
        Ok(Self {
            scene: SceneTexts::new(&SceneView::new(&table.scene)),
            metrics: Metrics::default(),
            started: Instant::now(),
            access: Arc::new(access),
            pace: Arc::default(),
            record: None,
            limits: Limits::default(),
            admission: Admission::default(),
            sockets: Arc::new(Semaphore::new(SOCKETS)),
            watchers: Arc::new(Semaphore::new(SOCKETS)),
            drive: Controller::new(Arc::clone(&equipment)),
            equipment,
            previews: Previews::new(Arc::clone(&scene_toml)),
            studies: Studies::new(scene_toml, place.clone()),
            looks: Looks::new(place),
            closing: watch::channel(false).0,
            table,
        })
    }

    /// What is known of the device, kept up to date.
    #[must_use]
    pub fn device(&self) -> watch::Receiver<Snapshot> {
        self.equipment.session.snapshots()
    }

    /// What is known of the device now.
    #[must_use]
    pub fn known(&self) -> Snapshot {
        self.equipment.session.known()
    }

    /// Writes a line down, where that is wanted.
    pub fn note(&self, kind: &str, content: impl FnOnce() -> serde_json::Value) {
        if let Some(record) = &self.record {
            record.line(kind, content);
        }
    }

    /// Resolves when the thread that looks after the device has ended.
    pub async fn session_ended(&self) {
        let mut device = self.equipment.session.snapshots();
        while device.changed().await.is_ok() {}
    }

    /// How long ago the device last answered; `None` if it never did.
    #[must_use]
    pub fn heard_ago(&self) -> Option<Duration> {
        let is_known = self.equipment.session.snapshots().borrow().identity.is_some();
        is_known.then(|| self.equipment.session.heard_ago())
    }

    /// Whether the thread that looks after the device does its work.
    #[must_use]
    pub fn is_alive(&self) -> bool {
        self.equipment.session.is_alive()
    }

    /// Plans and stops as they happen.
    #[must_use]
    pub fn updates(&self) -> broadcast::Receiver<Update> {
        self.drive.subscribe()
    }

    /// Becomes true when the daemon shuts down.
    #[must_use]
    pub fn closing(&self) -> watch::Receiver<bool> {
        self.closing.subscribe()
    }

    /// Waits until no page's socket is open any more.
    pub async fn sockets_closed(&self) {
        let all = u32::try_from(SOCKETS).unwrap_or(u32::MAX);
        for places in [&self.sockets, &self.watchers] {
            let _ = places.acquire_many(all).await;
        }
    }

    /// Stops the device, before anything else ends; nothing is driven from here on.
    pub async fn close(&self) {
        self.closing.send_replace(true);
        self.studies.stop();
        self.looks.stop();
        let problem = match tokio::time::timeout(LAST_STOP, self.stop()).await {
            Ok(result) => result.err(),
            Err(_) => Some(SessionError::Hangs),
        };
        if let Some(error) = problem {
            tracing::warn!(%error, "could not stop the device on leaving; its dead-man timer does it");
        }
    }

    /// What a changed scene would do; drives nothing. `read` gives what was asked for.
    ///
    /// # Errors
    /// [`Problem`]: a scene, move or touch that cannot be used, a newer request of the same client while this one waited, or one that takes too long.
    pub async fn compute_preview(
        &self,
        asker: &Asker,
        read: impl FnOnce() -> Result<PreviewRequest, Problem> + Send + 'static,
    ) -> Result<Preview, Problem> {
        let result = self.previews.compute_in_turn(asker.client, &asker.sender, read).await;
        self.metrics.count_preview(result.is_ok());
        result
    }

    /// How often everything was stopped so far: what was asked for before a stop is not driven after it.
    #[must_use]
    pub fn stops(&self) -> u64 {
        self.equipment.session.stops()
    }

    /// [`Snapshot::breaks`].
    pub fn breaks(&self) -> u64 {
        self.equipment.count_breaks()
    }

    /// Plans for a touch, the request `id` of `asker`, with all that belongs to it, and drives it unless everything was
    /// stopped since [`App::stops`] said `stops`.
    ///
    /// # Errors
    /// [`Problem`] that names what is wrong; nothing has changed then.
    pub async fn touch(
        self: &Arc<Self>,
        asker: &Asker,
        id: u64,
        stops: u64,
        request: &TouchRequest,
    ) -> Result<Touched, Problem> {
        let asked = request.asked(&self.table.scene);
        let result = match asked {
            Ok(asked) => self.try_touch(asker, id, stops, &asked).await,
            Err(problem) => Err(problem),
        };
        self.metrics.count_touch(result.is_ok());
        result
    }

    /// Plans for all fingers at once and drives them as `manner` says.
    ///
    /// # Errors
    /// As [`App::touch`].
    pub async fn touch_all(
        self: &Arc<Self>,
        client: Client,
        id: u64,
        stops: u64,
        touches: Vec<TouchView>,
        intensity: Option<Intensity>,
        manner: Manner,
    ) -> Result<Touched, Problem> {
        let result = match Asked::fingers(touches, intensity, manner, &self.table.scene) {
            Ok(asked) => {
                let asker = Asker { client, ..Asker::default() };
                self.try_touch(&asker, id, stops, &asked).await
            }
            Err(problem) => Err(problem),
        };
        self.metrics.count_touch(result.is_ok());
        result
    }

    async fn try_touch(
        self: &Arc<Self>,
        asker: &Asker,
        id: u64,
        stops: u64,
        asked: &Asked,
    ) -> Result<Touched, Problem> {
        if *self.closing.borrow() {
            return Err(SessionError::Closed.into());
        }
        let breaks = self.breaks();
        let place = self.admission.place(asker.client).await?;
        // Whoever has waited may not be wanted any more.
        self.drive.check_newest(id)?;
        if self.equipment.session.stops() != stops {
            return Err(SessionError::Stopped.into());
        }
        if let Some(spans) = &asked.spans {
            let since = AskedAt { stops, breaks: Some(breaks) };
            return self.in_stretches(asker, place, id, asked, spans.clone(), since).await;
        }
        let plan = tokio::task::block_in_place(|| self.plan(asked, &asked.request))?;
        drop(place);
        let since = AskedAt { stops, breaks: None };
        let driven = self.drive_plan(id, since, plan.clone(), asked.touches.clone(), asked.manner).await?;
        let trade = self.trade(asker, id, asked, &asked.request, &plan).await;
        Ok(Touched { trade, ..driven })
    }

    /// Drives a plan and shows it.
    pub(super) async fn drive_plan(
        &self,
        id: u64,
        since: AskedAt,
        plan: Plan,
        touches: Vec<TouchView>,
        manner: Manner,
    ) -> Result<Touched, Problem> {
        let prepare = || self.equipment.prepare_order(id, since, plan, touches, manner);
        let order = tokio::task::block_in_place(prepare)?;
        self.drive.drive(order).await
    }

    /// The plan that is being driven.
    #[must_use]
    pub fn active(&self) -> Option<Arc<Active>> {
        self.drive.find_current().map(|current| current.active)
    }

    /// When what is shown ends, if that is plan `id` or a newer one.
    pub fn end_of(&self, id: u64) -> Option<Instant> {
        self.drive.find_current().filter(|current| current.active.id >= id).map(|current| current.until)
    }

    /// Ends the drive of plan `id` at `when`: its fingers have been lifted.
    pub fn release(&self, id: u64, when: Instant) {
        self.drive.release(id, when);
    }

    /// Has the drive of plan `id` go on until `until`: its fingers are still down. Whether it is still what is shown.
    pub async fn renew(&self, id: u64, until: Instant) -> bool {
        self.drive.renew(id, until).await
    }

    /// Drops touch `id` if it waits for what is left of those before: there is something newer.
    pub fn withdraw(&self, id: u64) {
        self.drive.withdraw(id);
    }

    /// Whether the board is off: it has to be armed before it drives.
    pub fn is_off(&self) -> bool {
        self.equipment.read_board() == Board::Down
    }

    /// Everything off. What is asked for once this has been polled comes after it.
    ///
    /// # Errors
    /// [`SessionError`]; the board was told to all the same where there was a port, and goes off 250 ms after the last frame that it heard.
    pub async fn stop(&self) -> Result<(), SessionError> {
        // On its way before anything is waited for, a lock as well.
        let mut stopping = std::pin::pin!(self.equipment.session.stop());
        let at_once = std::future::poll_fn(|context| Poll::Ready(stopping.as_mut().poll(context))).await;
        self.drive.end_stopped();
        let result = match at_once {
            Poll::Ready(result) => result,
            Poll::Pending => self.equipment.wait_for_answer(stopping).await,
        };
        self.note("stopped", || serde_json::json!({"problem": result.as_ref().err().map(ToString::to_string)}));
        self.drive.tell_stopped();
        result
    }

    /// Arms the device, if it is not, so that the next touch need not wait for its self-test; it stays armed for the idle
    /// time.
    ///
    /// # Errors
    /// [`Problem`]; [`SessionError::Stopped`] if everything was stopped while it waited for its turn.
    pub async fn arm(&self, client: Client) -> Result<(), Problem> {
        let (stops, asked) = (self.stops(), Instant::now());
        let _place = self.admission.place_by_hand(client).await?;
        if *self.closing.borrow() {
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
}

/// Resolves when the daemon ends.
pub async fn closed(closing: &mut watch::Receiver<bool>) {
    // An error means that it is gone already.
    let _ = closing.wait_for(|closing| *closing).await.map(|_| ());
}
