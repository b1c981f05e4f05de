//! The one setting for a whole surface, or a region of it, whose weakest place is the strongest.

use super::measure::Measure;
use super::search;
use super::setting::{self, compute_peak_of_setting_at_each_point};
use super::space::ReachSpace;
use crate::request::SearchEffort;
use crate::table::{ActuatorSetting, PlanTable, PointView, Region};
use nalgebra::DMatrix;
use num_complex::Complex64;

/// Points of the finer grid that are added at once to those that the weakest place is looked for at.
const ADDED: usize = 12;
/// Rounds of that. A dozen is usual.
const REFINEMENTS: usize = 200;
/// Steps of all searches together after which no other begins.
const MOST_STEPS: usize = 400_000;
/// Relative difference of minima that counts as none.
pub(crate) const EQUAL_MINIMA: f64 = 1e-6;

/// The setting at distinct frequencies with the largest minimum over the surface or a region of it, for masses at
/// rest, and the relative gap by which another setting could be better. `None` if no frequencies are usable.
#[must_use]
pub fn max_min_setting_and_relative_gap_if_spacing_can_be_kept(
    table: &PlanTable,
    region: Option<Region>,
) -> Option<(Vec<ActuatorSetting>, f64)> {
    let (view, measure) = (PointView::new(table, region)?, Measure::G);
    let space = ReachSpace::from_table(table, &view.shapes, |hz| measure.weight_per_m_per_s2(hz));
    let (setting, at_most) = max_min_setting_and_upper_bound_if_spacing_can_be_kept(table, &view, measure, space)?;
    let least = compute_peak_of_setting_at_each_point(table, &view.finer, &setting, measure)
        .into_iter()
        .fold(f64::INFINITY, f64::min);
    let gap = if at_most <= least { 0.0 } else { at_most / least - 1.0 };
    Some((setting, gap))
}

/// The setting of [`max_min_setting_and_relative_gap_if_spacing_can_be_kept`] for the whole surface, computed at the first call and kept in the table.
pub(crate) fn get_or_compute_surface_max_min_setting_and_relative_gap(
    table: &PlanTable,
) -> Option<&(Vec<ActuatorSetting>, f64)> {
    table.evened.get_or_init(|| max_min_setting_and_relative_gap_if_spacing_can_be_kept(table, None)).as_ref()
}

/// Computes that setting in advance, so that the first request does not have to wait.
pub fn compute_and_cache_max_min_setting_of_whole_surface(table: &PlanTable) {
    let _ = get_or_compute_surface_max_min_setting_and_relative_gap(table);
}

/// The setting with the largest minimum on a view's finer grid, and an upper bound on that minimum. The search begins
/// at the points of `space`, those of the view's own grid, and adds points of the finer grid at which its setting is
/// weaker.
pub(crate) fn max_min_setting_and_upper_bound_if_spacing_can_be_kept(
    table: &PlanTable,
    view: &PointView,
    measure: Measure,
    mut space: ReachSpace,
) -> Option<(Vec<ActuatorSetting>, f64)> {
    let finer = &view.finer;
    let mut added: Vec<usize> = Vec::new();
    let mut strongest: Option<(f64, Vec<ActuatorSetting>)> = None;
    let mut upper = f64::INFINITY;
    let mut hint: Option<Vec<usize>> = None;
    let mut steps = 0;
    // With little work as long as points join.
    let mut effort = SearchEffort::Touch;
    for _ in 0..REFINEMENTS {
        let all: Vec<usize> = (0..space.points).collect();
        let best = search::find_frequencies_with_largest_least_gain_if_spacing_possible(
            &space,
            &all,
            effort,
            hint.as_deref(),
        )?;
        upper = upper.min(best.upper);
        steps += best.steps;
        let setting = best.to_setting(table, &space);
        let peaks = compute_peak_of_setting_at_each_point(table, finer, &setting, measure);
        let mut weaker: Vec<usize> =
            (0..peaks.len()).filter(|x| peaks[*x] < best.least * (1.0 - EQUAL_MINIMA) && !added.contains(x)).collect();
        weaker.sort_by(|a, b| peaks[*a].total_cmp(&peaks[*b]));
        let least = peaks.iter().copied().fold(f64::INFINITY, f64::min);
        if strongest.as_ref().is_none_or(|strongest| least > strongest.0) {
            strongest = Some((least, setting));
        }
        hint = Some(best.choice);
        let is_proven = strongest.as_ref().is_some_and(|(least, _)| upper <= least * (1.0 + 2.0 * EQUAL_MINIMA));
        if is_proven || steps >= MOST_STEPS {
            break;
        }
        if weaker.is_empty() {
            if effort == SearchEffort::Surface {
                break;
            }
            effort = SearchEffort::Surface;
            continue;
        }
        // The worst, and others from all of the range.
        added.extend(weaker.iter().step_by(weaker.len().div_ceil(ADDED)));
        let shapes = finer.select_rows(&added);
        let rows: Vec<_> = view.shapes.row_iter().chain(shapes.row_iter()).collect();
        space = ReachSpace::from_table(table, &DMatrix::from_rows(&rows), |hz| measure.weight_per_m_per_s2(hz));
    }
    let (least, setting) = strongest?;
    Some((setting, if upper <= least * (1.0 + 2.0 * EQUAL_MINIMA) { least } else { upper }))
}

impl search::MaxMinCombination {
    /// The combination as a setting with the forces of masses at rest.
    pub(crate) fn to_setting(&self, table: &PlanTable, space: &ReachSpace) -> Vec<ActuatorSetting> {
        let each = self.choice.iter().zip(&self.parts).enumerate();
        each.map(|(i, (f, part))| {
            setting::build_setting_with_strongest_pulse(table, i, *f, Complex64::from(part * space.max_force_n(i, *f)))
        })
        .collect()
    }
}
