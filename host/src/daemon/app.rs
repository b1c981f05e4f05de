//! What a touch needs, and what it does.

use super::access::Access;
use super::active::{Active, Held, Shown, Since, Touched, Update};
use super::admission::Admission;
use super::answers::scene::{SceneTexts, SceneView};
use super::answers::touched::Achieved;
use super::asked::Asked;
use super::background::Place;
use super::client::{Asker, Client};
use super::limits::Limits;
use super::metrics::Metrics;
use super::preview::{Preview, PreviewRequest, Previews};
use super::problem::Problem;
use super::record::Recorder;
use super::studies::Studies;
use super::thin::Thinned;
use super::tolerances::Looks;
use super::touch::{Manner, TouchRequest};
use super::turns::{Turn, Turns, board};
use super::view::{PlanView, TouchView};
use crate::device::convert::to_wire;
use crate::device::session::policy::{Needs, Policy};
use crate::device::sim::SimControl;
use crate::device::{DriveOrder, EffectOrder, LinkError, OpenDevice, Session, SessionError, Snapshot};
use crate::effects::{Design, Intensity};
use crate::planner::drive::on_channels;
use crate::planner::plan_motion::PlanMotion;
use crate::planner::{Drive, Plan, PlanTable};
use era_shared::limits::REST_MS;
use era_shared::protocol::Refusal;
use std::sync::atomic::AtomicBool;
use std::sync::{Arc, Mutex, PoisonError};
use std::task::Poll;
use std::time::{Duration, Instant};
use tokio::sync::{Semaphore, broadcast, watch};

/// Pages' sockets at once.
pub const SOCKETS: usize = 64;
/// Between two looks whether the session that is to answer still lives.
const LOOK: Duration = Duration::from_millis(250);
/// Longest wait for the last stop's answer: a board that is silent has been told by then.
const LAST_STOP: Duration = Duration::from_secs(1);
/// Events kept for a slow page before it misses some.
const EVENTS: usize = 16;

/// What the daemon works with.
#[derive(Debug)]
pub struct App {
    /// The planner's table, with scene and model.
    pub table: PlanTable,
    /// The scene as sent to pages.
    pub(super) scene: SceneTexts,
    /// Counters.
    pub metrics: Metrics,
    /// When the daemon started.
    pub started: Instant,
    /// Who may do what.
    pub access: Arc<Access>,
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
    pub(super) session: Session,
    pub(super) previews: Previews,
    /// Small design studies.
    pub studies: Arc<Studies>,
    /// What tolerances do to plans.
    pub looks: Looks,
    pub(super) sim: Option<SimControl>,
    /// The last plan.
    pub(super) active: Mutex<Option<Shown>>,
    pub(super) turns: Turns,
    /// What is looked after ([`super::tend`]).
    pub(super) held: watch::Sender<Option<Held>>,
    pub(super) tends: AtomicBool,
    pub(super) updates: broadcast::Sender<Update>,
    closing: watch::Sender<bool>,
}

/// What a plan needs to be driven.
pub(super) struct Prepared {
    pub(super) motion: PlanMotion,
    pub(super) kind: Kind,
}

/// What has begun.
pub(super) struct Begun {
    /// What the device achieves.
    pub(super) device: Achieved,
    /// When it ends.
    pub(super) until: Instant,
    /// [`Turn::drives`].
    pub(super) begun: u64,
}

pub(super) enum Kind {
    Hold(Duration),
    Effect(Box<Design>),
}

