//! One answer, wherever it is asked for: on the command line with the table computed, being kept and kept; over HTTP; from the library.

use crate::spec::{Spec, assert_holds_for_random_inputs, on, point, scenes};
use crate::support::Daemon;
use crate::support::program::{build_era_command, run_command};
use era::model::{Accuracy, compute_modes_with_error_bounds};
use era::response::compute_acceleration_curves_per_newton_with_error_bounds;
use proptest::prelude::*;
use serde_json::{Value, json};
use std::path::Path;

/// What `era` prints with a cache in this folder, as JSON.
fn run_era_with_cache(arguments: &[&str], cache: &Path) -> Result<Value, TestCaseError> {
    let ran = run_command(build_era_command().args(arguments).env("ERA_CACHE_DIR", cache));
    prop_assert!(ran.is_success(), "{arguments:?}: {}", ran.error);
    Ok(ran.parse_json())
}

/// What a plan is: all that may not depend on who was asked.
fn essence(answer: &Value) -> Value {
    let keys =
        ["target_mm", "targets", "drives", "predicted", "limited_by", "error_bound", "optimality_gap", "objective"];
    keys.iter().map(|key| ((*key).to_owned(), answer[*key].clone())).collect()
}

/// Seen to fail with an intensity that is 1e-6 more over HTTP.
#[test]
fn a_plan_is_the_same_everywhere() {
    assert_holds_for_random_inputs(3, (scenes(), point()), |(spec, at)| {
        let spec = Spec { screen: Some(([1000, 700], [0.0, 0.0, spec.size_mm[0], spec.size_mm[1]])), ..spec };
        let folder = tempfile::tempdir().unwrap();
        let (file, cache) = (folder.path().join("scene.toml"), folder.path().join("cache"));
        std::fs::write(&file, spec.text()).unwrap();
        let (x, y) = ((at[0] * 1000.0).round(), (at[1] * 700.0).round());
        let place = format!("{x},{y}");
        let common = [
            "plan",
            "--scene",
            file.to_str().unwrap(),
            "--accuracy",
            "fast",
            "--at",
            &place,
            "--intensity-g",
            "0.1",
            "--json",
        ];
        let computed = run_era_with_cache(&[&common[..], &["--no-cache"]].concat(), &cache)?;
        prop_assert!(
            !cache.exists() || std::fs::read_dir(&cache).unwrap().next().is_none(),
            "kept although told not to"
        );
        let (keeping, kept) = (run_era_with_cache(&common, &cache)?, run_era_with_cache(&common, &cache)?);
        prop_assert!(std::fs::read_dir(&cache).unwrap().next().is_some(), "nothing was kept\n{}", spec.text());
        prop_assert_eq!(essence(&computed), essence(&keeping));
        prop_assert_eq!(essence(&computed), essence(&kept), "kept\n{}", spec.text());
        let daemon = Daemon::start(&spec.text());
        let touch = json!({"x_px": x, "y_px": y, "intensity_g": 0.1, "duration_ms": 50}).to_string();
        let (status, _, served) = daemon.post("/v1/touch", &touch);
        prop_assert_eq!(status, 200, "{}", served);
        prop_assert_eq!(essence(&computed), essence(&served), "over HTTP\n{}", spec.text());
        Ok(())
    });
}

/// Equal but for the last digit, which reading JSON may change.
fn alike(a: &[f64], b: &[f64]) -> bool {
    a.len() == b.len() && a.iter().zip(b).all(|(a, b)| (a - b).abs() <= 2.0 * f64::EPSILON * a.abs())
}

#[test]
fn modes_and_responses_are_the_librarys() {
    assert_holds_for_random_inputs(4, (scenes(), point()), |(spec, at)| {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("scene.toml");
        std::fs::write(&file, spec.text()).unwrap();
        let (file, scene) = (file.to_str().unwrap(), spec.parse_scene());
        let at = on(&spec, at);
        let printed = run_era_with_cache(&["modes", "--scene", file, "--max-hz", "400", "--json"], folder.path())?;
        let found = compute_modes_with_error_bounds(&scene, Accuracy::BALANCED, 400.0).unwrap();
        let frequencies: Vec<f64> = found.answer.iter().map(|mode| mode.frequency_hz).collect();
        let numbers = |list: &Value| list.as_array().unwrap().iter().map(|v| v.as_f64().unwrap()).collect::<Vec<f64>>();
        let own: Vec<f64> =
            printed["modes"].as_array().unwrap().iter().map(|mode| mode["frequency_hz"].as_f64().unwrap()).collect();
        prop_assert!(alike(&own, &frequencies), "{own:?} and {frequencies:?}\n{}", spec.text());
        let place = format!("{:?},{:?}", at[0], at[1]);
        let band = ["--from", "50", "--to", "150", "--step", "25"];
        let printed = run_era_with_cache(
            &[&["response", "--scene", file, "--at", &place, "--json"][..], &band].concat(),
            folder.path(),
        )?;
        let hz = numbers(&printed["frequency_hz"]);
        prop_assert_eq!(&hz, &vec![50.0, 75.0, 100.0, 125.0, 150.0]);
        let found = compute_acceleration_curves_per_newton_with_error_bounds(
            &scene,
            Accuracy::BALANCED,
            (at[0] / 1e3, at[1] / 1e3),
            &hz,
        )
        .unwrap();
        for (own, curve) in printed["actuators"].as_array().unwrap().iter().zip(&found.answer) {
            let (re, im): (Vec<f64>, Vec<f64>) = curve.iter().map(|z| (z.re, z.im)).unzip();
            let printed = [numbers(&own["acceleration_re"]), numbers(&own["acceleration_im"])];
            prop_assert!(alike(&printed[0], &re) && alike(&printed[1], &im), "{own} and {curve:?}\n{}", spec.text());
        }
        Ok(())
    });
}
