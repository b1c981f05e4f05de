//! Which limits figures break, by how much, and what is wished for: as text, and as numbers.

use crate::run::{DesignRow, Study, worst_case_figure_of_wish_unless_failed};

/// The limits that figures break, each with its figure and what is allowed; `None` if they keep all. `low_and_high_of_figure` tells of a figure, by its place among
/// the study's, the least and the most.
#[must_use]
pub fn describe_broken_limits_if_any(
    study: &Study,
    low_and_high_of_figure: impl Fn(usize) -> Option<(f64, f64)>,
) -> Option<String> {
    let each = study.spec.limits.iter().filter_map(|limit| {
        let figure = study.figures.iter().position(|wanted| *wanted == limit.wanted)?;
        let (low, high) = low_and_high_of_figure(figure)?;
        let (value, allowed) = limit.violating_value_and_allowed_text_if_limit_broken(low, high)?;
        Some(format!("{} is {value:.4}, but must be {allowed}", limit.wanted.column_name()))
    });
    let each: Vec<String> = each.collect();
    (!each.is_empty()).then(|| each.join("; "))
}

/// Each bound of the study's limits in words (`sag_um at most 800`), and how far a design is beyond it in the figure's unit, the worst of what may be
/// off: a design that keeps all limits has none above 0. NaN where the design failed.
#[must_use]
pub fn constraint_names_and_signed_excesses_of_design(study: &Study, row: &DesignRow) -> Vec<(String, f64)> {
    let each = study.spec.limits.iter().flat_map(|limit| {
        let figure = study.figures.iter().position(|wanted| *wanted == limit.wanted);
        let (low, high) = figure
            .and_then(|figure| row.least_and_most_of_figure_over_samples_unless_failed(figure))
            .unwrap_or((f64::NAN, f64::NAN));
        limit.bounds_in_words_and_signed_excesses(low, high)
    });
    each.collect()
}

/// What the study wishes for in words (`least mass_g`), and a design's value, the worst of what may be off, with the sign that makes less better. NaN
/// where the design failed.
#[must_use]
pub fn objective_names_and_losses_of_design(study: &Study, row: &DesignRow) -> Vec<(String, f64)> {
    let each = study.spec.wishes.iter().map(|wish| {
        let value = worst_case_figure_of_wish_unless_failed(row, &study.figures, wish)
            .map_or(f64::NAN, |value| wish.goal.loss_of_figure(value));
        (format!("{} {}", wish.goal.name(), wish.wanted.column_name()), value)
    });
    each.collect()
}
