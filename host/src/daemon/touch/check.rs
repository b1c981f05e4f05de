//! A touch that has been checked, in the planner's units: the one place where the values of a touch are looked at.

use super::request::{
    Finger, MAX_DURATION_MS, MAX_INTENSITY_G, MIN_DURATION_MS, QuietZone, RequestedHaptics, TouchRequest,
};
use crate::daemon::api::kinds::ProblemKind;
use crate::daemon::api::problem::Problem;
use crate::effects::{DesignError, EffectDesign, EffectError, EffectRequest, Intensity};
use crate::planner::request::MAX_QUIET_RADIUS_M;
use crate::planner::schedule::{Span, Window, cut_windows_into_spans};
use crate::planner::{QuietZone as PlannerQuietZone, Request, Target};
use crate::scene::Scene;
use serde_json::Value;
use std::sync::Arc;
use std::time::Duration;

/// How long a touch over HTTP vibrates if it does not say, in ms.
pub const DEFAULT_DURATION_MS: u32 = 1_000;

/// A touch that has been checked as far as that goes without planning, whichever way it has come.
#[derive(Clone, Debug)]
pub struct Touch {
    /// The fingers, in the order of the request's targets.
    pub fingers: Vec<Finger>,
    /// For the planner.
    pub request: Request,
    /// For the targets that have none of their own.
    pub intensity: Option<Intensity>,
    /// For how long, and how, the plan is driven.
    pub mode: DriveMode,
    /// What it should feel like, as it was asked for.
    pub haptics: RequestedHaptics,
    /// Where there are time windows.
    pub spans: Option<Vec<Span>>,
    /// Whether to work out what can be had where it cannot be had in full.
    pub wants_trade: bool,
}

/// For how long, and how, a plan is driven.
#[derive(Clone, Debug)]
pub enum DriveMode {
    /// Evenly, for as long.
    Hold(Duration),
    /// As the board plays an effect.
    Effect(EffectRequest),
    /// As the board plays a part of an effect file, which has been designed.
    Designed(Arc<EffectDesign>),
}

/// A finger whose place and strength have been checked.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CheckedFinger {
    /// The finger.
    pub finger: Finger,
    /// For the planner.
    pub target: Target,
}

impl Touch {
    /// The touch that a request over HTTP asks for, on this scene. It is refused as a whole where anything in it is wrong.
    ///
    /// # Errors
    /// [`Problem`] that names field, value and range; `also[0].x_px` for the first other target.
    pub fn from_request(asked: &TouchRequest, scene: &Scene) -> Result<Self, Problem> {
        let haptics = asked.requested_haptics();
        let (intensity, mode) = haptics.check_strength_and_mode(DEFAULT_DURATION_MS)?;
        let also = asked.also.iter().flatten();
        let first = Finger { id: 0, x_px: asked.x_px, y_px: asked.y_px, intensity_g: None, effect: None };
        let others = (1..).zip(also.clone()).map(|(id, other)| Finger {
            id,
            x_px: other.x_px,
            y_px: other.y_px,
            intensity_g: other.intensity_g,
            effect: None,
        });
        let fingers: Vec<Finger> = std::iter::once(first).chain(others).collect();
        let name = |t: usize| (t > 0).then(|| format!("also[{}]", t - 1));
        let mut request = Request::for_touch(&[]);
        for (t, finger) in fingers.iter().enumerate() {
            request.targets.push(
                finger
                    .check_on_scene(scene)
                    .map_err(|problem| problem.prefix_field_and_detail_if_prefix_given(name(t)))?
                    .target,
            );
        }
        for (i, zone) in asked.quiet.iter().flatten().enumerate() {
            request.quiet.push(
                zone.check_and_convert(scene)
                    .map_err(|problem| problem.prefix_field_and_detail_if_prefix_given(Some(format!("quiet[{i}]"))))?,
            );
        }
        request.objective = asked.objective.unwrap_or_default();
        request.grouping = asked.grouping.unwrap_or_default();
        request.weigh = asked.weigh.unwrap_or_default();
        let ends: Vec<(Option<f64>, Option<f64>)> = std::iter::once((asked.from_ms, asked.to_ms))
            .chain(also.map(|other| (other.from_ms, other.to_ms)))
            .collect();
        let spans = check_and_cut_windows_into_spans(&ends, haptics.duration_ms, &mode, name)?;
        Ok(Self { fingers, request, intensity, mode, haptics, spans, wants_trade: asked.trade.unwrap_or(false) })
    }

