//! What can be had of a request that cannot be had in full: more for one target against less for the others, and quiet zones
//! against what the targets get.

use super::plan::Plan;
use super::request::{Objective, PlanError, Request};
use super::table::PlanTable;
use serde::Serialize;

/// Steps of a curve from nothing to all that its target can have.
const STEPS: u32 = 10;
/// Part of what the others can have to which their share is found.
const CLOSE: f64 = 5e-3;
/// Plans for one point of a curve at most.
const MOST_ROUNDS: usize = 12;
/// Times the wishes that are planned for to learn how far they are from the border: above 1, so that it is known from both
/// sides.
const FAR: f64 = 4.0;
/// What counts as on the border: a plan's last scaling, where the moving masses ask for one, is right to a thousandth.
const ON_BORDER: f64 = 1e-3;
/// Least limit of a quiet zone from which its steps are counted, in g: an eighth or less of what is felt.
const LEAST_QUIET_G: f64 = 1e-3;
/// Doublings of the quiet zones' limits at most: to a thousandfold.
const MOST_DOUBLINGS: u32 = 10;
/// Relative gain below which quiet zones are not what limits.
const NO_GAIN: f64 = 1e-3;

/// What can be had.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Trade {
    /// What each target gets if it is the only one, at most its wish, in g.
    pub alone_g: Vec<f64>,
    /// Of one target against all others together: one curve for two targets, one for each of more.
    pub targets: Vec<Curve>,
    /// With the quiet zones' limits as they are, doubled again and again, and without; empty where they do not limit.
    pub quiet: Vec<QuietPoint>,
}

/// One target against the others.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Curve {
    /// The target's number, from 0.
    pub target: usize,
    /// From nothing for it to all that it can have alone.
    pub points: Vec<Point>,
}

/// What can be had together. Each point is a plan.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Point {
    /// What the curve's target gets at least, of what it gets alone.
    pub part: f64,
    /// What every other target gets at least then, of what it gets alone: the most there is, to half a per cent.
    pub others_part: f64,
    /// Peaks of all targets in g.
    pub peaks_g: Vec<f64>,
}

/// What the targets get with other limits of the quiet zones.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct QuietPoint {
    /// Limit of each zone in g; `None` without any.
    pub at_most_g: Option<Vec<f64>>,
    /// The part of its wish that every target gets.
    pub part: f64,
    /// Peaks of all targets in g.
    pub peaks_g: Vec<f64>,
}

impl PlanTable {
    /// What can be had of `request`, for which `plan` was made: `None` if that gives all that was wanted, or if there is but
    /// one target and no quiet zone, so that `limited_by` says everything. Takes up to some hundred plans.
    ///
    /// # Errors
    /// [`PlanError`].
    pub fn trade(&self, request: &Request, plan: &Plan) -> Result<Option<Trade>, PlanError> {
        let has_parts = request.targets.len() > 1 || !request.quiet.is_empty();
        if plan.limited_by.is_none() || !has_parts || request.objective == Objective::Reach {
            return Ok(None);
        }
        let wanted_g: Vec<f64> = plan.targets.iter().map(|target| target.wanted_g).collect();
        let mut alone_g = Vec::with_capacity(wanted_g.len());
        for (t, wanted_g) in wanted_g.iter().enumerate() {
            let mut only = request.only(&[t]);
            only.targets.iter_mut().for_each(|target| target.intensity_g = Some(*wanted_g));
            alone_g.push(self.plan_for(&only)?.predicted.target_peak_g.min(*wanted_g));
        }
        let border = Border { table: self, request, alone_g: &alone_g };
        let curves = match alone_g.len() {
            0 | 1 => 0,
            2 => 1,
            more => more,
        };
        let mut targets = Vec::new();
        for target in (0..curves).filter(|t| alone_g[*t] > 0.0) {
            targets.push(border.curve(target)?);
        }
        let quiet = self.quiet_trade(request, &wanted_g)?;
        Ok(Some(Trade { alone_g, targets, quiet }))
    }

