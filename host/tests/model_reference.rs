//! Frequencies against closed equations and converged references: beams by their frequency equations, plates by
//! Navier, Levy and Legendre-Ritz.

mod support;

use era::model::{Accuracy, PanelModel};
use era::response;
use support::scenes::SceneText;

/// The lowest frequencies above zero, and how many zeros come before them.
fn frequencies(scene: &SceneText, accuracy: Accuracy, max_hz: f64) -> (usize, Vec<f64>) {
    let modes = PanelModel::build(&scene.scene(), accuracy, max_hz).unwrap().modes(max_hz).unwrap();
    assert!(modes.windows(2).all(|pair| pair[0].frequency_hz <= pair[1].frequency_hz), "ascending");
    let zeros = modes.iter().filter(|mode| mode.frequency_hz == 0.0).count();
    (zeros, modes.into_iter().map(|mode| mode.frequency_hz).filter(|hz| *hz > 0.0).collect())
}

/// The scene has `zeros` rigid motions and then exactly the frequencies `expected`, to `tolerance`.
fn check(name: &str, scene: &SceneText, zeros: usize, expected: &[f64], accuracy: Accuracy, tolerance: f64) {
    let highest = expected.iter().copied().fold(0.0, f64::max);
    let (found_zeros, found) = frequencies(scene, accuracy, highest * 1.001);
    assert_eq!(found_zeros, zeros, "{name}: rigid motions");
    assert!(found.len() >= expected.len(), "{name}: {found:?} for {expected:?}");
    for (found, expected) in found.iter().zip(expected) {
        let error = found / expected - 1.0;
        assert!(error.abs() < tolerance, "{name}: {found} Hz for {expected} Hz, off by {error:e}");
    }
}

/// To 0.1 % at balanced, to 5e-6 at reference.
fn check_bar(name: &str, scene: &SceneText, zeros: usize, beta_l: &[f64]) {
    let expected: Vec<f64> = beta_l.iter().map(|beta_l| scene.bar_hz(*beta_l)).collect();
    check(name, scene, zeros, &expected, Accuracy::FAST, 1e-3);
    check(name, scene, zeros, &expected, Accuracy::BALANCED, 2e-5);
    check(name, scene, zeros, &expected, Accuracy::REFERENCE, 2e-6);
}

fn check_plate(name: &str, scene: &SceneText, zeros: usize, lambda: &[f64], tolerance: f64) {
    let expected: Vec<f64> = lambda.iter().map(|lambda| scene.plate_hz(*lambda)).collect();
    check(name, scene, zeros, &expected, Accuracy::BALANCED, tolerance);
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
        let scene = era::scene::Scene::parse("elastic ends", &text).unwrap();
        let modes = PanelModel::build(&scene, Accuracy::BALANCED, 500.0).unwrap().modes(500.0).unwrap();
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
        check_plate("pinned", &scene, 0, &lambda[..6], 2e-5);
    }
}

#[test]
fn square_plates() {
    let plate = || SceneText::plate(0.3, 0.3, 0.3);
    let clamped = [35.98519112, 73.39384552, 73.39384552, 108.21650169, 131.58077261, 132.2047902];
    check_plate("clamped", &plate().all_edges("clamped"), 0, &clamped, 1e-4);
    let free = [13.46819735, 19.59613736, 24.27020089, 34.80089101, 34.80089101, 61.09323403, 61.09323403];
    check_plate("free", &plate(), 3, &free, 1e-4);
    let cantilever = [3.471005, 8.506238, 21.283988, 27.198713, 30.954399];
    check_plate("cantilever", &plate().edge("left", "clamped"), 0, &cantilever, 2e-4);
    let pinned = || plate().edge("left", "pinned").edge("right", "pinned");
    check_plate("SFSF", &pinned(), 0, &[9.63138487, 16.13477702], 1e-4);
    check_plate(
        "SCSC",
        &pinned().edge("top", "clamped").edge("bottom", "clamped"),
        0,
        &[28.95085037, 54.74307075],
        1e-4,
    );
    check_plate(
        "SCSS",
        &pinned().edge("top", "clamped").edge("bottom", "pinned"),
        0,
        &[23.64631954, 51.67427457],
        1e-4,
    );
}

