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
pub struct Reference {
    /// Its name.
    pub name: &'static str,
    /// The scene's file.
    pub scene: String,
    /// Elastic modes in Hz, ascending.
    pub frequencies_hz: Vec<f64>,
}

/// All of them.
#[must_use]
pub fn references() -> Vec<Reference> {
    let rigidity = YOUNGS_MODULUS_PA * THICKNESS_M.powi(3) / (12.0 * (1.0 - POISSON * POISSON));
    // k a^2 / D = 1.
    let spring = rigidity / (LENGTH_M * LENGTH_M);
    let support = |x: f64, y: f64, stiffness: f64| {
        format!("[[support]]\nx_mm = {}\ny_mm = {}\nstiffness_n_per_m = {stiffness:e}\n", x * 1e3, y * 1e3)
    };
    let corners = |stiffness: f64| {
        let at = [(0.0, 0.0), (LENGTH_M, 0.0), (0.0, LENGTH_M), (LENGTH_M, LENGTH_M)];
        at.map(|(x, y)| support(x, y, stiffness)).concat()
    };
    let pinned = edges(&["left", "right", "top", "bottom"], "pinned");
    let (vertical, horizontal) = (["left", "right"], ["top", "bottom"]);
    let squares = |most: i32| {
        let mut all: Vec<f64> =
            (1..=most).flat_map(|m| (1..=most).map(move |n| PI * PI * f64::from(m * m + n * n))).collect();
        all.sort_by(f64::total_cmp);
        all
    };
    let plate = |name, held: &str, lambda: &[f64]| plate(name, rigidity, held, lambda);
    vec![
        plate("pinned plate", &pinned, &squares(6)[..12]),
        plate(
            "clamped plate",
            &edges(&["left", "right", "top", "bottom"], "clamped"),
            &[35.985_191_12, 73.393_845_52, 73.393_845_52, 108.216_501_69, 131.580_772_61, 132.204_790_2],
        ),
        plate(
            "free plate",
            "",
            &[13.468_197_35, 19.596_137_36, 24.270_200_89, 34.800_891_01, 34.800_891_01, 61.093_234_03, 61.093_234_03],
        ),
        plate("plate SFSF", &edges(&vertical, "pinned"), &[9.631_384_87, 16.134_777_02]),
        plate(
            "plate SCSC",
            &(edges(&vertical, "pinned") + &edges(&horizontal, "clamped")),
            &[28.950_850_37, 54.743_070_75],
        ),
        plate(
            "corner springs, k a^2/D = 100",
            &corners(100.0 * spring),
            &[6.723_500_649, 14.517_204_74, 14.517_204_74],
        ),
        plate(
            "pinned plate, centre spring k a^2/D = 100",
            &(pinned + &support(0.5 * LENGTH_M, 0.5 * LENGTH_M, 100.0 * spring)),
            &[27.208_098_121],
        ),
        bar("free bar", "", &[4.730_040_745, 7.853_204_624, 10.995_607_84, 14.137_165_49]),
        bar(
            "clamped-pinned bar",
            &(edges(&["left"], "clamped") + &edges(&["right"], "pinned")),
            &[3.926_602_312, 7.068_582_746, 10.210_176_12, 13.351_768_78],
        ),
    ]
}

fn edges(sides: &[&str], kind: &str) -> String {
    sides.iter().map(|side| format!("[[edge]]\nside = \"{side}\"\nkind = \"{kind}\"\n")).collect()
}

fn scene(name: &str, kind: &str, width_m: f64, held: &str) -> String {
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
    text + "[screen]\nwidth_px = 1000\nheight_px = 1000\n" + held
}

/// A square plate; lambda = omega a^2 sqrt(rho h / D).
fn plate(name: &'static str, rigidity: f64, held: &str, lambda: &[f64]) -> Reference {
    let unit = (rigidity / (DENSITY_KG_M3 * THICKNESS_M)).sqrt() / (LENGTH_M * LENGTH_M) / TAU;
    let frequencies_hz = lambda.iter().map(|lambda| lambda * unit).collect();
    Reference { name, scene: scene(name, "plate", LENGTH_M, held), frequencies_hz }
}

/// A bar; omega = (b L)^2 sqrt(E I / (rho A L^4)).
fn bar(name: &'static str, held: &str, b_l: &[f64]) -> Reference {
    let unit =
        (YOUNGS_MODULUS_PA * THICKNESS_M * THICKNESS_M / (12.0 * DENSITY_KG_M3)).sqrt() / (LENGTH_M * LENGTH_M) / TAU;
    let frequencies_hz = b_l.iter().map(|b_l| b_l * b_l * unit).collect();
    Reference { name, scene: scene(name, "bar", 0.02, held), frequencies_hz }
}

#[cfg(test)]
mod tests {
    use super::*;
    use era_model::scene::Scene;

    #[test]
    fn every_reference_is_a_scene() {
        for reference in references() {
            Scene::parse(reference.name, &reference.scene).unwrap();
            assert!(reference.frequencies_hz.is_sorted(), "{}", reference.name);
        }
    }
}
