//! Which designs are looked at again.

use super::table::{DesignStatus, DesignTable, TableEntry, worst_case_loss_of_each_wish};
use crate::run::Study;
use crate::space::index_at_fraction;
use crate::spec::VariableKind;

/// Designs that are nearer than this in every dimension of the unit cube count as one; of lists those with the same values.
const ALIKE: f64 = 0.05;

/// The designs to look at again, the best first, as numbers of the table's entries: with one wish those with the best figures that are
/// not all alike; with several the one that is best between them (whose largest distance from the best of each wish, in parts of its
/// range over the front, is least), then the best of each, then others of the front in the first one's way.
#[must_use]
pub fn choose_distinct_finalist_indices_meeting_limits_best_first(
    study: &Study,
    table: &DesignTable,
    count: usize,
) -> Vec<usize> {
    let kept: Vec<usize> =
        (0..table.entries.len()).filter(|k| table.entries[*k].status == DesignStatus::Kept).collect();
    let losses: Vec<Vec<f64>> = kept.iter().map(|k| worst_case_loss_of_each_wish(study, &table.entries[*k])).collect();
    let wishes = study.spec.wishes.len();
    let (order, sure) = if wishes == 1 {
        let mut order: Vec<usize> = (0..kept.len()).collect();
        order.sort_by(|a, b| losses[*a][0].total_cmp(&losses[*b][0]));
        (order, 0)
    } else {
        order_front_and_count_leading_compromise_and_wish_bests(&losses, wishes, |k| table.entries[kept[k]].is_on_front)
    };
    let mut chosen: Vec<usize> = Vec::new();
    for (place, own) in order.into_iter().map(|k| kept[k]).enumerate() {
        let is_alike = |other: &usize| {
            let (one, other) = (&table.entries[*other], &table.entries[own]);
            one.row.design == other.row.design || place >= sure && are_designs_near_each_other(study, one, other)
        };
        if chosen.len() < count && !chosen.iter().any(is_alike) {
            chosen.push(own);
        }
    }
    chosen
}

/// Whether two designs are near each other: of what is chosen from a list, the same.
fn are_designs_near_each_other(study: &Study, one: &TableEntry, other: &TableEntry) -> bool {
    let mut both = study.space.dimensions().iter().zip(one.row.point.iter().zip(&other.row.point));
    both.all(|(dimension, (a, b))| match study.spec.variables.get(dimension.variable).map(|own| &own.what) {
        Some(VariableKind::Choice { values, .. }) => {
            index_at_fraction(values.len(), *a) == index_at_fraction(values.len(), *b)
        }
        _ => (a - b).abs() < ALIKE,
    })
}

/// The front, in the order of several wishes, and how many of its first are the one between them and the best of each.
fn order_front_and_count_leading_compromise_and_wish_bests(
    losses: &[Vec<f64>],
    wish_count: usize,
    is_on_front: impl Fn(usize) -> bool,
) -> (Vec<usize>, usize) {
    let front: Vec<usize> = (0..losses.len()).filter(|k| is_on_front(*k)).collect();
    let end =
        |wish: usize, of: fn(f64, f64) -> f64, start: f64| front.iter().fold(start, |end, k| of(end, losses[*k][wish]));
    let ends: Vec<(f64, f64)> = (0..wish_count)
        .map(|wish| (end(wish, f64::min, f64::INFINITY), end(wish, f64::max, f64::NEG_INFINITY)))
        .collect();
    let distance = |k: usize| {
        let parts = losses[k].iter().zip(&ends).map(
            |(loss, (least, most))| {
                if most > least { (loss - least) / (most - least) } else { 0.0 }
            },
        );
        parts.fold(0.0, f64::max)
    };
    let mut order = front.clone();
    order.sort_by(|a, b| distance(*a).total_cmp(&distance(*b)));
    let best_of = |wish: usize| front.iter().copied().min_by(|a, b| losses[*a][wish].total_cmp(&losses[*b][wish]));
    let first = order.first().copied();
    let mut all: Vec<usize> = Vec::new();
    for k in first.into_iter().chain((0..wish_count).filter_map(best_of)) {
        if !all.contains(&k) {
            all.push(k);
        }
    }
    let sure = all.len();
    let rest: Vec<usize> = order.into_iter().filter(|k| !all.contains(k)).collect();
    all.extend(rest);
    (all, sure)
}