    /// The touch of the fingers on a page, each of which has been checked by itself.
    ///
    /// # Errors
    /// [`Problem`] that names field, value and range of what the fingers should feel like.
    pub fn from_fingers(fingers: &[CheckedFinger], haptics: RequestedHaptics) -> Result<Self, Problem> {
        let (intensity, mode) = haptics.check_strength_and_mode(MAX_DURATION_MS)?;
        let targets: Vec<Target> = fingers.iter().map(|checked| checked.target).collect();
        Ok(Self {
            fingers: fingers.iter().map(|checked| checked.finger).collect(),
            request: Request::for_touch(&targets),
            intensity,
            mode,
            haptics,
            spans: None,
            wants_trade: false,
        })
    }

    /// No finger at all: those before are lifted.
    #[must_use]
    pub fn without_fingers() -> Self {
        Self {
            fingers: Vec::new(),
            request: Request::for_touch(&[]),
            intensity: None,
            mode: DriveMode::Hold(Duration::ZERO),
            haptics: RequestedHaptics::default(),
            spans: None,
            wants_trade: false,
        }
    }

    /// The same touch with the fingers of another one besides.
    #[must_use]
    pub fn with_added_fingers_of(mut self, other: &Self) -> Self {
        self.fingers.extend_from_slice(&other.fingers);
        self.request.targets.extend_from_slice(&other.request.targets);
        self
    }

    /// The same touch of those of its fingers that have one of these numbers.
    #[must_use]
    pub fn keep_only_fingers(mut self, ids: &[i64]) -> Self {
        let kept = |(finger, _): &(Finger, Target)| ids.contains(&finger.id);
        (self.fingers, self.request.targets) = self.fingers.into_iter().zip(self.request.targets).filter(kept).unzip();
        self
    }
}

impl Finger {
    /// Checks the place and the strength of a finger.
    ///
    /// # Errors
    /// [`Problem`] that names the field: a place outside the screen or in a cut-out, a peak that nothing can have.
    pub fn check_on_scene(self, scene: &Scene) -> Result<CheckedFinger, Problem> {
        let target = build_planner_target_at_px(scene, self.x_px, self.y_px, self.intensity_g)?;
        check_intensity_range(self.intensity_g)?;
        Ok(CheckedFinger { finger: self, target })
    }
}

impl QuietZone {
    fn check_and_convert(&self, scene: &Scene) -> Result<PlannerQuietZone, Problem> {
        let (x_m, y_m) = scene.surface_point_at_px(self.x_px, self.y_px)?.coordinates_m();
        let most_mm = MAX_QUIET_RADIUS_M * 1e3;
        if !(0.0..=most_mm).contains(&self.radius_mm) {
            return Err(Problem::out_of_range("radius_mm", self.radius_mm, 0, most_mm));
        }
        if !self.at_most_g.is_finite() || self.at_most_g < 0.0 {
            return Err(Problem::out_of_range("at_most_g", self.at_most_g, 0, f64::INFINITY));
        }
        Ok(PlannerQuietZone { x_m, y_m, radius_m: self.radius_mm / 1e3, at_most_g: self.at_most_g })
    }
}

impl RequestedHaptics {
    /// Strength and mode; a touch that says nothing of its length is held for `default_hold_ms`.
    fn check_strength_and_mode(&self, default_hold_ms: u32) -> Result<(Option<Intensity>, DriveMode), Problem> {
        check_intensity_range(self.intensity_g)?;
        let intensity = match (self.intensity_g, self.intensity_db) {
            (Some(_), Some(db)) => {
                let detail = "intensity_g and intensity_db are both given, but only one of them is allowed";
                let allowed = "absent with intensity_g".to_owned();
                return Err(Problem::bad_body(detail.into()).with_field_and_value(
                    "intensity_db",
                    db.into(),
                    allowed,
                    None,
                ));
            }
            (Some(g), None) => Some(Intensity::G(g)),
            (None, db) => db.map(Intensity::AboveThresholdDb),
        };
        let Some(effect) = self.effect else {
            let alone = [
                ("count", self.count.map(Value::from)),
                ("period_ms", self.period_ms.map(Value::from)),
                ("crisp_ms", self.crisp_ms.map(Value::from)),
                ("prefer", self.prefer.map(|prefer| prefer.name().into())),
            ];
            if let Some((field, value)) = alone.into_iter().find_map(|(field, value)| Some((field, value?))) {
                let detail =
                    format!("{field} is {value}, but is allowed only together with `effect`, which is not given");
                return Err(Problem::bad_body(detail).with_field_and_value(
                    field,
                    value,
                    "absent without an effect".into(),
                    None,
                ));
            }
            let duration_ms = self.duration_ms.unwrap_or_else(|| f64::from(default_hold_ms));
            if !(f64::from(MIN_DURATION_MS)..=f64::from(MAX_DURATION_MS)).contains(&duration_ms) {
                return Err(Problem::out_of_range("duration_ms", duration_ms, MIN_DURATION_MS, MAX_DURATION_MS));
            }
            return Ok((intensity, DriveMode::Hold(Duration::from_secs_f64(duration_ms / 1e3))));
        };
        let RequestedHaptics { duration_ms, count, period_ms, crisp_ms, prefer, .. } = *self;
        let request = EffectRequest { effect, duration_ms, count, period_ms, crisp_ms, prefer };
        // Before anything is planned.
        request.build_envelope_or_plain_push_if_click()?;
        Ok((intensity, DriveMode::Effect(request)))
    }
}

