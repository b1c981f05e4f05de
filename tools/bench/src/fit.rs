//! Power laws between and beyond what was measured.

/// `y` at `x` from pairs (x, y) in rising order of x: a straight line in logarithms between the two nearest pairs,
/// beyond the last through the last two. `None` with fewer than two pairs, or numbers that have no logarithm.
#[must_use]
pub fn evaluate_power_law(pairs: &[(f64, f64)], x: f64) -> Option<f64> {
    let upper = pairs.iter().position(|pair| pair.0 >= x).unwrap_or(pairs.len()).clamp(1, pairs.len().max(2) - 1);
    let ((x0, y0), (x1, y1)) = (*pairs.get(upper - 1)?, *pairs.get(upper)?);
    let power = (y1 / y0).ln() / (x1 / x0).ln();
    let y = y0 * (x / x0).powf(power);
    y.is_finite().then_some(y)
}

/// How large x must be for `y`, which falls, to come down to `wanted_y`; `None` if it stops falling before, or falls by
/// less than the square root of x where it ends.
#[must_use]
pub fn find_x_where_power_law_falls_to(pairs: &[(f64, f64)], wanted_y: f64) -> Option<f64> {
    let upper =
        pairs.iter().position(|pair| pair.1 <= wanted_y).unwrap_or(pairs.len()).clamp(1, pairs.len().max(2) - 1);
    let ((x0, y0), (x1, y1)) = (*pairs.get(upper - 1)?, *pairs.get(upper)?);
    let power = (y1 / y0).ln() / (x1 / x0).ln();
    (power < -0.5).then(|| x0 * (wanted_y / y0).powf(1.0 / power)).filter(|x| x.is_finite())
}

/// Whether an x lies within the pairs, but for rounding.
#[must_use]
pub fn is_within_measured_range(pairs: &[(f64, f64)], x: f64) -> bool {
    let slack = 1e-9 * x.abs();
    pairs.first().is_some_and(|pair| pair.0 <= x + slack) && pairs.last().is_some_and(|pair| x <= pair.0 + slack)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn power_laws_are_continued() {
        let cubes: Vec<(f64, f64)> = [1.0, 2.0, 4.0].map(|x: f64| (x, 5.0 * x.powi(3))).to_vec();
        for x in [0.5, 1.0, 3.0, 4.0, 16.0] {
            assert!((evaluate_power_law(&cubes, x).unwrap() / (5.0 * x.powi(3)) - 1.0).abs() < 1e-12, "{x}");
        }
        assert_eq!(evaluate_power_law(&cubes[..1], 2.0), None);
        assert!(
            is_within_measured_range(&cubes, 3.0)
                && !is_within_measured_range(&cubes, 5.0)
                && !is_within_measured_range(&[], 1.0)
        );
    }

    #[test]
    fn errors_reach_what_they_fall_to() {
        let squares: Vec<(f64, f64)> = [12.0, 24.0, 48.0].map(|x: f64| (x, 6.0 / (x * x))).to_vec();
        for x in [12.0, 30.0, 48.0, 200.0] {
            assert!((find_x_where_power_law_falls_to(&squares, 6.0 / (x * x)).unwrap() / x - 1.0).abs() < 1e-12, "{x}");
        }
        assert_eq!(find_x_where_power_law_falls_to(&[(12.0, 4e-2), (24.0, 8e-3), (48.0, 1e-2)], 1e-3), None);
        assert_eq!(find_x_where_power_law_falls_to(&[], 1e-3), None);
    }
}
