//! Which limits figures break, by how much, and what is wished for: as text, and as numbers.

use crate::run::{DesignRow, Study, worst_wished_figure};

/// The limits that figures break, each with its figure and what is allowed; `None` if they keep all. `ends` tells of a figure, by its place among
/// the study's, the least and the most.
#[must_use]
pub fn describe_broken_limits(study: &Study, ends: impl Fn(usize) -> Option<(f64, f64)>) -> Option<String> {
    let each = study.spec.limits.iter().filter_map(|limit| {
        let figure = study.figures.iter().position(|wanted| *wanted == limit.wanted)?;
        let (low, high) = ends(figure)?;
        let (value, allowed) = limit.find_broken_end(low, high)?;
        Some(format!("{} is {value:.4}, but must be {allowed}", limit.wanted.column_name()))
    });
    let each: Vec<String> = each.collect();
    (!each.is_empty()).then(|| each.join("; "))
}

/// Each bound of the study's limits in words (`sag_um at most 800`), and how far a design is beyond it in the figure's unit, the worst of what may be
/// off: a design that keeps all limits has none above 0. NaN where the design failed.
#[must_use]
pub fn constraint_margins_of_design(study: &Study, row: &DesignRow) -> Vec<(String, f64)> {
    let each = study.spec.limits.iter().flat_map(|limit| {
        let figure = study.figures.iter().position(|wanted| *wanted == limit.wanted);
        let (low, high) =
            figure.and_then(|figure| row.least_and_most_of_figure(figure)).unwrap_or((f64::NAN, f64::NAN));
        limit.margins_beyond_limits(low, high)
    });
    each.collect()
}

/// What the study wishes for in words (`least mass_g`), and a design's value, the worst of what may be off, with the sign that makes less better. NaN
/// where the design failed.
#[must_use]
pub fn objective_values_of_design(study: &Study, row: &DesignRow) -> Vec<(String, f64)> {
    let each = study.spec.wishes.iter().map(|wish| {
        let value =
            worst_wished_figure(row, &study.figures, wish).map_or(f64::NAN, |value| wish.goal.loss_of_figure(value));
        (format!("{} {}", wish.goal.name(), wish.wanted.column_name()), value)
    });
    each.collect()
}