    fn quiet_trade(&self, request: &Request, wanted_g: &[f64]) -> Result<Vec<QuietPoint>, PlanError> {
        if request.quiet.is_empty() {
            return Ok(Vec::new());
        }
        let mut trial = request.clone();
        for (target, wanted_g) in trial.targets.iter_mut().zip(wanted_g) {
            target.intensity_g = Some(*wanted_g);
        }
        let point = |trial: &Request| -> Result<QuietPoint, PlanError> {
            let peaks_g = peaks(&self.plan_for(trial)?);
            let limits = trial.quiet.iter().map(|zone| zone.at_most_g).collect::<Vec<_>>();
            let part = least_part(&peaks_g, wanted_g).min(1.0);
            Ok(QuietPoint { at_most_g: (!limits.is_empty()).then_some(limits), part, peaks_g })
        };
        let free = point(&Request { quiet: Vec::new(), ..trial.clone() })?;
        let mut points = vec![point(&trial)?];
        let is_free = |point: &QuietPoint| point.part >= free.part * (1.0 - NO_GAIN);
        if points.iter().any(is_free) {
            return Ok(Vec::new());
        }
        for _ in 0..MOST_DOUBLINGS {
            trial.quiet.iter_mut().for_each(|zone| zone.at_most_g = 2.0 * zone.at_most_g.max(LEAST_QUIET_G));
            let next = point(&trial)?;
            let is_last = is_free(&next);
            points.push(next);
            if is_last {
                break;
            }
        }
        points.push(free);
        Ok(points)
    }
}

/// Where what several targets can have together ends.
struct Border<'a> {
    table: &'a PlanTable,
    request: &'a Request,
    alone_g: &'a [f64],
}

impl Border<'_> {
    /// For `target` in steps: what every other one can have.
    fn curve(&self, target: usize) -> Result<Curve, PlanError> {
        let mut points = Vec::new();
        // The others never get more for the target's getting more.
        let mut most = 1.0;
        for step in 0..=STEPS {
            let part = f64::from(step) / f64::from(STEPS);
            most = self.most_others(target, part, most)?;
            let peaks_g = peaks(&self.plan(target, part, most, 1.0)?);
            points.push(Point { part, others_part: most, peaks_g });
        }
        Ok(Curve { target, points })
    }

    fn wishes(&self, target: usize, part: f64, others_part: f64) -> impl Iterator<Item = f64> + '_ {
        let parts = move |t: usize| if t == target { part } else { others_part };
        self.alone_g.iter().enumerate().map(move |(t, alone_g)| alone_g * parts(t))
    }

    fn plan(&self, target: usize, part: f64, others_part: f64, times: f64) -> Result<Plan, PlanError> {
        let mut trial = self.request.clone();
        for (asked, wish_g) in trial.targets.iter_mut().zip(self.wishes(target, part, others_part)) {
            asked.intensity_g = Some(wish_g * times);
        }
        self.table.plan_for(&trial)
    }

    /// By how much the wishes are beyond the border, relative: 0 on it, negative within.
    fn beyond(&self, target: usize, part: f64, others_part: f64) -> Result<f64, PlanError> {
        let peaks_g = peaks(&self.plan(target, part, others_part, FAR)?);
        let wishes: Vec<f64> = self.wishes(target, part, others_part).collect();
        Ok(1.0 / least_part(&peaks_g, &wishes) - 1.0)
    }

    /// The most that all others can have of what they have alone, at most `most`, while `target` has `part`. The distance
    /// from the border is a piecewise smooth, growing function of it: false position, its Illinois variant.
    fn most_others(&self, target: usize, part: f64, most: f64) -> Result<f64, PlanError> {
        let (mut low, mut high) = (0.0, most);
        let mut above = self.beyond(target, part, high)?;
        if above <= ON_BORDER {
            return Ok(high);
        }
        // Alone, each can have all of its part.
        let mut below = part - 1.0;
        let mut last_was_low = None;
        for _ in 0..MOST_ROUNDS {
            if high - low <= CLOSE {
                break;
            }
            // Never nearer to an end than is asked for, so that both come together.
            let step = (-below / (above - below) * (high - low)).clamp(0.5 * CLOSE, high - low - 0.5 * CLOSE);
            let middle = low + step;
            let value = self.beyond(target, part, middle)?;
            let is_low = value <= ON_BORDER;
            // An end that stays twice counts half.
            let half = if last_was_low == Some(is_low) { 0.5 } else { 1.0 };
            last_was_low = Some(is_low);
            if is_low {
                (low, below, above) = (middle, value, half * above);
            } else {
                (high, above, below) = (middle, value, half * below);
            }
        }
        Ok(low)
    }
}

fn peaks(plan: &Plan) -> Vec<f64> {
    plan.targets.iter().map(|target| target.peak_g).collect()
}

/// The least part of its wish that any target gets that has one; infinite without any.
fn least_part(peaks_g: &[f64], wishes_g: &[f64]) -> f64 {
    let parts = peaks_g.iter().zip(wishes_g).filter(|(_, wish)| **wish > 0.0).map(|(peak, wish)| peak / wish);
    parts.fold(f64::INFINITY, f64::min)
}