impl Prepared {
    /// Even drives.
    pub(super) fn drives<'a>(&self, plan: &'a Plan) -> Option<&'a [Drive]> {
        matches!(self.kind, Kind::Hold(_)).then_some(plan.drives.as_slice())
    }
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
        let place = Place::default();
        let scene_toml: Arc<str> = scene_toml.into();
        Ok(Self {
            scene: SceneTexts::new(&SceneView::new(&table.scene)),
            metrics: Metrics::default(),
            started: Instant::now(),
            access: Arc::new(access),
            record: None,
            limits: Limits::default(),
            admission: Admission::default(),
            sockets: Arc::new(Semaphore::new(SOCKETS)),
            watchers: Arc::new(Semaphore::new(SOCKETS)),
            session: Session::start(device, Needs { max_voltages_v, ready_v }, policy)?,
            previews: Previews::new(Arc::clone(&scene_toml)),
            studies: Studies::new(scene_toml, place.clone()),
            looks: Looks::new(place),
            sim,
            active: Mutex::new(None),
            turns: Turns::new(table.decaying_modes()),
            held: watch::channel(None).0,
            tends: AtomicBool::new(false),
            updates: broadcast::channel(EVENTS).0,
            closing: watch::channel(false).0,
            table,
        })
    }

    /// What is known of the device, kept up to date.
    #[must_use]
    pub fn device(&self) -> watch::Receiver<Snapshot> {
        self.session.snapshots()
    }

    /// What is known of the device now.
    #[must_use]
    pub fn known(&self) -> Snapshot {
        self.session.known()
    }

    /// Waits for the session's answer, and no longer than its thread shows that it lives.
    async fn answered<T>(&self, answer: impl Future<Output = Result<T, SessionError>>) -> Result<T, SessionError> {
        let mut answer = std::pin::pin!(answer);
        loop {
            match tokio::time::timeout(LOOK, &mut answer).await {
                Ok(answer) => return answer,
                Err(_) if self.session.hangs() => return Err(SessionError::Hangs),
                Err(_) => {}
            }
        }
    }

    /// Writes a line down, where that is wanted.
    pub fn note(&self, kind: &str, content: impl FnOnce() -> serde_json::Value) {
        if let Some(record) = &self.record {
            record.line(kind, content);
        }
    }

    /// Resolves when the thread that looks after the device has ended.
    pub async fn session_ended(&self) {
        let mut device = self.session.snapshots();
        while device.changed().await.is_ok() {}
    }

    /// How long ago the device last answered; `None` if it never did.
    #[must_use]
    pub fn heard_ago(&self) -> Option<Duration> {
        let is_known = self.session.snapshots().borrow().identity.is_some();
        is_known.then(|| self.session.heard_ago())
    }

    /// Whether the thread that looks after the device does its work.
    #[must_use]
    pub fn is_alive(&self) -> bool {
        self.session.is_alive()
    }

    /// Plans and stops as they happen.
    #[must_use]
    pub fn updates(&self) -> broadcast::Receiver<Update> {
        self.updates.subscribe()
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

    /// [`Turns::again`].
    pub(super) async fn turn_again(&self, id: u64, begun: u64) -> Option<Turn<'_>> {
        self.turns.again(id, begun, || board(&self.session.snapshots().borrow())).await
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
        self.session.stops()
    }

    /// [`Snapshot::breaks`].
    pub fn breaks(&self) -> u64 {
        self.session.snapshots().borrow().breaks
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
        self.turns.check(id)?;
        if self.session.stops() != stops {
            return Err(SessionError::Stopped.into());
        }
        if let Some(spans) = &asked.spans {
            let since = Since { stops, breaks: Some(breaks) };
            return self.in_stretches(asker, place, id, asked, spans.clone(), since).await;
        }
        let plan = tokio::task::block_in_place(|| self.plan(asked, &asked.request))?;
        drop(place);
        let since = Since { stops, breaks: None };
        let driven = self.driven(id, since, plan.clone(), &asked.touches, asked.manner).await?;
        let trade = self.trade(asker, id, asked, &asked.request, &plan).await;
        Ok(Touched { trade, ..driven })
    }

    /// Drives a plan and shows it.
    pub(super) async fn driven(
        self: &Arc<Self>,
        id: u64,
        since: Since,
        plan: Plan,
        touches: &[TouchView],
        manner: Manner,
    ) -> Result<Touched, Problem> {
        // One at a time, and what has been driven is not overtaken by a stretch of something older.
        let board = || board(&self.session.snapshots().borrow());
        let release = |older: u64| self.release(older, Instant::now());
        let is_stopped = || self.session.stops() != since.stops;
        let whole = plan.clone();
        let (thin, (plan, prepared)) = tokio::task::block_in_place(|| {
            let prepared = self.prepared(&plan, 1.0, manner)?;
            self.thinned(plan, prepared, manner)
        })?;
        let turn = self.turns.take(id, &prepared.motion, prepared.drives(&plan), board, release, is_stopped).await?;
        let first = (plan, prepared);
        let (part, (plan, prepared)) = tokio::task::block_in_place(|| self.fitted(&turn, first, &whole, thin, manner))?;
        self.put_sensor(id, &plan);
        let breaks = since.breaks.or_else(|| Some(self.breaks()));
        // Until it goes to the board: what that takes to answer is no wait.
        let delayed = turn.delayed();
        let begun = self.begun(&turn, since, &plan, &prepared).await;
        if begun.is_err()
            && let Some(active) = self.active()
        {
            // What was driven before goes on, and so does its measurement.
            self.put_sensor(active.id, active.plan.plan());
        }
        let Begun { device, until, begun } = begun?;
        let device = device.delayed(delayed);
        drop(turn);
        let active = match &prepared.kind {
            Kind::Hold(_) => self.shown(id, plan, touches, Thinned::by_credit(thin)),
            // What is told is what the effect does, and not the even motion that it was designed from.
            Kind::Effect(design) => {
                let plan = PlanView::played(plan, design);
                Arc::new(Active::new(id, plan, touches.to_vec(), device.effect().cloned()))
            }
        };
        let is_shown = self.activate(&active, until, since.stops).inspect_err(|_| {
            // The stop came after the board's answer: what was entered since then is not driven.
            self.turns.end_of(id, Instant::now());
        })?;
        if matches!(manner, Manner::Hold(_)) && is_shown {
            self.tend(Held { begun, since: Since { breaks, ..since }, whole, thin, part, active: Arc::clone(&active) });
        }
        Ok(Touched { active, device, stretches: None, trade: None, is_shown })
    }

    /// Has the device drive what it is the turn of.
    pub(super) async fn begun(
        &self,
        turn: &Turn<'_>,
        since: Since,
        plan: &Plan,
        prepared: &Prepared,
    ) -> Result<Begun, Problem> {
        let Prepared { motion, kind } = prepared;
        let planned = prepared.drives(plan);
        let (id, Since { stops, breaks }) = (turn.id(), since);
        let begun = match kind {
            Kind::Hold(hold) => {
                let drives = on_channels(&plan.drives).iter().map(to_wire).collect();
                let order = DriveOrder { id, stops, breaks, drives, hold: *hold, from_zero: turn.is_soft() };
                let mut driven = self.answered(self.session.drive(order.clone())).await;
                // A burst of before this daemon's time, or of drives that it does not look after.
                if let Err(SessionError::Link(LinkError::Refused(Refusal::Duty { wait_ms, .. }))) = &driven
                    && *wait_ms <= REST_MS
                {
                    tokio::time::sleep(Duration::from_millis(u64::from(*wait_ms) + 1)).await;
                    driven = self.answered(self.session.drive(order)).await;
                }
                driven.map(|driven| (Achieved::new(plan, &driven.achieved), Instant::now() + *hold))
            }
            Kind::Effect(design) => {
                let drives = design.wire_drives().iter().map(to_wire).collect();
                let effects = design.drives.iter().map(|drive| drive.effect.clone()).collect();
                let order = EffectOrder { id, stops, drives, effects, start: None };
                let played = self.answered(self.session.play(order)).await;
                played.map(|played| (Achieved::played(plan, design, &played), played.start + played.length))
            }
        };
        match begun {
            Ok((device, until)) => Ok(Begun { device, until, begun: turn.drives(motion, planned, until) }),
            Err(error) => {
                // Whether the device has heard of it is not known.
                if matches!(&error, SessionError::Link(error) if !matches!(error, LinkError::Refused(_) | LinkError::TooOld { .. }))
                {
                    turn.drives(motion, planned, Instant::now());
                }
                Err(error.into())
            }
        }
    }

    /// Drops touches that wait for what is left of those before: there is something newer.
    pub fn drop_waiting(&self) {
        self.turns.drop_waiting();
    }

    /// Ends what is driven for older plans than `id`, which drives nothing yet.
    pub(super) async fn make_way(&self, id: u64) {
        let Ok(newest) = self.turns.overtake(id).await else { return };
        newest.stays();
        if let Some(active) = self.active().filter(|active| active.id < id) {
            self.release(active.id, Instant::now());
        }
    }

    /// Everything off. What is asked for once this has been polled comes after it.
    ///
    /// # Errors
    /// [`SessionError`]; the board was told to all the same where there was a port, and goes off 250 ms after the last frame that it heard.
    pub async fn stop(&self) -> Result<(), SessionError> {
        // On its way before anything is waited for, a lock as well.
        let mut stopping = std::pin::pin!(self.session.stop());
        let at_once = std::future::poll_fn(|context| Poll::Ready(stopping.as_mut().poll(context))).await;
        self.turns.stop();
        self.turns.drop_waiting();
        let result = match at_once {
            Poll::Ready(result) => result,
            Poll::Pending => self.answered(stopping).await,
        };
        self.note("stopped", || serde_json::json!({"problem": result.as_ref().err().map(ToString::to_string)}));
        // One that was asked for after it stays.
        let is_older = |shown: &mut Shown| shown.stops != self.session.stops();
        self.active.lock().unwrap_or_else(PoisonError::into_inner).take_if(is_older);
        let _ = self.updates.send(Update::Stopped);
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
        Ok(self.answered(self.session.arm(stops, asked)).await?)
    }

    /// Clears the device's latched fault.
    ///
    /// # Errors
    /// [`Problem`].
    pub async fn clear_faults(&self, client: Client) -> Result<(), Problem> {
        let _place = self.admission.place_by_hand(client).await?;
        Ok(self.answered(self.session.clear_faults()).await?)
    }
}

/// Resolves when the daemon ends.
pub async fn closed(closing: &mut watch::Receiver<bool>) {
    // An error means that it is gone already.
    let _ = closing.wait_for(|closing| *closing).await.map(|_| ());
}