#[test]
fn rectangular_and_very_long_free_plates() {
    let expected = [21.45394343, 32.98900231, 59.62873002, 70.80315655];
    check_plate("free 2.5", &SceneText::plate(0.5, 0.2, 0.3), 3, &expected, 1e-4);
    check_plate("strip 100", &SceneText::plate(2.0, 0.02, 0.33), 3, &[21.120132, 58.219796, 114.13818], 1e-3);
}

#[test]
fn plates_on_point_springs() {
    let plate = || SceneText::plate(0.3, 0.3, 0.3);
    let k0 = plate().rigidity() / 0.09;
    let supported = [7.110883662, 15.77024003, 15.77024003, 19.59613736, 38.43154033];
    for stiffness in [1e14, 1e18] {
        check_plate("corner supports", &plate().corner_springs(stiffness), 0, &supported, 2e-4);
    }
    check_plate("corners 1", &plate().corner_springs(k0), 0, &[1.929823781, 3.394616509, 3.394616509], 1e-5);
    check_plate("corners 100", &plate().corner_springs(100.0 * k0), 0, &[6.723500649, 14.51720474, 14.51720474], 1e-4);
    check_plate("corners 1e4", &plate().corner_springs(1e4 * k0), 0, &[7.10670558], 1e-4);
    let pinned = || plate().all_edges("pinned");
    check_plate("centre spring", &pinned().spring(0.5, 0.5, 100.0 * k0), 0, &[27.208098121], 5e-4);
    // The second mode of the pinned plate, 5 pi^2, has its node line there and comes first.
    let pi2 = std::f64::consts::PI.powi(2);
    check_plate("centre support", &pinned().spring(0.5, 0.5, 1e16), 0, &[5.0 * pi2, 5.0 * pi2, 52.618507381], 1e-3);
    let mass = 0.1 * plate().surface_mass();
    let sprung = pinned().era("inertial", 0.5, 0.5, mass, 100.0 * k0, 0.0);
    check_plate("sprung mass", &sprung, 0, &[15.811037734, 36.874487505], 5e-4);
}

/// Pinned square plate under a centre load: w = 0.011600839772 P a^2 / D, from the response far below the first mode.
#[test]
fn static_deflection_under_a_point_load() {
    let scene = SceneText::plate(0.3, 0.3, 0.3).all_edges("pinned").force(0.5, 0.5);
    let reduced = PanelModel::build(&scene.scene(), Accuracy::BALANCED, 400.0).unwrap().reduce(400.0, &[]).unwrap();
    let hz = 0.01;
    let q = response::modal_coordinates(&reduced, hz).unwrap();
    let w = response::dot(&reduced.shape_at(0.15, 0.15), &q[0]).re;
    let expected = 0.011600839772 * 0.09 / scene.rigidity();
    assert!((w / expected - 1.0).abs() < 2e-3, "{w} for {expected}");
}

/// The example scenes, on their ERAs.
#[test]
fn example_scenes() {
    for (text, expected) in [
        (era::scene::EXAMPLE_BAR, &[67.8, 86.1, 147.4, 444.6][..]),
        (era::scene::EXAMPLE_PLATE, &[35.0, 40.96, 47.37, 123.8, 125.9, 259.8]),
    ] {
        let scene = era::scene::Scene::parse("example", text).unwrap();
        let modes = PanelModel::build(&scene, Accuracy::BALANCED, 450.0).unwrap().modes(450.0).unwrap();
        for (mode, expected) in modes.iter().zip(expected) {
            assert!((mode.frequency_hz / expected - 1.0).abs() < 1e-3, "{} Hz for {expected} Hz", mode.frequency_hz);
            assert!(mode.damping_ratio > 0.0 && mode.damping_ratio < 0.1);
        }
    }
}

/// The error of conforming cubic elements falls as h^4, from above.
#[test]
fn frequencies_converge_from_above() {
    let scene = SceneText::plate(0.3, 0.2, 0.33);
    let of = |accuracy| frequencies(&scene, accuracy, 900.0).1;
    let (fast, balanced, reference) = (of(Accuracy::FAST), of(Accuracy::BALANCED), of(Accuracy::REFERENCE));
    for ((fast, balanced), reference) in fast.iter().zip(&balanced).zip(&reference).take(9) {
        assert!(fast > balanced && balanced > reference, "{fast} {balanced} {reference}");
        // Halving h twice: (24^-4 - 96^-4) / (48^-4 - 96^-4) = 17, against 5 for second order.
        let ratio = (fast - reference) / (balanced - reference);
        assert!(ratio > 10.0, "{ratio}");
    }
}
