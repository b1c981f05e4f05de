//! Zeros of increasing functions by secants.

/// How near secants come to a crossing, as a part of it.
pub(super) const NEAR: f64 = 1e-12;
/// Secants that are drawn at most.
const SECANTS: usize = 12;

/// The zero of an increasing function between 0 and `upper`, if secants find it; otherwise any value in between.
pub(super) fn approximate_zero_of_increasing_function_by_secants(of: &impl Fn(f64) -> f64, upper: f64) -> f64 {
    let (mut before, mut own) = (upper, 0.75 * upper);
    let (mut at_before, mut at_own) = (of(before), of(own));
    for _ in 0..SECANTS {
        let next = own - at_own * (own - before) / (at_own - at_before);
        if !next.is_finite() || (next - own).abs() <= 0.1 * NEAR * own {
            break;
        }
        (before, at_before) = (own, at_own);
        own = next.clamp(0.0, upper);
        at_own = of(own);
    }
    own
}
