//! All parts of a daemon.

use super::access::client::Asker;
use super::access::limits::Limits;
use super::access::pace::Pace;
use super::access::permissions::Access;
use super::api::problem::Problem;
use super::design::background::Place;
use super::design::preview::{Preview, PreviewRequest, Previews};
use super::design::studies::Studies;
use super::design::tolerances::{Looks, TolerancesRequest, TolerancesView};
use super::drive::{Driver, Equipment};
use super::observe::metrics::Metrics;
use super::observe::recording::Recorder;
use super::observe::scene::{SceneTexts, SceneView};
use super::observe::state::{DrivenPlan, MOST_PEAKS, MeasuredView, Sources, StateView};
use crate::device::session::policy::{SceneNeeds, SessionPolicy};
use crate::device::{DeviceSnapshot, OpenDevice, Session, SessionError};
use crate::planner::PlanTable;
use std::sync::Arc;
use std::time::{Duration, Instant};
use tokio::sync::Semaphore;

/// Pages' sockets at once.
pub const SOCKETS: usize = 64;
/// Longest wait for the last stop's answer: a board that is silent has been told by then.
const LAST_STOP: Duration = Duration::from_secs(1);

/// All parts of a daemon.
#[derive(Debug)]
pub struct App {
    /// Plans touches and has the board drive them.
    pub driver: Arc<Driver>,
    /// The planner's table, with scene and model: the driver's.
    pub table: Arc<PlanTable>,
    /// The scene as sent to pages.
    pub(super) scene: SceneTexts,
    /// Counters: the driver's.
    pub metrics: Arc<Metrics>,
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
    /// Places for pages' sockets.
    pub sockets: Arc<Semaphore>,
    /// The same for those whose token only looks: they take no place from those that touch.
    pub watchers: Arc<Semaphore>,
    pub(super) previews: Previews,
    /// Small design studies.
    pub studies: Arc<Studies>,
    /// What tolerances do to plans.
    pub looks: Arc<Looks>,
}

impl App {
    /// Starts a session with `device` for the scene of `table`, whose file's text is `scene_toml`.
    ///
    /// # Errors
    /// If the session's thread cannot be started.
    pub fn new(table: PlanTable, device: OpenDevice, scene_toml: String) -> std::io::Result<Self> {
        Self::with(table, device, scene_toml, SessionPolicy::default(), Access::default())
    }

    /// The same with what the session does without being asked, and who may do what.
    ///
    /// # Errors
    /// If the session's thread cannot be started.
    pub fn with(
        table: PlanTable,
        device: OpenDevice,
        scene_toml: String,
        policy: SessionPolicy,
        access: Access,
    ) -> std::io::Result<Self> {
        let max_voltages_v = table.scene.actuators.iter().map(|actuator| actuator.max_voltage_v).collect();
        let (sim, ready_v) = (device.sim_control(), table.ready_v());
        let session = Session::start(device, SceneNeeds { max_voltages_v, ready_v }, policy)?;
        let table = Arc::new(table);
        let metrics = Arc::<Metrics>::default();
        let equipment = Equipment { table: Arc::clone(&table), session, sim };
        let place = Place::default();
        let scene_toml: Arc<str> = scene_toml.into();
        Ok(Self {
            scene: SceneTexts::new(&SceneView::new(&table.scene)),
            started: Instant::now(),
            access: Arc::new(access),
            pace: Arc::default(),
            record: None,
            limits: Limits::default(),
            sockets: Arc::new(Semaphore::new(SOCKETS)),
            watchers: Arc::new(Semaphore::new(SOCKETS)),
            driver: Arc::new(Driver::new(equipment, Arc::clone(&metrics))),
            metrics,
            previews: Previews::new(Arc::clone(&scene_toml)),
            studies: Studies::new(scene_toml, place.clone()),
            looks: Arc::new(Looks::new(place)),
            table,
        })
    }

    /// Writes a line down, where that is wanted.
    pub fn note(&self, kind: &str, content: impl FnOnce() -> serde_json::Value) {
        if let Some(record) = &self.record {
            record.line(kind, content);
        }
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
        self.driver.begin_closing();
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

    /// Everything there is to know now.
    #[must_use]
    pub fn view_state(&self) -> StateView {
        let (active, heard_ago) = (self.driver.active(), self.driver.heard_ago());
        let device = self.driver.known();
        let driven = active.map(|active| DrivenPlan {
            id: active.id,
            plan: active.plan.clone(),
            fingers: active.touches.clone(),
        });
        StateView::new(&self.sources(&device), driven, heard_ago, self.started.elapsed())
    }

    /// What a recording keeps of the device.
    #[must_use]
    pub fn view_measured(&self, device: &DeviceSnapshot) -> MeasuredView {
        MeasuredView::new(&self.sources(device))
    }

    fn sources<'a>(&'a self, device: &'a DeviceSnapshot) -> Sources<'a> {
        let touch_peaks = self.driver.touch_peaks(MOST_PEAKS);
        Sources { device, actuators: &self.table.scene.actuators, touch_peaks }
    }

    /// Switches everything off, and records that. What is asked for once this has been polled comes after it.
    ///
    /// # Errors
    /// If the session cannot confirm the stop.
    pub async fn stop(&self) -> Result<(), SessionError> {
        let result = self.driver.stop().await;
        self.note("stopped", || serde_json::json!({"problem": result.as_ref().err().map(ToString::to_string)}));
        result
    }

    /// Begins to look at what tolerances do to the plan for a touch; drives nothing. `read` gives what was asked for.
    ///
    /// # Errors
    /// [`Problem`]: a touch, tolerance, scene or move that cannot be used, a scene without a plan, or work that is under way.
    pub async fn begin_tolerances(
        &self,
        asker: &Asker,
        read: impl FnOnce() -> Result<TolerancesRequest, Problem> + Send + 'static,
    ) -> Result<TolerancesView, Problem> {
        if self.driver.is_closing() {
            return Err(SessionError::Closed.into());
        }
        self.looks.begin_for_request(&self.table, self.previews.own(), &asker.sender, read).await
    }
}
