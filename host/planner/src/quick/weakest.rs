//! The weakest of some points, with bounds for all and the exact search for few.

use super::points::list_finer_points_around_places_m;
use super::{QuickError, frequencies};
use crate::assignment::{Assignment, count_frequencies_below_each_with_spacing};
use crate::drive::Drive;
use crate::reach::setting::derate_setting_to_safe_fraction_if_any;
use crate::reach::{Measure, ReachSpace, search};
use crate::request::SearchEffort;
use crate::table::PlanTable;
use crate::table::touched::TouchedPanel;
use crate::{MIN_SPACING_HZ, PlanError, TableOptions};
use nalgebra::DMatrix;
use std::collections::{HashMap, HashSet};

/// Of the coarse points that are weaker than those beside them, how many of the weakest are looked around.
const LOOKED_AROUND: usize = 12;
/// Part by which what can be had at a place that is touched may be less than a rough look says. That look takes switching on for more than it is, so that it says less nearly
/// always, but may say more where other poles than a drive's own move a mass. No weakest place was left out on random panels with fingers.
pub(super) const ROUGHLY: f64 = 0.2;
/// Places that are touched and looked at side by side, for the many that would not have been looked at after the weakest of them.
const TOGETHER: usize = 8;
/// Rounds in which the points around the weakest are looked at again. One or two are usual.
const ROUNDS: usize = 8;

/// The weakest place of a design.
#[derive(Clone, Debug, PartialEq)]
pub struct WeakestPlace {
    /// The strongest peak that can be had there, in the measure's unit.
    pub peak: f64,
    /// Where, in m.
    pub at_m: (f64, f64),
    /// The drives that make it.
    pub drives: Vec<Drive>,
    /// Places that were looked at.
    pub points: usize,
    /// Frequencies to choose from.
    pub frequencies: usize,
}

/// The estimate of a point: the peak that it can have, or a lower bound on it.
#[derive(Clone, Copy)]
struct PointEstimate {
    place_m: (f64, f64),
    least: f64,
}

/// The weakest place of a table's points and of the points around the weakest of these.
pub(super) fn find_place_of_least_achievable_peak_of_table(
    table: &PlanTable,
    measure: Measure,
    max_hz: f64,
) -> Result<WeakestPlace, QuickError> {
    let there = list_surface_point_indices_and_places_m(table);
    let places = there.iter().map(|(_, place)| *place).collect();
    let of_grid: Vec<usize> = there.iter().map(|(point, _)| *point).collect();
    let shapes = table.grid.shapes.select_rows(&of_grid);
    let mut coarse = PointSearch::new(table, measure, places, &shapes).ok_or(PlanError::NoFrequencies)?;
    let first = coarse
        .find_exact_weakest_point_if_below_and_update_estimates(table, f64::INFINITY)
        .ok_or(PlanError::NoFrequencies)?;
    let found = refine_weakest_place_from_coarse_grid(table, max_hz, first, &coarse.known, &of_grid, |fine, below| {
        let mut shapes = DMatrix::zeros(fine.len(), table.model.count_coordinates());
        for (mut row, (x_m, y_m)) in shapes.row_iter_mut().zip(&fine) {
            row.tr_copy_from(&table.model.shape_deflections_at(*x_m, *y_m));
        }
        Ok(PointSearch::new(table, measure, fine, &shapes)
            .ok_or(PlanError::NoFrequencies)?
            .find_exact_weakest_point_if_below_and_update_estimates(table, below))
    })?;
    Ok(WeakestPlace { frequencies: table.frequencies_hz.len(), ..found })
}

/// The same with a finger on each place while it is evaluated; `table` is that of the untouched panel. All places are
/// estimated, and those that may be the weakest, if the peak is lower than the estimate by the fraction `slack`, are
/// evaluated exactly.
pub(super) fn find_place_of_least_achievable_peak_under_finger(
    touched: TouchedPanel<'_>,
    table: &PlanTable,
    measure: Measure,
    options: TableOptions,
    slack: f64,
) -> Result<WeakestPlace, QuickError> {
    let fingered = TouchedSearch { touched, measure, options, slack };
    let (of_grid, places): (Vec<usize>, Vec<(f64, f64)>) =
        list_surface_point_indices_and_places_m(table).into_iter().unzip();
    let coarse = fingered.estimate_achievable_peak_under_finger_at_each_place(&places)?;
    let first = fingered
        .find_exact_weakest_of_estimated_places_if_below(&coarse, f64::INFINITY)?
        .ok_or(PlanError::NoFrequencies)?;
    refine_weakest_place_from_coarse_grid(table, options.to_hz, first, &coarse, &of_grid, |fine, below| {
        fingered.find_exact_weakest_of_estimated_places_if_below(
            &fingered.estimate_achievable_peak_under_finger_at_each_place(&fine)?,
            below,
        )
    })
}

