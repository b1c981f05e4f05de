//! Panels on springs that lose another part than their material does, or nothing: what damps couples the modes through the springs'
//! forces. Responses against the bending equation solved with complex moduli.

use crate::scenes::SceneText;
use era_model::model::{Accuracy, Bound};
use era_model::response::compute_acceleration_curves_per_newton_with_error_bounds;
use nalgebra::{Matrix4, Vector4};
use num_complex::Complex64;
use std::f64::consts::{PI, TAU};

/// What stands at an end: dynamic stiffness against deflection and against slope, per metre of edge on a plate.
#[derive(Clone, Copy)]
struct End {
    shift: Complex64,
    turn: Complex64,
}

/// Deflection w(x) of a strip of rigidity `d` and mass `mu` per length (complex where they lose) that varies as cos(k y) across
/// it, under a unit force at x = 0: w'''' - 2 k^2 w'' + (k^4 - b^4) w = 0 with b^4 = mu omega^2 / d, shear
/// d (w''' - (2 - nu) k^2 w'), moment d (w'' - nu k^2 w).
fn deflection(
    [d, mu]: [Complex64; 2],
    (k, nu): (f64, f64),
    length: f64,
    ends: [End; 2],
    omega: f64,
) -> impl Fn(f64) -> Complex64 {
    let b_squared = (mu * omega * omega / d).sqrt();
    let (slow, fast) = ((k * k - b_squared).sqrt(), (k * k + b_squared).sqrt());
    // exp(-r x) and exp(-r (length - x)): none grows beyond one.
    let functions = [(-slow, 0.0), (slow, length), (-fast, 0.0), (fast, length)];
    let value = move |(r, from): (Complex64, f64), x: f64, derivative: i32| r.powi(derivative) * (r * (x - from)).exp();
    let mut matrix = Matrix4::<Complex64>::zeros();
    for (column, function) in functions.into_iter().enumerate() {
        for (end, (x, outward)) in [(0.0, -1.0), (length, 1.0)].into_iter().enumerate() {
            let [w, slope, bend, jerk] = [0, 1, 2, 3].map(|derivative| value(function, x, derivative));
            matrix[(2 * end, column)] = -outward * d * (jerk - (2.0 - nu) * k * k * slope) + ends[end].shift * w;
            matrix[(2 * end + 1, column)] = outward * d * (bend - nu * k * k * w) + ends[end].turn * slope;
        }
    }
    let load = Vector4::new(1.0, 0.0, 0.0, 0.0).map(Complex64::from);
    let amplitudes = matrix.lu().solve(&load).expect("damped");
    move |x| functions.iter().zip(&amplitudes).map(|(function, amplitude)| amplitude * value(*function, x, 0)).sum()
}

/// Asks for the curve at a point and holds its error against the bound, and the bound against the tolerance.
fn check(name: &str, scene: &SceneText, (x, y): (f64, f64), frequencies_hz: &[f64], compliance: &[Complex64]) {
    let accelerations = frequencies_hz.iter().zip(compliance).map(|(hz, w)| -(TAU * hz).powi(2) * w);
    let expected: Vec<_> = accelerations.collect();
    let peak = expected.iter().map(|z| z.norm()).fold(0.0, f64::max);
    for tolerance in [1e-3, 1e-5] {
        let accuracy = Accuracy::from_tolerance(tolerance).unwrap();
        let found =
            compute_acceleration_curves_per_newton_with_error_bounds(&scene.scene(), accuracy, (x, y), frequencies_hz)
                .unwrap();
        let differences = found.answer[0].iter().zip(&expected).map(|(a, b)| (a - b).norm() / peak);
        let error = differences.fold(0.0, f64::max);
        let Bound::AtMost(bound) = found.bounds[0] else { panic!("{name}: no bound") };
        assert!(error <= bound && bound <= tolerance, "{name}, {tolerance:e}: error {error:e}, bound {bound:e}");
    }
}

