//! Damping ratios of modes by their frequencies, against a bar's closed form: mode by mode, and as the sum over modes of what each does at a frequency.

use era_model::model::{Accuracy, PanelModel, compute_modes_with_error_bounds};
use era_model::response::compute_acceleration_curves_per_newton;
use era_model::scene::Scene;
use num_complex::Complex64;
use std::f64::consts::{PI, TAU};

const LENGTH_M: f64 = 0.371;
const THICKNESS_M: f64 = 2.3e-3;
const WIDTH_M: f64 = 0.031;
const E_PA: f64 = 3.1e9;
const KG_PER_M3: f64 = 1180.0;
/// Where it is driven and looked at, in parts of its length.
const DRIVEN: f64 = 0.23;
const SEEN: f64 = 0.41;

/// A pinned bar. Its ERA's mass and spring are next to nothing: it is there to push.
fn bar(modal_ratio: &str) -> Scene {
    let text = format!(
        "version = 1\nname = \"bar\"\n[surface]\nkind = \"bar\"\nlength_mm = {}\nwidth_mm = {}\nthickness_mm = {}\n\
         [surface.material]\nyoungs_modulus_pa = {E_PA}\ndensity_kg_m3 = {KG_PER_M3}\n\
         [surface.damping]\nmodal_ratio = {modal_ratio}\n\
         [[edge]]\nside = \"left\"\nkind = \"pinned\"\n[[edge]]\nside = \"right\"\nkind = \"pinned\"\n\
         [[actuator]]\nid = \"a\"\nx_mm = {}\ny_mm = {}\nmount = \"grounded\"\nmoving_mass_g = 0.0\nstiffness_n_per_m = 0.0\n\
         electrode_area_mm2 = 400.0\nair_gap_um = 200.0\nmax_voltage_v = 2000.0\n",
        LENGTH_M * 1e3,
        WIDTH_M * 1e3,
        THICKNESS_M * 1e3,
        DRIVEN * LENGTH_M * 1e3,
        WIDTH_M * 500.0
    );
    Scene::parse("bar", &text).unwrap()
}

/// (n pi / L)^2 sqrt(E I / (rho A)), in rad/s.
fn omega(n: u32) -> f64 {
    (f64::from(n) * PI / LENGTH_M).powi(2) * (E_PA * THICKNESS_M.powi(2) / (12.0 * KG_PER_M3)).sqrt()
}

/// The table of [`TABLE`], worked out by hand.
const TABLE: &str = "[[30, 0.05], [120, 0.01], [300, 0.04]]";
fn ratio(hz: f64) -> f64 {
    match hz {
        hz if hz < 30.0 => 0.05,
        hz if hz < 120.0 => 0.05 - 0.04 * (hz - 30.0) / 90.0,
        hz if hz < 300.0 => 0.01 + 0.03 * (hz - 120.0) / 180.0,
        _ => 0.04,
    }
}

#[test]
fn each_mode_has_the_ratio_of_its_frequency() {
    let found =
        compute_modes_with_error_bounds(&bar(TABLE), Accuracy::from_tolerance(1e-6).unwrap(), 500.0).unwrap().answer;
    assert!(found.len() >= 5, "{}", found.len());
    for (n, mode) in (1..).zip(&found) {
        let hz = omega(n) / TAU;
        assert!((mode.frequency_hz / hz - 1.0).abs() < 1e-5, "{n}: {} for {hz}", mode.frequency_hz);
        assert!((mode.damping_ratio / ratio(hz) - 1.0).abs() < 1e-4, "{n}: {} for {}", mode.damping_ratio, ratio(hz));
    }
}

/// -w^2 sum of 2 / (rho A L) sin(n pi a) sin(n pi b) / (w_n^2 - w^2 + 2 j zeta_n w_n w). Seen to fail with the ratios of the table's first point on all
/// modes, and with each mode's ratio taken at the frequency of the drive.
#[test]
fn a_response_is_the_sum_over_modes_with_their_ratios() {
    let scene = bar(TABLE);
    let model = PanelModel::build(&scene, Accuracy::from_tolerance(1e-5).unwrap(), 400.0).unwrap();
    let model = model
        .reduce_with_residual_shapes_of_actuators_damping_and_points(400.0, &[(SEEN * LENGTH_M, WIDTH_M / 2.0)])
        .unwrap();
    let hz: Vec<f64> = (1..80).map(|k| 5.0 * f64::from(k) + 0.3).collect();
    let shape = model.shape_deflections_at(SEEN * LENGTH_M, WIDTH_M / 2.0);
    let found = compute_acceleration_curves_per_newton(&model, &shape, &hz).unwrap().remove(0);
    let mass_kg = KG_PER_M3 * THICKNESS_M * WIDTH_M * LENGTH_M;
    let wanted: Vec<Complex64> = hz
        .iter()
        .map(|hz| {
            let w = TAU * hz;
            let mode = |n: u32| {
                let (own, at) = (omega(n), |part: f64| (f64::from(n) * PI * part).sin());
                let below = Complex64::new(own * own - w * w, 2.0 * ratio(own / TAU) * own * w);
                2.0 / mass_kg * at(DRIVEN) * at(SEEN) / below
            };
            -w * w * (1..4000).map(mode).sum::<Complex64>()
        })
        .collect();
    let peak = wanted.iter().map(|a| a.norm()).fold(0.0, f64::max);
    let off = found.iter().zip(&wanted).map(|(a, b)| (a - b).norm() / peak).fold(0.0, f64::max);
    assert!(off < 1e-4, "{off:e}");
}

/// To rounding: a table of one ratio is that ratio.
#[test]
fn a_table_that_is_level_is_one_number() {
    let modes = |text: &str| compute_modes_with_error_bounds(&bar(text), Accuracy::BALANCED, 400.0).unwrap().answer;
    let (number, table) = (modes("0.02"), modes("[[50, 0.02], [200, 0.02]]"));
    assert_eq!(number.len(), table.len());
    for (a, b) in number.iter().zip(&table) {
        assert!((a.damping_ratio / b.damping_ratio - 1.0).abs() < 1e-9);
    }
}

#[test]
fn a_wrong_table_is_reported_with_what_is_allowed() {
    let text = |table: &str| bar_text_error(table);
    for table in [
        "[]",
        "[[50, 0.02], [40, 0.01]]",
        "[[50, 0.02], [50, 0.01]]",
        "[[50, -0.1]]",
        "[[50]]",
        "[0.1, 0.2]",
        "[[50, 11]]",
    ] {
        let error = text(table);
        assert!(
            error.contains("surface.damping.modal_ratio is ") && error.contains("pairs [frequency in Hz"),
            "{error}"
        );
    }
    assert!(text("\"much\"").contains("a number from 0 to 10"), "{}", text("\"much\""));
}

fn bar_text_error(table: &str) -> String {
    let text = format!(
        "version = 1\nname = \"bar\"\n[surface]\nkind = \"bar\"\nlength_mm = 300\nwidth_mm = 20\nthickness_mm = 2\n\
         [surface.material]\nyoungs_modulus_pa = 7e10\ndensity_kg_m3 = 2700\n[surface.damping]\nmodal_ratio = {table}\n"
    );
    Scene::parse("bar", &text).unwrap_err().to_string()
}
