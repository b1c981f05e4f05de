//! The response against closed series, and against identities that hold for every panel.

use crate::scenes::SceneText;
use era_model::model::{Accuracy, PanelModel, ReducedModel};
use era_model::response::{multiply_shape_with_coordinates, solve_coordinates_per_newton_at_frequency};
use num_complex::Complex64;
use std::f64::consts::{PI, TAU};

fn reduced(scene: &SceneText, max_hz: f64) -> ReducedModel {
    PanelModel::build(&scene.scene(), Accuracy::BALANCED, max_hz)
        .unwrap()
        .reduce_with_residual_shapes_of_actuators_damping_and_points(max_hz, &[])
        .unwrap()
}

/// Displacement per newton at a point for each actuator.
fn compliance(model: &ReducedModel, hz: f64, x: f64, y: f64) -> Vec<Complex64> {
    let shape = model.shape_deflections_at(x, y);
    solve_coordinates_per_newton_at_frequency(model, hz)
        .unwrap()
        .iter()
        .map(|q| multiply_shape_with_coordinates(&shape, q))
        .collect()
}

/// Largest difference of two curves over the largest magnitude of the second.
fn worst(found: &[Complex64], expected: &[Complex64]) -> f64 {
    let peak = expected.iter().map(|z| z.norm()).fold(0.0, f64::max);
    found.iter().zip(expected).map(|(a, b)| (a - b).norm()).fold(0.0, f64::max) / peak
}

const ETA: f64 = 0.02;

/// A pinned bar: sum over n of sin sin / (omega_n^2 (1 + j eta) - omega^2), 4000 terms.
#[test]
fn pinned_bar_by_its_series() {
    let scene =
        SceneText::bar(0.25).edge("left", "pinned").edge("right", "pinned").force(0.3, 0.5).damping("loss_factor", ETA);
    let model = reduced(&scene, 500.0);
    let mass = scene.surface_mass();
    for x in [0.3, 0.71] {
        let (mut found, mut expected) = (Vec::new(), Vec::new());
        for step in 0..200 {
            let hz = 5.0 + 2.5 * f64::from(step);
            let series: Complex64 = (1..4000)
                .map(|n| {
                    let n = f64::from(n);
                    let omega_n = TAU * scene.bar_hz(n * PI);
                    let denominator = Complex64::new(omega_n * omega_n - (TAU * hz).powi(2), ETA * omega_n * omega_n);
                    2.0 / mass * (n * PI * 0.3).sin() * (n * PI * x).sin() / denominator
                })
                .sum();
            expected.push(series);
            found.push(compliance(&model, hz, x * 0.25, 0.01)[0]);
        }
        let error = worst(&found, &expected);
        assert!(error < 1e-4, "{x}: {error:e}");
    }
}

/// A pinned plate: the double sine series. At the driven point it converges slowly, so many terms.
#[test]
fn pinned_plate_by_its_series() {
    let (a, b, terms) = (0.3, 0.2, 700);
    let scene = SceneText::plate(a, b, 0.3).all_edges("pinned").force(0.3, 0.4).damping("loss_factor", ETA);
    let model = reduced(&scene, 600.0);
    let mass = scene.surface_mass();
    let rate = TAU * scene.plate_hz(PI * PI) * a * a;
    for (x, y) in [(0.3, 0.4), (0.62, 0.75)] {
        let (mut found, mut expected) = (Vec::new(), Vec::new());
        for step in 0..60 {
            let hz = 20.0 + 9.7 * f64::from(step);
            let mut sum = Complex64::ZERO;
            for m in 1..terms {
                let m = f64::from(m);
                let along = (m * PI * 0.3).sin() * (m * PI * x).sin();
                for n in 1..terms {
                    let n = f64::from(n);
                    let omega = rate * ((m / a).powi(2) + (n / b).powi(2));
                    let denominator = Complex64::new(omega * omega - (TAU * hz).powi(2), ETA * omega * omega);
                    sum += along * (n * PI * 0.4).sin() * (n * PI * y).sin() / denominator;
                }
            }
            expected.push(4.0 / mass * sum);
            found.push(compliance(&model, hz, x * a, y * b)[0]);
        }
        let error = worst(&found, &expected);
        assert!(error < 2e-3, "({x}, {y}): {error:e}");
    }
}

fn damped_plate() -> SceneText {
    SceneText::plate(0.3, 0.2, 0.33)
        .spring_damper(0.0, 0.0, 2e3, 1.3)
        .spring_damper(1.0, 0.0, 3e3, 0.4)
        .spring_damper(0.4, 1.0, 1e4, 5.0)
        .mass(0.6, 0.3, 0.02)
        .era("grounded", 0.25, 0.5, 0.01, 5e3, 0.7)
        .era("grounded", 0.8, 0.37, 0.01, 5e3, 1.1)
        .era("inertial", 0.55, 0.8, 0.012, 4e3, 0.3)
        .damping("loss_factor", 0.01)
}

