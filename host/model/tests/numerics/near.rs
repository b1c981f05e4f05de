//! Attachments that are next to each other: 1 nm to 1 mm. What they are together is known in closed form, to their distance over a wave.

use era_model::model::{Accuracy, compute_modes_with_error_bounds};
use era_model::response::compute_acceleration_curves_per_newton_with_error_bounds;
use era_model::scene::Scene;
use num_complex::Complex64;

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
    let found = compute_modes_with_error_bounds(scene, Accuracy::BALANCED, MAX_HZ).unwrap();
    found
        .answer
        .iter()
        .zip(&found.bounds)
        .map(|(mode, bound)| (mode.frequency_hz, bound.limit_if_known().unwrap_or(f64::INFINITY)))
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
        // Clamped-free, of 0.1 m and of what is left of 0.2 m: beta L = 1.8751, 4.6941. The stretch between bends, and the springs give way by M /
        // (k d) each: the slope is d / 3 EI + 2 / (k d^2) of the moment, as that of a bar which is clamped so much times EI farther away.
        let rigidity = material.youngs_modulus_pa * own.surface.width_m * own.surface.thickness_m.powi(3) / 12.0;
        let farther_m = apart_m / 3.0 + 2.0 * rigidity / (stiffness * apart_m.powi(2));
        let of =
            |beta_l: f64, length: f64| beta_l.powi(2) / (length + farther_m).powi(2) * wave / std::f64::consts::TAU;
        let mut expected =
            vec![of(1.875_104_069, 0.2 - apart_m), of(1.875_104_069, 0.1), of(4.694_091_133, 0.2 - apart_m)];
        expected.sort_by(f64::total_cmp);
        for ((hz, bound), expected) in modes(&own).into_iter().zip(expected) {
            let off = (hz / expected - 1.0).abs();
            println!("{apart_m} m: {hz} Hz for {expected}, {off:.1e} of {bound:.1e}");
            // What is left out above goes with the square of the distance over a tenth of the length.
            let next = (apart_m / 0.01).powi(2);
            assert!(
                off <= bound + next + 1e-9 && bound < 1e-7,
                "{apart_m} m: {hz} Hz for {expected}, {off:e} of {bound:e}"
            );
        }
    }
}

/// A bar that is held on the left, free on the right, with a support in between and something at `place_m` from the held end.
fn held_bar(end: &str, what: &str, place_m: f64) -> Scene {
    let text = format!(
        "version = 1\nname = \"held\"\n[surface]\nkind = \"bar\"\nlength_mm = 300.0\nwidth_mm = 30.0\nthickness_mm = 2.0\n\
         [surface.material]\nyoungs_modulus_pa = 70e9\npoisson_ratio = 0.33\ndensity_kg_m3 = 2700.0\n[surface.damping]\nloss_factor = 0.02\n\
         [[edge]]\nside = \"left\"\nkind = \"{end}\"\n[[support]]\nx_mm = 200.0\nstiffness_n_per_m = 20000.0\n{what}x_mm = {:?}\n",
        place_m * 1e3
    );
    Scene::parse("held", &text).unwrap()
}

/// Before, the cell between an end and what is next to it left a bound of 27.
#[test]
fn what_is_next_to_a_held_end_has_a_bound_that_holds_and_says_something() {
    let spring = |stiffness: f64| format!("[[support]]\nstiffness_n_per_m = {stiffness:e}\n");
    for apart_m in [1e-9, 2.9e-7, 3.1e-7, 1e-6, 1e-5, 4e-5] {
        for (end, stiffness) in [("pinned", 2e4), ("clamped", 2e4), ("pinned", 1e20), ("clamped", 1e20)] {
            // Soft ones do nothing next to an end. Firm ones clamp a pinned end once they are far enough from it to hold its slope, and make a
            // clamped bar shorter, by their distance or less.
            let is_firm = stiffness > 1e6;
            if is_firm && apart_m < 1e-6 {
                continue;
            }
            let wanted = modes(&held_bar(if is_firm { "clamped" } else { end }, &spring(1.0), 0.0));
            let found = modes(&held_bar(end, &spring(stiffness), apart_m));
            assert_eq!(found.len(), wanted.len());
            for ((hz, bound), (wanted, own)) in found.into_iter().zip(wanted) {
                let off = (hz / wanted - 1.0).abs();
                // Of a firm one: all of its distance over a quarter wave (0.1 m), four times for the two squares. Of a soft one the energy that it
                // takes, k d^2 over E I / 0.1 m = 14 N m.
                let moved = if is_firm { 40.0 * apart_m } else { 2e4 * apart_m * apart_m / 14.0 };
                assert!(
                    off <= bound + own + moved + 1e-9 && bound < 1e-2,
                    "{end} {stiffness:e} {apart_m}: {hz} for {wanted}, {off:e} of {bound:e} and {moved:e}"
                );
            }
        }
    }
}

