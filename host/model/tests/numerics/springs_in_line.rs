//! Three springs nearly in a line: the plate turns about that line slowly, and bends by the springs' forces all the same.

use crate::scenes::SceneText;
use era_model::model::{Accuracy, compute_modes_with_error_bounds};
use nalgebra::{Matrix3, Vector3};
use std::f64::consts::TAU;

const SIZE: (f64, f64) = (0.402, 0.208);
const SPRINGS: [(f64, f64, f64); 3] = [(0.684, 0.389, 1.2e4), (0.816, 0.370, 1.2e4), (0.567, 0.404, 9.6e4)];

/// The slowest mode of a plate that is `times` as stiff, in Hz, and its bound.
fn slowest(times: f64) -> (f64, f64) {
    let mut plate = SceneText::plate(SIZE.0, SIZE.1, 0.35).thickness(0.007);
    plate.young *= times;
    let scene = SPRINGS.into_iter().fold(plate, |plate, (x, y, k)| plate.spring(x, y, k)).scene();
    let found = compute_modes_with_error_bounds(&scene, Accuracy::BALANCED, 200.0).unwrap();
    (found.answer[0].frequency_hz, found.bounds[0].limit_if_known().unwrap())
}

/// The same of a plate that does not bend: w = a + b u + c v with u and v from the centre, mean squares 1, 1/12 and 1/12.
fn straight() -> f64 {
    let mass = SceneText::plate(SIZE.0, SIZE.1, 0.35).thickness(0.007).surface_mass();
    let root = 12.0_f64.sqrt();
    let mut stiffness = Matrix3::zeros();
    for (x, y, k) in SPRINGS {
        let row = Vector3::new(1.0, root * (x - 0.5), root * (y - 0.5));
        stiffness += k / mass * row * row.transpose();
    }
    // The least root of lambda^3 - trace lambda^2 + minors lambda - determinant, of which no digit is lost to the others.
    let minors: f64 = [(0, 1), (0, 2), (1, 2)]
        .iter()
        .map(|(i, j)| stiffness[(*i, *i)] * stiffness[(*j, *j)] - stiffness[(*i, *j)].powi(2))
        .sum();
    let (trace, determinant) = (stiffness.trace(), stiffness.determinant());
    let least = (0..4).fold(0.0, |l: f64, _| (determinant + trace * l * l - l.powi(3)) / minors);
    least.sqrt() / TAU
}

/// What bending takes from it goes with the inverse of the rigidity; it was not counted at all, with a bound of 1e-6.
#[test]
fn bending_by_the_springs_forces_is_counted() {
    let straight = straight();
    let missing = [1.0, 2.0, 4.0].map(|times| {
        let (found, bound) = slowest(times);
        assert!(found < 1.0 && bound < 1e-5, "{found} Hz, {bound:e}");
        straight / found - 1.0
    });
    assert!(missing[0] > 1e-4, "{missing:?}");
    for pair in missing.windows(2) {
        assert!((pair[0] / pair[1] - 2.0).abs() < 0.01, "{missing:?}");
    }
}
