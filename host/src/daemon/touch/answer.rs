//! What a touch has led to: its plan, and what the device achieves of it.

use super::plan_view::PlanView;
use crate::daemon::api::schema::to_ms;
use crate::device::convert::achieved_drive_from_wire;
use crate::device::session::EffectResult;
use crate::effects::EffectDesign;
use crate::effects::view::EffectView;
use crate::planner::Plan;
use crate::planner::schedule::Stretch;
use crate::planner::trade::TradeOffs;
use era_shared::protocol::AchievedDrive;
use serde::Serialize;
use std::time::Duration;
use utoipa::ToSchema;

/// The answer to a touch: the plan, of several stretches that in which the first target begins, and what the device achieves.
#[derive(Clone, Debug, Serialize, ToSchema)]
#[schema(as = Touched)]
pub struct TouchedView {
    /// The plan.
    #[serde(flatten)]
    pub plan: PlanView,
    /// The request's number, which is its plan's.
    pub plan_id: u64,
    /// What the device achieves of what begins at once.
    pub device: Achieved,
    /// With time windows: what is driven when. The plan above is that of the stretch in which the first target begins; `device` is
    /// for what begins at once.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schema(nullable = false)]
    pub stretches: Option<Vec<Stretch>>,
    /// What can be had instead, where it cannot be had in full and that was asked for.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schema(nullable = false)]
    pub trade: Option<TradeOffs>,
}

/// What the device achieves.
#[derive(Clone, Debug, Serialize, ToSchema)]
pub struct Achieved {
    /// Whether it drives; false where nothing begins at once.
    acknowledged: bool,
    /// One per drive of the plan.
    achieved: Vec<AchievedView>,
    /// With an effect: what is played on each drive, and what it should do at the first target.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schema(nullable = false)]
    effect: Option<PlayedEffect>,
    /// How long the drive was held up in ms, at most 30, as it is at least twice as strong for what was left of the touches
    /// before to decay; absent if it was not.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schema(nullable = false)]
    delayed_ms: Option<f64>,
}

/// What a channel drives, as near to the plan as its timers and its supply come.
#[derive(Clone, Debug, Serialize, ToSchema)]
#[schema(as = AchievedDrive)]
struct AchievedView {
    /// The actuator's `id`; null for a channel without one.
    actuator: Option<String>,
    /// The board's channel, from 0.
    channel: u8,
    /// Fundamental of the force in Hz.
    frequency_hz: f64,
    /// Electrode voltage in V.
    voltage_v: f64,
    /// Part of its half period for which an electrode is on.
    pulse_width: f64,
    /// Phase of the windows in rad.
    phase_rad: f64,
    /// Time for which neither electrode is on, at each change, in us.
    guard_us: f64,
}

/// An effect that is played.
#[derive(Clone, Debug, Serialize, ToSchema)]
pub struct PlayedEffect {
    /// The effect.
    #[serde(flatten)]
    effect: EffectView,
    /// When it begins, in us of the board's time.
    start_board_us: u64,
    /// From this answer to its start in ms, 0 or more, as the host's clock has it.
    #[schema(minimum = 0)]
    starts_in_ms: f64,
    /// How long it lasts, in ms.
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

    /// The same for an effect, with its design, when it begins and how long it lasts.
    #[must_use]
    pub fn from_effect(plan: &Plan, design: &EffectDesign, played: &EffectResult) -> Self {
        let ahead = played.start.saturating_duration_since(std::time::Instant::now());
        let effect = PlayedEffect {
            effect: EffectView::new(design),
            start_board_us: played.start_us,
            starts_in_ms: to_ms(ahead),
            duration_ms: to_ms(played.length),
        };
        Self { effect: Some(effect), ..Self::new(plan, &played.achieved) }
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