fn frequencies_hz() -> Vec<f64> {
    (0..100).map(|k| 10.0 + 4.0 * f64::from(k)).collect()
}

/// A bar with a force at its left end; springs there and at the other end, or a mass there.
#[test]
fn bars() {
    let length = 0.25;
    let none = SceneText::bar(length).force(0.0, 0.5);
    let (spring, turning, mass) = (3e3, 20.0, 0.03);
    let on_points = none.clone().spring(0.0, 0.5, spring).spring(1.0, 0.5, spring);
    let on_edges = none.clone().elastic_edge("left", spring).with(&format!(
        "[[edge]]\nside = \"right\"\nkind = \"elastic\"\nstiffness_n_per_m = {spring:e}\nrotational_stiffness_n_m_per_rad = {turning}\n"
    ));
    let turned = none.clone().spring(0.0, 0.5, spring).with(&format!(
        "[[support]]\nx_mm = 250.0\nstiffness_n_per_m = {spring:e}\nrotational_stiffness_n_m_per_rad = {turning}\n"
    ));
    let weighed = none.clone().spring(0.0, 0.5, spring).spring(1.0, 0.5, spring).mass(1.0, 0.5, mass);
    let cases = [
        ("springs at points", on_points, 0.0, 0.0),
        ("springs at ends", on_edges, turning, 0.0),
        ("a point that turns", turned, turning, 0.0),
        ("a mass", weighed, 0.0, mass),
    ];
    let (ei, mu) = (none.ei(), none.surface_mass() / length);
    for (name, scene, turning, mass) in cases {
        for (kind, key, value) in [(0, "loss_factor", 0.03), (1, "rayleigh_beta", 2e-5), (2, "rayleigh_alpha", 30.0)] {
            let scene = scene.clone().damping(key, value);
            for x in [0.4 * length, length] {
                let compliance: Vec<_> = frequencies_hz()
                    .iter()
                    .map(|hz| {
                        let omega = TAU * hz;
                        let loss = [value, omega * value, value / omega][kind];
                        let of = |on: bool| if on { Complex64::new(0.0, loss) } else { Complex64::ZERO };
                        // -omega^2 mu + j omega alpha mu = -omega^2 mu (1 - j alpha / omega)
                        let moduli = [ei * (1.0 + of(kind < 2)), mu * (1.0 - of(kind == 2))];
                        let left = End { shift: spring.into(), turn: Complex64::ZERO };
                        let right = End { shift: (spring - mass * omega * omega).into(), turn: turning.into() };
                        deflection(moduli, (0.0, 0.0), length, [left, right], omega)(x)
                    })
                    .collect();
                check(&format!("{name}, {key}, {x} m"), &scene, (x, 0.01), &frequencies_hz(), &compliance);
            }
        }
    }
}

/// A plate pinned above and below, on springs to the left and right, by Levy's series: a force on the left edge.
#[test]
fn plate() {
    let (length, width, nu, eta, spring) = (0.3, 0.2, 0.3, 0.04, 4e4);
    let scene = SceneText::plate(length, width, nu)
        .edge("top", "pinned")
        .edge("bottom", "pinned")
        .elastic_edge("left", spring)
        .elastic_edge("right", spring)
        .force(0.0, 0.4)
        .damping("loss_factor", eta);
    let moduli = [scene.rigidity() * Complex64::new(1.0, eta), (scene.surface_mass() / (length * width)).into()];
    let end = End { shift: spring.into(), turn: Complex64::ZERO };
    for (x, y) in [(length, 0.4), (0.4 * length, 0.7)] {
        let compliance: Vec<Complex64> = frequencies_hz()
            .iter()
            .map(|hz| {
                // Of wave n only exp(-n pi x / width) arrives.
                let waves = (1..40).map(|n| {
                    let k = f64::from(n) * PI / width;
                    let across = 2.0 / width * (k * 0.4 * width).sin() * (k * y * width).sin();
                    across * deflection(moduli, (k, nu), length, [end, end], TAU * hz)(x)
                });
                waves.sum()
            })
            .collect();
        check(&format!("plate at {x} m"), &scene, (x, y * width), &frequencies_hz(), &compliance);
    }
}

