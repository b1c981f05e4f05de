//! What can be had of a request that cannot be had in full: more for one target against less for the others, and quiet zones
//! against what the targets get.

use crate::STANDARD_GRAVITY;
use crate::chosen_drive::fundamental_acceleration_peak_at_point_m_per_s2;
use crate::plan::{MET_FRACTION, Plan, Planned};
use crate::request::y_or_bar_axis_y_m;
use crate::request::{Objective, PlanError, Request, Weigh};
use crate::stop::StopRequest;
use crate::table::PlanTable;
use serde::Serialize;

/// Steps of a curve from nothing to all that its target can have.
const STEPS: u32 = 10;
/// Part of what the others can have to which their share is found.
const CLOSE: f64 = 5e-3;
/// Plans for one point of a curve at most; halving takes 8.
const MOST_ROUNDS: usize = 10;
/// Part of a wish that may be missing: a plan's last scaling, where the moving masses ask for one, is right to a thousandth.
const ON_BORDER: f64 = 1e-3;
/// Least limit of a quiet zone from which its steps are counted, in g: an eighth or less of what is felt.
const LEAST_QUIET_G: f64 = 1e-3;
/// Doublings of the quiet zones' limits at most: to a thousandfold.
const MOST_DOUBLINGS: u32 = 10;
/// Relative gain below which quiet zones are not what limits.
const NO_GAIN: f64 = 1e-3;

/// What can be had.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[cfg_attr(feature = "schema", derive(utoipa::ToSchema))]
#[cfg_attr(feature = "schema", schema(as = Trade))]
pub struct TradeOffs {
    /// What each target gets if it is the only one, at most its wish, in g.
    pub alone_g: Vec<f64>,
    /// Of one target against all others together: one curve for two targets, one for each of more.
    pub targets: Vec<Curve>,
    /// With the quiet zones' limits as they are, doubled again and again, and without; empty where they do not limit.
    pub quiet: Vec<QuietPoint>,
}

/// One target against the others.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[cfg_attr(feature = "schema", derive(utoipa::ToSchema))]
#[cfg_attr(feature = "schema", schema(as = TradeCurve))]
pub struct Curve {
    /// The target's number, from 0.
    pub target: usize,
    /// From nothing for it to all that it can have alone.
    pub points: Vec<Point>,
}

/// What can be had together. Each point is a plan.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[cfg_attr(feature = "schema", derive(utoipa::ToSchema))]
#[cfg_attr(feature = "schema", schema(as = TradePoint))]
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
#[cfg_attr(feature = "schema", derive(utoipa::ToSchema))]
#[cfg_attr(feature = "schema", schema(as = TradeQuietPoint))]
pub struct QuietPoint {
    /// Limit of each zone in g; `None` without any.
    pub at_most_g: Option<Vec<f64>>,
    /// The part of its wish that every target gets.
    pub part: f64,
    /// Peaks of all targets in g.
    pub peaks_g: Vec<f64>,
}

