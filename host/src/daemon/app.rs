//! What a touch needs, and what it does.

use super::metrics::Metrics;
use super::problem::Problem;
use super::view::{FieldView, PlanView, SceneView, TouchView};
use crate::device::convert::{SiDrive, to_wire};
use crate::device::sim::SimControl;
use crate::device::{OpenDevice, Session, SessionError, Snapshot};
use crate::planner::{Plan, PlanTable, Target};
use serde::Deserialize;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};
use tokio::sync::{broadcast, watch};

/// How long a touch vibrates if it does not say.
pub const DEFAULT_DURATION_MS: u32 = 1_000;
/// Shortest in ms: two periods at the lowest frequency that is rendered (40 Hz).
pub const MIN_DURATION_MS: u32 = 50;
/// Longest in ms. A finger held on a page is renewed within it, and nobody needs more from one request.
pub const MAX_DURATION_MS: u32 = 10_000;
/// Events kept for a slow page before it misses some.
const EVENTS: usize = 16;

/// A touch as the HTTP interface takes it.
#[derive(Clone, Copy, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TouchRequest {
    /// In pixels of the scene's screen, from its left edge.
    pub x_px: f64,
    /// From its top edge.
    pub y_px: f64,
    /// Peak wanted in g.
    pub intensity_g: Option<f64>,
    /// How long, in ms.
    pub duration_ms: Option<u32>,
}

/// The current plan and what goes with it.
#[derive(Clone, Debug)]
pub struct Active {
    /// Counts plans from 1.
    pub id: u64,
    /// The plan as sent to clients.
    pub plan: PlanView,
    /// Its field.
    pub field: FieldView,
    /// The fingers it is for.
    pub touches: Vec<TouchView>,
}

/// What open pages are told at once.
#[derive(Clone, Debug)]
pub enum Update {
    /// There is a new plan.
    Plan(Arc<Active>),
    /// Everything was stopped.
    Stopped,
}

/// What the daemon works with.
#[derive(Debug)]
pub struct App {
    /// The planner's table, with scene and model.
    pub table: PlanTable,
    /// The scene as sent to pages.
    pub scene: SceneView,
    /// Counters.
    pub metrics: Metrics,
    /// When the daemon started.
    pub started: Instant,
    session: Session,
    sim: Option<SimControl>,
    active: Mutex<Option<Arc<Active>>>,
    next_id: Mutex<u64>,
    updates: broadcast::Sender<Update>,
    closing: watch::Sender<bool>,
}

