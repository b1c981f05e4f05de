//! Against quadratic equations by hand, a mass on a wall of dashpots, and what each mode becomes where that is known.

use crate::scenes::SceneText;
use era_model::model::damping::DampingMatrices;
use era_model::model::poles::{Pole, compute_poles_of_followed_modes_if_solvable};
use era_model::model::{Accuracy, PanelMode, compute_modes_with_error_bounds};
use nalgebra::{DMatrix, DVector};
use num_complex::Complex64;

fn build_damping(viscous: DMatrix<f64>, structural: DMatrix<f64>) -> DampingMatrices {
    DampingMatrices { viscous, structural, structured: None }
}

fn follow_poles(lambda: &[f64], viscous: DMatrix<f64>, structural: DMatrix<f64>) -> Vec<Pole> {
    compute_poles_of_followed_modes_if_solvable(lambda, &build_damping(viscous, structural), lambda.len(), lambda.len())
        .unwrap()
}

/// What det P(s) is against the product of the sizes of its rows.
fn find_residual(lambda: &[f64], viscous: &DMatrix<f64>, structural: &DMatrix<f64>, s: Complex64) -> f64 {
    let n = lambda.len();
    let matrix = DMatrix::from_fn(n, n, |i, j| {
        let own = if i == j { s * s + lambda[i] } else { Complex64::ZERO };
        own + s * viscous[(i, j)] + Complex64::I * structural[(i, j)]
    });
    let size: f64 = matrix.row_iter().map(|row| row.norm()).product();
    matrix.determinant().norm() / size
}

/// One dashpot at a point of three modes: the more it holds, the less the modes that are left swing with it.
#[test]
fn a_strong_dashpot_holds_its_point() {
    let lambda = [1e4, 4e4, 9.3e4];
    let along = DVector::from_row_slice(&[1.0, 0.8, -0.6]);
    let none = DMatrix::zeros(3, 3);
    for c in [1e-3, 1.0, 30.0, 300.0, 3e3, 1e5, 1e6] {
        let viscous = &along * along.transpose() * c;
        let found = follow_poles(&lambda, viscous.clone(), none.clone());
        for pole in &found {
            for s in [Some(pole.s), pole.slower].into_iter().flatten() {
                assert!(find_residual(&lambda, &viscous, &none, s) < 1e-9, "{c}: {found:?}");
            }
        }
        // The sum of all eigenvalues is the trace.
        let sum: f64 =
            found.iter().map(|pole| pole.slower.map_or(2.0 * pole.s.re, |slower| pole.s.re + slower.re)).sum();
        assert!((sum / -viscous.trace() - 1.0).abs() < 1e-6, "{c}: {sum} {}", viscous.trace());
        let product: f64 =
            found.iter().map(|pole| pole.slower.map_or(pole.s.norm_sqr(), |slower| (pole.s * slower).norm())).product();
        assert!((product / lambda.iter().product::<f64>() - 1.0).abs() < 1e-6, "{c}: {product:e}");
        let overdamped = found.iter().filter(|pole| pole.slower.is_some()).count();
        assert_eq!(overdamped, usize::from(c > 200.0), "{c}: {found:?}");
        assert!(found.iter().all(|pole| pole.slower.is_none() || pole.damping_ratio > 1.0), "{found:?}");
    }
    // Held altogether: the two motions of sum of along^2 / (lambda - w^2) = 0.
    let held = follow_poles(&lambda, &along * along.transpose() * 1e5, none);
    for pole in held.iter().filter(|pole| pole.slower.is_none()) {
        let square = pole.s.norm_sqr();
        let sum: f64 = lambda.iter().zip(&along).map(|(own, along)| along * along / (own - square)).sum();
        assert!(sum.abs() * 1e4 < 1e-3 && pole.damping_ratio < 1e-3, "{pole:?}");
    }
}

