//! Measured panels: peaks of the electrical impedance of an exciter on a free acrylic plate and on a free plywood plate.
//!
//! The coil's impedance is R + (Bl)^2 Y with Y the plate's velocity per newton under the coil: where Re Y peaks, so does the
//! resistance. Bl and R scale and shift the curve and move no peak.

use super::table::percent;
use era_model::model::Accuracy;
use era_model::response::compute_acceleration_curves_per_newton_with_error_bounds;
use era_model::scene::Scene;
use num_complex::Complex64;
use std::f64::consts::TAU;

const SCENE: &str = include_str!("pmma.toml");
/// Peaks of the measured impedance in Hz. The spectrum has a line every 0.366 Hz.
const MEASURED_HZ: [f64; 6] = [41.4, 87.2, 176.1, 233.3, 390.4, 471.3];
/// With the data set's own numbers: largest difference of a peak, relative.
const AS_GIVEN: f64 = 0.026;
/// With one number, the modulus, fitted.
const FITTED: f64 = 0.015;
/// Step in Hz at which peaks are looked for; a parabola through three points finds them to a hundredth of it, as none is narrower than 4
/// Hz.
const STEP_HZ: f64 = 0.25;

/// Frequencies in Hz from 30 Hz to `to_hz` at which the real part of the mobility under the exciter, in the middle, peaks.
fn peaks_to(scene: &str, to_hz: u32) -> Vec<f64> {
    let scene = Scene::parse("plate.toml", scene).unwrap();
    let frequencies: Vec<f64> = (0..=4 * (to_hz - 30)).map(|i| 30.0 + STEP_HZ * f64::from(i)).collect();
    let middle = (scene.surface.length_m / 2.0, scene.surface.width_m / 2.0);
    let curves =
        compute_acceleration_curves_per_newton_with_error_bounds(&scene, Accuracy::BALANCED, middle, &frequencies)
            .unwrap();
    assert!(curves.bounds[0].limit_if_known().unwrap() < 1e-3);
    let resistance: Vec<f64> = curves.answer[0]
        .iter()
        .zip(&frequencies)
        .map(|(acceleration, hz)| (acceleration / Complex64::new(0.0, TAU * hz)).re)
        .collect();
    assert!(resistance.iter().all(|resistance| *resistance > 0.0), "a plate that gives power");
    let peak = |three: &[f64]| -> Option<f64> {
        let (before, at, after) = (three[0], three[1], three[2]);
        (at > before && at > after).then(|| 0.5 * (before - after) / (before - 2.0 * at + after))
    };
    resistance.windows(3).zip(&frequencies[1..]).filter_map(|(three, hz)| Some(hz + STEP_HZ * peak(three)?)).collect()
}

/// Of the acrylic plate.
fn peaks(scene: &str) -> Vec<f64> {
    peaks_to(scene, 520)
}

#[test]
fn an_exciter_on_an_acrylic_plate() {
    let given = peaks(SCENE);
    assert_eq!(given.len(), MEASURED_HZ.len(), "{given:?}");
    // Frequencies of a free plate go with the square root of the modulus; the exciter's spring hardly matters.
    let mean = |found: &[f64]| {
        found.iter().zip(MEASURED_HZ).map(|(found, measured)| (measured / found).ln()).sum::<f64>() / 6.0
    };
    let modulus = 4.7e9 * (2.0 * mean(&given)).exp();
    let fitted = peaks(&SCENE.replace("4.7e9", &format!("{modulus:e}")));
    let mut lines = vec![
        format!("acrylic plate, impedance peaks in Hz; fitted modulus {:.2} GPa:", modulus / 1e9),
        "| peak | measured | era | difference | era, fitted | difference |".to_owned(),
        "|---|---|---|---|---|---|".to_owned(),
    ];
    for (k, ((given, fitted), measured)) in given.iter().zip(&fitted).zip(MEASURED_HZ).enumerate() {
        let difference = |found: &f64| found / measured - 1.0;
        lines.push(format!(
            "| {} | {measured} | {given:.1} | {} | {fitted:.1} | {} |",
            k + 1,
            percent(difference(given), 1),
            percent(difference(fitted), 1),
        ));
        assert!(difference(given).abs() < AS_GIVEN, "{given} Hz for {measured} Hz");
        assert!(difference(fitted).abs() < FITTED, "{fitted} Hz for {measured} Hz with {modulus} Pa");
    }
    super::on_the_page(&lines);
}