/// The plan for a request, and what can be had where it does not give all. Where a plan made for that gives every target a
/// larger part of its wish, within the same quiet zones, it is the plan.
///
/// # Errors
/// [`PlanError`].
pub fn plan_and_improve_by_exploring_trade_offs(
    table: &PlanTable,
    request: &Request,
) -> Result<(Planned, Option<TradeOffs>), PlanError> {
    let planned = table.plan_with_details(request)?;
    let Some((trade, seen)) = trace_trade_offs_and_tried_plans_if_wishes_conflict(table, request, &planned.plan)?
    else {
        return Ok((planned, None));
    };
    let wanted_g: Vec<f64> = planned.plan.targets.iter().map(|target| target.wanted_g).collect();
    let own = least_fraction_of_wishes_met_or_infinity(&peak_at_each_target_g(&planned.plan), &wanted_g);
    let best = seen.iter().max_by(|a, b| {
        least_fraction_of_wishes_met_or_infinity(&a.peaks_g, &wanted_g)
            .total_cmp(&least_fraction_of_wishes_met_or_infinity(&b.peaks_g, &wanted_g))
    });
    let Some(best) =
        best.filter(|seen| least_fraction_of_wishes_met_or_infinity(&seen.peaks_g, &wanted_g) > own * (1.0 + NO_GAIN))
    else {
        return Ok((planned, Some(trade)));
    };
    // What it was made for, and what it gives, which may be more: of the plans for these the better one. Both, as frequencies
    // between the grid's are chosen for what is asked.
    let given_g: Vec<f64> = best.peaks_g.iter().zip(&wanted_g).map(|(peak, wanted)| peak.min(*wanted)).collect();
    let mut found: Option<(f64, Planned)> = None;
    for asked_g in [&best.asked_g, &given_g] {
        let mut asked = request.clone();
        asked.targets.iter_mut().zip(asked_g).for_each(|(target, g)| target.intensity_g = Some(*g));
        let trial = table.plan_with_details(&asked)?;
        let part = least_fraction_of_wishes_met_or_infinity(&peak_at_each_target_g(&trial.plan), &wanted_g);
        if part > found.as_ref().map_or(own, |(part, _)| *part) {
            found = Some((part, trial));
        }
    }
    let Some((part, mut better)) = found else { return Ok((planned, Some(trade))) };
    for (target, wanted_g) in better.plan.targets.iter_mut().zip(wanted_g) {
        target.wanted_g = wanted_g;
    }
    if part < MET_FRACTION && better.plan.limits.is_empty() {
        (better.plan.limited_by, better.plan.limits) = (planned.plan.limited_by, planned.plan.limits);
    }
    // The bound stands; what is known is nearer to it.
    better.plan.optimality_gap = ((1.0 + planned.plan.optimality_gap) * own / part - 1.0).max(0.0);
    Ok((better, Some(trade)))
}

/// What can be had of `request`, for which `plan` was made: `None` if that gives all that was wanted, or if there is but
/// one target and no quiet zone or accelerations are weighed, so that `limited_by` says everything. Takes up to some hundred plans, between
/// which it looks whether it is to end ([`StopRequest`]).
///
/// # Errors
/// [`PlanError`].
pub fn explore_trade_offs_if_wishes_conflict(
    table: &PlanTable,
    request: &Request,
    plan: &Plan,
) -> Result<Option<TradeOffs>, PlanError> {
    Ok(trace_trade_offs_and_tried_plans_if_wishes_conflict(table, request, plan)?.map(|(trade, _)| trade))
}

