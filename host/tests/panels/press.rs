//! `era press`, and what loading a scene says of a press, as a user sees them.

use crate::support::program::{ProgramOutput, build_era_command, run_command};
use serde_json::Value;
use std::path::{Path, PathBuf};

const EXAMPLES: [&str; 5] = ["bar", "bezel", "camera", "plate", "stepped_bar"];

fn example(name: &str) -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR")).join(format!("../examples/scenes/{name}.toml"))
}

fn run_era_on_scene(arguments: &[&str], scene: &Path) -> ProgramOutput {
    let mut command = build_era_command();
    run_command(command.args(arguments).arg("--scene").arg(scene).args(["--no-cache", "--accuracy", "fast"]))
}

#[test]
fn the_example_scenes_bear_a_press() {
    for name in EXAMPLES {
        let output = run_era_on_scene(&["press", "--json"], &example(name));
        assert!(output.is_success() && !output.error.contains("press of"), "{name}: {}", output.error);
        let answer: Value = output.parse_json();
        assert_eq!(answer["force_n"], 5.0);
        for actuator in answer["actuators"].as_array().unwrap() {
            assert_eq!(actuator["stop"], "given", "{name}: {actuator}");
            let [sag, stop, left] = ["sag_um", "stop_um", "gap_left_um"].map(|key| actuator[key].as_f64().unwrap());
            // Five newtons are more than their springs hold, and 0.6 N are not.
            assert!((sag - stop).abs() < 1e-9 && (left - (500.0 - stop)).abs() < 1e-9, "{name}: {actuator}");
        }
        let output = run_era_on_scene(&["press", "--json", "--force-n", "0.6"], &example(name));
        let light: Value = output.parse_json();
        for (light, hard) in light["actuators"].as_array().unwrap().iter().zip(answer["actuators"].as_array().unwrap())
        {
            let [part, sag] = [
                light["alone_um"].as_f64().unwrap() / hard["alone_um"].as_f64().unwrap(),
                light["sag_um"].as_f64().unwrap(),
            ];
            assert!((part - 0.12).abs() < 1e-9 && sag > light["alone_um"].as_f64().unwrap(), "{name}: {light}");
        }
    }
}

/// Without its stops a scene is told of; what it names is enough, and more springs or a lighter press say nothing.
#[test]
fn a_scene_that_does_not_bear_it_is_reported_with_what_would_do() {
    let folder = tempfile::tempdir().unwrap();
    let text = std::fs::read_to_string(example("starting_plate")).unwrap();
    let without: String =
        text.lines().filter(|line| !line.starts_with("stop_um")).map(|line| format!("{line}\n")).collect();
    let told = |name: &str, text: &str| {
        let path = folder.path().join(name);
        std::fs::write(&path, text).unwrap();
        let output = run_era_on_scene(&["plan", "--at", "480,640", "--json", "--intensity-g", "50"], &path);
        assert!(output.is_success(), "{}", output.error);
        let plan: Value = output.parse_json();
        let volts = plan["drives"].as_array().unwrap().iter().map(|drive| drive["voltage_v"].as_f64().unwrap());
        (output.error, volts.fold(0.0, f64::max))
    };
    let (warned, volts) = told("without.toml", &without);
    assert!(warned.contains("a press of 5 N at 0.0, 100.0 mm moves the mass of the actuator \"left\""), "{warned}");
    assert!(
        warned.contains("stop_um = 166") && warned.contains("stiffness_n_per_m = 32000 (in the scene, it is 5000)"),
        "{warned}"
    );
    // 85 % of what two thirds of 0.5 mm hold: 24.22 d + 6.08 sqrt(d) kV, d in cm.
    let d = 0.1 / 3.0_f64;
    let holds = 0.85e3 * (24.22 * d + 6.08 * d.sqrt());
    assert!(volts > 0.99 * holds && volts <= holds * (1.0 + 1e-9), "{volts} {holds}");
    let (stiff, _) = told("stiff.toml", &without.replace("stiffness_n_per_m = 5000.0", "stiffness_n_per_m = 32000.0"));
    assert!(!stiff.contains("press of"), "{stiff}");
    let (light, volts) = told("light.toml", &(without.clone() + "\n[press]\nforce_n = 0.0\n"));
    assert!(!light.contains("press of") && volts > 1.1 * holds, "{light} {volts}");
    for (wrong, key) in [
        (without.clone() + "\n[press]\nforce_n = -1.0\n", "press.force_n"),
        (text.replacen("stop_um = 120.0", "stop_um = 501.0", 1), "actuator[1].stop_um"),
    ] {
        let path = folder.path().join("wrong.toml");
        std::fs::write(&path, wrong).unwrap();
        let output = run_era_on_scene(&["press"], &path);
        assert!(output.code == Some(2) && output.error.contains(key), "{}", output.error);
    }
    let output = run_era_on_scene(&["press", "--force-n", "2000"], &example("plate"));
    assert!(output.code == Some(2) && output.error.contains("0 to 1000 N"), "{}", output.error);
}

