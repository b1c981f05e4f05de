//! What is asked of the program, and how two answers are held against each other.

use crate::spec::{HIGHEST_HZ, Spec};
use era_model::model::{Accuracy, Bound, compute_modes_with_error_bounds};
use era_model::response::compute_acceleration_curves_per_newton_with_error_bounds;
use num_complex::Complex64;
use proptest::prelude::*;
use proptest::test_runner::TestCaseResult;

/// What answers are asked for.
pub const TOLERANCE: f64 = 1e-2;
/// Relative rounding between two computations of one number: both are what matrices of condition 1e5 or so make of inputs that
/// differ in their last digit.
const ROUNDING: f64 = 1e-10;

/// Modes and responses of a scene.
pub struct Answers {
    /// Frequency in Hz and bound, which is relative.
    pub modes: Vec<(f64, f64)>,
    /// For each ERA.
    pub curves: Vec<Curve>,
}

/// An ERA's id, its curve in m/s^2 per N, and the bound relative to the curve's peak.
pub type Curve = (String, Vec<Complex64>, f64);

/// Frequencies in Hz of the curves, in units of `1 / time`.
fn frequencies(time: f64) -> Vec<f64> {
    (0..11).map(|i| (21.7 + f64::from(i) * (HIGHEST_HZ - 25.0) / 10.0) / time).collect()
}

/// Answers at a point in mm; those without a bound have an infinite one.
pub fn answers(spec: &Spec, at_mm: [f64; 2]) -> Result<Answers, TestCaseError> {
    answers_in(spec, at_mm, 1.0)
}

/// The same with frequencies in units of `1 / time` Hz.
pub fn answers_in(spec: &Spec, at_mm: [f64; 2], time: f64) -> Result<Answers, TestCaseError> {
    let found = compute_modes_with_error_bounds(
        &spec.parse_scene(),
        Accuracy::from_tolerance(TOLERANCE).unwrap(),
        HIGHEST_HZ / time,
    )
    .map_err(|error| TestCaseError::fail(format!("{error}\n{}", spec.text())))?;
    let modes = found.answer.iter().zip(&found.bounds).map(|(mode, own)| (mode.frequency_hz, number(*own))).collect();
    Ok(Answers { modes, curves: curves_in(spec, at_mm, time)? })
}

fn number(bound: Bound) -> f64 {
    bound.limit_if_known().unwrap_or(f64::INFINITY)
}

/// Responses alone.
pub fn curves_in(spec: &Spec, at_mm: [f64; 2], time: f64) -> Result<Vec<Curve>, TestCaseError> {
    curves_at(spec, at_mm, &frequencies(time))
}

/// The same at frequencies of one's own choice, in Hz.
pub fn curves_at(spec: &Spec, at_mm: [f64; 2], frequencies_hz: &[f64]) -> Result<Vec<Curve>, TestCaseError> {
    let at = (at_mm[0] / 1e3, at_mm[1] / 1e3);
    let found = compute_acceleration_curves_per_newton_with_error_bounds(
        &spec.parse_scene(),
        Accuracy::from_tolerance(TOLERANCE).unwrap(),
        at,
        frequencies_hz,
    )
    .map_err(|error| TestCaseError::fail(format!("{error}\n{}", spec.text())))?;
    let ids = spec.eras.iter().map(|era| era.id.clone());
    Ok(ids.zip(found.answer).zip(&found.bounds).map(|((id, curve), own)| (id, curve, number(*own))).collect())
}

/// What answers change by: frequencies and accelerations per newton.
#[derive(Clone, Copy)]
pub struct Factors {
    pub frequency: f64,
    pub acceleration: f64,
}

pub const SAME: Factors = Factors { frequency: 1.0, acceleration: 1.0 };

/// That two scenes have the same answers but for `factors` (of the second over the first), within the sum of their bounds;
/// curves of one id belong together.
pub fn same(name: &str, a: (&Spec, &Answers), b: (&Spec, &Answers), factors: Factors) -> TestCaseResult {
    let texts = || format!("{}\n--- and\n{}", a.0.text(), b.0.text());
    // At the very end of the band one may be in and the other out.
    let below = |modes: &[(f64, f64)], factor: f64| -> Vec<(f64, f64)> {
        let end = 0.99 * HIGHEST_HZ * factor;
        modes.iter().copied().filter(|(hz, _)| *hz < end).collect()
    };
    let pairs = below(&a.1.modes, 1.0).len().max(below(&b.1.modes, factors.frequency).len());
    for k in 0..pairs {
        let (Some((first, own)), Some((second, other))) = (a.1.modes.get(k), b.1.modes.get(k)) else {
            return Err(TestCaseError::fail(format!("{name}: {:?} and {:?}\n{}", a.1.modes, b.1.modes, texts())));
        };
        if *first == 0.0 || *second == 0.0 {
            prop_assert!(first == second, "{name}: mode {}: {first} and {second} Hz\n{}", k + 1, texts());
            continue;
        }
        let difference = (second / (first * factors.frequency) - 1.0).abs();
        prop_assert!(
            difference <= own + other + ROUNDING,
            "{name}: mode {}: {first} and {second} Hz differ by {difference:e}, bounds {own:e} and {other:e}\n{}",
            k + 1,
            texts()
        );
    }
    prop_assert_eq!(a.1.curves.len(), b.1.curves.len());
    for (id, curve, own) in &a.1.curves {
        let Some((_, second, other)) = b.1.curves.iter().find(|(other, ..)| other == id) else {
            return Err(TestCaseError::fail(format!("{name}: no curve {id}")));
        };
        let difference = apart(curve, second, factors.acceleration, nothing(a.0));
        prop_assert!(
            difference <= own + other + ROUNDING,
            "{name}: curves of {id} differ by {difference:e} of their peak, bounds {own:e} and {other:e}\n{}",
            texts()
        );
    }
    Ok(())
}

/// An acceleration per newton that is as good as none: a millionth of the whole surface's under the same force, as at a clamped edge.
pub fn nothing(spec: &Spec) -> f64 {
    1e-6 / spec.parse_scene().surface_mass_with_air_kg()
}

/// Largest difference of two curves, the second divided by `factor`, relative to the first one's peak.
pub fn apart(first: &[Complex64], second: &[Complex64], factor: f64, nothing: f64) -> f64 {
    let peak = first.iter().map(|z| z.norm()).fold(nothing, f64::max);
    first.iter().zip(second).map(|(a, b)| (a - b / factor).norm()).fold(0.0, f64::max) / peak
}