/// A finger that is put on one place after the other.
struct TouchedSearch<'a> {
    touched: TouchedPanel<'a>,
    measure: Measure,
    options: TableOptions,
    slack: f64,
}

impl TouchedSearch<'_> {
    /// What can be had at places (m), roughly.
    fn estimate_achievable_peak_under_finger_at_each_place(
        &self,
        places_m: &[(f64, f64)],
    ) -> Result<Vec<PointEstimate>, QuickError> {
        let ask = |table: &PlanTable| Some(self.build_single_point_search_if_spacing_can_be_kept(table)?.known[0]);
        let known = self.touched.estimate_with_single_pole_overshoot_and_finger_on_each_place(
            places_m,
            |model| frequencies::choose_frequencies_denser_near_modes_hz(model, self.options),
            ask,
        )?;
        Ok(known.into_iter().collect::<Option<_>>().ok_or(PlanError::NoFrequencies)?)
    }

    /// The weakest of places that are known roughly, if it is weaker than `peak_limit`.
    fn find_exact_weakest_of_estimated_places_if_below(
        &self,
        known: &[PointEstimate],
        peak_limit: f64,
    ) -> Result<Option<WeakestPlace>, QuickError> {
        let mut order = known.to_vec();
        order.sort_by(|a, b| a.least.total_cmp(&b.least));
        let (mut least, mut found) = (peak_limit, None);
        for some in order.chunks(TOGETHER) {
            let in_question = some.iter().filter(|known| known.least * (1.0 - self.slack) < least);
            let places: Vec<(f64, f64)> = in_question.map(|known| known.place_m).collect();
            if places.is_empty() {
                break;
            }
            for own in self.compute_exact_achievable_peak_under_finger_at_each_place(&places)? {
                if own.peak < least {
                    least = own.peak;
                    found = Some(own);
                }
            }
        }
        Ok(found)
    }

    /// What can be had at places (m).
    fn compute_exact_achievable_peak_under_finger_at_each_place(
        &self,
        places_m: &[(f64, f64)],
    ) -> Result<Vec<WeakestPlace>, QuickError> {
        let ask = |table: &PlanTable| {
            let found = self
                .build_single_point_search_if_spacing_can_be_kept(table)?
                .find_exact_weakest_point_if_below_and_update_estimates(table, f64::INFINITY)?;
            Some(WeakestPlace { frequencies: table.frequencies_hz.len(), ..found })
        };
        let each = self.touched.evaluate_with_finger_on_each_place(
            places_m,
            |model| frequencies::choose_frequencies_denser_near_modes_hz(model, self.options),
            ask,
        )?;
        Ok(each.into_iter().collect::<Option<_>>().ok_or(PlanError::NoFrequencies)?)
    }

    /// The one point of a table.
    fn build_single_point_search_if_spacing_can_be_kept(&self, table: &PlanTable) -> Option<PointSearch> {
        let grid = &table.grid;
        let place_m = (*grid.x_m.first()?, *grid.y_m.first()?);
        PointSearch::new(table, self.measure, vec![place_m], &grid.shapes)
    }
}

/// The points of a table's grid where there is surface, with their places in m.
fn list_surface_point_indices_and_places_m(table: &PlanTable) -> Vec<(usize, (f64, f64))> {
    let grid = &table.grid;
    let columns = grid.x_m.len().max(1);
    let there = (0..grid.there.len()).filter(|point| grid.there[*point]);
    there.map(|point| (point, (grid.x_m[point % columns], grid.y_m[point / columns]))).collect()
}

/// The weakest of the points around the local minima of a coarse grid, then of those around that one, and so on.
/// `find_weaker_place` returns the weakest of some places (in m) if it is weaker than `below`.
fn refine_weakest_place_from_coarse_grid(
    table: &PlanTable,
    max_hz: f64,
    first: WeakestPlace,
    coarse: &[PointEstimate],
    surface_points: &[usize],
    mut find_weaker_place: impl FnMut(Vec<(f64, f64)>, f64) -> Result<Option<WeakestPlace>, QuickError>,
) -> Result<WeakestPlace, QuickError> {
    let mut points = surface_points.len();
    let mut found = first;
    let mut seen: HashSet<(u64, u64)> = HashSet::new();
    let mut centres = list_places_of_local_minima_m(coarse, table.grid.x_m.len().max(1), surface_points);
    for _ in 0..ROUNDS {
        let fine: Vec<(f64, f64)> = list_finer_points_around_places_m(table, max_hz, &centres)
            .into_iter()
            .filter(|(x_m, y_m)| seen.insert((x_m.to_bits(), y_m.to_bits())))
            .collect();
        if fine.is_empty() {
            break;
        }
        points += fine.len();
        let Some(weaker) = find_weaker_place(fine, found.peak)? else { break };
        centres = vec![weaker.at_m];
        found = weaker;
    }
    Ok(WeakestPlace { points, ..found })
}

