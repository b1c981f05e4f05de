//! What a request asks the planner for, in the planner's units.

use super::plan_view::TouchView;
use super::request::{AlsoRequest, Manner, QuietRequest, TouchRequest, check_intensity};
use crate::daemon::api::problem::Problem;
use crate::effects::Intensity;
use crate::planner::request::MAX_QUIET_RADIUS_M;
use crate::planner::schedule::{Span, Window, spans};
use crate::planner::{Quiet, Request, Target};
use crate::scene::Scene;

/// How long a touch vibrates if it does not say, in ms.
pub const DEFAULT_DURATION_MS: u32 = 1_000;

/// Everything that is asked for, checked as far as that goes without planning.
#[derive(Clone, Debug)]
pub struct Asked {
    /// The fingers, in the order of the request's targets.
    pub touches: Vec<TouchView>,
    /// For the planner.
    pub request: Request,
    /// For the targets that have none of their own.
    pub intensity: Option<Intensity>,
    /// For how long, and how.
    pub manner: Manner,
    /// Where there are time windows.
    pub spans: Option<Vec<Span>>,
    /// Whether to work out what can be had where it cannot be had in full.
    pub with_trade: bool,
}

impl Asked {
    /// All fingers of a page.
    ///
    /// # Errors
    /// [`Problem`] that names the field.
    pub fn fingers(
        touches: Vec<TouchView>,
        intensity: Option<Intensity>,
        manner: Manner,
        scene: &Scene,
    ) -> Result<Self, Problem> {
        let of = |(t, touch): (usize, &TouchView)| {
            target(touch, scene).map_err(|problem| problem.of(Some(format!("touches[{t}]"))).finger(touch.id))
        };
        let targets = touches.iter().enumerate().map(of).collect::<Result<Vec<_>, _>>()?;
        let request = Request::touch(&targets);
        Ok(Self { touches, request, intensity, manner, spans: None, with_trade: false })
    }
}

/// Refuses a finger that no plan can be made for.
///
/// # Errors
/// [`Problem`] that names the field: a place outside the screen or in a cut-out, a peak that nothing can have.
pub fn check_finger(touch: &TouchView, scene: &Scene) -> Result<(), Problem> {
    target(touch, scene).map(drop)
}

fn target(touch: &TouchView, scene: &Scene) -> Result<Target, Problem> {
    let (x_m, y_m) = scene.place_px(touch.x_px, touch.y_px)?.xy_m();
    check_intensity(touch.intensity_g)?;
    Ok(Target { x_m, y_m, intensity_g: touch.intensity_g })
}

fn at_least_0(field: &'static str, value: f64) -> Result<(), Problem> {
    if value.is_finite() && value >= 0.0 { Ok(()) } else { Err(Problem::range(field, value, 0, f64::INFINITY)) }
}

fn quiet(zone: &QuietRequest, scene: &Scene) -> Result<Quiet, Problem> {
    let (x_m, y_m) = scene.place_px(zone.x_px, zone.y_px)?.xy_m();
    let most_mm = MAX_QUIET_RADIUS_M * 1e3;
    if !(0.0..=most_mm).contains(&zone.radius_mm) {
        return Err(Problem::range("radius_mm", zone.radius_mm, 0, most_mm));
    }
    at_least_0("at_most_g", zone.at_most_g)?;
    Ok(Quiet { x_m, y_m, radius_m: zone.radius_mm / 1e3, at_most_g: zone.at_most_g })
}

/// The window of a target of which only one end may be given; `None` if neither is.
fn window(from_ms: Option<f64>, to_ms: Option<f64>, end_ms: f64) -> Result<Option<Window>, Problem> {
    if from_ms.is_none() && to_ms.is_none() {
        return Ok(None);
    }
    let window = Window { from_ms: from_ms.unwrap_or(0.0), to_ms: to_ms.unwrap_or(end_ms) };
    window.check()?;
    Ok(Some(window))
}