/// Next to a pinned end a panel moves with the distance from it, next to a clamped one with its square: so does what a force there does elsewhere.
#[test]
fn a_force_next_to_a_held_end_does_what_its_distance_says() {
    let era = "[[actuator]]\nid = \"a\"\nmount = \"grounded\"\nmoving_mass_g = 1.0\nstiffness_n_per_m = 900.0\ndamping_n_s_per_m = 0.1\n\
               electrode_area_mm2 = 900.0\nair_gap_um = 300.0\nmax_voltage_v = 1000.0\n";
    let frequencies = [60.0, 150.0, 390.0];
    for (end, power) in [("pinned", 1), ("clamped", 2)] {
        let of = |place_m: f64| {
            let scene = held_bar(end, era, place_m);
            let found = compute_acceleration_curves_per_newton_with_error_bounds(
                &scene,
                Accuracy::BALANCED,
                (0.26, 0.0),
                &frequencies,
            )
            .unwrap();
            (found.answer[0].clone(), found.bounds[0].limit_if_known().unwrap())
        };
        let (known, own) = of(2e-3);
        for apart_m in [1e-6, 1e-5, 4e-5, 1e-4, 1e-3] {
            let (found, bound) = of(apart_m);
            let scale = (apart_m / 2e-3_f64).powi(power);
            let largest = found.iter().map(|value| value.norm()).fold(0.0, f64::max);
            for (found, known) in found.iter().zip(&known) {
                let off = (found - known * scale).norm() / largest;
                // The next terms: the distance of 2 mm over a quarter wave (0.1 m), squared where the end is pinned.
                let next = if power == 1 { 1e-3 } else { 3e-2 };
                println!("{end} {apart_m}: {off:.1e} of {bound:.1e}");
                assert!(off <= bound + own + next && bound < 2e-2, "{end} {apart_m}: {off:e}, bound {bound:e}");
            }
        }
    }
}

/// Deflection, slope, moment and shear force at a place of a bar, or what they are multiplied by over a stretch.
type State = [Complex64; 4];

/// A state after `length_m` of a bar with this bending stiffness and mass per length, at so many radians a second: Krylov's functions.
fn advance_state(state: State, length_m: f64, rigidity: Complex64, mass_per_m: f64, omega: f64) -> State {
    let beta = (mass_per_m * omega * omega / rigidity).powf(0.25);
    let z = beta * length_m;
    // Sums of cosh and cos, sinh and sin, by their series where they would cancel.
    let series = |first: i32| {
        let (mut sum, mut term) = (Complex64::new(0.0, 0.0), Complex64::new(1.0, 0.0));
        for power in 0..80 {
            if power > 0 {
                term *= z / f64::from(power);
            }
            if power % 4 == first {
                sum += term;
            }
        }
        sum
    };
    let k = [series(0), series(1), series(2), series(3)];
    let [w, slope, moment, shear] = state;
    let (b, bend) = (beta, rigidity * beta * beta);
    [
        k[0] * w + k[1] / b * slope + k[2] / bend * moment + k[3] / (bend * b) * shear,
        b * k[3] * w + k[0] * slope + k[1] / (bend / b) * moment + k[2] / bend * shear,
        bend * k[2] * w + bend / b * k[3] * slope + k[0] * moment + k[1] / b * shear,
        bend * b * k[1] * w + bend * k[2] * slope + b * k[3] * moment + k[0] * shear,
    ]
}

