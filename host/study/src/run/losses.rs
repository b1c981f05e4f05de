//! What a design is worth to a search: one number, less being better.

use super::row::Row;
use crate::spec::{Goal, Limit, Spec, Wanted, Wish};

/// Beyond what any design that keeps the limits has.
const BROKEN: f64 = 1e6;
/// Beyond what any design that breaks them has.
const FAILED: f64 = 1e9;
/// Decibels that count as much as a factor of e.
const DB_PER_NEPER: f64 = 8.685_889_638_065_037;

/// A wish's figure, the worst of what may be off.
#[must_use]
pub fn worst(row: &Row, figures: &[Wanted], wish: &Wish) -> Option<f64> {
    let figure = figures.iter().position(|wanted| *wanted == wish.wanted)?;
    let (low, high) = row.ends(figure)?;
    Some(match wish.goal {
        Goal::Most => low,
        Goal::Least => high,
    })
}

/// By how much a design breaks limits, in parts of each: zero if it keeps them; `None` if it failed, or has no value of what is limited.
#[must_use]
pub fn broken(row: &Row, figures: &[Wanted], limits: &[Limit]) -> Option<f64> {
    let mut sum = 0.0;
    for limit in limits {
        let figure = figures.iter().position(|wanted| *wanted == limit.wanted)?;
        let (low, high) = row.ends(figure).filter(|(low, high)| !low.is_nan() && !high.is_nan())?;
        let beyond = |by: f64, bound: f64| if by > 0.0 { by / bound.abs().max(1e-9) } else { 0.0 };
        sum += beyond(limit.least - low, limit.least) + beyond(high - limit.most, limit.most);
    }
    Some(sum)
}

/// What a design is worth, wishes weighed: ratios to the scene's own figures (differences for levels in dB) where there are
/// several, the figure itself for one.
#[must_use]
pub fn loss(spec: &Spec, figures: &[Wanted], base: Option<&Row>, weights: &[f64], row: &Row) -> f64 {
    match broken(row, figures, &spec.limits) {
        None => return FAILED,
        Some(broken) if broken > 0.0 => return BROKEN * (1.0 + broken.min(1e2)),
        Some(_) => {}
    }
    let each = spec.wishes.iter().zip(weights).map(|(wish, weight)| {
        let own = worst(row, figures, wish)?;
        if spec.wishes.len() == 1 {
            return Some(wish.goal.loss(own));
        }
        let first = base.and_then(|base| worst(base, figures, wish));
        let part = match first {
            _ if wish.wanted.figure.is_level() => (own - first.unwrap_or(0.0)) / DB_PER_NEPER,
            Some(first) if first > 0.0 && own > 0.0 => (own / first).ln(),
            _ => own,
        };
        Some(weight * wish.goal.loss(part))
    });
    each.sum::<Option<f64>>().filter(|loss| loss.is_finite()).unwrap_or(FAILED)
}
