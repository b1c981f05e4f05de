//! What a touch has led to: its plan, and what the device achieves of it.

use super::plan_view::PlanView;
use crate::daemon::api::schema::to_ms;
use crate::device::convert::achieved_drive_from_wire;
use crate::device::session::EffectTimes;
use crate::effects::EffectDesign;
use crate::effects::view::EffectView;
use crate::planner::Plan;
use crate::planner::schedule::Stretch;
use crate::planner::trade::TradeOffs;
use era_shared::protocol::AchievedDrive;
use serde::Serialize;
use std::time::Duration;
use utoipa::ToSchema;

/// The answer to a touch: the plan, and the drives that the device achieves. With time windows, the plan is that of the stretch in which the
/// first target begins.
#[derive(Clone, Debug, Serialize, ToSchema)]
#[schema(as = Touched)]
pub struct TouchedView {
    /// The plan.
    #[serde(flatten)]
    pub plan: PlanView,
    /// Number of the request, which is also the number of its plan.
    pub plan_id: u64,
    /// The drives that the device achieves for the part that begins at once.
    pub device: Achieved,
    /// The stretches of time with their plans; only with time windows. The plan outside of `stretches` is that of the stretch in which the first
    /// target begins; `device` is for the stretch that begins at once.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schema(nullable = false)]
    pub stretches: Option<Vec<Stretch>>,
    /// Other results that are possible instead; only if the request had `trade` and cannot be met completely.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schema(nullable = false)]
    pub trade: Option<TradeOffs>,
}

/// The drives that the device achieves.
#[derive(Clone, Debug, Serialize, ToSchema)]
pub struct Achieved {
    /// Whether the device has accepted the drives; false if nothing begins at once.
    acknowledged: bool,
    /// The achieved values of each drive of the plan.
    achieved: Vec<AchievedView>,
    /// With an effect: what the board plays on each drive, and the predicted result at the first target.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schema(nullable = false)]
    effect: Option<PlayedEffect>,
    /// Delay of the drive in ms (at most 30), in which the vibration of earlier touches decayed so that the drive is at least twice as strong; absent
    /// without a delay.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schema(nullable = false)]
    delayed_ms: Option<f64>,
}

/// The drive of a channel, as near to the plan as the timers and the supply of the board allow.
#[derive(Clone, Debug, Serialize, ToSchema)]
#[schema(as = AchievedDrive)]
struct AchievedView {
    /// The `id` of the actuator; null for a channel without an actuator.
    actuator: Option<String>,
    /// Channel of the board, from 0.
    channel: u8,
    /// Fundamental frequency of the force in Hz.
    frequency_hz: f64,
    /// Voltage of the electrodes in V.
    voltage_v: f64,
    /// Fraction of each half period for which an electrode is on.
    pulse_width: f64,
    /// Phase of the windows (the times in which an electrode is on) in rad.
    phase_rad: f64,
    /// Time at each change of the electrode for which neither electrode is on, in us.
    guard_us: f64,
}

/// An effect that the board plays.
#[derive(Clone, Debug, Serialize, ToSchema)]
pub struct PlayedEffect {
    /// The effect.
    #[serde(flatten)]
    effect: EffectView,
    /// Start of the effect in us of the board's time.
    start_board_us: u64,
    /// Time from this answer to the start of the effect in ms of the host's clock, 0 or more.
    #[schema(minimum = 0)]
    starts_in_ms: f64,
    /// Duration of the effect in ms.
    duration_ms: f64,
}

impl Achieved {
    /// Where nothing begins at once.
    #[must_use]
    pub const fn without_drive() -> Self {
        Self { acknowledged: false, achieved: Vec::new(), effect: None, delayed_ms: None }
    }

    /// What the device achieves, with the actuators' names.
    #[must_use]
    pub fn new(plan: &Plan, achieved: &[AchievedDrive]) -> Self {
        let view = |drive: &AchievedDrive| {
            let si = achieved_drive_from_wire(drive);
            AchievedView {
                actuator: plan.drives.get(usize::from(drive.channel)).map(|drive| drive.actuator.clone()),
                channel: drive.channel,
                frequency_hz: si.frequency_hz,
                voltage_v: si.voltage_v,
                pulse_width: si.pulse_width,
                phase_rad: si.phase_rad,
                guard_us: f64::from(drive.guard_ns) / 1e3,
            }
        };
        Self { acknowledged: true, achieved: achieved.iter().map(view).collect(), effect: None, delayed_ms: None }
    }

    /// The same for an effect, with its design and times.
    #[must_use]
    pub fn from_effect(plan: &Plan, design: &EffectDesign, achieved: &[AchievedDrive], times: EffectTimes) -> Self {
        let ahead = times.start.saturating_duration_since(std::time::Instant::now());
        let effect = PlayedEffect {
            effect: EffectView::new(design),
            start_board_us: times.start_us,
            starts_in_ms: to_ms(ahead),
            duration_ms: to_ms(times.length),
        };
        Self { effect: Some(effect), ..Self::new(plan, achieved) }
    }

    /// How long after this answer an effect begins; nothing of other drives.
    #[must_use]
    pub fn time_from_answer_to_effect_start_or_zero(&self) -> Duration {
        let starts_in_ms = self.effect.as_ref().map_or(0.0, |effect| effect.starts_in_ms);
        Duration::try_from_secs_f64(starts_in_ms / 1e3).unwrap_or_default()
    }

    /// How long after this answer an effect ends; nothing of other drives.
    #[must_use]
    pub fn time_from_answer_to_effect_end_or_zero(&self) -> Duration {
        let duration_ms = self.effect.as_ref().map_or(0.0, |effect| effect.duration_ms);
        self.time_from_answer_to_effect_start_or_zero()
            + Duration::try_from_secs_f64(duration_ms / 1e3).unwrap_or_default()
    }

    /// Held up for so long, if it was.
    #[must_use]
    pub fn with_delay(self, delayed: Option<Duration>) -> Self {
        Self { delayed_ms: delayed.map(to_ms), ..self }
    }

    /// The effect that is played, if one is.
    #[must_use]
    pub const fn played_effect(&self) -> Option<&PlayedEffect> {
        self.effect.as_ref()
    }
}
