//! The fast ways against the plain ones: few couplings against the full matrix, one folded product against point by point.

use crate::scenes::SceneText;
use era_model::model::{Accuracy, PanelModel, ReducedModel};
use era_model::response::sweep::{Arithmetic, SurfaceShapes};
use era_model::response::{
    CoordinateSolver, multiply_shape_with_coordinates, solve_coordinates_per_newton_at_frequency,
};
use era_model::scene::{EXAMPLE_BAR, STARTING_PLATE, Scene};
use nalgebra::DMatrix;
use num_complex::Complex64;
use proptest::prelude::*;

fn reduced(scene: &Scene) -> ReducedModel {
    PanelModel::build(scene, Accuracy::FAST, 400.0)
        .unwrap()
        .reduce_with_residual_shapes_of_actuators_damping_and_points(400.0, &[])
        .unwrap()
}

/// How much the answers by the full matrix may be wrong because its entries are rounded, relative to the largest coordinate: the matrix's
/// condition number times the rounding. A dashpot that holds its point has entries 1e6 times those of the panel, and near the resonance of a
/// panel without loss, what they lose counts again as much.
fn rounding_of_full(model: &ReducedModel, hz: f64) -> f64 {
    let omega = std::f64::consts::TAU * hz;
    let matrix = DMatrix::from_fn(model.lambda.len(), model.lambda.len(), |i, j| {
        let diagonal = if i == j { model.lambda[i] - omega * omega } else { 0.0 };
        Complex64::new(diagonal, model.structural[(i, j)] + omega * model.viscous[(i, j)])
    });
    let norm = matrix.norm();
    f64::EPSILON * norm * matrix.try_inverse().map_or(f64::INFINITY, |inverse| inverse.norm())
}

/// Largest difference from the same answers by the full matrix, relative to the largest coordinate.
fn difference_from_full(model: &ReducedModel, hz: f64) -> f64 {
    let mut full = model.clone();
    assert!(full.structured.take().is_some());
    let (fast, full) = (
        solve_coordinates_per_newton_at_frequency(model, hz).unwrap(),
        solve_coordinates_per_newton_at_frequency(&full, hz).unwrap(),
    );
    let largest = full.iter().map(|q| q.camax()).fold(0.0, f64::max);
    fast.iter().zip(&full).map(|(a, b)| (a - b).camax()).fold(0.0, f64::max) / largest
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 60, ..ProptestConfig::default() })]

    /// Dashpots from nothing to ones that hold their point, springs from soft to rigid, with and without loss.
    #[test]
    fn few_couplings_answer_as_the_full_matrix(
        springs in prop::collection::vec((0.0..1.0, 0.0..1.0, 0.0..12.0, -6.0..8.0), 1..5),
        mass in 0.0..3.0,
        loss in prop::sample::select(vec![("loss_factor", 0.0), ("loss_factor", 0.003), ("loss_factor", 0.2),
            ("rayleigh_beta", 1e-6), ("rayleigh_alpha", 3.0)]),
        era in (0.1..0.9, 0.1..0.9),
        hz in 1.0..400.0,
    ) {
        let mut scene = SceneText::plate(0.3, 0.2, 0.33)
            .era("grounded", 0.3, 0.4, 0.01, 5e3, 0.7)
            .era("inertial", era.0, era.1, 0.012, 4e3, 0.3)
            .mass(0.6, 0.3, mass)
            .damping(loss.0, loss.1);
        for (x, y, stiffness, damping) in springs {
            scene = scene.spring_damper(x, y, 10_f64.powf(stiffness), 10_f64.powf(damping));
        }
        let model = reduced(&scene.scene());
        let (difference, rounding) = (difference_from_full(&model, hz), rounding_of_full(&model, hz));
        prop_assert!(difference < rounding, "{difference:e}, {rounding:e}");
    }
}

/// Without loss and right at a mode the diagonal cannot be divided by: dashpots alone bound the response.
#[test]
fn at_resonance_dashpots_are_enough() {
    let scene = SceneText::plate(0.3, 0.2, 0.33)
        .spring_damper(0.0, 0.0, 2e3, 1.3)
        .spring_damper(1.0, 0.7, 3e3, 0.4)
        .era("grounded", 0.3, 0.4, 0.01, 5e3, 0.7)
        .scene();
    let model = reduced(&scene);
    for lambda in model.lambda.iter().take(8) {
        let hz = lambda.sqrt() / std::f64::consts::TAU;
        for nearby in [hz, hz * (1.0 + 1e-15), hz * (1.0 + 1e-10), hz * (1.0 + 1e-6), hz * (1.0 + 1e-4)] {
            assert!(difference_from_full(&model, nearby) < 1e-9, "{nearby}");
        }
    }
}

