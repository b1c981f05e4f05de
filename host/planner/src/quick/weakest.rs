//! The weakest of some points, with bounds for all and the exact search for few.

use super::points::around;
use super::{QuickError, frequencies};
use crate::assignment::{Assignment, lags};
use crate::drive::Drive;
use crate::reach::setting::command;
use crate::reach::{Measure, Space, search};
use crate::request::Work;
use crate::table::PlanTable;
use crate::table::touched::Touched;
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

/// A design's weakest place.
#[derive(Clone, Debug, PartialEq)]
pub struct Weakest {
    /// The strongest peak that can be had there, in the measure's unit.
    pub peak: f64,
    /// Where, in m.
    pub at_m: (f64, f64),
    /// The drives that make it.
    pub drives: Vec<Drive>,
    /// Points that were looked at.
    pub points: usize,
    /// Frequencies to choose from.
    pub frequencies: usize,
}

/// A point as far as it is known: what can be had there, or a bound from below.
#[derive(Clone, Copy)]
struct Known {
    place_m: (f64, f64),
    least: f64,
}

/// The weakest place of a table's points and of those around the weakest of these.
pub(super) fn of(table: &PlanTable, measure: Measure, max_hz: f64) -> Result<Weakest, QuickError> {
    let there = there(table);
    let places = there.iter().map(|(_, place)| *place).collect();
    let of_grid: Vec<usize> = there.iter().map(|(point, _)| *point).collect();
    let shapes = table.grid.shapes.select_rows(&of_grid);
    let mut coarse = Points::new(table, measure, places, &shapes).ok_or(PlanError::NoFrequencies)?;
    let first = coarse.weakest(table, f64::INFINITY).ok_or(PlanError::NoFrequencies)?;
    let found = refined(table, max_hz, first, &coarse.known, &of_grid, |fine, below| {
        let mut shapes = DMatrix::zeros(fine.len(), table.model.count_coordinates());
        for (mut row, (x_m, y_m)) in shapes.row_iter_mut().zip(&fine) {
            row.tr_copy_from(&table.model.shape_deflections_at(*x_m, *y_m));
        }
        Ok(Points::new(table, measure, fine, &shapes).ok_or(PlanError::NoFrequencies)?.weakest(table, below))
    })?;
    Ok(Weakest { frequencies: table.frequencies_hz.len(), ..found })
}

/// The same with a finger on each place while it is looked at; `table` is that of the panel that nothing touches. All places are looked at roughly, and
/// those that may be the weakest, if there is less than that by the part `slack`, thoroughly.
pub(super) fn touched(
    touched: Touched<'_>,
    table: &PlanTable,
    measure: Measure,
    options: TableOptions,
    slack: f64,
) -> Result<Weakest, QuickError> {
    let fingered = Fingered { touched, measure, options, slack };
    let (of_grid, places): (Vec<usize>, Vec<(f64, f64)>) = there(table).into_iter().unzip();
    let coarse = fingered.roughly(&places)?;
    let first = fingered.weakest(&coarse, f64::INFINITY)?.ok_or(PlanError::NoFrequencies)?;
    refined(table, options.to_hz, first, &coarse, &of_grid, |fine, below| {
        fingered.weakest(&fingered.roughly(&fine)?, below)
    })
}

/// A finger that is put on one place after the other.
struct Fingered<'a> {
    touched: Touched<'a>,
    measure: Measure,
    options: TableOptions,
    slack: f64,
}

impl Fingered<'_> {
    /// What can be had at places (m), roughly.
    fn roughly(&self, places_m: &[(f64, f64)]) -> Result<Vec<Known>, QuickError> {
        let ask = |table: &PlanTable| Some(self.alone(table)?.known[0]);
        let known = self.touched.each_roughly(places_m, |model| frequencies::of(model, self.options), ask)?;
        Ok(known.into_iter().collect::<Option<_>>().ok_or(PlanError::NoFrequencies)?)
    }

    /// The weakest of places that are known roughly, if it is weaker than `below`.
    fn weakest(&self, known: &[Known], below: f64) -> Result<Option<Weakest>, QuickError> {
        let mut order = known.to_vec();
        order.sort_by(|a, b| a.least.total_cmp(&b.least));
        let (mut least, mut found) = (below, None);
        for some in order.chunks(TOGETHER) {
            let in_question = some.iter().filter(|known| known.least * (1.0 - self.slack) < least);
            let places: Vec<(f64, f64)> = in_question.map(|known| known.place_m).collect();
            if places.is_empty() {
                break;
            }
            for own in self.exactly(&places)? {
                if own.peak < least {
                    least = own.peak;
                    found = Some(own);
                }
            }
        }
        Ok(found)
    }

    /// What can be had at places (m).
    fn exactly(&self, places_m: &[(f64, f64)]) -> Result<Vec<Weakest>, QuickError> {
        let ask = |table: &PlanTable| {
            let found = self.alone(table)?.weakest(table, f64::INFINITY)?;
            Some(Weakest { frequencies: table.frequencies_hz.len(), ..found })
        };
        let each = self.touched.each(places_m, |model| frequencies::of(model, self.options), ask)?;
        Ok(each.into_iter().collect::<Option<_>>().ok_or(PlanError::NoFrequencies)?)
    }

    /// The one point of a table.
    fn alone(&self, table: &PlanTable) -> Option<Points> {
        let grid = &table.grid;
        let place_m = (*grid.x_m.first()?, *grid.y_m.first()?);
        Points::new(table, self.measure, vec![place_m], &grid.shapes)
    }
}

