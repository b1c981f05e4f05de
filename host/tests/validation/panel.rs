//! A measured panel: peaks of the electrical impedance of an exciter on a free acrylic plate.
//!
//! The coil's impedance is R + (Bl)^2 Y with Y the plate's velocity per newton under the coil: where Re Y peaks, so does the
//! resistance. Bl and R scale and shift the curve and move no peak.

use super::table::percent;
use era::model::Accuracy;
use era::response::bounded_curves;
use era::scene::Scene;
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

/// Frequencies in Hz from 30 to 520 Hz at which the real part of the mobility under the exciter peaks.
fn peaks(scene: &str) -> Vec<f64> {
    let scene = Scene::parse("pmma.toml", scene).unwrap();
    let frequencies: Vec<f64> = (0..=1960).map(|i| 30.0 + STEP_HZ * f64::from(i)).collect();
    let curves = bounded_curves(&scene, Accuracy::BALANCED, (0.21, 0.15), &frequencies).unwrap();
    assert!(curves.bounds[0].value().unwrap() < 1e-3);
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
