//! Frequencies against closed equations and converged references: beams by their frequency equations, plates by
//! Navier, Levy and Legendre-Ritz.

use crate::scenes::SceneText;
use era_model::model::{Accuracy, PanelModel, compute_modes_with_error_bounds};
use era_model::response;

const TOLERANCES: [f64; 4] = [1e-2, 1e-3, 1e-4, 1e-6];

/// The scene has `zeros` rigid motions and then exactly the frequencies `expected`, which are known to `digits`: at every
/// tolerance within it, and within the bound.
fn check(name: &str, scene: &SceneText, zeros: usize, expected: &[f64], digits: f64) {
    let max_hz = 1.001 * expected.iter().copied().fold(0.0, f64::max);
    for tolerance in TOLERANCES {
        let found =
            compute_modes_with_error_bounds(&scene.scene(), Accuracy::from_tolerance(tolerance).unwrap(), max_hz)
                .unwrap();
        let hz: Vec<f64> = found.answer.iter().map(|mode| mode.frequency_hz).collect();
        assert!(hz.is_sorted(), "{name}: {hz:?}");
        assert_eq!(hz.iter().filter(|hz| **hz == 0.0).count(), zeros, "{name}: rigid motions");
        assert!(hz.len() >= zeros + expected.len(), "{name}: {hz:?} for {expected:?}");
        for (k, expected) in expected.iter().enumerate() {
            let error = (hz[zeros + k] / expected - 1.0).abs();
            let bound = found.bounds[zeros + k].limit_if_known().unwrap();
            assert!(bound <= tolerance, "{name}: bound {bound:e} for a tolerance of {tolerance:e}");
            assert!(
                error <= bound + digits,
                "{name} at {tolerance:e}: {expected} Hz is off by {error:e}, bound {bound:e}"
            );
        }
    }
}

fn check_bar(name: &str, scene: &SceneText, zeros: usize, beta_l: &[f64]) {
    let expected: Vec<f64> = beta_l.iter().map(|beta_l| scene.bar_hz(*beta_l)).collect();
    check(name, scene, zeros, &expected, 2e-9);
}

fn check_plate(name: &str, scene: &SceneText, zeros: usize, lambda: &[f64], digits: f64) {
    let expected: Vec<f64> = lambda.iter().map(|lambda| scene.plate_hz(*lambda)).collect();
    check(name, scene, zeros, &expected, digits);
}

fn bar() -> SceneText {
    SceneText::bar(0.25)
}

#[test]
fn bars_with_ideal_ends() {
    let clamped = [4.730040745, 7.853204624, 10.99560784, 14.13716549];
    check_bar("free-free", &bar(), 2, &clamped);
    check_bar("clamped-clamped", &bar().edge("left", "clamped").edge("right", "clamped"), 0, &clamped);
    let cantilever = [1.875104069, 4.694091133, 7.854757438, 10.99554073];
    check_bar("cantilever", &bar().edge("left", "clamped"), 0, &cantilever);
    let pi = std::f64::consts::PI;
    check_bar("pinned", &bar().edge("left", "pinned").edge("right", "pinned"), 0, &[pi, 2.0 * pi, 3.0 * pi, 4.0 * pi]);
    let propped = [3.926602312, 7.068582746, 10.21017612, 13.35176878];
    check_bar("clamped-pinned", &bar().edge("left", "clamped").edge("right", "pinned"), 0, &propped);
    check_bar("free-pinned", &bar().edge("right", "pinned"), 1, &propped);
}

