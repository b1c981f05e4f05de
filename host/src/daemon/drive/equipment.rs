//! What drives are worked out and carried out with: the panel's table, the session with the board, the simulated sensor.

use super::active::AskedAt;
use super::known_clicks::KnownClicks;
use super::order::{PreparedMode, PreparedPlan};
use crate::daemon::touch::answer::Achieved;
use crate::device::convert::{drive_to_wire, windows_to_wire};
use crate::device::sim::SimControl;
use crate::device::{DeviceSnapshot, DriveOrder, EffectContent, EffectOrder, LinkError, Session, SessionError};
use crate::planner::drive::assign_channels;
use crate::planner::residual::RailState;
use crate::planner::{Plan, PlanTable};
use era_shared::limits::REST_MS;
use era_shared::protocol::{ChannelDrive, Refusal};
use era_shared::safety::SafetyState;
use std::sync::Arc;
use std::time::{Duration, Instant};

/// Between two looks whether the session that is to answer still lives.
const LOOK: Duration = Duration::from_millis(250);

/// Table, session and sensor.
#[derive(Debug)]
pub struct DriveEquipment {
    /// The planner's table, with scene and model.
    pub table: Arc<PlanTable>,
    /// The session with the board.
    pub session: Session,
    /// Of a simulated device.
    pub sim: Option<SimControl>,
    /// Clicks that have been designed.
    pub clicks: KnownClicks,
}

/// What the board has begun.
#[derive(Debug)]
pub struct BegunDrive {
    /// What it achieves.
    pub achieved: Achieved,
    /// When it ends.
    pub until: Instant,
}

/// That the board has not begun what it was told to.
#[derive(Debug)]
pub struct RefusedDrive {
    /// Why.
    pub error: SessionError,
    /// Whether it may drive all the same: nobody knows whether it has heard.
    pub may_drive: bool,
}

impl DriveEquipment {
    /// What the board does, as far as its state is known.
    #[must_use]
    pub fn read_rail_state_down_up_or_driving(&self) -> RailState {
        rail_state_from_snapshot(&self.session.subscribe_snapshots().borrow())
    }

    /// [`DeviceSnapshot::interruptions`].
    #[must_use]
    pub fn count_unrequested_board_interruptions(&self) -> u64 {
        self.session.subscribe_snapshots().borrow().interruptions
    }

    /// Waits for the session's answer, and no longer than its thread shows that it lives.
    ///
    /// # Errors
    /// The session's, or [`SessionError::Hangs`].
    pub async fn await_session_answer_unless_thread_hangs<T>(
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
    pub fn place_simulated_sensor_under_first_target(&self, id: u64, plan: &Plan) {
        if let (Some(sim), Some(target)) = (&self.sim, plan.targets.first()) {
            sim.place_accelerometer(id, self.table.model.shape_deflections_at(target.x_m, target.y_m));
        }
    }

    /// Has the board drive plan `id`, its rails rising with the drives if it `from_zero_volts`.
    ///
    /// # Errors
    /// [`RefusedDrive`].
    pub async fn begin_drive(
        self: Arc<Self>,
        id: u64,
        asked_at: AskedAt,
        prepared: PreparedPlan,
        from_zero_volts: bool,
    ) -> Result<BegunDrive, RefusedDrive> {
        let (plan, AskedAt { stops, interruptions }) = (&prepared.plan, asked_at);
        let begun = match &prepared.mode {
            PreparedMode::Hold(hold) => {
                let mut drives: Vec<ChannelDrive> = assign_channels(&plan.drives).iter().map(drive_to_wire).collect();
                // A finger that feels nothing, as one between two detents, takes no rail down: the next click would wait until it is up again.
                if drives.iter().all(|drive| drive.voltage_millivolts == 0) {
                    drives.clear();
                }
                let order = DriveOrder { id, stops, interruptions, drives, hold: *hold, from_zero: from_zero_volts };
                let mut driven = self.await_session_answer_unless_thread_hangs(self.session.drive(order.clone())).await;
                // A burst of before this daemon's time, or of drives that it does not look after.
                if let Err(SessionError::Link(LinkError::Refused(Refusal::Duty { wait_ms, .. }))) = &driven
                    && *wait_ms <= REST_MS
                {
                    tokio::time::sleep(Duration::from_millis(u64::from(*wait_ms) + 1)).await;
                    driven = self.await_session_answer_unless_thread_hangs(self.session.drive(order)).await;
                }
                driven.map(|driven| BegunDrive {
                    achieved: Achieved::new(plan, &driven.achieved),
                    until: Instant::now() + *hold,
                })
            }
            PreparedMode::Effect(design) => {
                let content = if design.windows.is_empty() {
                    let drives = design.drives_with_board_channels().iter().map(drive_to_wire).collect();
                    let effects = design.drives.iter().map(|drive| drive.effect.clone()).collect();
                    EffectContent::Envelopes { drives, effects, start: None }
                } else {
                    EffectContent::Windows(Box::new(windows_to_wire(&design.windows)))
                };
                let order = EffectOrder { id, stops, content };
                let schedule = || self.session.arm_if_needed_and_schedule_effect(order.clone());
                let mut played = self.await_session_answer_unless_thread_hangs(schedule()).await;
                // Effects that follow each other for long are one burst, which needs a rest.
                if let Err(SessionError::Link(LinkError::Refused(Refusal::Duty { wait_ms, .. }))) = &played
                    && *wait_ms <= REST_MS
                {
                    tokio::time::sleep(Duration::from_millis(u64::from(*wait_ms) + 1)).await;
                    played = self.await_session_answer_unless_thread_hangs(schedule()).await;
                }
                played.map(|played| BegunDrive {
                    achieved: Achieved::from_effect(plan, design, &played),
                    until: played.start + played.length,
                })
            }
        };
        begun.map_err(|error| {
            let is_known = |error: &LinkError| matches!(error, LinkError::Refused(_) | LinkError::TooOld { .. });
            let may_drive = matches!(&error, SessionError::Link(link) if !is_known(link));
            RefusedDrive { error, may_drive }
        })
    }
}

fn rail_state_from_snapshot(device: &DeviceSnapshot) -> RailState {
    match device.state() {
        Some(SafetyState::Running) => RailState::Driving,
        Some(SafetyState::Armed | SafetyState::Arming) | None => RailState::Up,
        Some(SafetyState::Boot | SafetyState::Safe | SafetyState::Fault | SafetyState::Discharging) => RailState::Down,
    }
}
