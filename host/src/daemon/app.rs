//! All parts of a daemon.

use super::access::client::Asker;
use super::access::limits::Limits;
use super::access::pace::RequestRateLimiter;
use super::access::permissions::Access;
use super::api::problem::Problem;
use super::design::background::BackgroundPlace;
use super::design::preview::{Preview, PreviewRequest, Previews};
use super::design::studies::Studies;
use super::design::tolerances::{ToleranceStudies, TolerancesRequest, TolerancesView};
use super::drive::{DriveEquipment, TouchDriver};
use super::observe::metrics::Metrics;
use super::observe::recording::Recorder;
use super::observe::scene::{SceneTexts, SceneView};
use super::observe::state::{MOST_PEAKS, MeasuredView, StateView, ViewSources};
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
    pub driver: Arc<TouchDriver>,
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
    pub pace: Arc<RequestRateLimiter>,
    /// How often messages on live sockets of each client are read.
    pub(super) live_pace: RequestRateLimiter,
    /// Writes down what is asked and what becomes of it, where that is wanted.
    pub record: Option<Recorder>,
    /// What connections may take.
    pub limits: Limits,
    /// Places for pages' sockets.
    pub sockets: Arc<Semaphore>,
    /// The same for those whose token only looks: they take no place from those that touch.
    pub watchers: Arc<Semaphore>,
    pub(super) previews: Previews,
    background: BackgroundPlace,
    /// Small design studies.
    pub studies: Arc<Studies>,
    /// What tolerances do to plans.
    pub tolerances: Arc<ToleranceStudies>,
}

impl App {
    /// Starts a session with `device` for the scene of `table`, whose file's text is `scene_toml`.
    ///
    /// # Errors
    /// If the session's thread cannot be started.
    pub fn new(table: PlanTable, device: OpenDevice, scene_toml: String) -> std::io::Result<Self> {
        Self::start_session_with_policy_and_access(
            table,
            device,
            scene_toml,
            SessionPolicy::default(),
            Access::default(),
        )
    }

    /// The same with what the session does without being asked, and who may do what.
    ///
    /// # Errors
    /// If the session's thread cannot be started.
    pub fn start_session_with_policy_and_access(
        table: PlanTable,
        device: OpenDevice,
        scene_toml: String,
        policy: SessionPolicy,
        access: Access,
    ) -> std::io::Result<Self> {
        let max_voltages_v = table.scene.actuators.iter().map(|actuator| actuator.max_voltage_v).collect();
        let (sim, ready_v) =
            (device.sim_control_if_simulated(), table.max_rail_voltage_with_masses_at_rest_of_each_actuator_v());
        let session = Session::start(device, SceneNeeds { max_voltages_v, ready_v }, policy)?;
        let table = Arc::new(table);
        let metrics = Arc::<Metrics>::default();
        let equipment = DriveEquipment::new(Arc::clone(&table), session, sim);
        let place = BackgroundPlace::default();
        let scene_toml: Arc<str> = scene_toml.into();
        Ok(Self {
            background: place.clone(),
            scene: SceneTexts::new(&SceneView::new(&table.scene)),
            started: Instant::now(),
            access: Arc::new(access),
            pace: Arc::default(),
            live_pace: RequestRateLimiter::default(),
            record: None,
            limits: Limits::default(),
            sockets: Arc::new(Semaphore::new(SOCKETS)),
            watchers: Arc::new(Semaphore::new(SOCKETS)),
            driver: Arc::new(TouchDriver::new(equipment, Arc::clone(&metrics))),
            metrics,
            previews: Previews::new(Arc::clone(&scene_toml)),
            studies: Studies::new(scene_toml, place.clone()),
            tolerances: Arc::new(ToleranceStudies::new(place)),
            table,
        })
    }

    /// Writes a line down, where that is wanted.
    pub fn record_line(&self, kind: &str, content: impl FnOnce() -> serde_json::Value) {
        if let Some(record) = &self.record {
            record.queue_line_or_count_as_left_out_if_full(kind, content);
        }
    }

    /// Waits until no page's socket is open any more.
    pub async fn wait_until_all_sockets_closed(&self) {
        let all = u32::try_from(SOCKETS).unwrap_or(u32::MAX);
        for places in [&self.sockets, &self.watchers] {
            let _ = places.acquire_many(all).await;
        }
    }

    /// Stops the device, before anything else ends; nothing is driven from here on.
    pub async fn begin_closing_and_stop_studies_and_device(&self) {
        self.driver.begin_closing();
        self.background.close();
        self.studies.stop_newest_study();
        self.tolerances.stop_newest_study();
        let problem = match tokio::time::timeout(LAST_STOP, self.stop_device()).await {
            Ok(result) => result.err(),
            Err(_) => Some(SessionError::Hangs),
        };
        if let Some(error) = problem {
            tracing::warn!(
                %error,
                "could not stop the device at shutdown; the device's dead-man timer switches its high voltage off"
            );
        }
    }

    /// What a changed scene would do; drives nothing. `parse_request` gives what was asked for.
    ///
    /// # Errors
    /// [`Problem`]: a scene, move or touch that cannot be used, a newer request of the same client while this one waited, or one that takes too long.
    pub async fn compute_preview(
        &self,
        asker: &Asker,
        parse_request: impl FnOnce() -> Result<PreviewRequest, Problem> + Send + 'static,
    ) -> Result<Preview, Problem> {
        let result = self.previews.compute_preview_in_turn(asker.client, &asker.sender, parse_request).await;
        self.metrics.count_preview(result.is_ok());
        result
    }

    /// Everything there is to know now.
    #[must_use]
    pub fn build_state_view(&self) -> StateView {
        let (active, heard_ago) = (self.driver.find_active_plan(), self.driver.time_since_last_answer());
        let device = self.driver.current_device_snapshot_marked_disconnected_if_thread_hung();
        StateView::new(&self.collect_view_sources(&device), active.as_deref(), heard_ago, self.started.elapsed())
    }

    /// What a recording keeps of the device.
    #[must_use]
    pub fn build_recorded_device_view(&self, device: &DeviceSnapshot) -> MeasuredView {
        MeasuredView::new(&self.collect_view_sources(device))
    }

    fn collect_view_sources<'a>(&'a self, device: &'a DeviceSnapshot) -> ViewSources<'a> {
        let touch_peaks = self.driver.list_simulated_sensor_peaks_of_newest_touches(MOST_PEAKS);
        ViewSources { device, actuators: &self.table.scene.actuators, touch_peaks }
    }

    /// Switches everything off, and records that. What is asked for once this has been polled comes after it.
    ///
    /// # Errors
    /// If the session cannot confirm the stop.
    pub async fn stop_device(&self) -> Result<(), SessionError> {
        let result = self.driver.stop_device().await;
        self.record_line("stopped", || serde_json::json!({"problem": result.as_ref().err().map(ToString::to_string)}));
        result
    }

    /// Begins to look at what tolerances do to the plan for a touch; drives nothing. `parse_request` gives what was asked for.
    ///
    /// # Errors
    /// [`Problem`]: a touch, tolerance, scene or move that cannot be used, a scene without a plan, or work that is under way.
    pub async fn begin_tolerance_study_of_requested_touch(
        &self,
        asker: &Asker,
        parse_request: impl FnOnce() -> Result<TolerancesRequest, Problem> + Send + 'static,
    ) -> Result<TolerancesView, Problem> {
        if self.driver.is_closing() {
            return Err(SessionError::Closed.into());
        }
        self.tolerances
            .begin_study_for_request_unless_busy(&self.table, self.previews.own_scene_toml(), asker, parse_request)
            .await
    }
}