/// Modes by themselves, of every ratio, with loss factors and without.
#[test]
fn a_mode_by_itself_has_its_ratio() {
    for (eta, zeta) in [
        (0.0, 1e-6),
        (0.0, 0.3),
        (0.0, 0.999),
        (0.0, 1.0),
        (0.0, 1.001),
        (0.0, 7.0),
        (0.0, 1e4),
        (0.3, 0.0),
        (1.5, 0.0),
        (0.1, 0.2),
    ] {
        // Beside another mode that a thread of coupling makes it a matter of matrices.
        let lambda = [2.5e5, 7e6];
        let mut viscous = DMatrix::zeros(2, 2);
        (viscous[(0, 0)], viscous[(0, 1)], viscous[(1, 0)], viscous[(1, 1)]) = (2.0 * zeta * 500.0, 1e-6, 1e-6, 1.0);
        let mut structural = DMatrix::zeros(2, 2);
        structural[(0, 0)] = eta * lambda[0];
        let found = follow_poles(&lambda, viscous, structural)[0];
        let alone = Pole::from_uncoupled_mode(lambda[0], 2.0 * zeta * 500.0, eta * lambda[0]);
        let expected = if eta == 0.0 { zeta } else { alone.damping_ratio };
        if zeta == 0.0 {
            assert!((expected - (0.5 * f64::atan(eta)).sin()).abs() < 1e-12, "{expected}");
        }
        // Of two equal ones rounding is known by its root.
        assert!((found.damping_ratio / expected - 1.0).abs() < 1e-6, "{eta} {zeta}: {found:?} {alone:?}");
        assert!((found.frequency_hz / alone.frequency_hz - 1.0).abs() < 1e-6, "{eta} {zeta}: {found:?} {alone:?}");
        assert!(zeta == 1.0 || found.slower.is_some() == (zeta > 1.0), "{eta} {zeta}: {found:?}");
        if let Some(slower) = found.slower.filter(|_| zeta > 1.0) {
            let swing = (zeta * zeta - 1.0_f64).sqrt();
            assert!((found.s.re / (-500.0 * (zeta + swing)) - 1.0).abs() < 1e-5, "{found:?}");
            assert!((slower.re / (-500.0 / (zeta + swing)) - 1.0).abs() < 1e-5, "{found:?}");
        }
    }
}

/// Two modes that are nearly one, and a dashpot that moves with their sum: what is left of the other one hardly loses.
#[test]
fn of_two_modes_that_are_nearly_one_a_dashpot_takes_one() {
    for apart in [0.0, 1e-12, 1e-9, 1e-7, 1e-4] {
        let lambda = [1e6, 1e6 * (1.0 + apart), 5e6];
        let along = DVector::from_row_slice(&[1.0, 1.0, 0.3]);
        let viscous = &along * along.transpose() * 40.0;
        let found = follow_poles(&lambda, viscous.clone(), DMatrix::zeros(3, 3));
        let mut ratios = [found[0].damping_ratio, found[1].damping_ratio];
        ratios.sort_by(f64::total_cmp);
        assert!(ratios[0] < 1e-5 && (ratios[1] / 0.04 - 1.0).abs() < 0.01, "{apart}: {found:?}");
        assert!((found[2].damping_ratio / 8e-4 - 1.0).abs() < 0.1, "{found:?}");
    }
}

/// Motions that nothing holds stay at nothing, and take a dashpot's share of the others' all the same.
#[test]
fn a_free_motion_stays_at_rest() {
    let lambda = [0.0, 0.0, 1e5];
    let along = DVector::from_row_slice(&[1.0, 0.4, 1.2]);
    let viscous = &along * along.transpose() * 50.0;
    let found = follow_poles(&lambda, viscous.clone(), DMatrix::zeros(3, 3));
    assert!(found[..2].iter().all(|pole| *pole == Pole::FREE), "{found:?}");
    assert!(find_residual(&lambda, &viscous, &DMatrix::zeros(3, 3), found[2].s) < 1e-12, "{found:?}");
}

/// From 0 to 1, the same ones at every run.
fn random_numbers(mut seed: u64) -> impl FnMut() -> f64 {
    move || {
        seed = seed.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        f64::from(u32::try_from(seed >> 33).unwrap()) / f64::from(1_u32 << 31)
    }
}

