//! Against quadratic equations by hand, a mass on a wall of dashpots, and what each mode becomes where that is known.

use era_model::model::damping::Damping;
use era_model::model::poles::{Pole, poles};
use nalgebra::{DMatrix, DVector};
use num_complex::Complex64;

fn damping(viscous: DMatrix<f64>, structural: DMatrix<f64>) -> Damping {
    Damping { viscous, structural, structured: None }
}

fn followed(lambda: &[f64], viscous: DMatrix<f64>, structural: DMatrix<f64>) -> Vec<Pole> {
    poles(lambda, &damping(viscous, structural), lambda.len(), lambda.len()).unwrap()
}

/// What det P(s) is against the product of the sizes of its rows.
fn residual(lambda: &[f64], viscous: &DMatrix<f64>, structural: &DMatrix<f64>, s: Complex64) -> f64 {
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
        let found = followed(&lambda, viscous.clone(), none.clone());
        for pole in &found {
            for s in [Some(pole.s), pole.slower].into_iter().flatten() {
                assert!(residual(&lambda, &viscous, &none, s) < 1e-9, "{c}: {found:?}");
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
    let held = followed(&lambda, &along * along.transpose() * 1e5, none);
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
        let found = followed(&lambda, viscous, structural)[0];
        let alone = Pole::alone(lambda[0], 2.0 * zeta * 500.0, eta * lambda[0]);
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
        let found = followed(&lambda, viscous.clone(), DMatrix::zeros(3, 3));
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
    let found = followed(&lambda, viscous.clone(), DMatrix::zeros(3, 3));
    assert!(found[..2].iter().all(|pole| *pole == Pole::FREE), "{found:?}");
    assert!(residual(&lambda, &viscous, &DMatrix::zeros(3, 3), found[2].s) < 1e-12, "{found:?}");
}

/// No pole is told twice, whatever the damping.
#[test]
fn every_mode_has_a_pole_of_its_own() {
    let mut seed = 7_u64;
    let mut random = || {
        seed = seed.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        f64::from(u32::try_from(seed >> 33).unwrap()) / f64::from(1_u32 << 31)
    };
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
        let found = followed(&lambda, viscous.clone(), structural.clone());
        for (k, pole) in found.iter().enumerate() {
            assert!(residual(&lambda, &viscous, &structural, pole.s) < 1e-7, "{trial}: {pole:?}");
            for other in &found[..k] {
                assert!((pole.s - other.s).norm() > 1e-9 * pole.s.norm(), "{trial}: {pole:?} {other:?}");
            }
        }
    }
}
