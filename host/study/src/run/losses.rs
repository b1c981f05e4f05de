//! What a design is worth to a search: one number, less being better.

use super::row::DesignRow;
use crate::spec::{FigureLimit, StudySpec, WantedFigure, Wish, WishGoal};

/// Beyond what any design that keeps the limits has.
const BROKEN: f64 = 1e6;
/// Beyond what any design that breaks them has.
const FAILED: f64 = 1e9;
/// Decibels that count as much as a factor of e.
const DB_PER_NEPER: f64 = 8.685_889_638_065_037;
/// Ratio down to which logarithms count, which never end towards 0: no more than a factor of a million.
const LEAST_RATIO: f64 = 1e-6;
/// Bounds below this are 0, and no measure of what is beyond them.
const NO_BOUND: f64 = 1e-9;

/// A wish's figure, the worst of what may be off.
#[must_use]
pub fn worst_case_figure_of_wish_unless_failed(row: &DesignRow, figures: &[WantedFigure], wish: &Wish) -> Option<f64> {
    let figure = figures.iter().position(|wanted| *wanted == wish.wanted)?;
    let (low, high) = row.least_and_most_of_figure_over_samples_unless_failed(figure)?;
    Some(match wish.goal {
        WishGoal::Most => low,
        WishGoal::Least => high,
    })
}

/// By how much a design breaks limits, in parts of each (of the figure that `base` has, or else of one in its unit, where a limit is 0; in nepers for
/// levels in dB): zero if it keeps them; `None` if it failed, or has no value of what is limited.
#[must_use]
pub fn sum_relative_limit_violations_if_all_limited_figures_known(
    row: &DesignRow,
    figures: &[WantedFigure],
    limits: &[FigureLimit],
    base_scaling_limits_of_zero: Option<&DesignRow>,
) -> Option<f64> {
    let mut sum = 0.0;
    for limit in limits {
        let figure = figures.iter().position(|wanted| *wanted == limit.wanted)?;
        let (low, high) = row
            .least_and_most_of_figure_over_samples_unless_failed(figure)
            .filter(|(low, high)| !low.is_nan() && !high.is_nan())?;
        let own = base_scaling_limits_of_zero
            .and_then(DesignRow::figures_unless_failed)
            .and_then(|own| own.values.get(figure));
        let usual = own.map(|own| own.abs()).filter(|own| own.is_finite() && *own > NO_BOUND).unwrap_or(1.0);
        let beyond = |by: f64, bound: f64| {
            let whole = match bound.abs() {
                _ if limit.wanted.figure.is_level_in_db() => DB_PER_NEPER,
                whole if whole < NO_BOUND => usual,
                whole => whole,
            };
            if by > 0.0 { by / whole } else { 0.0 }
        };
        sum += beyond(limit.least - low, limit.least) + beyond(high - limit.most, limit.most);
    }
    Some(sum)
}