/// No pole is told twice, whatever the damping.
#[test]
fn every_mode_has_a_pole_of_its_own() {
    let mut random = random_numbers(7);
    for trial in 0..60 {
        let n = 2 + trial % 9;
        let mut lambda: Vec<f64> = (0..n).map(|_| 10.0_f64.powf(4.0 + 2.0 * random())).collect();
        lambda.sort_by(f64::total_cmp);
        let mut viscous = DMatrix::zeros(n, n);
        for _ in 0..=trial % 4 {
            let along = DVector::from_fn(n, |_, _| 2.0 * random() - 1.0);
            viscous += &along * along.transpose() * 10.0_f64.powf(7.0 * random());
        }
        let mut structural = DMatrix::zeros(n, n);
        if trial % 3 == 0 {
            let along = DVector::from_fn(n, |i, _| lambda[i].sqrt() * (2.0 * random() - 1.0));
            structural += &along * along.transpose() * random();
        }
        let found = follow_poles(&lambda, viscous.clone(), structural.clone());
        for (k, pole) in found.iter().enumerate() {
            assert!(find_residual(&lambda, &viscous, &structural, pole.s) < 1e-7, "{trial}: {pole:?}");
            for other in &found[..k] {
                assert!((pole.s - other.s).norm() > 1e-9 * pole.s.norm(), "{trial}: {pole:?} {other:?}");
            }
        }
    }
}

/// A free plate before a grounded ERA, and one with a dashpot at two corners, both of a material that loses energy: the poles by the Ritz model of an
/// independent reference in Python (Legendre polynomials, 324 of them), whatever was asked for beside them. Before, with some questions, the second pole of
/// the mode was said to be that of a motion that nothing holds, and its ratio was 2224 and 1e6.
#[test]
fn a_motion_that_nothing_holds_has_no_part_in_a_pole() {
    let era = SceneText::plate(0.3, 0.3, 0.33).thickness(3e-3).damping("loss_factor", 0.1).era(
        "grounded",
        11.382_093_025_694_273 / 300.0,
        112.155_292_186_210_8 / 300.0,
        0.02,
        3000.0,
        50.0,
    );
    let dashpots = SceneText::plate(0.3, 0.2, 0.33)
        .thickness(3e-3)
        .damping("loss_factor", 0.1)
        .spring_damper(0.0, 0.0, 0.0, 30.0)
        .spring_damper(1.0, 1.0, 0.0, 1e5);
    // All 324 modes of the polynomials; the first 120 alone say -1101 + 764j of the second one.
    for (scene, at, expected, apart) in
        [(era, 2, Complex64::new(-124.84, 9.08), 1e-3), (dashpots, 3, Complex64::new(-1048.875, 805.146), 1e-5)]
    {
        for max_hz in [100.0, 200.0, 300.0] {
            for tolerance in [1e-3, 1e-4] {
                let accuracy = Accuracy::from_tolerance(tolerance).unwrap();
                let found = compute_modes_with_error_bounds(&scene.scene(), accuracy, max_hz).unwrap().answer;
                assert!(found[..2].iter().all(|mode| mode.pole == Pole::FREE), "{found:?}");
                let Some(mode) = found.get(at) else { continue };
                let said = || format!("{max_hz} Hz, {tolerance}: {mode:?}");
                assert!((mode.pole.s - expected).norm() < apart * expected.norm(), "{}", said());
                assert!(mode.pole.slower.is_none(), "{}", said());
                assert!((mode.damping_ratio + expected.re / expected.norm()).abs() < apart, "{}", said());
            }
        }
    }
}

