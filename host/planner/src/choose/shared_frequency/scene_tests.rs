//! On panels: random scenes with two and three actuators, against exhaustive search.

use super::tests::{Owned, Random, check_phasors_and_get_cancellation_ratio, find_least_energy_and_peak_exhaustively};
use super::{ZERO, find_least_energy_or_largest_peak_phasors};
use crate::model::{Accuracy, PanelModel, ReducedModel};
use crate::response::solve_coordinates_per_newton_at_frequency;
use crate::scene::Scene;
use nalgebra::DVector;
use num_complex::Complex64;
use std::fmt::Write;

/// Points that stand for elsewhere.
const POINTS: usize = 40;
const GAP_M: f64 = 500e-6;

/// A plate or bar of aluminium with actuators anywhere on it.
fn make_random_scene(random: &mut Random, actuators: usize) -> Scene {
    let (kind, width) =
        if random.draw_fraction() < 0.5 { ("bar", 20.0) } else { ("plate", random.draw_between(100.0, 220.0)) };
    let length = random.draw_between(200.0, 400.0);
    let mut text = format!(
        "version = 1\nname = \"test\"\n[surface]\nkind = \"{kind}\"\nlength_mm = {length}\nwidth_mm = {width}\n\
         thickness_mm = 2\n[surface.material]\nyoungs_modulus_pa = 70e9\npoisson_ratio = 0.3\ndensity_kg_m3 = 2700\n\
         [surface.damping]\nloss_factor = 0.02\n[screen]\nwidth_px = 1920\nheight_px = 1280\n"
    );
    for i in 0..actuators {
        let (x, y) = (random.draw_between(0.02, 0.98) * length, random.draw_between(0.05, 0.95) * width);
        let _ = write!(
            text,
            "[[actuator]]\nid = \"a{i}\"\nx_mm = {x}\ny_mm = {y}\nmount = \"inertial\"\nmoving_mass_g = 10\nstiffness_n_per_m = {}\n\
             damping_n_s_per_m = 0.7\nelectrode_area_mm2 = 1963.5\nair_gap_um = 500\nmax_voltage_v = 2000\n",
            random.draw_between(2000.0, 9000.0)
        );
    }
    Scene::parse("test scene", &text).unwrap()
}

/// The field of a random touch on the scene.
#[expect(clippy::cast_precision_loss, reason = "small counts")]
fn make_random_touch_field(scene: &Scene, random: &mut Random, count: usize, most_force_n: f64) -> Owned {
    let model: ReducedModel = PanelModel::build(scene, Accuracy::FAST, 400.0)
        .unwrap()
        .reduce_with_residual_shapes_of_actuators_damping_and_points(400.0, &[])
        .unwrap();
    let mut place = || {
        let (x, y) = (random.draw_fraction() * scene.surface.length_m, random.draw_fraction() * scene.surface.width_m);
        model.shape_deflections_at(x, y)
    };
    let target = place();
    let points: Vec<DVector<f64>> = (0..POINTS).map(|_| place()).collect();
    let at = |shape: &DVector<f64>, q: &DVector<Complex64>| -> Complex64 {
        shape.iter().zip(q.iter()).map(|(shape, q)| q * *shape).sum()
    };
    let actuators = scene.actuators.len();
    let mut owned = Owned::new(actuators, count, GAP_M / 3.0);
    for k in 0..count {
        let frequency_hz = 40.0 + 360.0 * k as f64 / count as f64;
        owned.frequencies_hz.push(frequency_hz);
        let q = solve_coordinates_per_newton_at_frequency(&model, frequency_hz).unwrap();
        let factor = -(std::f64::consts::TAU * frequency_hz).powi(2);
        let elsewhere: Vec<Vec<Complex64>> =
            q.iter().map(|q| points.iter().map(|point| at(point, q) * factor).collect()).collect();
        for i in 0..actuators {
            owned.gain[k][i] = at(&target, &q[i]) * factor;
            for j in 0..actuators {
                let products = elsewhere[i].iter().zip(&elsewhere[j]).map(|(a, b)| a.conj() * b);
                owned.energy[k][i][j] = products.sum::<Complex64>() / POINTS as f64;
                owned.travel[k][i][j] = model.actuator_mass_travel_against_electrodes(i, &q[j]);
            }
            owned.max_force_n[k][i] = (owned.max_travel_m[i] / owned.travel[k][i][i].norm()).min(most_force_n);
        }
        assert!(owned.travel[k][0][0] != ZERO);
    }
    owned
}

#[test]
fn equals_exhaustive_search_on_random_scenes() {
    let random = &mut Random(5);
    let (mut free, mut limited) = (0, 0);
    for (actuators, count, scenes) in [(2, 24, 8), (3, 24, 8)] {
        for _ in 0..scenes {
            let scene = make_random_scene(random, actuators);
            // At 0.02 N voltage limits, at 0.2 N travel near the resonances of the actuators.
            for most_force_n in [0.02, 0.2] {
                let owned = make_random_touch_field(&scene, random, count, most_force_n);
                let field = owned.borrow_target_field();
                let most = find_least_energy_or_largest_peak_phasors(&field, f64::INFINITY).unwrap().reached;
                for part in [0.01, 0.5, 0.9, 2.0] {
                    let found = find_least_energy_or_largest_peak_phasors(&field, part * most).unwrap();
                    let cancelled = check_phasors_and_get_cancellation_ratio(&field, &found);
                    let (energy, peak) = find_least_energy_and_peak_exhaustively(&field, part * most);
                    let tolerance = if part < 1.0 { 1e-9 + 1e-13 * cancelled } else { 1e-5 };
                    assert!((found.reached / peak - 1.0).abs() < 1e-9, "{found:?} {peak}");
                    assert!((found.energy / energy - 1.0).abs() < tolerance, "{found:?} {energy} {cancelled}");
                    assert!(found.proven_gap < if part < 1.0 { 1e-9 } else { 1e-6 }, "{found:?}");
                    if found.solved == 0 { free += 1 } else { limited += 1 }
                }
            }
        }
    }
    assert!(free > 20 && limited > 20, "{free} without and {limited} with limits that bind");
}
