//! Bounds of a plan's harmonics, which lie above the band that the plan's mesh was chosen for.

use era_model::model::Accuracy;
use era_model::model::levels::ReducedLevels;
use era_model::scene::Scene;
use era_planner::report::build_harmonics_and_timing_report_at_first_target;
use era_planner::{FirstTargetReport, PlanTable, Request, TableOptions, Target};

/// A thin plate of odd size whose resonances near 950 Hz are sharp: on the mesh of its plans harmonics were 6 % off.
const THIN: &str = r#"
version = 1
name = "thin plate"

[surface]
kind = "plate"
length_mm = 256.0
width_mm = 83.0
damping = { rayleigh_alpha = 0.157, rayleigh_beta = 3.88e-7 }

[screen]
width_px = 2560
height_px = 830

[[support]]
x_mm = 0.0
y_mm = 0.0
stiffness_n_per_m = 1.4e11
damping_n_s_per_m = 1.34

[[support]]
x_mm = 256.0
y_mm = 0.0
stiffness_n_per_m = 50.4
damping_n_s_per_m = 0.073

[[support]]
x_mm = 0.0
y_mm = 83.0
stiffness_n_per_m = 3551.0
damping_n_s_per_m = 0.62

[[support]]
x_mm = 256.0
y_mm = 83.0
stiffness_n_per_m = 3551.0
damping_n_s_per_m = 0.62

[[mass]]
x_mm = 33.0
y_mm = 83.0
mass_g = 8.2

[[actuator]]
id = "first"
x_mm = 152.0
y_mm = 79.0
mount = "inertial"
moving_mass_g = 1.75
housing_mass_g = 2.96
stiffness_n_per_m = 409.0
damping_n_s_per_m = 0.21
electrode_area_mm2 = 309.0
air_gap_um = 411.0
max_voltage_v = 553.0

[[actuator]]
id = "second"
x_mm = 188.0
y_mm = 27.0
mount = "inertial"
moving_mass_g = 0.48
stiffness_n_per_m = 665.0
damping_n_s_per_m = 0.147
electrode_area_mm2 = 1850.0
air_gap_um = 263.0
max_voltage_v = 1896.0

[press]
force_n = 0.13

[[layer]]
thickness_mm = 0.013
material = { youngs_modulus_pa = 1.32e11, density_kg_m3 = 6350.0, poisson_ratio = 0.3 }

[[layer]]
thickness_mm = 0.228
material = { youngs_modulus_pa = 1.56e11, density_kg_m3 = 7439.0, poisson_ratio = 0.3 }
"#;

fn report(scene: &Scene, accuracy: Accuracy, (x_m, y_m): (f64, f64)) -> FirstTargetReport {
    let options = TableOptions::default();
    let levels = ReducedLevels::build(scene, accuracy, options.to_hz).unwrap();
    let table = PlanTable::from_levels(scene, levels, options).unwrap();
    let target = Target { x_m, y_m, intensity_g: Some(2.0) };
    build_harmonics_and_timing_report_at_first_target(
        &table,
        &table.plan_with_details(&Request::for_touch(&[target])).unwrap(),
    )
}

/// Whatever the plan's tolerance is, the harmonics of its drives are the same within their bounds, and the bound says something.
#[test]
fn harmonics_keep_their_bounds_at_any_tolerance() {
    let scene = Scene::parse("thin plate", THIN).unwrap();
    // More than any place reaches: windows are wide then, and harmonics strong.
    let mut compared = 0;
    for at in [(0.172, 0.073), (0.061, 0.022), (0.203, 0.041)] {
        let of = |accuracy| report(&scene, accuracy, at);
        let finest = of(Accuracy::REFERENCE);
        for rough in [of(Accuracy::FAST)] {
            let found = [&rough, &finest].map(|report| report.harmonics_g);
            let Some(bound) = rough.harmonics_error_bound.zip(finest.harmonics_error_bound).map(|(a, b)| a + b) else {
                // Windows that drop what would be below 1 kHz leave rounding, of which nothing is told.
                assert!(found.iter().all(|g| *g < 1e-9), "at {at:?}: {found:?}");
                continue;
            };
            compared += 1;
            assert!((0.0..0.1).contains(&bound), "{bound}");
            // The drives differ by rounding of their frequencies between the levels, far below this.
            let apart = (found[0] - found[1]).abs() / found[1];
            assert!(apart <= bound, "at {at:?}: {found:?} g, {apart:.1e} of {bound:.1e}");
            let [a, b] = [&rough, &finest].map(|report| report.strongest_harmonic_db.unwrap());
            let bound_db: f64 =
                [&rough, &finest].map(|report| report.strongest_harmonic_error_db.unwrap()).iter().sum();
            assert!((a - b).abs() <= bound_db, "at {at:?}: {a} for {b} dB, within {bound_db}");
        }
    }
    assert!(compared >= 2, "{compared}");
}