/// Free motions, springs and dashpots of all sizes: none of the poles that are told is one of those at rest.
#[test]
fn what_rests_is_no_pole_of_a_mode() {
    let mut random = random_numbers(3);
    for trial in 0..200 {
        let (free, n) = (1 + trial % 3, 6);
        let mut lambda: Vec<f64> =
            (0..n).map(|i| if i < free { 0.0 } else { 10.0_f64.powf(3.0 + 3.0 * random()) }).collect();
        lambda.sort_by(f64::total_cmp);
        let mut viscous = DMatrix::zeros(n, n);
        for _ in 0..=trial % 4 {
            let along = DVector::from_fn(n, |_, _| 2.0 * random() - 1.0);
            viscous += &along * along.transpose() * 10.0_f64.powf(5.0 * random());
        }
        let loss = if trial % 2 == 0 { 0.1 } else { 0.0 };
        let structural = DMatrix::from_diagonal(&DVector::from_iterator(n, lambda.iter().map(|own| loss * own)));
        let found = follow_poles(&lambda, viscous.clone(), structural.clone());
        let slowest = lambda[free] / (viscous.trace() + lambda[free].sqrt());
        for pole in &found[free..] {
            for s in pole.eigenvalues_without_conjugates() {
                assert!(s.norm() > 1e-3 * slowest, "{trial}: {pole:?} {lambda:?}");
                assert!(find_residual(&lambda, &viscous, &structural, s) < 1e-7, "{trial}: {pole:?}");
            }
        }
    }
}

/// With a loss factor no motion that loses energy by it has two real poles: what is told is the one with Im s > 0, and two only where both are real.
#[test]
fn two_poles_of_a_mode_are_reported_only_where_both_are_real() {
    let mut random = random_numbers(11);
    for trial in 0..200 {
        let n = 2 + trial % 5;
        let mut lambda: Vec<f64> = (0..n).map(|_| 10.0_f64.powf(4.0 + 2.0 * random())).collect();
        lambda.sort_by(f64::total_cmp);
        let along = DVector::from_fn(n, |_, _| 2.0 * random() - 1.0);
        let viscous = &along * along.transpose() * 10.0_f64.powf(2.0 + 3.0 * random());
        let loss = [0.0, 0.1, 2.0][trial % 3];
        let structural = DMatrix::from_diagonal(&DVector::from_iterator(n, lambda.iter().map(|own| loss * own)));
        for pole in follow_poles(&lambda, viscous.clone(), structural.clone()) {
            assert!(pole.s.im >= 0.0 && pole.s.re <= 0.0, "{trial}: {pole:?}");
            let Some(slower) = pole.slower else {
                assert!((pole.damping_ratio + pole.s.re / pole.s.norm()).abs() < 1e-12, "{trial}: {pole:?}");
                continue;
            };
            assert!(loss == 0.0 && (pole.s.im, slower.im) == (0.0, 0.0), "{trial}: {pole:?}");
        }
    }
    // By itself, too: the root of s^2 + c s + lambda (1 + j eta) with Im s > 0.
    for (zeta, eta) in [(1.5, 0.1), (7.0, 0.1), (7.0, 1e-6), (0.9, 2.0)] {
        let pole = Pole::from_uncoupled_mode(1e4, 2.0 * zeta * 100.0, eta * 1e4);
        let left = pole.s * pole.s + 2.0 * zeta * 100.0 * pole.s + Complex64::new(1e4, eta * 1e4);
        assert!(pole.slower.is_none() && pole.s.im > 0.0 && left.norm() < 1e-9 * 1e4, "{zeta} {eta}: {pole:?}");
    }
}