#[test]
fn bars_on_springs_and_with_masses() {
    let cases = [
        (1.0, [1.18428467990, 1.56415306022]),
        (10.0, [2.03234135617, 2.76660910601]),
        (100.0, [2.87675069401, 4.66378459604]),
    ];
    for (ratio, beta_l) in cases {
        let k = ratio * bar().ei() / 0.25_f64.powi(3);
        check_bar("end springs", &bar().spring(0.0, 0.5, k).spring(1.0, 0.5, k), 0, &beta_l);
        // The same as an elastic edge of a bar.
        let text = bar().text()
            + &["left", "right"]
                .map(|side| format!("[[edge]]\nside = \"{side}\"\nkind = \"elastic\"\nstiffness_n_per_m = {k:e}\n"))
                .concat();
        let scene = era_model::scene::Scene::parse("elastic ends", &text).unwrap();
        let modes = PanelModel::build(&scene, Accuracy::BALANCED, 500.0)
            .unwrap()
            .compute_mode_frequencies_and_poles(500.0)
            .unwrap();
        assert!((modes[0].frequency_hz / bar().bar_hz(beta_l[0]) - 1.0).abs() < 1e-6);
    }
    let mass = bar().surface_mass();
    let cantilever = || bar().edge("left", "clamped");
    check_bar("tip mass 1", &cantilever().mass(1.0, 0.5, mass), 0, &[1.24791740961, 4.03113943672]);
    check_bar("tip mass 0.1", &cantilever().mass(1.0, 0.5, 0.1 * mass), 0, &[1.72274152059]);
    let k = 100.0 * bar().ei() / 0.25_f64.powi(3);
    check_bar("tip spring", &cantilever().spring(1.0, 0.5, k), 0, &[3.64054171892, 5.61599608237]);
    // A sprung mass is what an inertial ERA is.
    let k = 10.0 * bar().ei() / 0.25_f64.powi(3);
    let pinned = bar().edge("left", "pinned").edge("right", "pinned").era("inertial", 0.5, 0.5, 0.1 * mass, k, 0.0);
    let two_pi = std::f64::consts::TAU;
    check_bar("sprung mass", &pinned, 0, &[2.8181164149, 3.5225723288, two_pi, 9.4308335491, 2.0 * two_pi]);
}

#[test]
fn pinned_plates_by_navier() {
    let pi2 = std::f64::consts::PI.powi(2);
    for (a, b) in [(0.3, 0.2), (0.2, 0.2), (0.5, 0.1)] {
        let scene = SceneText::plate(a, b, 0.33).all_edges("pinned");
        let mut lambda: Vec<f64> = (1..8)
            .flat_map(|m: i32| {
                (1..8).map(move |n: i32| pi2 * (f64::from(m * m) + f64::from(n * n) * (a / b) * (a / b)))
            })
            .collect();
        lambda.sort_by(f64::total_cmp);
        check_plate("pinned", &scene, 0, &lambda[..6], 1e-12);
    }
}

#[test]
fn square_plates() {
    let plate = || SceneText::plate(0.3, 0.3, 0.3);
    let clamped = [35.98519112, 73.39384552, 73.39384552, 108.21650169, 131.58077261, 132.2047902];
    check_plate("clamped", &plate().all_edges("clamped"), 0, &clamped, 2e-9);
    let free = [13.46819735, 19.59613736, 24.27020089, 34.80089101, 34.80089101, 61.09323403, 61.09323403];
    check_plate("free", &plate(), 3, &free, 2e-9);
    let cantilever = [3.471005, 8.506238, 21.283988, 27.198713, 30.954399];
    check_plate("cantilever", &plate().edge("left", "clamped"), 0, &cantilever, 1e-5);
    let pinned = || plate().edge("left", "pinned").edge("right", "pinned");
    check_plate("SFSF", &pinned(), 0, &[9.63138487, 16.13477702], 2e-9);
    check_plate(
        "SCSC",
        &pinned().edge("top", "clamped").edge("bottom", "clamped"),
        0,
        &[28.95085037, 54.74307075],
        2e-9,
    );
    check_plate(
        "SCSS",
        &pinned().edge("top", "clamped").edge("bottom", "pinned"),
        0,
        &[23.64631954, 51.67427457],
        2e-9,
    );
}

#[test]
fn rectangular_and_very_long_free_plates() {
    let expected = [21.45394343, 32.98900231, 59.62873002, 70.80315655];
    check_plate("free 2.5", &SceneText::plate(0.5, 0.2, 0.3), 3, &expected, 2e-9);
    check_plate("strip 100", &SceneText::plate(2.0, 0.02, 0.33), 3, &[21.120132, 58.219796, 114.13818], 5e-8);
}

