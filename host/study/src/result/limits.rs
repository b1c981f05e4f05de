//! Which limits figures break.

use crate::run::Study;

/// The limits that figures break, each with its figure and what is allowed; `None` if they keep all. `ends` tells of a figure, by its place among
/// the study's, the least and the most.
#[must_use]
pub fn broken_limits(study: &Study, ends: impl Fn(usize) -> Option<(f64, f64)>) -> Option<String> {
    let each = study.spec.limits.iter().filter_map(|limit| {
        let figure = study.figures.iter().position(|wanted| *wanted == limit.wanted)?;
        let (low, high) = ends(figure)?;
        let (value, allowed) = limit.broken_by(low, high)?;
        Some(format!("{} is {value:.4}, but must be {allowed}", limit.wanted.column()))
    });
    let each: Vec<String> = each.collect();
    (!each.is_empty()).then(|| each.join("; "))
}
