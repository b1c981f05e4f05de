//! Plans and tables against closed formulas, all combinations, and each other.

mod clicks;
mod clicks_everywhere;
mod drive_schemes;
mod finger;
mod harmonics;
mod optimum;
#[path = "../../../model/tests/numerics/scenes.rs"]
#[expect(dead_code, reason = "shared with other tests")]
mod scenes;
mod steady;
mod weak_springs;

use era_model::model::{Accuracy, PanelModel};
use era_model::scene::Scene;
use era_planner::{PlanTable, TableOptions};

/// The table of a scene's text, on the coarsest mesh.
fn build_table(text: &str) -> PlanTable {
    let scene = Scene::parse("test scene", text).unwrap();
    let options = TableOptions::default();
    let model = PanelModel::build(&scene, Accuracy::FAST, options.to_hz)
        .unwrap()
        .reduce_with_residual_shapes_of_actuators_damping_and_points(options.to_hz, &[])
        .unwrap();
    PlanTable::build(&scene, model, options).unwrap()
}
