//! `[[layer]]` in the scene file.

use super::SurfaceKind;
use super::laminate::{Elastic, Ply};
use super::ranges::{DENSITY_KG_M3, LOSS_FACTOR, MAX_THICKNESS_MM, POISSON_RATIO, THICKNESS_MM, YOUNGS_MODULUS_PA};
use super::read::{Allowed, Section};

/// Part by which a surface's thickness may differ from the sum of its layers': nobody writes more digits.
const SAME_THICKNESS: f64 = 1e-6;

/// Keys that only a material with axes has.
const WITH_AXES: [&str; 3] = ["ex_pa", "ey_pa", "g_pa"];

/// All `[[layer]]`, from the bottom to the top; empty if there are none.
pub(super) fn layers(sections: Vec<Section<'_, '_>>, kind: SurfaceKind) -> Vec<Ply> {
    let mut plies: Vec<Ply> = Vec::new();
    for section in sections {
        let thickness_m = section.number("thickness_mm", THICKNESS_MM) / 1e3;
        let (elastic, density_kg_m3) =
            section.required_table("material").map_or((Elastic::isotropic(f64::NAN, f64::NAN), f64::NAN), |table| {
                let read = (elastic(&table, kind), table.number("density_kg_m3", DENSITY_KG_M3));
                table.close();
                read
            });
        let elastic = if is_turned(&section) { elastic.turned() } else { elastic };
        let loss_factor = section.number_or("loss_factor", 0.0, LOSS_FACTOR);
        let has_bond = section.has("bond");
        let slips = has_bond && section.word("bond", &[("bonded", false), ("slips", true)]).unwrap_or(false);
        if slips && plies.is_empty() {
            section.wrong("bond", String::from("\"slips\""), "left out of the lowest layer, which lies on none");
        }
        let total_mm = 1e3 * (thickness_m + plies.iter().map(|ply| ply.thickness_m).sum::<f64>());
        if total_mm > MAX_THICKNESS_MM {
            let text = format!(
                "{} makes the layers {total_mm} mm thick, but must keep them within {MAX_THICKNESS_MM} mm",
                section.key("thickness_mm")
            );
            section.report().add(&section.place("thickness_mm"), text);
        }
        plies.push(Ply { thickness_m, elastic, density_kg_m3, loss_factor, slips });
        section.close();
    }
    plies
}

/// Whether a layer lies with its material's x along the surface's y.
fn is_turned(section: &Section<'_, '_>) -> bool {
    let angle = section.number_or("angle_deg", 0.0, Allowed::Within(0.0, 90.0));
    if angle > 0.0 && angle < 90.0 {
        section.wrong("angle_deg", angle.to_string(), "0 or 90: the material's axes along those of the surface");
    }
    angle > 0.0
}

fn elastic(table: &Section<'_, '_>, kind: SurfaceKind) -> Elastic {
    let poisson = |allowed| match kind {
        SurfaceKind::Plate => table.number("poisson_ratio", allowed),
        SurfaceKind::Bar => table.number_or("poisson_ratio", 0.0, allowed),
    };
    if !WITH_AXES.iter().any(|key| table.has(key)) {
        return Elastic::isotropic(table.number("youngs_modulus_pa", YOUNGS_MODULUS_PA), poisson(POISSON_RATIO));
    }
    if table.has("youngs_modulus_pa") {
        let text = format!(
            "{}: a material has one modulus (youngs_modulus_pa), or {} and its other axes'; leave out the one or the others",
            table.key("youngs_modulus_pa"),
            table.key("ex_pa")
        );
        table.report().add(&table.place("youngs_modulus_pa"), text);
    }
    let [ex_pa, ey_pa, g_pa] = WITH_AXES.map(|key| table.number(key, YOUNGS_MODULUS_PA));
    // Beyond, stretched along one axis it would give energy.
    let most = (ex_pa / ey_pa).sqrt();
    let allowed = if most.is_nan() { Allowed::Between(f64::MIN, f64::MAX) } else { Allowed::Between(-most, most) };
    Elastic { ex_pa, ey_pa, g_pa, poisson_xy: poisson(allowed) }
}

/// The thickness of a surface that has layers, in m. It need not be given again, and neither must another material be.
pub(super) fn thickness_m(surface: &Section<'_, '_>, plies: &[Ply]) -> f64 {
    let thickness_m: f64 = plies.iter().map(|ply| ply.thickness_m).sum();
    let own_mm = surface.number_or("thickness_mm", thickness_m * 1e3, THICKNESS_MM);
    if (own_mm / 1e3 - thickness_m).abs() > SAME_THICKNESS * thickness_m {
        let allowed = format!("{} as the [[layer]] are together, or left out", super::place::mm(thickness_m));
        surface.wrong("thickness_mm", own_mm.to_string(), &allowed);
    }
    if surface.has("material") {
        surface.wrong("material", String::from("given"), "left out where [[layer]] say what the surface is made of");
    }
    thickness_m
}
