//! The sine in integers: the same on every processor.

/// 1 with 30 bits behind the point.
pub(crate) const ONE: u32 = 1 << 30;
/// Coefficients of the series of sin(pi x / 2) in x, with 30 bits behind the point: (pi/2)^n / n! for n = 11, 9, ... 1. What
/// is cut off is below 6e-8.
const SERIES: [u32; 6] = [3_864, 172_272, 5_026_995, 85_569_306, 693_598_668, 1_686_629_713];
/// What [`quarter_sine_q30`] may be short of the sine, in parts of [`ONE`]: 5.7e-8 of the series (61 parts), six products
/// cut off (a part each) and the coefficients' own rounding; twice that.
const SHORT: u32 = 128;
/// Bits of x that [`quarter_sine_q30_upper_bound`] rounds up: 16 are left, as many as a timer's ticks have.
const COARSE: u32 = (1 << 14) - 1;

/// sin(pi x / 2) for x from 0 to 1, both with 30 bits behind the point.
pub(crate) fn quarter_sine_q30(x: u32) -> u32 {
    // No factor is above 2 and none of the products either.
    let times = |a: u32, b: u32| u32::try_from((u64::from(a) * u64::from(b)) >> 30).unwrap_or(u32::MAX);
    let x = x.min(ONE);
    let square = times(x, x);
    let sum = SERIES.into_iter().reduce(|sum, next| next - times(square, sum)).unwrap_or(0);
    times(x, sum)
}

/// As [`quarter_sine_q30`], but never less than the sine, above it by no more than 2.5e-5, and never less for a greater x: on a grid
/// of 2^-16 two neighbours differ by more than what is cut off, but for the last few before 1, which all become 1.
pub(crate) fn quarter_sine_q30_upper_bound(x: u32) -> u32 {
    let x = x.min(ONE).saturating_add(COARSE) & !COARSE;
    if x == 0 { 0 } else { quarter_sine_q30(x).saturating_add(SHORT).min(ONE) }
}

#[cfg(test)]
mod tests {
    use super::{COARSE, ONE, quarter_sine_q30_upper_bound};

    #[test]
    fn never_short_never_falling() {
        let mut before = 0;
        for x in (0..=ONE).step_by(COARSE as usize + 1) {
            let sine = quarter_sine_q30_upper_bound(x);
            let exact = (std::f64::consts::FRAC_PI_2 * f64::from(x) / f64::from(ONE)).sin() * f64::from(ONE);
            assert!(f64::from(sine) >= exact - 1e-3 && f64::from(sine) < exact + 200.0, "{x}: {sine}, {exact}");
            assert!(sine >= before, "{x}: {sine} after {before}");
            before = sine;
            let between = quarter_sine_q30_upper_bound(x.saturating_sub(COARSE / 2));
            assert!(between == sine, "{x}: {between} between");
        }
        assert_eq!(
            (
                quarter_sine_q30_upper_bound(0),
                quarter_sine_q30_upper_bound(1) > 0,
                quarter_sine_q30_upper_bound(ONE),
                quarter_sine_q30_upper_bound(u32::MAX)
            ),
            (0, true, ONE, ONE)
        );
    }
}