impl TouchRequest {
    /// What this asks for, on this scene.
    ///
    /// # Errors
    /// [`Problem`] that names the field, `also[0].x_px` for one of the first other target.
    pub fn asked(&self, scene: &Scene) -> Result<Asked, Problem> {
        let (intensity, manner) = self.feel().check(DEFAULT_DURATION_MS)?;
        let also = self.also.iter().flatten();
        let first = TouchView { id: 0, x_px: self.x_px, y_px: self.y_px, intensity_g: None, effect: None };
        let others = (1..).zip(also.clone()).map(|(id, other)| {
            let AlsoRequest { x_px, y_px, intensity_g, .. } = *other;
            TouchView { id, x_px, y_px, intensity_g, effect: None }
        });
        let touches: Vec<TouchView> = std::iter::once(first).chain(others).collect();
        let name = |t: usize| (t > 0).then(|| format!("also[{}]", t - 1));
        let mut request = Request::touch(&[]);
        for (t, touch) in touches.iter().enumerate() {
            request.targets.push(target(touch, scene).map_err(|problem| problem.of(name(t)))?);
        }
        for (i, zone) in self.quiet.iter().flatten().enumerate() {
            request.quiet.push(quiet(zone, scene).map_err(|problem| problem.of(Some(format!("quiet[{i}]"))))?);
        }
        request.objective = self.objective.unwrap_or_default();
        request.grouping = self.grouping.unwrap_or_default();
        request.weigh = self.weigh.unwrap_or_default();
        let ends: Vec<(Option<f64>, Option<f64>)> =
            std::iter::once((self.from_ms, self.to_ms)).chain(also.map(|other| (other.from_ms, other.to_ms))).collect();
        let spans = self.spans(&ends, manner, name)?;
        Ok(Asked { touches, request, intensity, manner, spans, with_trade: self.trade.unwrap_or(false) })
    }

    /// Where windows begin and end. Targets without one last for `duration_ms`; if that is not given, as long as any other.
    fn spans(
        &self,
        ends: &[(Option<f64>, Option<f64>)],
        manner: Manner,
        name: impl Fn(usize) -> Option<String>,
    ) -> Result<Option<Vec<Span>>, Problem> {
        if matches!(manner, Manner::Effect(_)) {
            // Before their values are looked at: an effect has no end that could stand for one that is not given.
            let given = |(t, (from_ms, to_ms)): (usize, &(Option<f64>, Option<f64>))| {
                Some((t, from_ms.map(|ms| ("from_ms", ms)).or(to_ms.map(|ms| ("to_ms", ms)))?))
            };
            return match ends.iter().enumerate().find_map(given) {
                None => Ok(None),
                Some((t, (field, ms))) => {
                    let detail = format!("{field} is {ms}, but is for even drives: an effect has its own length");
                    Err(Problem::body(detail).at(field, ms.into(), "absent with an effect".into(), None).of(name(t)))
                }
            };
        }
        let latest_ms = ends.iter().filter_map(|(_, to_ms)| *to_ms).fold(f64::NAN, f64::max);
        let hold_ms = match manner {
            Manner::Hold(hold) if self.duration_ms.is_some() || latest_ms.is_nan() => hold.as_secs_f64() * 1e3,
            _ => latest_ms,
        };
        let mut windows = Vec::new();
        for (t, (from_ms, to_ms)) in ends.iter().enumerate() {
            windows.push(window(*from_ms, *to_ms, hold_ms).map_err(|problem| problem.of(name(t)))?);
        }
        if windows.iter().all(Option::is_none) {
            return Ok(None);
        }
        let all = Window { from_ms: 0.0, to_ms: hold_ms };
        let windows: Vec<Window> = windows.into_iter().map(|window| window.unwrap_or(all)).collect();
        Ok(Some(spans(&windows)?))
    }
}
