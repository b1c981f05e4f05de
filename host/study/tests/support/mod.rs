//! A panel whose motion is known without a model.

use era_model::scene::Scene;

/// Of the bar in m.
pub const LENGTH_M: f64 = 0.137;
/// Of the bar in m.
pub const WIDTH_M: f64 = 0.041;
/// A bar of steel on two springs at its ends, with an actuator in its middle so light and soft that it is hardly there. Its numbers are written
/// here once more, as whoever knows a bar would write them.
pub fn bar(thickness_mm: f64) -> Scene {
    let text = format!(
        r#"
version = 1
name = "a bar on two springs"
[surface]
kind = "bar"
length_mm = 137.0
width_mm = 41.0
thickness_mm = {thickness_mm}
[surface.material]
youngs_modulus_pa = 200e9
poisson_ratio = 0.3
density_kg_m3 = 7850.0
[surface.damping]
loss_factor = 0.01
[screen]
width_px = 1000
height_px = 300
[[support]]
x_mm = 0.0
y_mm = 20.5
stiffness_n_per_m = 900.0
damping_n_s_per_m = 0.05
[[support]]
x_mm = 137.0
y_mm = 20.5
stiffness_n_per_m = 900.0
damping_n_s_per_m = 0.05
[[actuator]]
id = "only"
x_mm = 68.5
y_mm = 20.5
mount = "grounded"
moving_mass_g = 0.05
stiffness_n_per_m = 0.5
damping_n_s_per_m = 0.001
electrode_area_mm2 = 1963.5
air_gap_um = 500.0
max_voltage_v = 2000.0
"#
    );
    Scene::parse("bar", &text).unwrap()
}
