//! Dimensional analysis: the same scene in other units of length, mass and time. Frequencies are 1/T, accelerances (L/T^2)/(M L/T^2) =
//! 1/M; what is relative, as bounds are, stays.

use crate::ask::{Answers, Factors, answers, answers_in, same};
use crate::spec::{assert_holds_for_random_inputs, on, point, scenes};
use proptest::prelude::*;

/// Seen to fail with a thickness that is 10 um more in any units.
#[test]
fn other_units_answer_the_same() {
    // Length by 0.1, 1 or 10; density by 0.01 to 100; time by 0.1, 1 or 10: all within what a scene file may say.
    assert_holds_for_random_inputs(
        18,
        (scenes(), point(), -1..=1_i32, -2..=2_i32, -1..=1_i32),
        |(spec, at, length, heavier, time)| {
            let at = on(&spec, at);
            let (length, time) = (10_f64.powi(length), 10_f64.powi(time));
            let mass = length.powi(3) * 10_f64.powi(heavier);
            let scaled = spec.scaled([length, mass, time]);
            let own = answers(&spec, at)?;
            let other = answers_in(&scaled, at.map(|part| part * length), time)?;
            let factors = Factors { frequency: 1.0 / time, acceleration: 1.0 / mass };
            same("units", (&spec, &own), (&scaled, &other), factors)?;
            // A ratio of damping that is the same on every mode is the root of a matrix over shapes of which some nearly depend on
            // others: rounding reaches 3e-4 of a peak in the levels' differences. The answers above are compared all the same.
            let is_modal = spec.damping.0 == "modal_ratio";
            prop_assert!(
                is_modal || bounds_alike(&own, &other),
                "bounds {:?} and {:?} with length, mass, time {:?}\n{}",
                bounds(&own),
                bounds(&other),
                [length, mass, time],
                spec.text()
            );
            Ok(())
        },
    );
}

fn bounds(answers: &Answers) -> Vec<f64> {
    answers.modes.iter().map(|(_, bound)| *bound).chain(answers.curves.iter().map(|(.., bound)| *bound)).collect()
}

/// Bounds come from differences between levels, whose last digits are rounding's: they are alike where they are far above that, or
/// as long as both are small.
fn bounds_alike(a: &Answers, b: &Answers) -> bool {
    bounds(a).into_iter().zip(bounds(b)).all(|(a, b)| a == b || (a - b).abs() <= 0.05 * a.max(b) + 1e-6)
}