#[test]
fn plates_on_point_springs() {
    let plate = || SceneText::plate(0.3, 0.3, 0.3);
    let k0 = plate().rigidity() / 0.09;
    let supported = [7.110883662, 15.77024003, 15.77024003, 19.59613736, 38.43154033];
    for stiffness in [1e14, 1e18] {
        check_plate("corner supports", &plate().corner_springs(stiffness), 0, &supported, 2e-9);
    }
    check_plate("corners 1", &plate().corner_springs(k0), 0, &[1.929823781, 3.394616509, 3.394616509], 2e-9);
    check_plate("corners 100", &plate().corner_springs(100.0 * k0), 0, &[6.723500649, 14.51720474, 14.51720474], 2e-9);
    check_plate("corners 1e4", &plate().corner_springs(1e4 * k0), 0, &[7.10670558], 2e-9);
    let pinned = || plate().all_edges("pinned");
    check_plate("centre spring", &pinned().spring(0.5, 0.5, 100.0 * k0), 0, &[27.208098121], 1e-9);
    // The second mode of the pinned plate, 5 pi^2, has its node line there and comes first.
    let pi2 = std::f64::consts::PI.powi(2);
    check_plate("centre support", &pinned().spring(0.5, 0.5, 1e16), 0, &[5.0 * pi2, 5.0 * pi2, 52.618507381], 1e-9);
    let mass = 0.1 * plate().surface_mass();
    let sprung = pinned().era("inertial", 0.5, 0.5, mass, 100.0 * k0, 0.0);
    check_plate("sprung mass", &sprung, 0, &[15.811037734, 36.874487505], 1e-9);
}

/// Pinned square plate under a centre load: w = 0.011600839772 P a^2 / D, from the response far below the first mode.
#[test]
fn static_deflection_under_a_point_load() {
    let scene = SceneText::plate(0.3, 0.3, 0.3).all_edges("pinned").force(0.5, 0.5);
    let reduced = PanelModel::build(&scene.scene(), Accuracy::BALANCED, 400.0)
        .unwrap()
        .reduce_with_residual_shapes_of_actuators_damping_and_points(400.0, &[])
        .unwrap();
    let hz = 0.01;
    let q = response::solve_coordinates_per_newton_at_frequency(&reduced, hz).unwrap();
    let w = response::multiply_shape_with_coordinates(&reduced.shape_deflections_at(0.15, 0.15), &q[0]).re;
    let expected = 0.011600839772 * 0.09 / scene.rigidity();
    assert!((w / expected - 1.0).abs() < 1e-5, "{w} for {expected}");
}

/// The example scenes, on their ERAs.
#[test]
fn example_scenes() {
    for (text, expected) in [
        (era_model::scene::EXAMPLE_BAR, &[67.8, 86.1, 147.4, 444.6][..]),
        (era_model::scene::STARTING_PLATE, &[35.0, 40.96, 47.37, 123.8, 125.9, 259.8]),
    ] {
        let scene = era_model::scene::Scene::parse("example", text).unwrap();
        let modes = PanelModel::build(&scene, Accuracy::BALANCED, 450.0)
            .unwrap()
            .compute_mode_frequencies_and_poles(450.0)
            .unwrap();
        for (mode, expected) in modes.iter().zip(expected) {
            assert!((mode.frequency_hz / expected - 1.0).abs() < 1e-3, "{} Hz for {expected} Hz", mode.frequency_hz);
            assert!(mode.damping_ratio > 0.0 && mode.damping_ratio < 0.1);
        }
    }
}

/// Spaces of rising order contain each other: frequencies fall.
#[test]
fn frequencies_converge_from_above() {
    let scene = SceneText::plate(0.3, 0.2, 0.33).mass(0.4, 0.3, 0.05).scene();
    let of = |accuracy| -> Vec<f64> {
        let model = PanelModel::build(&scene, accuracy, 900.0).unwrap();
        model
            .compute_mode_frequencies_and_poles(900.0)
            .unwrap()
            .iter()
            .map(|mode| mode.frequency_hz)
            .filter(|hz| *hz > 0.0)
            .collect()
    };
    let (balanced, fine, reference) =
        (of(Accuracy::BALANCED), of(Accuracy::from_tolerance(1e-4).unwrap()), of(Accuracy::REFERENCE));
    for ((balanced, fine), reference) in balanced.iter().zip(&fine).zip(&reference).take(9) {
        assert!(balanced > fine && fine > reference, "{balanced} {fine} {reference}");
    }
}
