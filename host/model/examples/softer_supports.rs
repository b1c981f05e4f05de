//! How the modes of the example plate follow the springs at its corners, and what a force at one actuator does in the middle of the plate.
//!
//! `cargo run --release -p era-model --example softer_supports`

use era_model::model::{Accuracy, PanelModel};
use era_model::response::compute_acceleration_curves_per_newton_with_error_bounds;
use era_model::scene::{EXAMPLE_PLATE, Scene};
use std::error::Error;

fn main() -> Result<(), Box<dyn Error>> {
    let scene = Scene::parse("plate.toml", EXAMPLE_PLATE)?;
    for factor in [0.5, 1.0, 2.0] {
        let mut changed = scene.clone();
        changed.supports.iter_mut().for_each(|support| support.stiffness_n_per_m *= factor);
        let modes =
            PanelModel::build(&changed, Accuracy::BALANCED, 400.0)?.compute_mode_frequencies_and_poles(400.0)?;
        let hz: Vec<String> = modes.iter().take(5).map(|mode| format!("{:.1}", mode.frequency_hz)).collect();
        println!("modes with the stiffness of the supports times {factor}: {} Hz", hz.join(", "));
    }
    let middle = (scene.surface.length_m / 2.0, scene.surface.width_m / 2.0);
    let found =
        compute_acceleration_curves_per_newton_with_error_bounds(&scene, Accuracy::BALANCED, middle, &[100.0, 200.0])?;
    for (actuator, (curve, bound)) in scene.actuators.iter().zip(found.answer.iter().zip(&found.bounds)) {
        let bound = bound.limit_if_known().map_or("unknown".to_owned(), |bound| format!("{bound:.1e}"));
        println!(
            "{}: {:.2} m/s^2 per N at 100 Hz, {:.2} m/s^2 per N at 200 Hz, relative error at most {bound}",
            actuator.id,
            curve[0].norm(),
            curve[1].norm()
        );
    }
    Ok(())
}

#[test]
fn it_runs() {
    main().unwrap();
}
