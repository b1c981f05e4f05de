//! A touch's plan on its way to the board.

use crate::daemon::touch::check::DriveMode;
use crate::daemon::touch::request::Finger;
use crate::device::AskedAt;
use crate::effects::EffectDesign;
use crate::planner::plan_motion::PlanMotion;
use crate::planner::{Drive, Plan};
use std::time::{Duration, Instant};

/// A touch's plan on its way to the board.
#[derive(Debug)]
pub struct TouchOrder {
    /// The touch's number.
    pub id: u64,
    /// When the touch was asked for.
    pub asked_at: AskedAt,
    /// When an effect is to begin; `None` is as soon as it can.
    pub start: Option<Instant>,
    /// The fingers it is for.
    pub touches: Vec<Finger>,
    /// For how long, and how.
    pub drive_mode: DriveMode,
    /// The plan first made.
    pub whole_plan: Plan,
    /// The fraction of its forces that the channels' credit allows.
    pub credit_fraction: f64,
    /// The plan with that fraction.
    pub first: PreparedPlan,
}

impl TouchOrder {
    /// When its effect begins if it is driven now.
    #[must_use]
    pub fn effect_start_no_earlier_than(&self, now: Instant) -> Instant {
        self.start.map_or(now, |start| start.max(now))
    }
}

/// A plan, and what it takes to drive it.
#[derive(Clone, Debug)]
pub struct PreparedPlan {
    /// The plan.
    pub plan: Plan,
    /// How the masses move under it.
    pub motion: PlanMotion,
    /// How the board drives it.
    pub mode: PreparedMode,
}

/// How the board drives a plan.
#[derive(Clone, Debug)]
pub enum PreparedMode {
    /// Evenly, for as long.
    Hold(Duration),
    /// As an effect.
    Effect(Box<EffectDesign>),
}

impl PreparedPlan {
    /// The drives of a plan that is driven evenly.
    #[must_use]
    pub fn steady_drives(&self) -> Option<&[Drive]> {
        matches!(self.mode, PreparedMode::Hold(_)).then_some(self.plan.drives.as_slice())
    }
}
