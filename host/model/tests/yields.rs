//! How far surfaces yield to a steady force, against closed formulas that share nothing with the model: Navier's series for a plate with pinned
//! edges (Timoshenko and Woinowsky-Krieger 1959, section 34), beams, bodies on springs.

use era_model::model::{Accuracy, BarePanel};
use era_model::scene::{EXAMPLE_BAR, Edge, EdgeKind, Mount, STARTING_PLATE, Scene, Side, Support};
use std::f64::consts::PI;

const MAX_HZ: f64 = 400.0;

/// The example with nothing attached, of these sides in m.
fn bare(text: &str, length_m: f64, width_m: f64) -> Scene {
    let mut scene = Scene::parse("scene", text).unwrap();
    (scene.surface.length_m, scene.surface.width_m) = (length_m, width_m);
    scene.supports.clear();
    scene.masses.clear();
    scene.actuators.clear();
    scene.edges.clear();
    scene
}

fn support(x_m: f64, y_m: f64, stiffness_n_per_m: f64) -> Support {
    Support {
        x_m,
        y_m,
        stiffness_n_per_m,
        damping_n_s_per_m: 0.0,
        rotational_stiffness_n_m_per_rad: 0.0,
        loss_factor: 0.0,
    }
}

/// Yield and its bound at places.
fn yields(scene: &Scene, accuracy: Accuracy, places_m: &[(f64, f64)]) -> Vec<(f64, f64)> {
    let panel = BarePanel::build(scene, accuracy, MAX_HZ).unwrap();
    let one = |(x, y): &(f64, f64)| {
        let found = panel.compute_static_compliance_at_grid_points(scene, &[*x], &[*y]).unwrap();
        (found.m_per_n[0], found.error_m_per_n[0])
    };
    places_m.iter().map(one).collect()
}

fn rigidity(scene: &Scene) -> f64 {
    let material = &scene.surface.material;
    material.youngs_modulus_pa * scene.surface.thickness_m.powi(3) / (12.0 * (1.0 - material.poisson_ratio.powi(2)))
}

/// w = 4 F / (pi^4 D a b) * sum of sin^2 sin^2 / (m^2 / a^2 + n^2 / b^2)^2, whose rest falls as the square of the terms along each side.
#[test]
fn a_plate_with_pinned_edges_yields_as_naviers_series_says() {
    let (a, b) = (0.317, 0.211);
    let mut scene = bare(STARTING_PLATE, a, b);
    scene.edges =
        [Side::Left, Side::Right, Side::Top, Side::Bottom].map(|side| Edge { side, kind: EdgeKind::Pinned }).into();
    let places = [(0.5 * a, 0.5 * b), (0.31 * a, 0.44 * b), (0.1 * a, 0.1 * b), (0.77 * a, 0.93 * b)];
    let series = |(x, y): &(f64, f64)| -> f64 {
        let term = |m: i32, n: i32| {
            let (m, n) = (f64::from(m), f64::from(n));
            ((m * PI * x / a).sin() * (n * PI * y / b).sin() / ((m / a).powi(2) + (n / b).powi(2))).powi(2)
        };
        let sum: f64 = (1..=1200).map(|m| (1..=1200).map(|n| term(m, n)).sum::<f64>()).sum();
        4.0 / (PI.powi(4) * rigidity(&scene) * a * b) * sum
    };
    for accuracy in [Accuracy::FAST, Accuracy::BALANCED] {
        let all = yields(&scene, accuracy, &places);
        let most = all.iter().map(|(found, _)| *found).fold(0.0, f64::max);
        for ((found, error), place) in all.into_iter().zip(&places) {
            let expected = series(place);
            println!(
                "{place:?}: {found:.6e} for {expected:.6e}, {:.1e} off, bound {:.1e}",
                found / expected - 1.0,
                error / found
            );
            assert!(
                (found - expected).abs() < error + 1e-6 * expected,
                "{place:?}: {found} +- {error} is not {expected}"
            );
            assert!(error < 0.01 * most, "a bound that says nothing: {error} of {most}");
        }
    }
    // In the middle of a square alpha is 0.01160 (ibid., table 23, to four digits).
    let mut square = bare(STARTING_PLATE, 0.233, 0.233);
    square.edges = scene.edges;
    let (found, _) = yields(&square, Accuracy::BALANCED, &[(0.1165, 0.1165)])[0];
    let alpha = found * rigidity(&square) / 0.233_f64.powi(2);
    assert!((alpha - 0.01160).abs() < 1e-5, "{alpha}");
}