/// The comparison can fail: a plate of 3.6 mm is not the one that was measured, and a coil of ten times the mass is not its exciter.
#[test]
fn another_plate_or_exciter_is_found() {
    for (from, to) in [("= 3.5", "= 3.6"), ("= 1.21", "= 12.1")] {
        assert!(SCENE.contains(from));
        let found = peaks(&SCENE.replace(from, to));
        let worst = found.iter().zip(MEASURED_HZ).map(|(a, b)| (a / b - 1.0).abs()).fold(0.0, f64::max);
        assert!(found.len() != MEASURED_HZ.len() || worst > AS_GIVEN, "{from} to {to}: {found:?}");
    }
}

/// What the exciter does to the peaks, for the page: without its suspension and its coil.
#[test]
fn what_the_exciter_does() {
    let bare = peaks(&SCENE.replace("= 1.21", "= 1e-9").replace("= 1236.0", "= 0.0"));
    let line = format!(
        "without suspension and coil: {} Hz",
        bare.iter().map(|hz| format!("{hz:.1}")).collect::<Vec<_>>().join(", ")
    );
    super::on_the_page(&[line]);
}

const PLYWOOD: &str = include_str!("plywood.toml");
/// Its peaks in Hz up to 640 Hz that stand out by more than 1.3 of the coil's 5 ohms, but for one at 64.5 Hz (see the page).
const PLYWOOD_HZ: [f64; 6] = [54.6, 116.1, 162.6, 275.0, 357.8, 617.1];
/// With the data set's own numbers: largest difference of a peak, relative.
const PLYWOOD_AS_GIVEN: f64 = 0.04;

#[test]
fn an_exciter_on_a_plywood_plate() {
    let found = peaks_to(PLYWOOD, 640);
    assert_eq!(found.len(), PLYWOOD_HZ.len(), "{found:?}");
    let mut lines = vec![
        "plywood plate, impedance peaks in Hz:".to_owned(),
        "| peak | measured | era | difference |".to_owned(),
        "|---|---|---|---|".to_owned(),
    ];
    for (k, (found, measured)) in found.iter().zip(PLYWOOD_HZ).enumerate() {
        let difference = found / measured - 1.0;
        lines.push(format!("| {} | {measured} | {found:.1} | {} |", k + 1, percent(difference, 1)));
        assert!(difference.abs() < PLYWOOD_AS_GIVEN, "{found} Hz for {measured} Hz");
    }
    super::on_the_page(&lines);
}

/// The comparison can fail: neither a plate of plywood turned by a right angle, nor one of the same stiffness along both axes, nor a thicker one is the one that
/// was measured.
#[test]
fn another_plywood_is_found() {
    let turned = PLYWOOD.replace("thickness_mm = 5.15", "thickness_mm = 5.15\nangle_deg = 90");
    let axes = "ex_pa = 6.9e9\ney_pa = 5.9e9\ng_pa = 0.57e9\npoisson_ratio = 0.058";
    assert!(PLYWOOD.contains(axes));
    let uniform = PLYWOOD.replace(axes, "youngs_modulus_pa = 6.4e9\npoisson_ratio = 0.058");
    let thicker = PLYWOOD.replace("5.15", "5.4");
    for other in [turned, uniform, thicker] {
        let found = peaks_to(&other, 640);
        let worst = found.iter().zip(PLYWOOD_HZ).map(|(a, b)| (a / b - 1.0).abs()).fold(0.0, f64::max);
        assert!(found.len() != PLYWOOD_HZ.len() || worst > PLYWOOD_AS_GIVEN, "{found:?}");
    }
}