/// Largest difference of a sweep from point by point, relative to the largest value; and the multiplications per frequency
/// and actuator, relative to those of all points and coordinates.
fn against_points<T: Arithmetic + Into<f64>>(scene: &Scene, nx: u32, ny: u32) -> (f64, f64) {
    let model = reduced(scene);
    let line = |side: f64, n: u32| -> Vec<f64> {
        (0..n).map(|i| if n == 1 { side / 2.0 } else { side * f64::from(i) / f64::from(n - 1) }).collect()
    };
    let (x_m, y_m) = (line(scene.surface.length_m, nx), line(scene.surface.width_m, ny));
    let frequencies_hz: Vec<f64> = (0..70).map(|i| 40.0 + 5.0 * f64::from(i)).collect();
    let shapes = SurfaceShapes::<T>::new(scene, &model, &x_m, &y_m);
    let sweep = shapes.compute_accelerations_per_newton_at_all_points(&frequencies_hz).unwrap();
    let solver = CoordinateSolver::new(&model);
    let (mut worst, mut largest) = (0.0_f64, 0.0_f64);
    for (k, hz) in frequencies_hz.iter().enumerate() {
        let minus_omega_squared = -(std::f64::consts::TAU * hz).powi(2);
        for (actuator, q) in solver.solve_coordinates_per_newton_at(*hz).unwrap().iter().enumerate() {
            for (point, (x, y)) in y_m.iter().flat_map(|y| x_m.iter().map(move |x| (x, y))).enumerate() {
                let expected =
                    multiply_shape_with_coordinates(&model.shape_deflections_at(*x, *y), q) * minus_omega_squared;
                let found = sweep.acceleration_per_newton_at_indices(k, actuator, point);
                worst = worst.max((Complex64::new(found.re.into(), found.im.into()) - expected).norm());
                largest = largest.max(expected.norm());
            }
        }
    }
    let all = 4 * x_m.len() * y_m.len() * model.count_coordinates();
    (worst / largest, shapes.count_multiplications_and_additions_per_frequency_and_actuator() as f64 / all as f64)
}

/// Twice symmetric, with both ERAs on the centre line: a quarter of the points, and half of the coordinates stay at rest.
#[test]
fn symmetric_plate_by_a_quarter() {
    let scene = Scene::parse("plate", STARTING_PLATE).unwrap();
    for (nx, ny) in [(13, 9), (12, 8), (7, 2)] {
        let (difference, part) = against_points::<f32>(&scene, nx, ny);
        assert!(difference < 2e-6, "{nx} x {ny}: {difference:e}");
        assert!(part < 0.25, "{nx} x {ny}: {part}");
        let (difference, _) = against_points::<f64>(&scene, nx, ny);
        assert!(difference < 1e-9, "{nx} x {ny}: {difference:e}");
    }
}

#[test]
fn bar_by_half() {
    let scene = Scene::parse("bar", EXAMPLE_BAR).unwrap();
    let (difference, part) = against_points::<f64>(&scene, 31, 1);
    assert!(difference < 1e-9 && part < 0.6, "{difference:e} {part}");
}

/// Whatever breaks the symmetry, however little, the whole grid is computed.
#[test]
fn without_symmetry_nothing_is_folded() {
    let symmetric = || SceneText::plate(0.3, 0.2, 0.33).corner_springs(2e3).damping("loss_factor", 0.01);
    let eras = |scene: SceneText, x: f64, mass: f64| {
        scene.era("grounded", 0.25, 0.5, 0.01, 5e3, 0.7).era("grounded", x, 0.5, mass, 5e3, 0.7).scene()
    };
    let part = |scene: &Scene| {
        let (difference, part) = against_points::<f32>(scene, 13, 9);
        assert!(difference < 2e-6, "{difference:e}");
        part
    };
    assert!(part(&eras(symmetric(), 0.75, 0.01)) < 0.25);
    // Still symmetric about the horizontal centre line.
    for scene in [
        eras(symmetric(), 0.7503, 0.01),
        eras(symmetric(), 0.75, 0.010_001),
        eras(symmetric().edge("left", "pinned"), 0.75, 0.01),
    ] {
        let part = part(&scene);
        assert!(part > 0.25 && part < 0.6, "{part}");
    }
    let lone = symmetric().mass(0.31, 0.42, 1e-4);
    assert!(part(&eras(lone, 0.75, 0.01)) > 0.99);
}
