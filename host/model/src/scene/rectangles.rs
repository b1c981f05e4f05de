//! Patches and cut-outs in the scene file.

use super::layout::SurfaceLayout;
use super::patch::{Cutout, Patch};
use super::place::{ROUNDING, metres_to_mm_rounded_to_9_decimals};
use super::ranges::{
    DENSITY_KG_M3, POISSON_RATIO, SurfaceSize, THICKNESS_MM, YOUNGS_MODULUS_PA, allowed_mm_along_side,
};
use super::read::{AllowedNumbers, TomlSection};
use super::{Material, Surface, SurfaceKind};

/// Least side of a patch or cut-out in mm: well above what counts as one place on the largest panel, 0.01 mm.
const LEAST_SIDE_MM: f64 = 0.1;

/// Where a rectangle begins and how long it is along one side, in m.
fn read_start_and_extent_m_and_report_end_beyond_side(
    section: &TomlSection<'_, '_>,
    keys: [&'static str; 2],
    side_m: f64,
) -> (f64, f64) {
    let start = section.read_required_number_or_nan(keys[0], allowed_mm_along_side(side_m)) / 1e3;
    let longest = if side_m.is_nan() {
        AllowedNumbers::Positive
    } else {
        AllowedNumbers::Along(LEAST_SIDE_MM, metres_to_mm_rounded_to_9_decimals(side_m))
    };
    let extent = section.read_required_number_or_nan(keys[1], longest) / 1e3;
    if start + extent > side_m * (1.0 + ROUNDING) {
        let text = format!(
            "{} makes the rectangle end at {} mm, but the surface ends at {} mm",
            section.key_with_path(keys[1]),
            metres_to_mm_rounded_to_9_decimals(start + extent),
            metres_to_mm_rounded_to_9_decimals(side_m)
        );
        section.mistake_report().add_mistake_at(&section.byte_range_of_value_or_section(keys[1]), text);
    }
    (start, extent)
}

/// Reads all `[[patch]]`.
pub(super) fn read_patches_or_report_them_on_layered_surface(
    sections: Vec<TomlSection<'_, '_>>,
    surface: Option<&Surface>,
    size: &SurfaceSize,
) -> Vec<Patch> {
    if let Some(section) = sections.first().filter(|_| surface.is_some_and(|surface| !surface.layers.is_empty())) {
        // Which layers go on beneath it, and about which plane, it does not say.
        let text = format!(
            "{}: a [[patch]] is not allowed on a surface with [[layer]] tables: leave out the patches or the layers",
            section.path_in_messages()
        );
        section.mistake_report().add_mistake_at(&section.byte_range_of_value_or_section("x_mm"), text);
        return Vec::new();
    }
    sections.into_iter().map(|section| read_patch(section, surface, size)).collect()
}

fn read_patch(section: TomlSection<'_, '_>, surface: Option<&Surface>, size: &SurfaceSize) -> Patch {
    let (x_m, length_m) =
        read_start_and_extent_m_and_report_end_beyond_side(&section, ["x_mm", "length_mm"], size.length_m);
    let (y_m, width_m) = match size.kind {
        SurfaceKind::Plate => {
            read_start_and_extent_m_and_report_end_beyond_side(&section, ["y_mm", "width_mm"], size.width_m)
        }
        SurfaceKind::Bar => {
            let width = section.read_optional_number_or_nan(
                "width_mm",
                size.width_m * 1e3,
                AllowedNumbers::Within(LEAST_SIDE_MM, 1e4),
            ) / 1e3;
            (0.5 * (size.width_m - width), width)
        }
    };
    let nothing = Material { youngs_modulus_pa: f64::NAN, poisson_ratio: f64::NAN, density_kg_m3: f64::NAN };
    let (thickness_m, base) = surface.map_or((f64::NAN, nothing), |surface| (surface.thickness_m, surface.material));
    let own_thickness = section.has_key_marking_known("thickness_mm");
    let thickness_mm = section.read_optional_number_or_nan("thickness_mm", thickness_m * 1e3, THICKNESS_MM);
    let table = section.read_table_if_given_and_a_table("material");
    let material = table.map_or(base, |table| {
        let material = Material {
            youngs_modulus_pa: table.read_optional_number_or_nan(
                "youngs_modulus_pa",
                base.youngs_modulus_pa,
                YOUNGS_MODULUS_PA,
            ),
            poisson_ratio: table.read_optional_number_or_nan("poisson_ratio", base.poisson_ratio, POISSON_RATIO),
            density_kg_m3: table.read_optional_number_or_nan("density_kg_m3", base.density_kg_m3, DENSITY_KG_M3),
        };
        table.report_unknown_keys();
        material
    });
    section.report_unknown_keys();
    // The surface's own thickness to the last digit, so that a patch like the surface changes nothing.
    let thickness_m = if own_thickness { thickness_mm / 1e3 } else { thickness_m };
    Patch { x_m, y_m, length_m, width_m, thickness_m, material }
}

/// Reads all `[[cutout]]`, which must leave the surface in one piece.
pub(super) fn read_cutouts(
    sections: Vec<TomlSection<'_, '_>>,
    surface: Option<&Surface>,
    size: &SurfaceSize,
) -> Vec<Cutout> {
    let mut cutouts = Vec::new();
    let mut is_whole = true;
    for section in sections {
        let report = section.mistake_report();
        let place = section.byte_range_of_value_or_section("x_mm");
        let path = section.path_in_messages().to_owned();
        if size.kind == SurfaceKind::Bar {
            report.add_mistake_at(
                &place,
                format!(
                    "{path}: a bar cannot have cut-outs; to make a part of the bar narrower, use a [[patch]] with \
                     width_mm"
                ),
            );
            return Vec::new();
        }
        let (x_m, length_m) =
            read_start_and_extent_m_and_report_end_beyond_side(&section, ["x_mm", "length_mm"], size.length_m);
        let (y_m, width_m) =
            read_start_and_extent_m_and_report_end_beyond_side(&section, ["y_mm", "width_mm"], size.width_m);
        section.report_unknown_keys();
        let cutout = Cutout { x_m, y_m, length_m, width_m };
        if [x_m, y_m, length_m, width_m].iter().any(|number| number.is_nan()) {
            continue;
        }
        cutouts.push(cutout);
        if let Some(surface) = surface.filter(|_| is_whole) {
            let text = describe_cutout_problem_if_any(&SurfaceLayout::new(surface, &[], &cutouts));
            is_whole = text.is_none();
            if let Some(text) = text {
                report.add_mistake_at(&place, format!("{path} {text}"));
            }
        }
    }
    cutouts
}

/// What is wrong with the surface that cut-outs leave; `None` if nothing is.
fn describe_cutout_problem_if_any(remaining_layout: &SurfaceLayout) -> Option<String> {
    if let Some(vertex) =
        remaining_layout.vertices_at_crossings_of_border_lines().find(|vertex| vertex.is_pinch_point())
    {
        let (x, y) = vertex.at;
        return Some(format!(
            "leaves parts of the surface that touch only at the point ({}, {}) mm, but these parts must be connected \
             along a line: let the cut-outs overlap, or move the cut-outs apart",
            metres_to_mm_rounded_to_9_decimals(x),
            metres_to_mm_rounded_to_9_decimals(y)
        ));
    }
    match remaining_layout.count_connected_pieces() {
        0 => Some(String::from("removes the whole surface")),
        1 => None,
        pieces => Some(format!("divides the surface into {pieces} pieces, but the surface must remain in one piece")),
    }
}
