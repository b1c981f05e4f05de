//! One setting for the whole surface, or a region of it: the one whose weakest place is the strongest.

use super::measure::Measure;
use super::search;
use super::setting::{self, peaks};
use super::space::Space;
use crate::request::Work;
use crate::table::{Part, PlanTable, Region, View};
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

/// The setting at distinct frequencies with the largest minimum over the surface, or a part of it, for masses at rest, and by which part another
/// could have a larger one. `None` where no frequencies are usable.
#[must_use]
pub fn everywhere(table: &PlanTable, region: Option<Region>) -> Option<(Vec<Part>, f64)> {
    let (view, measure) = (View::new(table, region)?, Measure::G);
    let space = Space::of(table, &view.shapes, |hz| measure.weight(hz));
    let (setting, at_most) = strongest_everywhere(table, &view, measure, space)?;
    let least = peaks(table, &view.finer, &setting, measure).into_iter().fold(f64::INFINITY, f64::min);
    let gap = if at_most <= least { 0.0 } else { at_most / least - 1.0 };
    Some((setting, gap))
}

/// The setting of [`everywhere`] for the whole surface, found when it is first asked for.
pub(crate) fn whole_surface_setting(table: &PlanTable) -> Option<&(Vec<Part>, f64)> {
    table.evened.get_or_init(|| everywhere(table, None)).as_ref()
}

/// Finds that setting now, for those who will ask.
pub fn prepare_whole_surface_setting(table: &PlanTable) {
    let _ = whole_surface_setting(table);
}

/// The setting with the largest minimum on a view's finer grid, and a bound on that: the optimum at the points of `space`, those of the
/// view's own grid, is one, and points where its setting does less join them.
pub(crate) fn strongest_everywhere(
    table: &PlanTable,
    view: &View,
    measure: Measure,
    mut space: Space,
) -> Option<(Vec<Part>, f64)> {
    let finer = &view.finer;
    let mut added: Vec<usize> = Vec::new();
    let mut strongest: Option<(f64, Vec<Part>)> = None;
    let mut upper = f64::INFINITY;
    let mut hint: Option<Vec<usize>> = None;
    let mut steps = 0;
    // With little work as long as points join.
    let mut effort = Work::Touch;
    for _ in 0..REFINEMENTS {
        let all: Vec<usize> = (0..space.points).collect();
        let best = search::best(&space, &all, effort, hint.as_deref())?;
        upper = upper.min(best.upper);
        steps += best.steps;
        let setting = best.setting(table, &space);
        let peaks = peaks(table, finer, &setting, measure);
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
            if effort == Work::Surface {
                break;
            }
            effort = Work::Surface;
            continue;
        }
        // The worst, and others from all of the range.
        added.extend(weaker.iter().step_by(weaker.len().div_ceil(ADDED)));
        let shapes = finer.select_rows(&added);
        let rows: Vec<_> = view.shapes.row_iter().chain(shapes.row_iter()).collect();
        space = Space::of(table, &DMatrix::from_rows(&rows), |hz| measure.weight(hz));
    }
    let (least, setting) = strongest?;
    Some((setting, if upper <= least * (1.0 + 2.0 * EQUAL_MINIMA) { least } else { upper }))
}

impl search::Best {
    /// The choice as forces of masses at rest.
    pub(crate) fn setting(&self, table: &PlanTable, space: &Space) -> Vec<Part> {
        let each = self.choice.iter().zip(&self.parts).enumerate();
        each.map(|(i, (f, part))| setting::part(table, i, *f, Complex64::from(part * space.force_n(i, *f)))).collect()
    }
}