/// The mass of a panel has no part in what is steady, and none in where it is looked for.
#[test]
fn the_furthest_place_does_not_depend_on_the_mass_of_the_panel() {
    let folder = tempfile::tempdir().unwrap();
    for name in EXAMPLES {
        let text = std::fs::read_to_string(example(name)).unwrap();
        let pressed_with_density = |factor: f64| -> Vec<[f64; 2]> {
            let line = |line: &str| match line.strip_prefix("density_kg_m3 = ") {
                Some(density) => format!("density_kg_m3 = {:?}\n", factor * density.parse::<f64>().unwrap()),
                None => format!("{line}\n"),
            };
            let path = folder.path().join(format!("{name}.toml"));
            std::fs::write(&path, text.lines().map(line).collect::<String>()).unwrap();
            let output = run_era_on_scene(&["press", "--json"], &path);
            assert!(output.is_success(), "{name} {factor}: {}", output.error);
            let answer: Value = output.parse_json();
            let figures = |own: &Value| [&own["alone_um"], &own["error_bound"]].map(|value| value.as_f64().unwrap());
            answer["actuators"].as_array().unwrap().iter().map(figures).collect()
        };
        let as_it_is = pressed_with_density(1.0);
        for factor in [0.02, 50.0] {
            for ([own_um, own_bound], [other_um, bound]) in as_it_is.iter().zip(pressed_with_density(factor)) {
                let difference = (other_um / own_um - 1.0).abs();
                assert!(difference <= own_bound + bound + 1e-9, "{name} {factor}: {own_um} {other_um}");
            }
        }
    }
}

/// With stiffer springs the furthest place is another one, between the points of the grid, too.
#[test]
fn the_springs_that_are_named_withstand_the_press() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("sprung.toml");
    let text = std::fs::read_to_string(example("starting_plate")).unwrap();
    let (panel, _) = text.split_once("[[actuator]]").unwrap();
    let panel = panel.replace("stiffness_n_per_m = 2000.0", "stiffness_n_per_m = 20000.0");
    let panel = panel.replace("thickness_mm = 2.0", "thickness_mm = 1.2");
    let actuators_under_press = |places: [(f64, f64); 2], springs_n_per_m: [f64; 2]| -> Vec<Value> {
        let actuator = |((x, y), spring): (&(f64, f64), f64)| {
            format!(
                "[[actuator]]\nid = \"at {x:?}\"\nx_mm = {x:?}\ny_mm = {y:?}\nmount = \"grounded\"\nmoving_mass_g = 10.0\n\
                 stiffness_n_per_m = {spring:?}\ndamping_n_s_per_m = 0.7\nelectrode_area_mm2 = 1963.5\n\
                 air_gap_um = 500.0\nmax_voltage_v = 2000.0\n"
            )
        };
        let both: String = places.iter().zip(springs_n_per_m).map(actuator).collect();
        std::fs::write(&path, format!("{panel}{both}")).unwrap();
        let output = run_era_on_scene(&["press", "--json"], &path);
        assert!(output.is_success(), "{}", output.error);
        let answer: Value = output.parse_json();
        answer["actuators"].as_array().unwrap().clone()
    };
    for i in 0..12 {
        let i = f64::from(i);
        let places = [(40.0 + 7.0 * i, 30.0 + 11.0 * i), (280.0 - 5.0 * i, 170.0 - 9.0 * i)];
        let weak = actuators_under_press(places, [3000.0 + 900.0 * i, 9000.0 - 500.0 * i]);
        assert!(weak.iter().all(|own| own["stop"] == "assumed"), "{weak:?}");
        let named = [0, 1].map(|own| weak[own]["stiffness_n_per_m"].as_f64().unwrap());
        let sprung = actuators_under_press(places, named);
        assert!(sprung.iter().all(|own| own["stop"] == "none"), "{i}: {named:?}, {sprung:?}");
        // They are not more than is needed, either.
        let weaker = actuators_under_press(places, named.map(|spring| 0.99 * spring));
        assert!(weaker.iter().any(|own| own["stop"] == "assumed"), "{i}: {named:?}, {weaker:?}");
    }
}
