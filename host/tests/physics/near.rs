//! Attachments that are next to each other: 1 nm to 1 mm. What they are together is known in closed form, to their distance over a wave.

use era::model::{Accuracy, bounded_modes};
use era::scene::Scene;

const MAX_HZ: f64 = 400.0;

#[derive(Clone, Copy, Debug, PartialEq)]
enum What {
    Springs(f64),
    Masses,
    Grounded,
    Inertial,
}

/// A bar or plate on three soft springs with two equal things `apart_m` from each other in the middle of its left half.
fn scene(is_bar: bool, what: What, apart_m: f64) -> Scene {
    let (kind, width, y) = if is_bar { ("bar", 30.0, "") } else { ("plate", 200.0, "y_mm = 70.0\n") };
    let mut text = format!(
        "version = 1\nname = \"near\"\n[surface]\nkind = \"{kind}\"\nlength_mm = 300.0\nwidth_mm = {width}\nthickness_mm = 2.0\n\
         [surface.material]\nyoungs_modulus_pa = 70e9\npoisson_ratio = 0.33\ndensity_kg_m3 = 2700.0\n"
    );
    for (x, other_y) in [(250.0, 70.0), (20.0, 20.0), (40.0, 180.0)] {
        let y = if is_bar { String::new() } else { format!("y_mm = {other_y}\n") };
        text += &format!("[[support]]\nx_mm = {x}\n{y}stiffness_n_per_m = 20000.0\n");
    }
    for (k, x) in [100.0, 100.0 + apart_m * 1e3].into_iter().enumerate() {
        let era = |mount: &str| {
            format!(
                "[[actuator]]\nid = \"{k}\"\nx_mm = {x:?}\n{y}mount = \"{mount}\"\nmoving_mass_g = 10.0\nhousing_mass_g = 8.0\n\
                 stiffness_n_per_m = 9000.0\ndamping_n_s_per_m = 1.0\nelectrode_area_mm2 = 900.0\nair_gap_um = 300.0\nmax_voltage_v = 1000.0\n"
            )
        };
        text += &match what {
            What::Springs(stiffness) => format!("[[support]]\nx_mm = {x:?}\n{y}stiffness_n_per_m = {stiffness:e}\n"),
            What::Masses => format!("[[mass]]\nx_mm = {x:?}\n{y}mass_g = 80.0\n"),
            What::Grounded => era("grounded"),
            What::Inertial => era("inertial"),
        };
    }
    Scene::parse("near", &text).unwrap()
}

fn modes(scene: &Scene) -> Vec<(f64, f64)> {
    let found = bounded_modes(scene, Accuracy::BALANCED, MAX_HZ).unwrap();
    found
        .answer
        .iter()
        .zip(&found.bounds)
        .map(|(mode, bound)| (mode.frequency_hz, bound.value().unwrap_or(f64::INFINITY)))
        .collect()
}

/// Frequencies are smooth in the distance, so that what they are next to each other follows from 1 and 2 mm apart, and from nothing apart: a
/// parabola through the three is right to the cube of 1 mm over a wave's length. Before, bars' cells as thin as the distance left rounding of up to a third of a
/// frequency, with bounds of up to 9e4.
#[test]
fn what_is_next_to_each_other_has_a_bound_that_holds_and_says_something() {
    for is_bar in [true, false] {
        for what in [What::Springs(2e4), What::Masses, What::Grounded, What::Inertial] {
            let [zero, one, two] = [0.0, 1e-3, 2e-3].map(|apart| modes(&scene(is_bar, what, apart)));
            for apart_m in [1e-9, 1e-8, 1e-7, 2.9e-7, 3.1e-7, 1e-6, 1e-5, 4e-5, 1e-4, 3e-4] {
                let found = modes(&scene(is_bar, what, apart_m));
                assert_eq!(found.len(), zero.len(), "{is_bar} {what:?} {apart_m}");
                for (k, (hz, bound)) in found.iter().enumerate() {
                    let t = apart_m / 1e-3;
                    let (a, b, c) = (zero[k].0, one[k].0, two[k].0);
                    let expected = a + t * (2.0 * b - 1.5 * a - 0.5 * c) + t * t * (0.5 * a - b + 0.5 * c);
                    let own = zero[k].1 + one[k].1 + two[k].1 + 1e-2 * t * (b / a - 1.0).abs().max(1e-3);
                    let off = (hz / expected - 1.0).abs();
                    assert!(
                        off <= bound + own,
                        "{is_bar} {what:?} {apart_m} m, mode {k}: {hz} for {expected}, {off:e} of {bound:e} and {own:e}"
                    );
                    assert!(*bound < 1e-3, "{is_bar} {what:?} {apart_m} m, mode {k}: {bound:e}");
                }
            }
        }
    }
}

/// Two rigid supports next to each other clamp a bar: f L^2 of what is on either side, clamped there and free at the other end.
#[test]
fn rigid_supports_next_to_each_other_clamp_a_bar() {
    for (apart_m, stiffness) in [(1e-6, 1e20), (1e-5, 1e18), (4e-5, 1e17)] {
        let mut own = scene(true, What::Springs(stiffness), apart_m);
        own.supports.drain(..3);
        let material = &own.surface.material;
        let wave =
            (material.youngs_modulus_pa * own.surface.thickness_m.powi(2) / (12.0 * material.density_kg_m3)).sqrt();
        // Clamped-free, of 0.1 m and of what is left of 0.2 m: beta L = 1.8751, 4.6941.
        let of = |beta_l: f64, length: f64| beta_l.powi(2) / length.powi(2) * wave / std::f64::consts::TAU;
        let mut expected =
            vec![of(1.875_104_069, 0.2 - apart_m), of(1.875_104_069, 0.1), of(4.694_091_133, 0.2 - apart_m)];
        expected.sort_by(f64::total_cmp);
        for ((hz, bound), expected) in modes(&own).into_iter().zip(expected) {
            let off = (hz / expected - 1.0).abs();
            println!("{apart_m} m: {hz} Hz for {expected}, {off:.1e} of {bound:.1e}");
            assert!(off <= bound + 1e-8 && bound < 3e-3, "{apart_m} m: {hz} Hz for {expected}, {off:e} of {bound:e}");
        }
    }
}
