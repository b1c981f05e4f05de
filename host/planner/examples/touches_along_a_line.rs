//! Plans of touches from left to right across the example plate: who vibrates at which frequency, and what is felt there and elsewhere.
//!
//! `cargo run --release -p era-planner --example touches_along_a_line`

use era_model::model::Accuracy;
use era_model::model::levels::ReducedLevels;
use era_model::scene::{EXAMPLE_PLATE, Scene};
use era_planner::{PlanTable, TableOptions, Target};
use std::error::Error;

fn main() -> Result<(), Box<dyn Error>> {
    let scene = Scene::parse("plate.toml", EXAMPLE_PLATE)?;
    let grid = TableOptions::default();
    let table = PlanTable::from_levels(&scene, ReducedLevels::build(&scene, Accuracy::BALANCED, grid.to_hz)?, grid)?;
    for tenth in [1.0, 3.0, 5.0, 7.0, 9.0] {
        let (x_m, y_m) = (scene.surface.length_m * tenth / 10.0, scene.surface.width_m * 0.4);
        let plan = table.plan(&[Target { x_m, y_m, intensity_g: Some(0.3) }])?;
        let drives: Vec<String> = plan
            .drives
            .iter()
            .map(|drive| format!("{} {:.0} Hz {:.0} V", drive.actuator, drive.frequency_hz, drive.voltage_v))
            .collect();
        let predicted = &plan.predicted;
        println!(
            "touch at {:5.1} mm: {:.3} g at the target, contrast {:.1} dB; {}",
            x_m * 1e3,
            predicted.target_peak_g,
            predicted.contrast_db,
            drives.join(", ")
        );
    }
    Ok(())
}

#[test]
fn it_runs() {
    main().unwrap();
}
