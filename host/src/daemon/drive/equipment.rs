//! What drives are worked out and carried out with: the panel's table, the session with the board, the simulated sensor.

use super::known_clicks::KnownClicks;
use super::order::{PreparedMode, PreparedPlan};
use crate::daemon::touch::answer::Achieved;
use crate::device::convert::{drive_to_wire_zeroing_too_narrow_pulses, windows_to_wire_sequence_dropping_excess};
use crate::device::session::DriveResult;
use crate::device::sim::SimControl;
use crate::device::{AskedAt, DeviceSnapshot, DriveContent, DriveOrder, LinkError, Session, SessionError};
use crate::planner::drive::assign_channels_in_order_of_drives;
use crate::planner::residual::RailState;
use crate::planner::{Plan, PlanTable};
use era_shared::limits::REST_MS;
use era_shared::protocol::{ChannelDrive, Refusal};
use era_shared::safety::SafetyState;
use era_shared::supply::RAILS;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

/// Between two looks whether the session that is to answer still lives.
const LOOK: Duration = Duration::from_millis(250);

/// Table, session and sensor.
#[derive(Debug)]
pub struct DriveEquipment {
    /// The planner's table, with scene and model.
    pub table: Arc<PlanTable>,
    /// The session with the board. No other folder of the daemon reaches it.
    pub(super) session: Session,
    /// Of a simulated device.
    pub(super) sim: Option<SimControl>,
    /// Clicks that have been designed.
    pub(super) clicks: KnownClicks,
    /// The voltages in V at which the last burst of windows left the rails; 0 where that is not known.
    standing_rails_v: Mutex<[f64; RAILS]>,
}

/// What the board has begun.
#[derive(Debug)]
pub struct StartedDrive {
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
    /// Nothing has been driven yet; `sim` belongs to a simulated device.
    #[must_use]
    pub fn new(table: Arc<PlanTable>, session: Session, sim: Option<SimControl>) -> Self {
        Self { table, session, sim, clicks: KnownClicks::default(), standing_rails_v: Mutex::default() }
    }

    /// What the board does, as far as its state is known.
    #[must_use]
    pub fn read_rail_state_down_up_or_driving(&self) -> RailState {
        rail_state_from_snapshot(&self.session.subscribe_snapshots().borrow())
    }

    /// The voltages in V at which the rails stand, as far as that is known: 0 where it is not. A board that is off has lowered them.
    #[must_use]
    pub fn standing_rail_voltages_v_or_zeros(&self) -> [f64; RAILS] {
        match self.read_rail_state_down_up_or_driving() {
            RailState::Down => [0.0; RAILS],
            RailState::Up | RailState::Driving => *self.lock_standing_rail_voltages(),
        }
    }

    fn lock_standing_rail_voltages(&self) -> MutexGuard<'_, [f64; RAILS]> {
        self.standing_rails_v.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// A burst of windows leaves a rail where it is that feeds none of them.
    fn note_rail_voltages_left_by_effect_windows_or_zeros(&self, prepared: &PreparedPlan, is_begun: bool) {
        let mut standing_v = self.lock_standing_rail_voltages();
        match &prepared.mode {
            PreparedMode::Effect(design) if is_begun && !design.windows.is_empty() => {
                let used = design.find_rail_voltages_v().into_iter().zip(standing_v.iter_mut());
                used.filter(|(volts, _)| *volts > 0.0).for_each(|(volts, standing_v)| *standing_v = volts);
            }
            PreparedMode::Hold(_) if prepared.plan.drives.iter().all(|drive| drive.voltage_v <= 0.0) => {}
            PreparedMode::Effect(_) | PreparedMode::Hold(_) => *standing_v = [0.0; RAILS],
        }
    }

    /// [`DeviceSnapshot::interruptions`].
    #[must_use]
    pub fn count_unrequested_disarms_faults_and_outages_of_board(&self) -> u64 {
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
                Err(_) if self.session.is_thread_alive_without_heartbeat() => return Err(SessionError::Hangs),
                Err(_) => {}
            }
        }
    }

    /// Puts the simulated sensor under the first target of plan `id`.
    pub fn place_simulated_sensor_under_first_target(&self, id: u64, plan: &Plan) {
        if let (Some(sim), Some(target)) = (&self.sim, plan.targets.first()) {
            sim.move_accelerometer_to_touch(id, self.table.model.shape_deflections_at(target.x_m, target.y_m));
        }
    }

    /// Has the board drive plan `id`, an effect not before `start`, its rails rising with the drives if it `from_zero_volts`.
    ///
    /// # Errors
    /// [`RefusedDrive`].
    pub async fn begin_drive_retrying_once_after_required_rest(
        self: Arc<Self>,
        (id, asked_at): (u64, AskedAt),
        start: Option<Instant>,
        prepared: PreparedPlan,
        from_zero_volts: bool,
    ) -> Result<StartedDrive, RefusedDrive> {
        let plan = &prepared.plan;
        let content = match &prepared.mode {
            PreparedMode::Hold(hold) => {
                let mut drives: Vec<ChannelDrive> = assign_channels_in_order_of_drives(&plan.drives)
                    .iter()
                    .map(drive_to_wire_zeroing_too_narrow_pulses)
                    .collect();
                // A finger that feels nothing, as one between two detents, takes no rail down: the next click would wait until it is up again.
                if drives.iter().all(|drive| drive.voltage_millivolts == 0) {
                    drives.clear();
                }
                DriveContent::Steady { drives, hold: *hold, from_zero: from_zero_volts }
            }
            PreparedMode::Effect(design) if design.windows.is_empty() => {
                let drives =
                    design.drives_with_board_channels().iter().map(drive_to_wire_zeroing_too_narrow_pulses).collect();
                let effects = design.drives.iter().map(|drive| drive.effect.clone()).collect();
                DriveContent::Envelopes { drives, effects }
            }
            PreparedMode::Effect(design) => {
                DriveContent::Windows(Box::new(windows_to_wire_sequence_dropping_excess(&design.windows)))
            }
        };
        let order = DriveOrder { id, asked_at, start, content };
        let mut driven = self
            .await_session_answer_unless_thread_hangs(self.session.begin_drive_arming_if_needed(order.clone()))
            .await;
        // A burst of before this daemon's time, drives that it does not look after, or effects that follow each other for so long that they are
        // one burst, which needs a rest.
        if let Err(SessionError::Link(LinkError::Refused(Refusal::Duty { wait_ms, .. }))) = &driven
            && *wait_ms <= REST_MS
        {
            tokio::time::sleep(Duration::from_millis(u64::from(*wait_ms) + 1)).await;
            driven =
                self.await_session_answer_unless_thread_hangs(self.session.begin_drive_arming_if_needed(order)).await;
        }
        self.note_rail_voltages_left_by_effect_windows_or_zeros(&prepared, driven.is_ok());
        let begun = driven.map(|DriveResult { achieved, effect }| {
            let now = Instant::now();
            match (&prepared.mode, effect) {
                (PreparedMode::Effect(design), Some(times)) => StartedDrive {
                    achieved: Achieved::from_effect(plan, design, &achieved, times),
                    until: times.start + times.length,
                },
                (PreparedMode::Hold(hold), _) => {
                    StartedDrive { achieved: Achieved::new(plan, &achieved), until: now + *hold }
                }
                // The session answers an effect with its times.
                (PreparedMode::Effect(_), None) => {
                    StartedDrive { achieved: Achieved::new(plan, &achieved), until: now }
                }
            }
        });
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