/// What a design is worth, wishes weighed: logarithms of ratios to the scene's own figures (differences for levels in dB), so that no figure in whatever
/// unit is beyond what a broken limit counts. The scene's own are constants in a sum: where it has none above 0 they are left out.
#[must_use]
pub fn compute_search_loss_of_weighted_wishes_or_only_broken_limits(
    spec: &StudySpec,
    figures: &[WantedFigure],
    base: Option<&DesignRow>,
    wish_weights: &[f64],
    row: &DesignRow,
) -> f64 {
    match sum_relative_limit_violations_if_all_limited_figures_known(row, figures, &spec.limits, base) {
        None => return FAILED,
        Some(broken) if broken > 0.0 => return BROKEN * (1.0 + broken.min(1e2)),
        Some(_) => {}
    }
    let each = spec.wishes.iter().zip(wish_weights).map(|(wish, weight)| {
        let own = worst_case_figure_of_wish_unless_failed(row, figures, wish).filter(|own| !own.is_nan())?;
        let first = base
            .and_then(|base| worst_case_figure_of_wish_unless_failed(base, figures, wish))
            .filter(|first| first.is_finite());
        let part = if wish.wanted.figure.is_level_in_db() {
            (own - first.unwrap_or(0.0)) / DB_PER_NEPER
        } else {
            let ratio = own / first.filter(|first| *first > 0.0).unwrap_or(1.0);
            // A straight line goes on where logarithms end.
            ratio.max(LEAST_RATIO).ln() + (ratio - LEAST_RATIO).min(0.0)
        };
        Some(weight * wish.goal.loss_of_figure(part))
    });
    each.sum::<Option<f64>>().filter(|loss| loss.is_finite()).unwrap_or(FAILED)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::evaluate::Figures;
    use crate::run::DesignOutcome;
    use crate::space::Design;

    fn spec(rest: &str) -> StudySpec {
        let text = format!("version = 1\nname = \"s\"\nscene = \"x.toml\"\n{rest}");
        StudySpec::parse("s.toml", &text).unwrap()
    }

    fn row(values: &[f64]) -> DesignRow {
        let figures = Figures { values: values.to_vec(), weakest_mm: None };
        let outcome = DesignOutcome::Found { figures, low: Vec::new(), high: Vec::new() };
        DesignRow { point: Vec::new(), design: Design { settings: Vec::new() }, outcome }
    }

    /// What the scene itself has is a constant in the sum: it changes nothing in which of two designs is better, and by how much.
    #[test]
    fn several_wishes_are_weighed_alike_whatever_the_scene_itself_has() {
        let spec = spec("[[wish]]\nfigure = \"rigid_mode_hz\"\n[[wish]]\nfigure = \"mass_g\"\n");
        let figures = spec.distinct_figures_of_wishes_and_limits();
        let loss = |base: Option<&DesignRow>, values: &[f64]| {
            compute_search_loss_of_weighted_wishes_or_only_broken_limits(
                &spec,
                &figures,
                base,
                &[0.5, 0.5],
                &row(values),
            )
        };
        let failed = DesignRow { outcome: DesignOutcome::Failed("no such thing".into()), ..row(&[]) };
        let (usual, none, unknown) = (row(&[50.0, 300.0]), row(&[0.0, 300.0]), row(&[50.0, f64::NAN]));
        for base in [None, Some(&usual), Some(&none), Some(&unknown), Some(&failed)] {
            let first = loss(base, &[40.0, 200.0]);
            // Twice the one and half the other is the same; twice one of them is a factor of two.
            assert!((loss(base, &[80.0, 100.0]) - first).abs() < 1e-12, "{base:?}");
            assert!((loss(base, &[80.0, 200.0]) - first - 0.5 * 2.0_f64.ln()).abs() < 1e-12, "{base:?}");
            // No rigid mode at all is better than any, and no failure.
            let least = loss(base, &[0.0, 200.0]);
            assert!(least < loss(base, &[1e-3, 200.0]) && least > -100.0, "{base:?} {least}");
            assert!(loss(base, &[f64::NAN, 200.0]) >= FAILED && loss(base, &[40.0, f64::INFINITY]) >= FAILED);
        }
    }

    /// Of one wish the order is that of its figure, and what keeps the limits goes before what breaks them, in whatever currency.
    #[test]
    fn one_wish_is_ordered_by_its_figure_and_after_the_limits() {
        let spec = spec("[[wish]]\nfigure = \"cost\"\n[[limit]]\nfigure = \"mass_g\"\nmost = 500\n");
        let figures = spec.distinct_figures_of_wishes_and_limits();
        for unit in [1.0, 1e9, 1e12] {
            let base = row(&[0.35 * unit, 300.0]);
            let loss = |cost: f64, mass_g: f64| {
                compute_search_loss_of_weighted_wishes_or_only_broken_limits(
                    &spec,
                    &figures,
                    Some(&base),
                    &[1.0],
                    &row(&[cost * unit, mass_g]),
                )
            };
            let kept = [0.0, 1e-9, 0.1, 0.3, 0.300_000_1, 5.0, 1e6].map(|cost| loss(cost, 500.0));
            assert!(kept.windows(2).all(|pair| pair[0] < pair[1]), "{kept:?}");
            assert!(kept[6] < loss(1e-9, 500.1) && loss(1e-9, 500.1) < FAILED);
        }
    }

    /// Of 0 dB nothing is a part: what is 0.7 dB below it is nearer than what is 14 times a limit.
    #[test]
    fn limits_at_zero_and_of_levels_have_a_measure() {
        let spec = spec(
            "[[wish]]\nfigure = \"mass_g\"\n[[limit]]\nfigure = \"contrast_db\"\nat_mm = [10, 10]\nleast = 0\n\
             [[limit]]\nfigure = \"sag_um\"\nmost = 1000\n[[limit]]\nfigure = \"rigid_mode_hz\"\nmost = 0\n",
        );
        let figures = spec.distinct_figures_of_wishes_and_limits();
        let base = row(&[300.0, 3.0, 900.0, 40.0]);
        let broken = |base: Option<&DesignRow>, values: &[f64]| {
            sum_relative_limit_violations_if_all_limited_figures_known(&row(values), &figures, &spec.limits, base)
                .unwrap()
        };
        let near = |found: f64, expected: f64| assert!((found - expected).abs() < 1e-12, "{found} {expected}");
        near(broken(Some(&base), &[300.0, -0.7, 900.0, 0.0]), 0.7 / DB_PER_NEPER);
        near(broken(Some(&base), &[300.0, 1.0, 13795.0, 0.0]), 12.795);
        near(broken(Some(&base), &[300.0, 1.0, 900.0, 20.0]), 0.5);
        near(broken(None, &[300.0, 1.0, 900.0, 20.0]), 20.0);
        assert_eq!(broken(Some(&base), &[300.0, 0.0, 1000.0, 0.0]), 0.0);
    }
}