/// Dashpots of up to 1e12 N s/m at the corners: what still swings loses its energy in them, and less by as much as they are stiffer (a force f on a
/// dashpot c costs f^2 / c). Before, rounding was up to 4e-4 1/s, of either sign.
#[test]
fn what_swings_with_its_dashpots_at_rest_never_grows() {
    let at = |dashpot: f64| {
        let mut scene = SceneText::plate(0.3, 0.2, 0.33).thickness(3e-3);
        for (x, y) in [(0.0, 0.0), (1.0, 0.0), (0.0, 1.0), (1.0, 1.0)] {
            scene = scene.spring_damper(x, y, 3000.0, dashpot);
        }
        compute_modes_with_error_bounds(&scene.scene(), Accuracy::BALANCED, 300.0).unwrap().answer
    };
    // Whichever mode has it.
    let swinging = |modes: &[PanelMode]| {
        let mut all: Vec<Complex64> =
            modes.iter().filter(|mode| mode.pole.s.im > 1.0).map(|mode| mode.pole.s).collect();
        all.sort_by(|a, b| a.im.total_cmp(&b.im));
        all
    };
    let reference = swinging(&at(1e6));
    assert!(reference.len() >= 4, "{reference:?}");
    for dashpot in [1e8, 1e9, 1e10, 1e11, 1e12] {
        let modes = at(dashpot);
        assert!(
            modes.iter().all(|mode| mode.pole.eigenvalues_without_conjugates().iter().all(|s| s.re < 0.0)),
            "{dashpot:e}: {modes:?}"
        );
        for s in swinging(&modes) {
            let Some(own) = reference.iter().find(|own| (own.im / s.im - 1.0).abs() < 1e-4) else { continue };
            let expected = own.re * 1e6 / dashpot;
            assert!((s.re / expected - 1.0).abs() < 0.02, "{dashpot:e}: {s} {expected:e}");
        }
    }
}

/// Dashpots of ERAs on a plate's edges: the fast motion beside each is one of the mesh, and what is told of it is nothing; the slow one is the ERA's spring
/// on its dashpot. Before, the ratio was 626 with one tolerance and 684 with another.
#[test]
fn a_pole_that_a_finer_mesh_changes_is_not_reported() {
    let mut scene = SceneText::plate(0.3, 0.2, 0.33).thickness(3e-3);
    for (x, y) in [(0.0, 0.0), (1.0, 0.0), (0.0, 1.0), (1.0, 1.0)] {
        scene = scene.spring_damper(x, y, 3000.0, 3.0);
    }
    let scene = scene.era("inertial", 1.0, 0.5, 0.05, 2000.0, 2000.0).era("grounded", 0.0, 0.5, 0.05, 2000.0, 8000.0);
    let ask = |tolerance| {
        compute_modes_with_error_bounds(&scene.scene(), Accuracy::from_tolerance(tolerance).unwrap(), 200.0)
            .unwrap()
            .answer
    };
    let [loose, tight] = [1e-3, 1e-4].map(ask);
    assert!(loose.iter().any(|mode| !mode.pole.is_known()), "{loose:?}");
    for (loose, tight) in loose.iter().zip(&tight) {
        let said = || format!("{loose:?} {tight:?}");
        assert_eq!(loose.pole.is_known(), tight.pole.is_known(), "{}", said());
        assert_eq!(loose.pole.slower.is_some(), tight.pole.slower.is_some(), "{}", said());
        if loose.pole.is_known() {
            assert!((loose.damping_ratio / tight.damping_ratio - 1.0).abs() < 1e-3, "{}", said());
            continue;
        }
        assert!(loose.damping_ratio.is_nan() && loose.pole.frequency_hz.is_nan(), "{}", said());
        for (one, other) in
            loose.pole.eigenvalues_without_conjugates().iter().zip(tight.pole.eigenvalues_without_conjugates())
        {
            assert!((one - other).norm() < 1e-3 * one.norm(), "{}", said());
        }
    }
    // A mode by itself has both, however fast: zeta = 100 at 10 Hz and more is a quadratic equation.
    let plate =
        SceneText::plate(0.3, 0.2, 0.33).damping("rayleigh_alpha", 2e4).edge("left", "pinned").edge("right", "pinned");
    for mode in compute_modes_with_error_bounds(&plate.scene(), Accuracy::BALANCED, 150.0).unwrap().answer {
        let expected = 2e4 / (4.0 * std::f64::consts::PI * mode.frequency_hz);
        assert!((mode.damping_ratio / expected - 1.0).abs() < 1e-6, "{mode:?} {expected}");
        assert!(mode.pole_bound.limit_if_known().is_some(), "{mode:?}");
    }
}