/// What one actuator does at another's place is what the other does at its.
#[test]
fn reciprocity() {
    let model = reduced(&damped_plate(), 400.0);
    for hz in [12.0, 47.3, 110.0, 262.0, 399.0] {
        let at_second = compliance(&model, hz, 0.8 * 0.3, 0.37 * 0.2)[0];
        let at_first = compliance(&model, hz, 0.25 * 0.3, 0.5 * 0.2)[1];
        assert!((at_second - at_first).norm() < 1e-10 * at_first.norm(), "{hz} Hz: {at_second} {at_first}");
    }
}

/// The power that an actuator puts in is what dashpots and material take out.
#[test]
fn power_in_is_power_dissipated() {
    let model = reduced(&damped_plate(), 400.0);
    for hz in [12.0, 47.3, 110.0, 262.0, 399.0] {
        let omega = TAU * hz;
        for (actuator, q) in solve_coordinates_per_newton_at_frequency(&model, hz).unwrap().iter().enumerate() {
            let velocity = q * Complex64::new(0.0, omega);
            let force = model.force.column(actuator);
            let power_in: f64 = 0.5 * force.iter().zip(velocity.iter()).map(|(f, v)| f * v.re).sum::<f64>();
            let quadratic = |matrix: &nalgebra::DMatrix<f64>, z: &nalgebra::DVector<Complex64>| {
                let (re, im) = (z.map(|z| z.re), z.map(|z| z.im));
                re.dot(&(matrix * &re)) + im.dot(&(matrix * &im))
            };
            let taken = 0.5 * quadratic(&model.viscous, &velocity) + 0.5 * omega * quadratic(&model.structural, q);
            assert!(power_in > 0.0 && (power_in / taken - 1.0).abs() < 1e-8, "{hz} Hz: {power_in} {taken}");
        }
    }
}

/// The reduced model against a finer mesh with more modes: what the residual shapes are for.
#[test]
fn reduction_loses_little() {
    let scene = damped_plate();
    let small = reduced(&scene, 400.0);
    let large = PanelModel::build(&scene.scene(), Accuracy::REFERENCE, 1500.0)
        .unwrap()
        .reduce_with_residual_shapes_of_actuators_damping_and_points(1500.0, &[])
        .unwrap();
    for (x, y) in [(0.075, 0.1), (0.29, 0.19), (0.1, 0.02)] {
        for actuator in 0..3 {
            let curve = |model: &ReducedModel| -> Vec<Complex64> {
                (0..90)
                    .map(|i| {
                        let hz = 40.0 + 4.0 * f64::from(i);
                        compliance(model, hz, x, y)[actuator] * (TAU * hz).powi(2)
                    })
                    .collect()
            };
            let error = worst(&curve(&small), &curve(&large));
            assert!(error < 5e-3, "({x}, {y}), {actuator}: {error:e}");
        }
    }
}

/// The three kinds of surface damping agree where they mean the same: at a mode's own frequency.
#[test]
fn kinds_of_damping_give_the_ratio_they_name() {
    let pinned = || SceneText::bar(0.25).edge("left", "pinned").edge("right", "pinned");
    let ratios = |scene: &SceneText| -> Vec<(f64, f64)> {
        let modes = PanelModel::build(&scene.scene(), Accuracy::FAST, 700.0)
            .unwrap()
            .compute_mode_frequencies_and_poles(700.0)
            .unwrap();
        modes.iter().map(|mode| (mode.frequency_hz, mode.damping_ratio)).collect()
    };
    for (_, ratio) in ratios(&pinned().damping("loss_factor", 0.02)) {
        // Of s^2 = -omega^2 (1 + j eta).
        assert!((ratio - (0.5 * 0.02_f64.atan()).sin()).abs() < 1e-9, "{ratio}");
    }
    for (_, ratio) in ratios(&pinned().damping("modal_ratio", 0.03)) {
        assert!((ratio - 0.03).abs() < 1e-9, "{ratio}");
    }
    for (hz, ratio) in ratios(&pinned().damping("rayleigh_beta", 1e-6)) {
        assert!((ratio - 0.5e-6 * TAU * hz).abs() < 1e-9, "{ratio}");
    }
    for (hz, ratio) in ratios(&pinned().damping("rayleigh_alpha", 10.0)) {
        assert!((ratio - 5.0 / (TAU * hz)).abs() < 1e-9, "{ratio}");
    }
    // ERAs are not part of the supported surface: their own spring is damped by nothing here.
    let with_era = pinned().era("inertial", 0.5, 0.5, 0.5, 100.0, 0.0).damping("modal_ratio", 0.03);
    assert!(ratios(&with_era)[0].1 < 1e-4);
}
