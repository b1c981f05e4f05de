//! Tolerances are met: at any frequency and place of the shipped scenes, and what a tight request meets a loose one meets.

use crate::support;
use era::model::levels::ReducedLevels;
use era::model::{Accuracy, compute_modes_with_error_bounds};
use era::planner::{PlanTable, TableOptions, Target};
use era::response::{
    compute_acceleration_curves_per_newton_with_error_bounds, compute_acceleration_sweep_per_newton_with_error_bounds,
};
use era::scene::{STARTING_PLATE, Scene};
use era::verify::spread_points;
use proptest::prelude::*;
use proptest::test_runner::{Config, TestRng, TestRunner};
use std::path::Path;
use std::time::Duration;
use support::scenes::SceneText;

/// The answers for one place and one frequency, and the largest bound.
fn at_one(scene: &Scene, accuracy: Accuracy, at: (f64, f64), hz: f64) -> (Vec<num_complex::Complex64>, f64) {
    let found = compute_acceleration_curves_per_newton_with_error_bounds(scene, accuracy, at, &[hz]).unwrap();
    let bounds = found.bounds.iter().map(|bound| bound.limit_if_known().unwrap_or(f64::INFINITY));
    (found.answer.iter().map(|curve| curve[0]).collect(), bounds.fold(0.0, f64::max))
}

fn shipped(name: &str) -> Scene {
    Scene::load(&Path::new(env!("CARGO_MANIFEST_DIR")).join("../examples/scenes").join(name)).unwrap()
}

/// Four ERAs on a large sheet of glass.
fn sheet() -> SceneText {
    let mut scene = SceneText::plate(0.7, 0.4, 0.22).corner_springs(2e3).damping("loss_factor", 0.01);
    for (x, y) in [(0.2, 0.25), (0.8, 0.25), (0.2, 0.75), (0.8, 0.75)] {
        scene = scene.era("grounded", x, y, 0.01, 5e3, 1.1);
    }
    scene
}

/// Beside patches two levels may agree at one place, for once, and be wrong: the first two places were found by search, the others
/// are at random. Each frequency alone, so that no other shows what this one hides.
#[test]
fn bounds_hold_where_two_levels_agree_by_chance() {
    let check = |scene: &Scene, at: (f64, f64), hz: f64| -> Result<(), TestCaseError> {
        let (exact, own) = at_one(scene, Accuracy::from_tolerance(1e-5).unwrap(), at, hz);
        for tolerance in [1e-2, 1e-3] {
            let found = compute_acceleration_curves_per_newton_with_error_bounds(
                scene,
                Accuracy::from_tolerance(tolerance).unwrap(),
                at,
                &[hz],
            )
            .unwrap();
            for ((curve, exact), bound) in found.answer.iter().zip(&exact).zip(&found.bounds) {
                let (error, bound) = ((curve[0] - exact).norm() / exact.norm(), bound.limit_if_known().unwrap());
                prop_assert!(error <= bound + own, "{}: {at:?}, {hz} Hz: {error:e} of {bound:e}", scene.name);
            }
        }
        Ok(())
    };
    let bezel = shipped("bezel.toml");
    for (at, hz) in [((0.18687, 0.14836), 803.386), ((0.18687, 0.14836), 487.646), ((0.19618, 0.12311), 191.194)] {
        check(&bezel, at, hz).unwrap();
    }
    let config = Config { cases: 6, failure_persistence: None, ..Config::default() };
    for scene in [bezel, shipped("camera.toml")] {
        let mut runner = TestRunner::new_with_rng(config.clone(), TestRng::deterministic_rng(Default::default()));
        let (length, width) = (scene.surface.length_m, scene.surface.width_m);
        let anywhere = (0.0..=1.0_f64, 0.2..=1.0_f64, 1.5..=3.0_f64);
        runner.run(&anywhere, |(x, y, decade)| check(&scene, (x * length, y * width), 10.0_f64.powf(decade))).unwrap();
    }
}

/// Where a response is near zero its error relative to itself is large: 28 of 60 such requests used to miss 1e-3.
#[test]
fn the_default_tolerance_is_met_at_any_frequency() {
    let scenes = [
        shipped("plate.toml"),
        shipped("starting_plate.toml"),
        shipped("bar.toml"),
        shipped("stepped_bar.toml"),
        shipped("bezel.toml"),
        shipped("camera.toml"),
        sheet().scene(),
    ];
    let config = Config { cases: 5, failure_persistence: None, ..Config::default() };
    let mut runner = TestRunner::new_with_rng(config, TestRng::deterministic_rng(Default::default()));
    for scene in scenes {
        let (length, width) = (scene.surface.length_m, scene.surface.width_m);
        let is_bar = scene.surface.kind == era::scene::SurfaceKind::Bar;
        runner
            .run(&(0.0..=1.0_f64, 0.2..=1.0_f64, 40.0..400.0_f64), |(x, y, hz)| {
                let at = (x * length, if is_bar { 0.5 } else { y } * width);
                let (found, bound) = at_one(&scene, Accuracy::BALANCED, at, hz);
                prop_assert!(bound <= 1e-3, "{}: {at:?}, {hz} Hz: bound {bound:e}", scene.name);
                let (exact, own) = at_one(&scene, Accuracy::from_tolerance(2e-5).unwrap(), at, hz);
                for (found, exact) in found.iter().zip(&exact) {
                    let error = (found - exact).norm() / exact.norm();
                    prop_assert!(error <= bound + own, "{}: {at:?}, {hz} Hz: off by {error:e}", scene.name);
                }
                Ok(())
            })
            .unwrap();
    }
}

