//! `[[layer]]` in the scene file.

use super::SurfaceKind;
use super::laminate::{Ply, PlyElasticity};
use super::ranges::{DENSITY_KG_M3, LOSS_FACTOR, MAX_THICKNESS_MM, POISSON_RATIO, THICKNESS_MM, YOUNGS_MODULUS_PA};
use super::read::{AllowedNumbers, TomlSection};

/// Part by which a surface's thickness may differ from the sum of its layers': nobody writes more digits.
const SAME_THICKNESS: f64 = 1e-6;

/// Keys that only a material with axes has.
const WITH_AXES: [&str; 3] = ["ex_pa", "ey_pa", "g_pa"];

/// All `[[layer]]`, from the bottom to the top; empty if there are none.
pub(super) fn read_layers(sections: Vec<TomlSection<'_, '_>>, kind: SurfaceKind) -> Vec<Ply> {
    let mut plies: Vec<Ply> = Vec::new();
    for section in sections {
        let thickness_m = section.read_required_number_or_nan("thickness_mm", THICKNESS_MM) / 1e3;
        let (elastic, density_kg_m3) = section.read_required_table("material").map_or(
            (PlyElasticity::from_isotropic_moduli(f64::NAN, f64::NAN), f64::NAN),
            |table| {
                let read = (
                    read_ply_elasticity(&table, kind),
                    table.read_required_number_or_nan("density_kg_m3", DENSITY_KG_M3),
                );
                table.report_unknown_keys();
                read
            },
        );
        let elastic = if read_is_ply_turned_by_90_degrees(&section) { elastic.turn_by_90_degrees() } else { elastic };
        let loss_factor = section.read_optional_number_or_nan("loss_factor", 0.0, LOSS_FACTOR);
        let has_bond = section.has_key_marking_known("bond");
        let slips =
            has_bond && section.read_required_word("bond", &[("bonded", false), ("slips", true)]).unwrap_or(false);
        if slips && plies.is_empty() {
            section.report_wrong_value(
                "bond",
                String::from("\"slips\""),
                "left out in the lowest layer, because no layer is below the lowest layer",
            );
        }
        let total_mm = 1e3 * (thickness_m + plies.iter().map(|ply| ply.thickness_m).sum::<f64>());
        if total_mm > MAX_THICKNESS_MM {
            let text = format!(
                "{} makes the total thickness of the layers {total_mm} mm, but at most {MAX_THICKNESS_MM} mm are \
                 allowed",
                section.key_with_path("thickness_mm")
            );
            section.mistake_report().add_mistake_at(&section.byte_range_of_value_or_section("thickness_mm"), text);
        }
        plies.push(Ply { thickness_m, elastic, density_kg_m3, loss_factor, slips });
        section.report_unknown_keys();
    }
    plies
}

/// Whether a layer lies with its material's x along the surface's y.
fn read_is_ply_turned_by_90_degrees(section: &TomlSection<'_, '_>) -> bool {
    let angle = section.read_optional_number_or_nan("angle_deg", 0.0, AllowedNumbers::Within(0.0, 90.0));
    if angle > 0.0 && angle < 90.0 {
        section.report_wrong_value(
            "angle_deg",
            angle.to_string(),
            "0 or 90, because the axes of the material must be parallel to the axes of the surface",
        );
    }
    angle > 0.0
}

/// Reads a layer's elastic constants: one modulus, or those of a material with axes.
fn read_ply_elasticity(table: &TomlSection<'_, '_>, kind: SurfaceKind) -> PlyElasticity {
    let poisson = |allowed| match kind {
        SurfaceKind::Plate => table.read_required_number_or_nan("poisson_ratio", allowed),
        SurfaceKind::Bar => table.read_optional_number_or_nan("poisson_ratio", 0.0, allowed),
    };
    if !WITH_AXES.iter().any(|key| table.has_key_marking_known(key)) {
        return PlyElasticity::from_isotropic_moduli(
            table.read_required_number_or_nan("youngs_modulus_pa", YOUNGS_MODULUS_PA),
            poisson(POISSON_RATIO),
        );
    }
    if table.has_key_marking_known("youngs_modulus_pa") {
        let text = format!(
            "{} is given together with separate moduli for the axes ({}), but only one of the two is allowed: give only youngs_modulus_pa \
             if the material is isotropic, otherwise give only the separate moduli",
            table.key_with_path("youngs_modulus_pa"),
            WITH_AXES.join(", ")
        );
        table.mistake_report().add_mistake_at(&table.byte_range_of_value_or_section("youngs_modulus_pa"), text);
    }
    let [ex_pa, ey_pa, g_pa] = WITH_AXES.map(|key| table.read_required_number_or_nan(key, YOUNGS_MODULUS_PA));
    // Beyond, stretched along one axis it would give energy.
    let most = (ex_pa / ey_pa).sqrt();
    let allowed =
        if most.is_nan() { AllowedNumbers::Between(f64::MIN, f64::MAX) } else { AllowedNumbers::Between(-most, most) };
    PlyElasticity { ex_pa, ey_pa, g_pa, poisson_xy: poisson(allowed) }
}

/// The thickness of a surface that has layers, in m. It need not be given again, and neither must another material be.
pub(super) fn report_conflicting_keys_and_sum_layer_thickness_m(surface: &TomlSection<'_, '_>, plies: &[Ply]) -> f64 {
    let thickness_m: f64 = plies.iter().map(|ply| ply.thickness_m).sum();
    let own_mm = surface.read_optional_number_or_nan("thickness_mm", thickness_m * 1e3, THICKNESS_MM);
    if (own_mm / 1e3 - thickness_m).abs() > SAME_THICKNESS * thickness_m {
        let allowed = format!(
            "{}, the sum of the thicknesses of all [[layer]] tables, or be left out",
            super::place::metres_to_mm_rounded_to_9_decimals(thickness_m)
        );
        surface.report_wrong_value("thickness_mm", own_mm.to_string(), &allowed);
    }
    if surface.has_key_marking_known("material") {
        surface.report_wrong_value(
            "material",
            String::from("given"),
            "left out, because every [[layer]] has its own material",
        );
    }
    thickness_m
}