/// Positions in m of the weakest points of a grid that are weaker than all their neighbours.
fn list_places_of_local_minima_m(known: &[PointEstimate], columns: usize, surface_points: &[usize]) -> Vec<(f64, f64)> {
    let least_at: HashMap<usize, f64> =
        surface_points.iter().copied().zip(known.iter().map(|known| known.least)).collect();
    let is_weak = |at: usize, own: f64| {
        let (row, column) = (at / columns, at % columns);
        let rows = row.saturating_sub(1)..=row + 1;
        let mut beside = rows.flat_map(|row| {
            (column.saturating_sub(1)..=(column + 1).min(columns - 1)).map(move |column| row * columns + column)
        });
        // Of equals the first.
        beside.all(|other| {
            other == at || least_at.get(&other).is_none_or(|least| own < *least || (own == *least && at < other))
        })
    };
    let each = surface_points.iter().zip(known);
    let mut weak: Vec<&PointEstimate> =
        each.filter(|(at, known)| is_weak(**at, known.least)).map(|(_, known)| known).collect();
    weak.sort_by(|a, b| a.least.total_cmp(&b.least));
    weak.into_iter().take(LOOKED_AROUND).map(|known| known.place_m).collect()
}

/// Points with what is known of each.
struct PointSearch {
    space: ReachSpace,
    known: Vec<PointEstimate>,
}

impl PointSearch {
    fn new(table: &PlanTable, measure: Measure, places_m: Vec<(f64, f64)>, shapes: &DMatrix<f64>) -> Option<Self> {
        let space = ReachSpace::from_table(table, shapes, |hz| measure.weight_per_m_per_s2(hz));
        let lags = count_frequencies_below_each_with_spacing(&space.frequencies_hz, MIN_SPACING_HZ - 1e-9);
        let mut assignment = Assignment::default();
        let p = space.count_actuators();
        let known = places_m.into_iter().enumerate().map(|(point, place_m)| {
            let value = (0..p).flat_map(|i| (0..lags.len()).map(move |k| (i, k)));
            let value = value.map(|(i, k)| match space.max_force_n(i, k) > 0.0 {
                true => f64::from(space.weighted_acceleration_at_full_force_at_each_point(i, k)[point]),
                false => f64::NEG_INFINITY,
            });
            assignment.fill_best_sums_of_actuator_sets(p, value.collect(), &lags);
            let choice = assignment.best_frequency_of_each_actuator_if_spacing_can_be_kept(&lags)?;
            let used = (0..space.limits).map(|limit| {
                (0..p).map(|i| space.usage_fraction_of_each_limit_at_max_force(i, choice[i])[limit]).sum::<f64>()
            });
            Some(PointEstimate { place_m, least: assignment.best_sum_of_all_actuators() / used.fold(1.0, f64::max) })
        });
        let known = known.collect::<Option<_>>()?;
        Some(Self { space, known })
    }

    /// The weakest point, if it is weaker than `peak_limit`. What is found out about points on the way is kept. Masses that move far leave a part of what limits
    /// allow: points whose bound from below would be the weakest with the least such part that was met are looked at, too.
    fn find_exact_weakest_point_if_below_and_update_estimates(
        &mut self,
        table: &PlanTable,
        peak_limit: f64,
    ) -> Option<WeakestPlace> {
        let mut order: Vec<usize> = (0..self.known.len()).collect();
        order.sort_by(|a, b| self.known[*a].least.total_cmp(&self.known[*b].least));
        let (mut least, mut found) = (peak_limit, None);
        let mut hint: Option<Vec<usize>> = None;
        let mut least_part = 1.0_f64;
        for point in order {
            if self.known[point].least * least_part >= least {
                break;
            }
            let best = search::find_frequencies_with_largest_least_gain_if_spacing_possible(
                &self.space,
                &[point],
                SearchEffort::Study,
                hint.as_deref(),
            )?;
            let mut setting = best.to_setting(table, &self.space);
            // Masses that move far leave a part of it.
            let part = derate_setting_to_safe_fraction_if_any(table, &mut setting)?;
            least_part = least_part.min(part);
            let peak = best.least * part;
            self.known[point].least = peak;
            hint = Some(best.choice);
            if peak < least {
                least = peak;
                let drives = setting.into_iter().map(|part| part.drive).collect();
                let at_m = self.known[point].place_m;
                found = Some(WeakestPlace { peak, at_m, drives, points: 0, frequencies: 0 });
            }
        }
        found
    }
}