/// Rubber at points and along edges, on a material that loses nothing, less, or by its stiffness' rate: one complex spring at each end.
/// Seen to fail without the losses of points, of slopes and of edges, each by itself.
#[test]
fn bars_on_rubber() {
    let length = 0.25;
    let none = SceneText::bar(length).force(0.0, 0.5);
    let (spring, turning, [left_eta, right_eta]) = (3e3, 20.0, [0.35, 0.9]);
    let on_points = none.clone().lossy_spring(0.0, 0.5, spring, left_eta).with(&format!(
        "[[support]]\nx_mm = 250.0\nstiffness_n_per_m = {spring:e}\nrotational_stiffness_n_m_per_rad = {turning}\n\
             loss_factor = {right_eta}\n"
    ));
    let on_edges = none.clone().lossy_edge("left", spring, left_eta).with(&format!(
        "[[edge]]\nside = \"right\"\nkind = \"elastic\"\nstiffness_n_per_m = {spring:e}\n\
             rotational_stiffness_n_m_per_rad = {turning}\nloss_factor = {right_eta}\n"
    ));
    let (ei, mu) = (none.ei(), none.surface_mass() / length);
    for (name, scene) in [("points", on_points), ("edges", on_edges)] {
        for (key, value) in
            [("loss_factor", 0.0), ("loss_factor", 0.03), ("loss_factor", 0.35), ("rayleigh_beta", 2e-5)]
        {
            let scene = scene.clone().damping(key, value);
            for x in [0.4 * length, length] {
                let compliance: Vec<_> = frequencies_hz()
                    .iter()
                    .map(|hz| {
                        let omega = TAU * hz;
                        let loss = if key == "loss_factor" { value } else { omega * value };
                        let moduli = [ei * Complex64::new(1.0, loss), mu.into()];
                        let left = End { shift: spring * Complex64::new(1.0, left_eta), turn: Complex64::ZERO };
                        let rubber = Complex64::new(1.0, right_eta);
                        let right = End { shift: spring * rubber, turn: turning * rubber };
                        deflection(moduli, (0.0, 0.0), length, [left, right], omega)(x)
                    })
                    .collect();
                check(&format!("{name}, {key} {value}, {x} m"), &scene, (x, 0.01), &frequencies_hz(), &compliance);
            }
        }
    }
}

/// Tape of two kinds to the left and to the right. Seen to fail with the losses of the two exchanged.
#[test]
fn a_plate_on_tape() {
    let (length, width, nu, spring, etas) = (0.3, 0.2, 0.3, 4e4, [0.5, 0.08]);
    for eta in [0.0, 0.02] {
        let scene = SceneText::plate(length, width, nu)
            .edge("top", "pinned")
            .edge("bottom", "pinned")
            .lossy_edge("left", spring, etas[0])
            .lossy_edge("right", spring, etas[1])
            .force(0.0, 0.4)
            .damping("loss_factor", eta);
        let moduli = [scene.rigidity() * Complex64::new(1.0, eta), (scene.surface_mass() / (length * width)).into()];
        let ends = etas.map(|eta| End { shift: spring * Complex64::new(1.0, eta), turn: Complex64::ZERO });
        for (x, y) in [(length, 0.4), (0.4 * length, 0.7)] {
            let compliance: Vec<Complex64> = frequencies_hz()
                .iter()
                .map(|hz| {
                    let waves = (1..40).map(|n| {
                        let k = f64::from(n) * PI / width;
                        let across = 2.0 / width * (k * 0.4 * width).sin() * (k * y * width).sin();
                        across * deflection(moduli, (k, nu), length, ends, TAU * hz)(x)
                    });
                    waves.sum()
                })
                .collect();
            check(&format!("plate of {eta} at {x} m"), &scene, (x, y * width), &frequencies_hz(), &compliance);
        }
    }
}