/// Plans have no ladder to climb: their models are made once, for a tolerance that has to hold at any target.
#[test]
fn plans_meet_the_default_tolerance() {
    let options = TableOptions::default();
    for name in ["plate.toml", "starting_plate.toml", "bar.toml", "stepped_bar.toml", "bezel.toml", "camera.toml"] {
        let scene = shipped(name);
        let levels = ReducedLevels::build(&scene, Accuracy::BALANCED, options.to_hz).unwrap();
        let table = PlanTable::from_levels(&scene, levels, options).unwrap();
        let surface = &scene.surface;
        for (x_m, y_m) in spread_points(12, surface.length_m, surface.width_m) {
            let Ok(plan) = table.plan(&[Target { x_m, y_m, intensity_g: Some(0.1) }]) else { continue };
            let bound = plan.error_bound.unwrap();
            assert!(bound <= 1e-3, "{name} at {x_m}, {y_m}: {bound:e}");
        }
    }
}

/// Near an antiresonance the bound grew from one order to the next by chance, which was taken for rounding.
#[test]
fn what_a_tight_tolerance_meets_a_loose_one_meets() {
    let mut glass = SceneText::plate(0.32, 0.18, 0.22).thickness(0.0018);
    glass.density = 2500.0;
    let glass = glass
        .corner_springs(2e3)
        .era("grounded", 0.25, 0.5, 0.01, 5e3, 1.1)
        .era("grounded", 0.75, 0.5, 0.01, 5e3, 1.1)
        .damping("loss_factor", 0.01)
        .scene();
    for hz in [607.0, 610.0, 613.0, 616.0, 619.0] {
        for tolerance in [1e-2, 1e-3, 1e-4, 1e-6] {
            let (_, bound) = at_one(&glass, Accuracy::from_tolerance(tolerance).unwrap(), (0.08, 0.045), hz);
            assert!(bound <= tolerance, "{hz} Hz at {tolerance:e}: bound {bound:e}");
        }
    }
}

/// A sweep of many values compares its levels on a lattice of points: the bound holds at all the others.
#[test]
fn bounds_of_sweeps_hold_between_the_points_compared() {
    let (x_m, y_m): (Vec<f64>, Vec<f64>) =
        ((0..=48).map(|k| 0.3 * f64::from(k) / 48.0).collect(), (0..=32).map(|k| 0.2 * f64::from(k) / 32.0).collect());
    let (x_m, y_m) =
        (x_m.iter().map(|x| x.min(0.3)).collect::<Vec<_>>(), y_m.iter().map(|y| y.min(0.2)).collect::<Vec<_>>());
    let frequencies: Vec<f64> = (1..=150).map(|k| 5.0 * f64::from(k)).collect();
    let lopsided = SceneText::plate(0.3, 0.2, 0.3)
        .spring_damper(0.03, 0.9, 4e4, 2.0)
        .spring_damper(0.8, 0.1, 3e3, 1.0)
        .era("inertial", 0.37, 0.21, 0.02, 2e4, 1.0)
        .damping("loss_factor", 0.01)
        .scene();
    for scene in [Scene::parse("plate", STARTING_PLATE).unwrap(), lopsided] {
        let at = |accuracy| {
            compute_acceleration_sweep_per_newton_with_error_bounds::<f64>(&scene, accuracy, (&x_m, &y_m), &frequencies)
                .unwrap()
        };
        let (found, exact) = (at(Accuracy::BALANCED), at(Accuracy::from_tolerance(1e-5).unwrap()));
        for actuator in 0..found.answer.actuators {
            let (bound, own) =
                (found.bounds[actuator].limit_if_known().unwrap(), exact.bounds[actuator].limit_if_known().unwrap());
            assert!(bound <= 1e-3, "{bound:e}");
            for point in 0..found.answer.points {
                let curve = |sweep: &era::response::sweep::AccelerationSweep<f64>| {
                    (0..frequencies.len())
                        .map(|k| sweep.acceleration_per_newton_at_indices(k, actuator, point))
                        .collect::<Vec<_>>()
                };
                let (found, exact) = (curve(&found.answer), curve(&exact.answer));
                let peak = exact.iter().map(|z| z.norm()).fold(0.0, f64::max);
                let error = found.iter().zip(&exact).map(|(a, b)| (a - b).norm()).fold(0.0, f64::max) / peak;
                assert!(error <= bound + own, "point {point}: off by {error:e}, bound {bound:e}");
            }
        }
    }
}

/// With next to no time two levels are asked; with more time there are more levels and a smaller bound.
#[test]
fn more_time_buys_a_smaller_bound() {
    let scene = Scene::parse("plate", STARTING_PLATE).unwrap();
    let within = |time| compute_modes_with_error_bounds(&scene, Accuracy::best_within_time(time), 300.0).unwrap();
    let largest = |found: &era::model::BoundedAnswer<Vec<era::model::PanelMode>>| {
        found.bounds.iter().map(|bound| bound.limit_if_known().unwrap()).fold(0.0, f64::max)
    };
    let (short, long) = (within(Duration::from_millis(1)), within(Duration::from_secs(60)));
    assert_eq!(short.steps.len(), 2);
    assert!(long.steps.len() > 2 && largest(&long) < 0.01 * largest(&short), "{:e}", largest(&long));
}