impl App {
    /// Starts a session with `device` for the scene of `table`.
    ///
    /// # Errors
    /// If the session's thread cannot be started.
    pub fn new(table: PlanTable, device: OpenDevice) -> std::io::Result<Self> {
        let sim = device.sim();
        Ok(Self {
            scene: SceneView::new(&table.scene),
            metrics: Metrics::default(),
            started: Instant::now(),
            session: Session::start(device)?,
            sim,
            active: Mutex::new(None),
            next_id: Mutex::new(0),
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

    /// Plans and stops as they happen.
    #[must_use]
    pub fn updates(&self) -> broadcast::Receiver<Update> {
        self.updates.subscribe()
    }

    /// Becomes true when the daemon shuts down.
    #[must_use]
    pub fn closing(&self) -> watch::Sender<bool> {
        self.closing.clone()
    }

    /// The current plan.
    #[must_use]
    pub fn active(&self) -> Option<Arc<Active>> {
        self.active.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }

    /// Plans for one touch and drives it.
    ///
    /// # Errors
    /// [`Problem`] that names what is wrong; nothing has changed then.
    pub async fn touch(&self, request: TouchRequest) -> Result<(Arc<Active>, serde_json::Value), Problem> {
        let duration_ms = request.duration_ms.unwrap_or(DEFAULT_DURATION_MS);
        if !(MIN_DURATION_MS..=MAX_DURATION_MS).contains(&duration_ms) {
            return Err(Problem::range("duration_ms", f64::from(duration_ms), MIN_DURATION_MS, MAX_DURATION_MS));
        }
        let touch = TouchView { id: 0, x_px: request.x_px, y_px: request.y_px };
        self.touch_all(vec![touch], request.intensity_g, Duration::from_millis(u64::from(duration_ms))).await
    }

    /// Plans for all fingers at once and drives them for `hold`.
    ///
    /// # Errors
    /// As [`App::touch`].
    pub async fn touch_all(
        &self,
        touches: Vec<TouchView>,
        intensity_g: Option<f64>,
        hold: Duration,
    ) -> Result<(Arc<Active>, serde_json::Value), Problem> {
        let result = self.try_touch(touches, intensity_g, hold).await;
        self.metrics.count_touch(result.is_ok());
        result
    }

    async fn try_touch(
        &self,
        touches: Vec<TouchView>,
        intensity_g: Option<f64>,
        hold: Duration,
    ) -> Result<(Arc<Active>, serde_json::Value), Problem> {
        let targets = touches
            .iter()
            .map(|touch| {
                let (x_m, y_m) = self.table.scene.screen.px_to_surface_m(touch.x_px, touch.y_px)?;
                Ok(Target { x_m, y_m, intensity_g })
            })
            .collect::<Result<Vec<_>, Problem>>()?;
        let plan = tokio::task::block_in_place(|| self.table.plan(&targets))?;
        self.metrics.plan_time(plan.elapsed_us);
        if let (Some(sim), Some(target)) = (&self.sim, targets.first()) {
            sim.set_probe(self.table.model.shape_at(target.x_m, target.y_m));
        }
        let drives = wire_drives(&plan).iter().map(to_wire).collect();
        let driven = self.session.drive(drives, hold).await?;
        let achieved = super::view::achieved(&plan, &driven.achieved);
        let active = tokio::task::block_in_place(|| self.activate(&plan, touches));
        Ok((active, achieved))
    }

    fn activate(&self, plan: &Plan, touches: Vec<TouchView>) -> Arc<Active> {
        let id = {
            let mut next = self.next_id.lock().unwrap_or_else(PoisonError::into_inner);
            *next += 1;
            *next
        };
        let field = FieldView::new(&self.table, Some(plan), id);
        let active = Arc::new(Active { id, plan: PlanView::new(plan.clone()), field, touches });
        *self.active.lock().unwrap_or_else(PoisonError::into_inner) = Some(Arc::clone(&active));
        // Nobody listening is no error.
        let _ = self.updates.send(Update::Plan(Arc::clone(&active)));
        active
    }

    /// Ends the drive at `when`: the fingers have been lifted.
    pub fn release(&self, when: Instant) {
        self.session.end_at(when);
    }

    /// Everything off.
    ///
    /// # Errors
    /// [`SessionError`]; the board's dead-man timer then does it.
    pub async fn stop(&self) -> Result<(), SessionError> {
        let result = self.session.stop().await;
        *self.active.lock().unwrap_or_else(PoisonError::into_inner) = None;
        let _ = self.updates.send(Update::Stopped);
        result
    }

    /// Clears the device's latched fault.
    ///
    /// # Errors
    /// [`SessionError`].
    pub async fn clear_faults(&self) -> Result<(), SessionError> {
        self.session.clear_faults().await
    }
}

/// The plan's drives with their channels: actuator i of the scene is on channel i of the board.
#[must_use]
pub fn wire_drives(plan: &Plan) -> Vec<SiDrive> {
    (0_u8..)
        .zip(&plan.drives)
        .map(|(channel, drive)| SiDrive {
            channel,
            frequency_hz: drive.frequency_hz,
            voltage_v: drive.voltage_v,
            pulse_width: drive.pulse_width,
            phase_rad: drive.phase_rad,
        })
        .collect()
}
