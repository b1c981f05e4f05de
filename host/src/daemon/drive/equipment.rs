//! What drives are worked out and carried out with: the panel's table, the session with the board, the simulated sensor.

use super::active::AskedAt;
use super::order::{Drivable, Mode};
use crate::daemon::touch::answer::Achieved;
use crate::device::convert::drive_to_wire;
use crate::device::sim::SimControl;
use crate::device::{DeviceSnapshot, DriveOrder, EffectOrder, LinkError, Session, SessionError};
use crate::planner::drive::on_channels;
use crate::planner::residual::Board;
use crate::planner::{Plan, PlanTable};
use era_shared::limits::REST_MS;
use era_shared::protocol::Refusal;
use era_shared::safety::SafetyState;
use std::sync::Arc;
use std::time::{Duration, Instant};

/// Between two looks whether the session that is to answer still lives.
const LOOK: Duration = Duration::from_millis(250);

/// Table, session and sensor.
#[derive(Debug)]
pub struct Equipment {
    /// The planner's table, with scene and model.
    pub table: Arc<PlanTable>,
    /// The session with the board.
    pub session: Session,
    /// Of a simulated device.
    pub sim: Option<SimControl>,
}

/// What the board has begun.
#[derive(Debug)]
pub struct Begun {
    /// What it achieves.
    pub achieved: Achieved,
    /// When it ends.
    pub until: Instant,
}

/// That the board has not begun what it was told to.
#[derive(Debug)]
pub struct NotBegun {
    /// Why.
    pub error: SessionError,
    /// Whether it may drive all the same: nobody knows whether it has heard.
    pub may_drive: bool,
}

impl Equipment {
    /// What the board does, as far as its state is known.
    #[must_use]
    pub fn read_board(&self) -> Board {
        find_board(&self.session.subscribe_snapshots().borrow())
    }

    /// [`DeviceSnapshot::breaks`].
    #[must_use]
    pub fn count_breaks(&self) -> u64 {
        self.session.subscribe_snapshots().borrow().breaks
    }

    /// Waits for the session's answer, and no longer than its thread shows that it lives.
    ///
    /// # Errors
    /// The session's, or [`SessionError::Hangs`].
    pub async fn wait_for_answer<T>(
        &self,
        answer: impl Future<Output = Result<T, SessionError>>,
    ) -> Result<T, SessionError> {
        let mut answer = std::pin::pin!(answer);
        loop {
            match tokio::time::timeout(LOOK, &mut answer).await {
                Ok(answer) => return answer,
                Err(_) if self.session.is_thread_hung() => return Err(SessionError::Hangs),
                Err(_) => {}
            }
        }
    }

    /// Puts the simulated sensor under the first target of plan `id`.
    pub fn place_sensor(&self, id: u64, plan: &Plan) {
        if let (Some(sim), Some(target)) = (&self.sim, plan.targets.first()) {
            sim.place_accelerometer(id, self.table.model.shape_deflections_at(target.x_m, target.y_m));
        }
    }

    /// Has the board drive plan `id`, its rails rising with the drives if it `is_soft`.
    ///
    /// # Errors
    /// [`NotBegun`].
    pub async fn begin_drive(
        self: Arc<Self>,
        id: u64,
        since: AskedAt,
        drivable: Drivable,
        is_soft: bool,
    ) -> Result<Begun, NotBegun> {
        let (plan, AskedAt { stops, breaks }) = (&drivable.plan, since);
        let begun = match &drivable.mode {
            Mode::Hold(hold) => {
                let drives = on_channels(&plan.drives).iter().map(drive_to_wire).collect();
                let order = DriveOrder { id, stops, breaks, drives, hold: *hold, from_zero: is_soft };
                let mut driven = self.wait_for_answer(self.session.drive(order.clone())).await;
                // A burst of before this daemon's time, or of drives that it does not look after.
                if let Err(SessionError::Link(LinkError::Refused(Refusal::Duty { wait_ms, .. }))) = &driven
                    && *wait_ms <= REST_MS
                {
                    tokio::time::sleep(Duration::from_millis(u64::from(*wait_ms) + 1)).await;
                    driven = self.wait_for_answer(self.session.drive(order)).await;
                }
                driven.map(|driven| Begun {
                    achieved: Achieved::new(plan, &driven.achieved),
                    until: Instant::now() + *hold,
                })
            }
            Mode::Effect(design) => {
                let drives = design.wire_drives().iter().map(drive_to_wire).collect();
                let effects = design.drives.iter().map(|drive| drive.effect.clone()).collect();
                let order = EffectOrder { id, stops, drives, effects, start: None };
                let played = self.wait_for_answer(self.session.play_effect(order)).await;
                played.map(|played| Begun {
                    achieved: Achieved::played(plan, design, &played),
                    until: played.start + played.length,
                })
            }
        };
        begun.map_err(|error| {
            let is_known = |error: &LinkError| matches!(error, LinkError::Refused(_) | LinkError::TooOld { .. });
            let may_drive = matches!(&error, SessionError::Link(link) if !is_known(link));
            NotBegun { error, may_drive }
        })
    }
}

fn find_board(device: &DeviceSnapshot) -> Board {
    match device.state() {
        Some(SafetyState::Running) => Board::Driving,
        Some(SafetyState::Armed | SafetyState::Arming) | None => Board::Up,
        Some(SafetyState::Boot | SafetyState::Safe | SafetyState::Fault | SafetyState::Discharging) => Board::Down,
    }
}