/// The points of a table's grid where there is surface, with their places in m.
fn there(table: &PlanTable) -> Vec<(usize, (f64, f64))> {
    let grid = &table.grid;
    let columns = grid.x_m.len().max(1);
    let there = (0..grid.there.len()).filter(|point| grid.there[*point]);
    there.map(|point| (point, (grid.x_m[point % columns], grid.y_m[point / columns]))).collect()
}

/// The weakest of the points around the weak ones of a coarse grid, then of those around that, and so on. `look` tells the weakest of some
/// places (m), if it is weaker than `below`.
fn refined(
    table: &PlanTable,
    max_hz: f64,
    first: Weakest,
    coarse: &[Known],
    there: &[usize],
    mut look: impl FnMut(Vec<(f64, f64)>, f64) -> Result<Option<Weakest>, QuickError>,
) -> Result<Weakest, QuickError> {
    let mut points = there.len();
    let mut found = first;
    let mut seen: HashSet<(u64, u64)> = HashSet::new();
    let mut centres = weak_places(coarse, table.grid.x_m.len().max(1), there);
    for _ in 0..ROUNDS {
        let fine: Vec<(f64, f64)> = around(table, max_hz, &centres)
            .into_iter()
            .filter(|(x_m, y_m)| seen.insert((x_m.to_bits(), y_m.to_bits())))
            .collect();
        if fine.is_empty() {
            break;
        }
        points += fine.len();
        let Some(weaker) = look(fine, found.peak)? else { break };
        centres = vec![weaker.at_m];
        found = weaker;
    }
    Ok(Weakest { points, ..found })
}

/// The weakest of the points `there` of a grid that are weaker than all those beside them, in m.
fn weak_places(known: &[Known], columns: usize, there: &[usize]) -> Vec<(f64, f64)> {
    let least_at: HashMap<usize, f64> = there.iter().copied().zip(known.iter().map(|known| known.least)).collect();
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
    let each = there.iter().zip(known);
    let mut weak: Vec<&Known> = each.filter(|(at, known)| is_weak(**at, known.least)).map(|(_, known)| known).collect();
    weak.sort_by(|a, b| a.least.total_cmp(&b.least));
    weak.into_iter().take(LOOKED_AROUND).map(|known| known.place_m).collect()
}

/// Points with what is known of each.
struct Points {
    space: Space,
    known: Vec<Known>,
}

impl Points {
    fn new(table: &PlanTable, measure: Measure, places_m: Vec<(f64, f64)>, shapes: &DMatrix<f64>) -> Option<Self> {
        let space = Space::of(table, shapes, |hz| measure.weight(hz));
        let lags = lags(&space.frequencies_hz, MIN_SPACING_HZ - 1e-9);
        let mut assignment = Assignment::default();
        let p = space.actuators();
        let known = places_m.into_iter().enumerate().map(|(point, place_m)| {
            let value = (0..p).flat_map(|i| (0..lags.len()).map(move |k| (i, k)));
            let value = value.map(|(i, k)| match space.force_n(i, k) > 0.0 {
                true => f64::from(space.gains(i, k)[point]),
                false => f64::NEG_INFINITY,
            });
            assignment.fill(p, value.collect(), &lags);
            let choice = assignment.choice(&lags)?;
            let used = (0..space.limits).map(|limit| (0..p).map(|i| space.usages(i, choice[i])[limit]).sum::<f64>());
            Some(Known { place_m, least: assignment.most() / used.fold(1.0, f64::max) })
        });
        let known = known.collect::<Option<_>>()?;
        Some(Self { space, known })
    }

    /// The weakest point, if it is weaker than `below`. What is found out about points on the way is kept. Masses that move far leave a part of what limits
    /// allow: points whose bound from below would be the weakest with the least such part that was met are looked at, too.
    fn weakest(&mut self, table: &PlanTable, below: f64) -> Option<Weakest> {
        let mut order: Vec<usize> = (0..self.known.len()).collect();
        order.sort_by(|a, b| self.known[*a].least.total_cmp(&self.known[*b].least));
        let (mut least, mut found) = (below, None);
        let mut hint: Option<Vec<usize>> = None;
        let mut least_part = 1.0_f64;
        for point in order {
            if self.known[point].least * least_part >= least {
                break;
            }
            let best = search::best(&self.space, &[point], Work::Study, hint.as_deref())?;
            let mut setting = best.setting(table, &self.space);
            // Masses that move far leave a part of it.
            let part = command(table, &mut setting)?;
            least_part = least_part.min(part);
            let peak = best.least * part;
            self.known[point].least = peak;
            hint = Some(best.choice);
            if peak < least {
                least = peak;
                let drives = setting.into_iter().map(|part| part.drive).collect();
                let at_m = self.known[point].place_m;
                found = Some(Weakest { peak, at_m, drives, points: 0, frequencies: 0 });
            }
        }
        found
    }
}
