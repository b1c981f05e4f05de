//! Which designs are looked at again.

use super::table::{Entry, Status, Table, losses};
use crate::run::Study;

/// Designs that are nearer than this in every dimension of the unit cube count as one.
const ALIKE: f64 = 0.05;

/// The designs to look at again, the best first, as numbers of the table's entries: with one wish those with the best figures that are
/// not all alike; with several the one that is best between them (whose largest distance from the best of each wish, in parts of its
/// range over the front, is least), then the best of each, then others of the front in the first one's way.
#[must_use]
pub fn finalists(study: &Study, table: &Table, count: usize) -> Vec<usize> {
    let kept: Vec<usize> = (0..table.entries.len()).filter(|k| table.entries[*k].status == Status::Kept).collect();
    let losses: Vec<Vec<f64>> = kept.iter().map(|k| losses(study, &table.entries[*k])).collect();
    let wishes = study.spec.wishes.len();
    let order = if wishes == 1 {
        let mut order: Vec<usize> = (0..kept.len()).collect();
        order.sort_by(|a, b| losses[*a][0].total_cmp(&losses[*b][0]));
        order
    } else {
        between(&losses, wishes, |k| table.entries[kept[k]].is_on_front)
    };
    let mut chosen: Vec<usize> = Vec::new();
    for own in order.into_iter().map(|k| kept[k]) {
        if chosen.len() < count && chosen.iter().all(|other| !alike(&table.entries[*other], &table.entries[own])) {
            chosen.push(own);
        }
    }
    chosen
}

fn alike(one: &Entry, other: &Entry) -> bool {
    one.row.design == other.row.design || one.row.point.iter().zip(&other.row.point).all(|(a, b)| (a - b).abs() < ALIKE)
}

/// The front, in the order of several wishes.
fn between(losses: &[Vec<f64>], wishes: usize, is_on_front: impl Fn(usize) -> bool) -> Vec<usize> {
    let front: Vec<usize> = (0..losses.len()).filter(|k| is_on_front(*k)).collect();
    let end =
        |wish: usize, of: fn(f64, f64) -> f64, start: f64| front.iter().fold(start, |end, k| of(end, losses[*k][wish]));
    let ends: Vec<(f64, f64)> =
        (0..wishes).map(|wish| (end(wish, f64::min, f64::INFINITY), end(wish, f64::max, f64::NEG_INFINITY))).collect();
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
    let mut all: Vec<usize> = first.into_iter().chain((0..wishes).filter_map(best_of)).collect();
    all.extend(order);
    let mut seen = Vec::new();
    all.retain(|k| {
        let is_new = !seen.contains(k);
        seen.push(*k);
        is_new
    });
    all
}
