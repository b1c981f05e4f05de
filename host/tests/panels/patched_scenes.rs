//! The examples with patches and cut-outs: planned for, served, drawn.

use crate::support;
use era::model::Accuracy;
use era::model::levels::ReducedLevels;
use era::planner::{PlanTable, TableOptions, Target};
use era::scene::Scene;
use serde_json::json;
use support::Daemon;
use support::browser::{Browser, program};

fn example(name: &str) -> String {
    let path = format!("{}/../examples/scenes/{name}.toml", env!("CARGO_MANIFEST_DIR"));
    std::fs::read_to_string(path).unwrap()
}

/// Each example is read, modelled and planned for; in the camera's hole there is nothing to touch, and no value on the map.
#[test]
fn examples_are_planned_for() {
    for name in ["bezel", "camera", "stepped_bar"] {
        let scene = Scene::parse(name, &example(name)).unwrap();
        let options = TableOptions { from_hz: 40.0, to_hz: 200.0, step_hz: 4.0 };
        let levels = ReducedLevels::build_with_order_and_two_lower(
            &scene,
            Accuracy::FAST.choose_element_order_for_tolerance(),
            options.to_hz,
        )
        .unwrap();
        let table = PlanTable::from_levels(&scene, levels, options).unwrap();
        let target = |x_m: f64, y_m: f64| Target { x_m, y_m, intensity_g: Some(0.3) };
        let plan = table.plan(&[target(0.05, 0.01)]).unwrap();
        assert!(plan.predicted.target_peak_g > 0.29, "{name}: {plan:?}");
        assert!(plan.error_bound.unwrap() < 0.02, "{name}: {plan:?}");
        let field = table.compute_peak_at_each_grid_point_m_per_s2(&plan);
        let has_hole = name == "camera";
        assert_eq!(field.iter().any(Option::is_none), has_hole, "{name}");
        assert!((table.grid.weights.iter().sum::<f64>() - 1.0).abs() < 1e-12);
        if has_hole {
            let told = table.plan(&[target(0.15, 0.02)]).unwrap_err().to_string();
            assert!(told.contains("x_mm = 150 and y_mm = 20") && told.contains("cutout[1]"), "{told}");
            let csv = era::maps::PeakField::from_plan(&table, &plan).to_csv();
            assert!(csv.lines().any(|line| line.starts_with("150.000,") && line.ends_with(',')), "{csv}");
        }
    }
}

#[test]
fn a_hole_is_served_and_drawn_and_not_touched() {
    let daemon = Daemon::start(&example("camera"));
    let (_, scene) = daemon.get("/v1/scene");
    assert_eq!(scene["cutouts"], json!([{"x_mm": 135.0, "y_mm": 12.0, "length_mm": 30.0, "width_mm": 14.0}]));
    assert_eq!(scene["patches"], json!([]));
    // (150, 20) mm.
    let (status, _, told) = daemon.post("/v1/touch", r#"{"x_px": 960, "y_px": 128}"#);
    assert_eq!(status, 400, "{told}");
    assert!(told["type"].as_str().unwrap().ends_with("in-cutout"), "{told}");
    assert!(told["detail"].as_str().unwrap().contains("cutout[1]"), "{told}");
    let (status, _, told) = daemon.post("/v1/touch", r#"{"x_px": 960, "y_px": 640, "duration_ms": 5000}"#);
    assert_eq!(status, 200, "{told}");
    let (_, field) = daemon.get("/v1/field");
    let peaks = field["peak_g"].as_array().unwrap();
    assert!(peaks.iter().any(serde_json::Value::is_null) && peaks.iter().any(|peak| peak.as_f64() > Some(0.1)));
    let Some(program) = program() else {
        assert!(std::env::var_os("ERA_NO_BROWSER").is_some(), "no Chromium here: install it, or set ERA_NO_BROWSER");
        return;
    };
    let mut browser = Browser::start(program, 1280, 800);
    browser.open(&daemon.url);
    browser.wait_for("document.querySelectorAll('#overlay .cutout').length === 1");
    browser.wait_for("Number(document.querySelector('#heat').dataset.maxG) > 0");
    if let Some(folder) = std::env::var_os("ERA_SCREENSHOTS") {
        std::fs::write(std::path::Path::new(&folder).join("camera.png.base64"), browser.screenshot()).unwrap();
    }
}