/// Acceleration at `at_m` for 1 N at a grounded mass `(place, stiffness, damping, mass)` of a free bar on supports `(place, stiffness)`.
fn find_acceleration(
    (length_m, rigidity, mass_per_m): (f64, Complex64, f64),
    supports: &[(f64, f64)],
    era: (f64, f64, f64, f64),
    at_m: f64,
    hz: f64,
) -> Complex64 {
    let omega = std::f64::consts::TAU * hz;
    let zero = Complex64::new(0.0, 0.0);
    let mut stops: Vec<(f64, Complex64, f64)> =
        supports.iter().map(|(place, stiffness)| (*place, Complex64::new(*stiffness, 0.0), 0.0)).collect();
    stops.push((era.0, Complex64::new(era.1 - omega * omega * era.3, omega * era.2), 1.0));
    stops.push((at_m, zero, 0.0));
    stops.sort_by(|a, b| a.0.total_cmp(&b.0));
    // Free at the left end: its deflection, its slope, and what the force adds.
    let one = Complex64::new(1.0, 0.0);
    let run = |mut state: State, with_force: bool| {
        let (mut here, mut seen) = (0.0, zero);
        for (place, stiffness, force) in &stops {
            state = advance_state(state, place - here, rigidity, mass_per_m, omega);
            here = *place;
            if *place == at_m {
                seen = state[0];
            }
            // EI w'''' = q, so that EI w''' grows by what acts upwards.
            state[3] += if with_force { Complex64::new(*force, 0.0) } else { zero } - stiffness * state[0];
        }
        (advance_state(state, length_m - here, rigidity, mass_per_m, omega), seen)
    };
    let (first, first_seen) = run([one, zero, zero, zero], false);
    let (second, second_seen) = run([zero, one, zero, zero], false);
    let (forced, forced_seen) = run([zero; 4], true);
    // No moment and no shear force at the right end.
    let determinant = first[2] * second[3] - second[2] * first[3];
    let a = -(forced[2] * second[3] - second[2] * forced[3]) / determinant;
    let b = -(first[2] * forced[3] - forced[2] * first[3]) / determinant;
    -omega * omega * (a * first_seen + b * second_seen + forced_seen)
}

/// An ERA beside a firm support moves by the slope there, which is next to nothing: against transfer matrices. Before, the curvature was left
/// out, and all of these responses were off by more than their bounds.
#[test]
fn responses_of_what_is_beside_a_firm_support_have_bounds_that_hold() {
    let material = "youngs_modulus_pa = 69e9\ndensity_kg_m3 = 2700.0";
    let rigidity = Complex64::new(69e9 * 0.02 * 0.002_f64.powi(3) / 12.0, 0.0) * Complex64::new(1.0, 0.02);
    let bar = (0.25, rigidity, 2700.0 * 0.02 * 0.002);
    let frequencies = [40.0, 90.0, 170.0, 280.0, 400.0];
    for apart_m in [1e-6, 5e-6, 2e-5, 5e-5, 1e-4, 3e-4] {
        for stiffness in [1e3, 1e6, 1e8, 1e9] {
            let supports = [(0.02, 2e4), (0.1, stiffness), (0.24, 2e4)];
            let mut text = format!(
                "version = 1\nname = \"firm\"\n[surface]\nkind = \"bar\"\nlength_mm = 250.0\nwidth_mm = 20.0\nthickness_mm = 2.0\n\
                 [surface.material]\n{material}\n[surface.damping]\nloss_factor = 0.02\n\
                 [[actuator]]\nid = \"a\"\nx_mm = {:?}\nmount = \"grounded\"\nmoving_mass_g = 5.0\nstiffness_n_per_m = 1e5\n\
                 damping_n_s_per_m = 30.0\nelectrode_area_mm2 = 1963.5\nair_gap_um = 500.0\nmax_voltage_v = 2000.0\n",
                100.0 + apart_m * 1e3
            );
            for (place, stiffness) in supports {
                text += &format!("[[support]]\nx_mm = {:?}\nstiffness_n_per_m = {stiffness:?}\n", place * 1e3);
            }
            let scene = Scene::parse("firm", &text).unwrap();
            for tolerance in [1e-3, 1e-6] {
                let accuracy = Accuracy::from_tolerance(tolerance).unwrap();
                let found = compute_acceleration_curves_per_newton_with_error_bounds(
                    &scene,
                    accuracy,
                    (0.15, 0.0),
                    &frequencies,
                )
                .unwrap();
                let exact: Vec<Complex64> = frequencies
                    .iter()
                    .map(|hz| find_acceleration(bar, &supports, (0.1 + apart_m, 1e5, 30.0, 5e-3), 0.15, *hz))
                    .collect();
                let largest = exact.iter().map(|value| value.norm()).fold(0.0, f64::max);
                let pairs = found.answer[0].iter().zip(&exact);
                let off = pairs.map(|(found, exact)| (found - exact).norm()).fold(0.0, f64::max) / largest;
                let bound = found.bounds[0].limit_if_known().unwrap();
                // Of the reference the shear force at a firm support is a difference, and the response goes with the distance.
                let rounding = 1e-20 * stiffness / apart_m + 1e-11;
                assert!(
                    off <= bound + rounding && bound <= tolerance,
                    "{apart_m} m, {stiffness:e} N/m, {tolerance:e}: {off:e} of {bound:e} and {rounding:e}"
                );
            }
        }
    }
}