/// The planner's target at a place on the screen. Its strength is as given: that of a preview has no upper limit.
///
/// # Errors
/// [`Problem`] that names the field: a place outside the screen or in a cut-out.
pub fn build_planner_target_at_px(
    scene: &Scene,
    x_px: f64,
    y_px: f64,
    intensity_g: Option<f64>,
) -> Result<Target, Problem> {
    let (x_m, y_m) = scene.surface_point_at_px(x_px, y_px)?.coordinates_m();
    Ok(Target { x_m, y_m, intensity_g })
}

/// Refuses a peak that nothing can have.
///
/// # Errors
/// [`Problem`] with the range.
pub fn check_intensity_range(intensity_g: Option<f64>) -> Result<(), Problem> {
    match intensity_g {
        Some(g) if !(0.0..=MAX_INTENSITY_G).contains(&g) => {
            Err(Problem::out_of_range("intensity_g", g, 0, MAX_INTENSITY_G))
        }
        _ => Ok(()),
    }
}

/// The window of a target of which only one end may be given; `None` if neither is.
fn build_window_if_any_end_given(
    from_ms: Option<f64>,
    to_ms: Option<f64>,
    default_end_ms: f64,
) -> Result<Option<Window>, Problem> {
    if from_ms.is_none() && to_ms.is_none() {
        return Ok(None);
    }
    let window = Window { from_ms: from_ms.unwrap_or(0.0), to_ms: to_ms.unwrap_or(default_end_ms) };
    window.check_range()?;
    Ok(Some(window))
}

/// When which targets are driven; `None` if no target has a time window. Of each target `window_ends` are the two ends of its window, `name_of_target` is how
/// messages call it. Targets without a window last for `duration_ms`; if that is not given, as long as any other.
fn check_and_cut_windows_into_spans(
    window_ends: &[(Option<f64>, Option<f64>)],
    duration_ms: Option<f64>,
    mode: &DriveMode,
    name_of_target: impl Fn(usize) -> Option<String>,
) -> Result<Option<Vec<Span>>, Problem> {
    if !matches!(mode, DriveMode::Hold(_)) {
        // Before their values are looked at: an effect has no end that could stand for one that is not given.
        let given = |(t, (from_ms, to_ms)): (usize, &(Option<f64>, Option<f64>))| {
            Some((t, from_ms.map(|ms| ("from_ms", ms)).or(to_ms.map(|ms| ("to_ms", ms)))?))
        };
        return match window_ends.iter().enumerate().find_map(given) {
            None => Ok(None),
            Some((t, (field, ms))) => {
                let detail =
                    format!("{field} is {ms}, but is not allowed together with `effect`: an effect has its own length");
                Err(Problem::bad_body(detail)
                    .with_field_and_value(field, ms.into(), "absent with an effect".into(), None)
                    .prefix_field_and_detail_if_prefix_given(name_of_target(t)))
            }
        };
    }
    let latest_ms = window_ends.iter().filter_map(|(_, to_ms)| *to_ms).fold(f64::NAN, f64::max);
    let hold_ms = match mode {
        DriveMode::Hold(hold) if duration_ms.is_some() || latest_ms.is_nan() => hold.as_secs_f64() * 1e3,
        _ => latest_ms,
    };
    let mut windows = Vec::new();
    for (t, (from_ms, to_ms)) in window_ends.iter().enumerate() {
        windows.push(
            build_window_if_any_end_given(*from_ms, *to_ms, hold_ms)
                .map_err(|problem| problem.prefix_field_and_detail_if_prefix_given(name_of_target(t)))?,
        );
    }
    if windows.iter().all(Option::is_none) {
        return Ok(None);
    }
    let all = Window { from_ms: 0.0, to_ms: hold_ms };
    let windows: Vec<Window> = windows.into_iter().map(|window| window.unwrap_or(all)).collect();
    Ok(Some(cut_windows_into_spans(&windows)?))
}

impl From<EffectError> for Problem {
    fn from(error: EffectError) -> Self {
        let (field, value, allowed) = error.field_value_and_allowed_range();
        Self::new(ProblemKind::OutOfRange, error.to_string()).with_field_and_value(field, value, allowed, None)
    }
}

impl From<DesignError> for Problem {
    fn from(error: DesignError) -> Self {
        match error {
            DesignError::Request(error) => error.into(),
            DesignError::Unbounded => Self::new(ProblemKind::NoPlan, error.to_string()),
        }
    }
}