/// The trade-off, and all plans that were tried for it.
fn trace_trade_offs_and_tried_plans_if_wishes_conflict(
    table: &PlanTable,
    request: &Request,
    plan: &Plan,
) -> Result<Option<(TradeOffs, Vec<TriedPlan>)>, PlanError> {
    let has_parts = request.targets.len() > 1 || !request.quiet.is_empty();
    if plan.limited_by.is_none() || !has_parts || request.objective == Objective::Reach || request.weigh == Weigh::Felt
    {
        return Ok(None);
    }
    let wanted_g: Vec<f64> = plan.targets.iter().map(|target| target.wanted_g).collect();
    let shapes: Vec<_> = request
        .targets
        .iter()
        .map(|target| table.model.shape_deflections_at(target.x_m, y_or_bar_axis_y_m(table, target.y_m)))
        .collect();
    let (mut alone_g, mut seen) = (Vec::with_capacity(shapes.len()), Vec::with_capacity(shapes.len()));
    for (t, wanted_g) in wanted_g.iter().enumerate() {
        let mut only = request.with_selected_targets(&[t]);
        only.targets.iter_mut().for_each(|target| target.intensity_g = Some(*wanted_g));
        fail_if_stop_requested()?;
        let Planned { plan, drives, .. } = table.plan_with_details(&only)?;
        alone_g.push(plan.predicted.target_peak_g.min(*wanted_g));
        let peaks_g = shapes
            .iter()
            .map(|shape| fundamental_acceleration_peak_at_point_m_per_s2(&drives, shape) / STANDARD_GRAVITY)
            .collect();
        let asked_g = (0..shapes.len()).map(|other| if other == t { *wanted_g } else { 0.0 }).collect();
        seen.push(TriedPlan { asked_g, peaks_g });
    }
    seen.push(TriedPlan { asked_g: wanted_g.clone(), peaks_g: peak_at_each_target_g(plan) });
    let mut border = TradeFrontier { table, request, peak_of_each_target_alone_g: &alone_g, seen };
    let curves = match alone_g.len() {
        0 | 1 => 0,
        2 => 1,
        more => more,
    };
    let mut targets = Vec::new();
    for target in (0..curves).filter(|t| alone_g[*t] > 0.0) {
        targets.push(border.trace_curve_of_others_fraction_over_target_fraction(target)?);
    }
    let seen = border.seen;
    let quiet = explore_peaks_at_relaxed_quiet_limits(table, request, &wanted_g)?;
    Ok(Some((TradeOffs { alone_g, targets, quiet }, seen)))
}

