//! What the drive task and the board are at: nothing, a touch that waits, a drive that the board has been told of, a rest.

use super::active::SustainedDrive;
use super::command::DriveRequest;
use super::equipment::{RefusedDrive, StartedDrive};
use super::order::PreparedPlan;
use crate::device::AskedAt;
use crate::planner::residual::RailState;
use std::pin::Pin;
use std::time::{Duration, Instant};

type Answer = Pin<Box<dyn Future<Output = Result<StartedDrive, RefusedDrive>> + Send>>;

/// What there is to do with the board.
pub enum BoardActivity {
    /// Nothing.
    Free,
    /// A touch waits for what is left of those before.
    Settling { request: Box<DriveRequest>, since: Instant, until: Instant },
    /// The board has been told to drive, and has not answered yet; `newest_before` was [`super::state::DriveState::newest_plan_id`] before.
    Ordered { sent: Box<SentDrive>, newest_before: u64, answer: Answer },
    /// The board rests, at least until `until`, for a drive that goes on afterwards.
    Resting { held: Box<SustainedDrive>, until: Instant, looks: u32 },
}

impl std::fmt::Debug for BoardActivity {
    fn fmt(&self, out: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        out.write_str(match self {
            Self::Free => "Free",
            Self::Settling { .. } => "Settling",
            Self::Ordered { .. } => "Ordered",
            Self::Resting { .. } => "Resting",
        })
    }
}

impl BoardActivity {
    /// The board's answer; never, if it has not been told anything.
    pub async fn await_board_answer_or_forever_if_none_is_due(&mut self) -> Result<StartedDrive, RefusedDrive> {
        match self {
            Self::Ordered { answer, .. } => answer.await,
            _ => std::future::pending().await,
        }
    }
}

/// What the board has been told to drive.
#[derive(Debug)]
pub struct SentDrive {
    /// What for.
    pub purpose: DrivePurpose,
    /// The plan, with the fraction of its forces for which there is room.
    pub prepared: PreparedPlan,
    /// That fraction.
    pub force_fraction: f64,
    /// What the board did before.
    pub board: RailState,
    /// When it was told.
    pub since: Instant,
}

/// What the board has been told to drive something for.
#[derive(Debug)]
pub enum DrivePurpose {
    /// A touch, which has waited for what is left of those before.
    Touch { request: Box<DriveRequest>, waited: Option<Duration> },
    /// A drive that goes on, after a rest or with other forces.
    Again { held: Box<SustainedDrive>, has_rested: bool },
}

impl DrivePurpose {
    /// The touch's number, and when it was asked for.
    #[must_use]
    pub fn touch_id_and_asked_at(&self) -> (u64, AskedAt) {
        match self {
            Self::Touch { request, .. } => (request.order.id, request.order.asked_at),
            Self::Again { held, .. } => (held.active.id, held.asked_at),
        }
    }

    /// When an effect is to begin, if that has been said.
    #[must_use]
    pub fn wanted_start(&self) -> Option<Instant> {
        match self {
            Self::Touch { request, .. } => request.order.start,
            Self::Again { .. } => None,
        }
    }
}
