//! Panels with known frequencies, as scene files.
//!
//! The numbers are those of closed equations (pinned plate, Levy, bars) or of converged Legendre-Ritz (the others).

use std::f64::consts::{PI, TAU};
use std::fmt::Write;

const YOUNGS_MODULUS_PA: f64 = 70e9;
const DENSITY_KG_M3: f64 = 2700.0;
const POISSON: f64 = 0.3;
const LENGTH_M: f64 = 0.25;
const THICKNESS_M: f64 = 1e-3;

/// A panel and what is known of it.
#[derive(Clone, Debug)]
pub struct ReferencePanel {
    /// Its name.
    pub name: &'static str,
    /// The scene's file.
    pub scene: String,
    /// Elastic modes in Hz, ascending.
    pub frequencies_hz: Vec<f64>,
}

/// All panels with known frequencies.
#[must_use]
pub fn list_reference_panels() -> Vec<ReferencePanel> {
    let rigidity = YOUNGS_MODULUS_PA * THICKNESS_M.powi(3) / (12.0 * (1.0 - POISSON * POISSON));
    // k a^2 / D = 1.
    let spring = rigidity / (LENGTH_M * LENGTH_M);
    let make_support = |x: f64, y: f64, stiffness: f64| {
        format!("[[support]]\nx_mm = {}\ny_mm = {}\nstiffness_n_per_m = {stiffness:e}\n", x * 1e3, y * 1e3)
    };
    let make_corner_supports = |stiffness: f64| {
        let corners_m = [(0.0, 0.0), (LENGTH_M, 0.0), (0.0, LENGTH_M), (LENGTH_M, LENGTH_M)];
        corners_m.map(|(x, y)| make_support(x, y, stiffness)).concat()
    };
    let pinned = make_edges_toml(&["left", "right", "top", "bottom"], "pinned");
    let (vertical, horizontal) = (["left", "right"], ["top", "bottom"]);
    let squares = |most: i32| {
        let mut all: Vec<f64> =
            (1..=most).flat_map(|m| (1..=most).map(move |n| PI * PI * f64::from(m * m + n * n))).collect();
        all.sort_by(f64::total_cmp);
        all
    };
    let make_plate =
        |name, supports_toml: &str, lambda: &[f64]| make_reference_plate(name, rigidity, supports_toml, lambda);
    vec![
        make_plate("pinned plate", &pinned, &squares(6)[..12]),
        make_plate(
            "clamped plate",
            &make_edges_toml(&["left", "right", "top", "bottom"], "clamped"),
            &[35.985_191_12, 73.393_845_52, 73.393_845_52, 108.216_501_69, 131.580_772_61, 132.204_790_2],
        ),
        make_plate(
            "free plate",
            "",
            &[13.468_197_35, 19.596_137_36, 24.270_200_89, 34.800_891_01, 34.800_891_01, 61.093_234_03, 61.093_234_03],
        ),
        make_plate("plate SFSF", &make_edges_toml(&vertical, "pinned"), &[9.631_384_87, 16.134_777_02]),
        make_plate(
            "plate SCSC",
            &(make_edges_toml(&vertical, "pinned") + &make_edges_toml(&horizontal, "clamped")),
            &[28.950_850_37, 54.743_070_75],
        ),
        make_plate(
            "corner springs, k a^2/D = 100",
            &make_corner_supports(100.0 * spring),
            &[6.723_500_649, 14.517_204_74, 14.517_204_74],
        ),
        make_plate(
            "pinned plate, centre spring k a^2/D = 100",
            &(pinned + &make_support(0.5 * LENGTH_M, 0.5 * LENGTH_M, 100.0 * spring)),
            &[27.208_098_121],
        ),
        make_reference_bar("free bar", "", &[4.730_040_745, 7.853_204_624, 10.995_607_84, 14.137_165_49]),
        make_reference_bar(
            "clamped-pinned bar",
            &(make_edges_toml(&["left"], "clamped") + &make_edges_toml(&["right"], "pinned")),
            &[3.926_602_312, 7.068_582_746, 10.210_176_12, 13.351_768_78],
        ),
    ]
}

fn make_edges_toml(sides: &[&str], kind: &str) -> String {
    sides.iter().map(|side| format!("[[edge]]\nside = \"{side}\"\nkind = \"{kind}\"\n")).collect()
}

fn make_scene_toml(name: &str, kind: &str, width_m: f64, supports_toml: &str) -> String {
    let mut text = format!("version = 1\nname = \"{name}\"\n[surface]\nkind = \"{kind}\"\n");
    let sizes = [("length_mm", LENGTH_M * 1e3), ("width_mm", width_m * 1e3), ("thickness_mm", THICKNESS_M * 1e3)];
    for (key, value) in sizes {
        let _ = writeln!(text, "{key} = {value:e}");
    }
    let material =
        [("youngs_modulus_pa", YOUNGS_MODULUS_PA), ("poisson_ratio", POISSON), ("density_kg_m3", DENSITY_KG_M3)];
    text.push_str("[surface.material]\n");
    for (key, value) in material {
        let _ = writeln!(text, "{key} = {value:e}");
    }
    text + "[screen]\nwidth_px = 1000\nheight_px = 1000\n" + supports_toml
}

/// A square plate; lambda = omega a^2 sqrt(rho h / D).
fn make_reference_plate(name: &'static str, rigidity: f64, supports_toml: &str, lambda: &[f64]) -> ReferencePanel {
    let unit = (rigidity / (DENSITY_KG_M3 * THICKNESS_M)).sqrt() / (LENGTH_M * LENGTH_M) / TAU;
    let frequencies_hz = lambda.iter().map(|lambda| lambda * unit).collect();
    ReferencePanel { name, scene: make_scene_toml(name, "plate", LENGTH_M, supports_toml), frequencies_hz }
}

/// A bar; omega = (b L)^2 sqrt(E I / (rho A L^4)).
fn make_reference_bar(name: &'static str, supports_toml: &str, b_l: &[f64]) -> ReferencePanel {
    let unit =
        (YOUNGS_MODULUS_PA * THICKNESS_M * THICKNESS_M / (12.0 * DENSITY_KG_M3)).sqrt() / (LENGTH_M * LENGTH_M) / TAU;
    let frequencies_hz = b_l.iter().map(|b_l| b_l * b_l * unit).collect();
    ReferencePanel { name, scene: make_scene_toml(name, "bar", 0.02, supports_toml), frequencies_hz }
}

#[cfg(test)]
mod tests {
    use super::*;
    use era_model::scene::Scene;

    #[test]
    fn every_reference_is_a_scene() {
        for reference in list_reference_panels() {
            Scene::parse(reference.name, &reference.scene).unwrap();
            assert!(reference.frequencies_hz.is_sorted(), "{}", reference.name);
        }
    }
}
