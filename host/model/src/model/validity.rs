//! Where the theory of thin plates and slender bars ends.

use crate::scene::{Scene, Side, SurfaceKind};

/// Thickness over length above which thin-plate theory is off by more than a percent or two.
const THIN: f64 = 1.0 / 30.0;
/// Error of thin-plate theory in a frequency that is worth a warning.
const SHEAR: f64 = 0.02;

/// What is wrong with taking a panel for thin up to a frequency, a sentence each: by the panel's side, and by the waves there.
#[must_use]
pub fn list_thin_plate_warnings(scene: &Scene, max_hz: f64) -> Vec<String> {
    let mut doubts = Vec::new();
    let thickest =
        scene.layout().areas_or_bar_lengths_with_layers().map(|(_, layer)| layer.thickness_m).fold(0.0, f64::max);
    let slenderness = thickest / shortest_length_along_which_panel_has_to_bend_m(scene);
    if slenderness > THIN {
        doubts.push(format!(
            "the thickness of the surface is {slenderness:.3} times the shortest length along which the surface \
             bends, but thin-plate theory is accurate only for a thickness of at most 0.033 times this length: the \
             model of the panel is a few percent too stiff"
        ));
    }
    let too_high = relative_overestimate_of_frequency_by_thin_theory(scene, max_hz);
    if too_high > SHEAR {
        doubts.push(format!(
            "at {max_hz} Hz the bending waves are so short compared with the thickness that computed frequencies are \
             about {:.0} % too high, because thin-plate theory neglects shear and rotary inertia",
            100.0 * too_high
        ));
    }
    doubts
}

/// The shortest side that the panel has to bend along at whatever low frequency: the longer one, and one with a line support
/// at its end. Across a narrow strip that nothing holds nothing bends below frequencies whose waves are as short, and for
/// those there is [`relative_overestimate_of_frequency_by_thin_theory`]; it is a bar, however it is called.
fn shortest_length_along_which_panel_has_to_bend_m(scene: &Scene) -> f64 {
    let surface = &scene.surface;
    let is_held = |sides: [Side; 2]| scene.edges.iter().any(|edge| sides.contains(&edge.side));
    match surface.kind {
        SurfaceKind::Bar => surface.length_m,
        SurfaceKind::Plate => {
            let longer = surface.length_m.max(surface.width_m);
            let along = is_held([Side::Left, Side::Right]).then_some(surface.length_m);
            let across = is_held([Side::Top, Side::Bottom]).then_some(surface.width_m);
            [along, across].into_iter().flatten().fold(longer, f64::min)
        }
    }
}

/// About how much too high thin-plate theory has a frequency, relative: (k h)^2 (1/12 + S) / 2 for the wavenumber k, S =
/// (1 + nu) / (6 kappa) for a bar's shear and 1 / (6 kappa (1 - nu)) for a plate's, kappa = 5/6 (Mindlin 1951, first order). What layers have
/// in place of h^2 / 12 and S h^2 follows from how shear is handed from one to the next; the softest of them counts most.
fn relative_overestimate_of_frequency_by_thin_theory(scene: &Scene, max_hz: f64) -> f64 {
    let (surface, material) = (&scene.surface, &scene.surface.material);
    let (h, nu) = (surface.thickness_m, material.poisson_ratio);
    let shear = match surface.kind {
        SurfaceKind::Plate => 0.2 / (1.0 - nu),
        SurfaceKind::Bar => 0.2 * (1.0 + nu),
    };
    // k^4 = 12 rho w^2 / (E h^2), a plate's less by 1 - nu^2.
    let omega = std::f64::consts::TAU * max_hz;
    if let Some(laminate) = surface.laminate_if_layered() {
        let least = match surface.kind {
            SurfaceKind::Plate => laminate.rigidities.least_and_largest_rigidity_over_directions()[0],
            SurfaceKind::Bar => laminate.rigidities.d11,
        };
        let square = omega * (laminate.per_area_kg_m2 / least).sqrt();
        return 0.5 * square * (laminate.turning_m2 + laminate.shear_m2);
    }
    let square = h * h * omega * (12.0 * material.density_kg_m3 / (material.youngs_modulus_pa * h * h)).sqrt();
    0.5 * square * (1.0 / 12.0 + shear)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A strip is the same panel as a plate and as a bar; it is stubby where it has to bend along a short side.
    #[test]
    fn the_side_that_bends_counts() {
        let strip = |kind: &str, length_mm: f64, width_mm: f64, edges: &str| {
            let text = format!(
                "version = 1\nname = \"strip\"\n[surface]\nkind = \"{kind}\"\nlength_mm = {length_mm}\nwidth_mm = {width_mm}\n\
                 thickness_mm = 2\n[surface.material]\nyoungs_modulus_pa = 69e9\npoisson_ratio = 0.33\n\
                 density_kg_m3 = 2700\n{edges}"
            );
            Scene::parse("strip", &text).unwrap()
        };
        let edge = |side: &str, kind: &str| format!("[[edge]]\nside = \"{side}\"\nkind = \"{kind}\"\n");
        for scene in [
            strip("bar", 300.0, 40.0, ""),
            strip("plate", 300.0, 40.0, ""),
            strip("plate", 40.0, 300.0, ""),
            strip("plate", 300.0, 40.0, &edge("left", "clamped")),
        ] {
            assert_eq!(shortest_length_along_which_panel_has_to_bend_m(&scene), 0.3, "{scene:?}");
        }
        assert_eq!(
            shortest_length_along_which_panel_has_to_bend_m(&strip("plate", 300.0, 40.0, &edge("top", "pinned"))),
            0.04
        );
        assert_eq!(shortest_length_along_which_panel_has_to_bend_m(&strip("plate", 40.0, 30.0, "")), 0.04);
        assert_eq!(shortest_length_along_which_panel_has_to_bend_m(&strip("bar", 40.0, 30.0, "")), 0.04);
    }
}
