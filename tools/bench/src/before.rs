//! The levels and the bound as they were until 0.1: orders p - 4, p - 2 and p from p = 7 (9 and 11 for tight tolerances), the whole
//! answer at each, and a bound that believes in part the rate that three levels show. Kept to measure against.

use crate::error::Error;
use era_model::model::Fineness;
use era_model::model::{Accuracy, PanelModel};
use era_model::scene::Scene;

/// Times the estimate, and the bound of a response over that of a frequency.
const SAFETY: f64 = 2.5;
/// A response's bound over that of a frequency.
const RESPONSE: f64 = 1.5;
/// Largest ratio of successive differences that gave a bound.
const LARGEST_RATIO: f64 = 0.7;
/// Least power of the order that errors were taken to fall with, and the part of the one shown that was believed.
const LEAST_POWER: f64 = 5.0;
/// Part of the power shown that was believed.
const BELIEVED: f64 = 0.4;
/// Growth of a bound that was taken for rounding.
const GETTING_WORSE: f64 = 2.0;
/// Highest order.
const HIGHEST_ORDER: usize = 15;

/// An answer, its bounds and how many levels were asked.
pub struct AnswerWithBounds<A> {
    /// From the last level.
    pub answer: A,
    /// For each part of it.
    pub bounds: Vec<f64>,
    /// How many.
    pub levels: usize,
}

/// Raises the order of the elements until the bound is within the tolerance, as it was done, without the smaller cells
/// that came after the highest order.
///
/// # Errors
/// Those of `compute_answer`, and [`Error::Model`].
pub fn refine_with_former_error_bounds<A: Clone>(
    scene: &Scene,
    accuracy: Accuracy,
    max_hz: f64,
    is_response: bool,
    compute_answer: impl Fn(&PanelModel) -> Result<A, Error>,
    compute_differences: impl Fn(&A, &A) -> Vec<f64>,
) -> Result<AnswerWithBounds<A>, Error> {
    let usual = PanelModel::build(scene, accuracy, max_hz)?.fineness();
    let compute_answer_of_order = |order: usize| -> Result<A, Error> {
        let fineness = Fineness { order, layers: (order - 1) / 2, ..usual };
        compute_answer(&PanelModel::build_with_fineness(scene, fineness)?)
    };
    let mut order = accuracy.choose_element_order_for_tolerance();
    let mut last =
        [compute_answer_of_order(order - 4)?, compute_answer_of_order(order - 2)?, compute_answer_of_order(order)?];
    let mut levels = 3;
    let mut before: Option<(A, Vec<f64>)> = None;
    loop {
        let [coarse, middle, fine] = last;
        let earlier = compute_differences(&coarse, &middle).into_iter().chain(std::iter::repeat(f64::INFINITY));
        let factor = if is_response { RESPONSE } else { 1.0 };
        let bounds: Vec<f64> = compute_differences(&middle, &fine)
            .iter()
            .zip(earlier)
            .map(|(d, e)| factor * estimate_error_bound_from_differences(order, e, *d))
            .collect();
        if let Some((answer, kept)) = before.take()
            && find_largest_bound(&bounds) > GETTING_WORSE * find_largest_bound(&kept)
        {
            return Ok(AnswerWithBounds { answer, bounds: kept, levels });
        }
        if find_largest_bound(&bounds) <= accuracy.relative_tolerance_or_tightest() || order + 2 > HIGHEST_ORDER {
            return Ok(AnswerWithBounds { answer: fine, bounds, levels });
        }
        order += 2;
        levels += 1;
        // Cells then shrank towards corners with the order, until rounding was all that was left.
        let Ok(finer) = compute_answer_of_order(order) else {
            return Ok(AnswerWithBounds { answer: fine, bounds, levels });
        };
        if find_largest_bound(&bounds).is_finite() {
            before = Some((fine.clone(), bounds));
        }
        last = [middle, fine, finer];
    }
}

fn find_largest_bound(bounds: &[f64]) -> f64 {
    bounds.iter().copied().fold(0.0, f64::max)
}

#[expect(clippy::cast_precision_loss, reason = "orders are small")]
fn estimate_error_bound_from_differences(order: usize, earlier_difference: f64, last_difference: f64) -> f64 {
    if last_difference == 0.0 {
        return 0.0;
    }
    let p = order as f64;
    let ratio = if earlier_difference.is_finite() { last_difference / earlier_difference } else { LARGEST_RATIO };
    if ratio.is_nan() || ratio > LARGEST_RATIO || !last_difference.is_finite() {
        return f64::INFINITY;
    }
    let error = |order: f64, power: f64| ((p - 4.0) / order).powf(power);
    let ratio_of = |power: f64| (error(p - 2.0, power) - error(p, power)) / (1.0 - error(p - 2.0, power));
    let (mut low, mut high) = (0.1, 60.0);
    for _ in 0..40 {
        let middle = 0.5 * (low + high);
        if ratio_of(middle) > ratio { low = middle } else { high = middle }
    }
    let rest = |power: f64| 1.0 / ((p / (p - 2.0)).powf(power) - 1.0);
    SAFETY * last_difference * rest(LEAST_POWER.max(BELIEVED * low)).max(ratio / (1.0 - ratio))
}