/// What the targets get with the quiet zones' limits as they are, doubled again and again, and without limits.
fn explore_peaks_at_relaxed_quiet_limits(
    table: &PlanTable,
    request: &Request,
    wanted_g: &[f64],
) -> Result<Vec<QuietPoint>, PlanError> {
    if request.quiet.is_empty() {
        return Ok(Vec::new());
    }
    let mut trial = request.clone();
    for (target, wanted_g) in trial.targets.iter_mut().zip(wanted_g) {
        target.intensity_g = Some(*wanted_g);
    }
    let point = |trial: &Request| -> Result<QuietPoint, PlanError> {
        fail_if_stop_requested()?;
        let peaks_g = peak_at_each_target_g(&table.plan_request(trial)?);
        let limits = trial.quiet.iter().map(|zone| zone.at_most_g).collect::<Vec<_>>();
        let part = least_fraction_of_wishes_met_or_infinity(&peaks_g, wanted_g).min(1.0);
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

/// A plan that was tried, in g at all targets.
struct TriedPlan {
    /// What it was made for.
    asked_g: Vec<f64>,
    /// What it gives.
    peaks_g: Vec<f64>,
}

/// The peaks that several targets have had together so far, in all plans tried.
struct TradeFrontier<'a> {
    table: &'a PlanTable,
    request: &'a Request,
    peak_of_each_target_alone_g: &'a [f64],
    seen: Vec<TriedPlan>,
}

impl TradeFrontier<'_> {
    /// The curve for `target` in steps: what every other target can have.
    fn trace_curve_of_others_fraction_over_target_fraction(&mut self, target: usize) -> Result<Curve, PlanError> {
        // The others never get more for the target's getting more.
        let mut most = 1.0;
        let parts: Vec<f64> = (0..=STEPS).map(|step| f64::from(step) / f64::from(STEPS)).collect();
        for part in &parts {
            most = self.search_others_fraction_and_return_upper_bound(target, *part, most)?;
        }
        let points = parts.into_iter().filter_map(|part| {
            let (others_part, peaks_g) = self.find_best_others_fraction_and_peaks_g_of_tried_plans(target, part)?;
            Some(Point { part, others_part, peaks_g: peaks_g.clone() })
        });
        Ok(Curve { target, points: points.collect() })
    }

    /// Searches for the largest fraction up to `upper` that all others can have while `target` has `target_fraction_of_alone`;
    /// returns an upper bound on it.
    fn search_others_fraction_and_return_upper_bound(
        &mut self,
        target: usize,
        target_fraction_of_alone: f64,
        upper: f64,
    ) -> Result<f64, PlanError> {
        let mut high = upper;
        let mut next = high;
        for _ in 0..MOST_ROUNDS {
            let low = self
                .find_best_others_fraction_and_peaks_g_of_tried_plans(target, target_fraction_of_alone)
                .map_or(0.0, |(others_part, _)| others_part);
            if high - low <= CLOSE {
                break;
            }
            if !self.try_plan_meeting_fractions_of_alone_peaks(target, target_fraction_of_alone, next)? {
                high = next;
            }
            let low = self
                .find_best_others_fraction_and_peaks_g_of_tried_plans(target, target_fraction_of_alone)
                .map_or(0.0, |(others_part, _)| others_part);
            next = 0.5 * (low + high);
        }
        Ok(high)
    }

    /// Makes a plan for these fractions; returns whether it gives them.
    fn try_plan_meeting_fractions_of_alone_peaks(
        &mut self,
        target: usize,
        target_fraction_of_alone: f64,
        others_fraction_of_alone: f64,
    ) -> Result<bool, PlanError> {
        fail_if_stop_requested()?;
        let wish =
            |(t, g): (usize, &f64)| g * if t == target { target_fraction_of_alone } else { others_fraction_of_alone };
        let asked_g: Vec<f64> = self.peak_of_each_target_alone_g.iter().enumerate().map(wish).collect();
        let mut trial = self.request.clone();
        trial.targets.iter_mut().zip(&asked_g).for_each(|(target, g)| target.intensity_g = Some(*g));
        let peaks_g = peak_at_each_target_g(&self.table.plan_request(&trial)?);
        self.seen.push(TriedPlan { asked_g, peaks_g });
        Ok(self
            .find_best_others_fraction_and_peaks_g_of_tried_plans(target, target_fraction_of_alone)
            .is_some_and(|(had, _)| had >= others_fraction_of_alone * (1.0 - ON_BORDER)))
    }

    /// Of all tried plans that give `target` its fraction, the fraction and the peaks of the one that gives the
    /// others most.
    fn find_best_others_fraction_and_peaks_g_of_tried_plans(
        &self,
        target: usize,
        target_fraction_of_alone: f64,
    ) -> Option<(f64, &Vec<f64>)> {
        // Who cannot have anything has all of it.
        let of = |t: usize, peaks_g: &[f64]| match self.peak_of_each_target_alone_g[t] {
            alone_g if alone_g > 0.0 => peaks_g[t] / alone_g,
            _ => 1.0,
        };
        self.seen
            .iter()
            .map(|seen| &seen.peaks_g)
            .filter(|peaks_g| of(target, peaks_g) >= target_fraction_of_alone * (1.0 - ON_BORDER))
            .map(|peaks_g| {
                let others = (0..peaks_g.len()).filter(|t| *t != target).map(|t| of(t, peaks_g));
                (others.fold(1.0, f64::min), peaks_g)
            })
            .max_by(|a, b| a.0.total_cmp(&b.0))
    }
}

/// Returns an error if nobody waits for the answer any more; called between two plans.
fn fail_if_stop_requested() -> Result<(), PlanError> {
    if StopRequest::current_request_of_thread().is_stop_requested_or_deadline_over() {
        Err(PlanError::Stopped)
    } else {
        Ok(())
    }
}

/// The peaks at the targets in g.
fn peak_at_each_target_g(plan: &Plan) -> Vec<f64> {
    plan.targets.iter().map(|target| target.peak_g).collect()
}

/// The least fraction of its wish that any target with a wish gets; infinite without any.
fn least_fraction_of_wishes_met_or_infinity(peaks_g: &[f64], wishes_g: &[f64]) -> f64 {
    let parts = peaks_g.iter().zip(wishes_g).filter(|(_, wish)| **wish > 0.0).map(|(peak, wish)| peak / wish);
    parts.fold(f64::INFINITY, f64::min)
}
