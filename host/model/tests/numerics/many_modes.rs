//! Hundreds of modes beside slow motions of heavy ERAs, on a soft panel of three layers.

use era_model::model::{Accuracy, PanelModel};
use era_model::scene::Scene;
use std::fmt::Write;

/// A table top of 2.9 x 1.4 m with two sides pinned, springs of two sizes at its corners, and two ERAs of 36 kg.
fn table_top() -> Scene {
    let mut text = String::from(
        "version = 1\nname = \"a table top\"\n[surface]\nkind = \"plate\"\nlength_mm = 2947.0\nwidth_mm = 1416.0\n\
         [[edge]]\nside = \"right\"\nkind = \"pinned\"\n[[edge]]\nside = \"left\"\nkind = \"pinned\"\n",
    );
    for (y_mm, stiffness, damping) in [(0.0, 18_882_070.0, 8125.6004), (1416.0, 1_619_227_695_670.0, 43_941.0)] {
        for x_mm in [0.0, 2947.0] {
            let _ = write!(
                text,
                "[[support]]\nx_mm = {x_mm:?}\ny_mm = {y_mm:?}\nstiffness_n_per_m = {stiffness}\ndamping_n_s_per_m = {damping}\n\
                 loss_factor = 0.8542\n"
            );
        }
    }
    for (id, x_mm, y_mm) in [("era0", 2192.0, 1416.0), ("era1", 1371.0, 1217.0)] {
        let _ = write!(
            text,
            "[[actuator]]\nid = \"{id}\"\nx_mm = {x_mm:?}\ny_mm = {y_mm:?}\nmount = \"inertial\"\nmoving_mass_g = 19542.7858\n\
             stiffness_n_per_m = 13659860.8558\ndamping_n_s_per_m = 978.1281\nhousing_mass_g = 16200.3385\n\
             electrode_area_mm2 = 2125.6556\nair_gap_um = 706.0\nmax_voltage_v = 616.0\n"
        );
    }
    let layers = [
        (2.9602, 90, [3_571_732_631.0, 644_779_706.0, 516_935_177.0, 8287.8803, 0.1662]),
        (23.6566, 0, [4_529_483_686.0, 596_836_982.0, 559_403_188.0, 5539.1526, 1.2318]),
        (16.5831, 90, [3_247_695_555.0, 541_882_297.0, 231_921_216.0, 6487.3831, 0.6957]),
    ];
    for (thickness_mm, angle_deg, [ex, ey, g, density, poisson]) in layers {
        let _ = write!(
            text,
            "[[layer]]\nthickness_mm = {thickness_mm}\nangle_deg = {angle_deg}\n[layer.material]\nex_pa = {ex}\ney_pa = {ey}\n\
             g_pa = {g}\ndensity_kg_m3 = {density}\npoisson_ratio = {poisson}\n"
        );
    }
    Scene::parse("scene.toml", &text).unwrap()
}

/// Small values of the inverted operator are right to the rounding of its largest, and asked for no better: asked for more, the search went on until it had
/// no more vectors. The modes are those of coarser elements.
#[test]
fn hundreds_of_modes_beside_slow_ones_are_found() {
    let scene = table_top();
    let found = [Accuracy::FAST, Accuracy::REFERENCE].map(|accuracy| {
        let model = PanelModel::build(&scene, accuracy, 400.0).unwrap();
        assert!(
            model.reduce_with_residual_shapes_of_actuators_damping_and_points(400.0, &[]).unwrap().count_coordinates()
                > 100
        );
        model
            .compute_mode_frequencies_and_poles(400.0)
            .unwrap()
            .iter()
            .map(|mode| mode.frequency_hz)
            .collect::<Vec<_>>()
    });
    assert_eq!(found[0].len(), found[1].len());
    for (coarse, fine) in found[0].iter().zip(&found[1]) {
        assert!((coarse / fine - 1.0).abs() < 1e-3, "{coarse} for {fine}");
    }
}
