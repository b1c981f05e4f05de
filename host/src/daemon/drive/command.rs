//! What is told to the task that owns what is driven, and what it publishes.

use super::active::CurrentPlan;
use super::equipment::DriveEquipment;
use super::order::TouchOrder;
use crate::daemon::api::kinds::ProblemKind;
use crate::daemon::api::problem::Problem;
use crate::daemon::touch::answer::TouchedView;
use std::time::Instant;
use tokio::sync::oneshot;

/// What is told to the task.
#[derive(Debug)]
pub enum DriveCommand {
    /// What a newer one replaces while it waits.
    Queue(NextRequest),
    /// End the drive of a touch.
    Release { id: u64, when: Instant },
    /// Give the drive of a touch more time.
    Renew { id: u64, until: Instant, reply: oneshot::Sender<bool> },
    /// Drop a touch that waits for what is left of those before.
    Withdraw { id: u64 },
    /// Everything has been stopped.
    Stopped { when: Instant },
}

/// What waits for the board, if it is busy.
#[derive(Debug)]
pub enum NextRequest {
    /// Drive a touch.
    Drive(Box<DriveRequest>),
    /// End what is driven for touches before this one, which drives nothing yet.
    Overtake { id: u64, reply: oneshot::Sender<()> },
}

impl NextRequest {
    /// The touch's number.
    #[must_use]
    pub const fn touch_id(&self) -> u64 {
        match self {
            Self::Drive(request) => request.order.id,
            Self::Overtake { id, .. } => *id,
        }
    }

    /// Answers that it has been replaced: nobody waits for the answer to one that drives nothing.
    pub fn refuse_as_superseded(self) {
        if let Self::Drive(request) = self {
            request.refuse(superseded_problem());
        }
    }
}

/// A touch that is to be driven, and who waits for it.
#[derive(Debug)]
pub struct DriveRequest {
    /// What to drive.
    pub order: TouchOrder,
    /// Where the answer goes.
    pub reply: oneshot::Sender<Result<TouchedView, Problem>>,
}

impl DriveRequest {
    /// Answers that it is not driven.
    pub fn refuse(self, problem: impl Into<Problem>) {
        // Whoever has asked may have gone.
        let _ = self.reply.send(Err(problem.into()));
    }
}

/// What others see of the task's state.
#[derive(Clone, Debug, Default)]
pub struct PublishedDriveState {
    /// The newest touch that is driven, or is to be.
    pub newest: u64,
    /// What is driven.
    pub current: Option<CurrentPlan>,
}

/// Whether it is still driven: neither is its time over, nor has everything been stopped since it was asked for.
pub fn is_plan_neither_over_nor_stopped(current: &CurrentPlan, equipment: &DriveEquipment, now: Instant) -> bool {
    now < current.until && current.asked_at.stops == equipment.session.stop_count()
}

/// That a newer touch stands in this one's place.
#[must_use]
pub fn superseded_problem() -> Problem {
    Problem::new(ProblemKind::Superseded, "a newer touch replaced this touch")
}