/// A bar on two springs, pressed between them: it bends by a^2 b^2 / (3 E I L), and sinks with its springs.
#[test]
fn a_bar_on_two_springs_bends_and_sinks() {
    let (length, k) = (0.413, [5_200.0, 880.0]);
    let mut scene = bare(EXAMPLE_BAR, length, 0.037);
    scene.supports = vec![support(0.0, 0.0185, k[0]), support(length, 0.0185, k[1])];
    let bending = scene.surface.material.youngs_modulus_pa * 0.037 * scene.surface.thickness_m.powi(3) / 12.0;
    for part in [0.0, 0.1, 1.0 / 3.0, 0.5, 0.873, 1.0] {
        let (a, b) = (part * length, (1.0 - part) * length);
        let expected = (a * b).powi(2) / (3.0 * bending * length) + (1.0 - part).powi(2) / k[0] + part.powi(2) / k[1];
        let (found, error) = yields(&scene, Accuracy::FAST, &[(a, 0.0185)])[0];
        assert!((found - expected).abs() < error + 1e-6 * expected, "{part}: {found} +- {error} is not {expected}");
    }
}

/// A plate a hundred times as stiff as its springs sinks and tilts on them: 1 / (sum of k) and, for either way to tilt, (distance from the
/// middle)^2 / (sum of k distance^2).
#[test]
fn a_stiff_plate_sinks_and_tilts_on_its_springs() {
    let (a, b, k) = (0.271, 0.193, 3.0);
    let mut scene = bare(STARTING_PLATE, a, b);
    scene.supports = [(0.0, 0.0), (a, 0.0), (0.0, b), (a, b)].map(|(x, y)| support(x, y, k)).into();
    for (u, v) in [(0.0, 0.0), (0.5, 0.5), (0.2, 0.9)] {
        let expected = (1.0 + (2.0 * u - 1.0_f64).powi(2) + (2.0 * v - 1.0_f64).powi(2)) / (4.0 * k);
        let (found, _) = yields(&scene, Accuracy::FAST, &[(u * a, v * b)])[0];
        assert!((found / expected - 1.0).abs() < 1e-3, "{u} {v}: {found} is not {expected}");
    }
}

/// What hangs on the panel and what damps it has no part in it, to the last bit; a spring more never lets it yield more; a spring so stiff that it
/// is a rigid support is no trouble.
#[test]
fn only_springs_to_the_ground_hold_a_panel() {
    let scene = Scene::parse("plate", STARTING_PLATE).unwrap();
    let (x, y) = ([0.0, 0.041, 0.15, 0.3], [0.0, 0.07, 0.13, 0.2]);
    let of = |scene: &Scene| {
        BarePanel::build(scene, Accuracy::FAST, MAX_HZ)
            .unwrap()
            .compute_static_compliance_at_grid_points(scene, &x, &y)
            .unwrap()
            .m_per_n
    };
    let before = of(&scene);
    let mut heavy = scene.clone();
    heavy.supports.iter_mut().for_each(|own| own.damping_n_s_per_m *= 7.0);
    heavy.actuators.iter_mut().for_each(|own| (own.moving_mass_kg, own.housing_mass_kg) = (0.4, 0.2));
    assert_eq!(of(&heavy), before);
    let mut inertial = scene.clone();
    inertial.actuators.iter_mut().for_each(|own| own.mount = Mount::Inertial);
    let mut without = scene.clone();
    without.actuators.clear();
    assert_eq!(of(&inertial), of(&without));
    for stiffness in [1.0, 1e3, 1e6, 1e12, 1e18] {
        let mut held = scene.clone();
        held.supports.push(support(0.041, 0.07, stiffness));
        for (k, (after, before)) in of(&held).into_iter().zip(&before).enumerate() {
            assert!(after > -1e-9 && after <= before * (1.0 + 1e-9), "{stiffness} N/m, point {k}: {after} of {before}");
        }
    }
}

/// Held by one support a panel turns about it, and by two about the line between them: it yields without end. Three hold it.
#[test]
fn what_nothing_holds_yields_without_end() {
    let (a, b) = (0.271, 0.193);
    let corners = [(0.01, 0.02), (0.26, 0.03), (0.14, 0.18)];
    for stiffness in [30.0, 8e3, 1e15] {
        for count in 0..=3 {
            let mut scene = bare(STARTING_PLATE, a, b);
            scene.supports = corners[..count].iter().map(|(x, y)| support(*x, *y, stiffness)).collect();
            let (found, _) = yields(&scene, Accuracy::FAST, &[(0.2, 0.05)])[0];
            assert_eq!(found.is_finite(), count == 3, "{count} of {stiffness} N/m: {found}");
        }
    }
}
