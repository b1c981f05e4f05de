//! The scene file's keys and what they may be.

use super::electronics::Electronics;
use super::laminate::{Laminate, Ply};
use super::layers::{read_layers, report_conflicting_keys_and_sum_layer_thickness_m};
use super::layout::SurfaceLayout;
use super::modal_ratio::{MOST_POINTS, ModalRatio};
use super::place::ROUNDING;
use super::ranges::{
    DENSITY_KG_M3, LOSS_FACTOR, POISSON_RATIO, SurfaceSize, THICKNESS_MM, YOUNGS_MODULUS_PA, allowed_mm_along_side,
};
use super::read::{self, AllowedNumbers, MistakeReport, SceneError, TomlSection};
use super::rectangles::{read_cutouts, read_patches_or_report_them_on_layered_surface};
use super::{
    Actuator, ChargingTimes, DEFAULT_CABLE_CAPACITANCE_F, DEFAULT_PRESS_N, Edge, EdgeKind, Finger, MOST_PRESS_N, Mass,
    Material, Mount, Scene, Screen, Side, Support, Surface, SurfaceDamping, SurfaceKind,
};

/// The version of scene files that is read.
const VERSION: f64 = 1.0;
/// Largest side of a panel in mm; beyond it this is not a touch surface and someone has mixed up units.
const MAX_SIDE_MM: f64 = 10_000.0;
/// A thousand tonnes, in g: for masses that only stand for "held still".
const MOST_MASS_G: f64 = 1e12;
const MASS_G: AllowedNumbers = AllowedNumbers::Within(0.0, MOST_MASS_G);
/// All springs, in N/m, N m/rad and per metre: the model is tested up to 1e18.
const STIFFNESS: AllowedNumbers = AllowedNumbers::Within(0.0, 1e20);
/// All dashpots, in N s/m.
const DAMPING: AllowedNumbers = AllowedNumbers::Within(0.0, 1e12);
/// A finger, in g, N s/m and N/m: a hundred times what is measured on fingertips, which is more than a whole arm. Beyond it someone has mixed up
/// units.
const FINGER_MASS_G: AllowedNumbers = AllowedNumbers::Within(0.0, 1000.0);
const FINGER_DAMPING: AllowedNumbers = AllowedNumbers::Within(0.0, 1000.0);
const FINGER_STIFFNESS: AllowedNumbers = AllowedNumbers::Within(0.0, 1e6);
/// Damping ratios of modes; from 1 on they do not swing.
const MODAL_RATIO: AllowedNumbers = AllowedNumbers::Within(0.0, 10.0);
/// Frequencies that such a ratio is told for, in Hz: what can be computed, and beyond.
const MODE_HZ: AllowedNumbers = AllowedNumbers::Within(0.0, 1e6);
/// Sealed air behind the panel: from a film of it to a room.
const SEALED_DEPTH_MM: AllowedNumbers = AllowedNumbers::Within(0.01, MAX_SIDE_MM);
/// Air that moves with the surface, in kg/m^2: a hundred times what a piston as large as any panel moves.
const ADDED_MASS: AllowedNumbers = AllowedNumbers::Within(0.0, 1000.0);
/// Electrodes up to a square metre.
const AREA_MM2: AllowedNumbers = AllowedNumbers::Within(1e-6, 1e6);
/// Cable and switches of an electrode: ten nF are 100 m of coaxial cable.
const CABLE_PF: AllowedNumbers = AllowedNumbers::Within(0.0, 10_000.0);
/// A stop nearer to a mass's middle leaves it no room.
const LEAST_STOP_UM: f64 = 0.1;
/// Most pixels along a side.
const MAX_PIXELS: u32 = 100_000;

/// Parses a scene file's text; `source_name` is what messages call it.
pub(super) fn parse_scene_text(source_name: &str, text: &str) -> Result<Scene, SceneError> {
    let document = read::parse_toml_document(source_name, text)?;
    let report = MistakeReport::new(text);
    let file = TomlSection::new(&report, document.get_ref(), String::new(), 0..0);
    let scene = read_all_tables_unless_surface_missing(&file);
    file.report_unknown_keys();
    report.into_result(source_name)?;
    // Every part that is missing has been reported.
    scene.ok_or_else(|| SceneError::from_single_mistake(source_name, 0, "incomplete".into()))
}

/// Reads all tables; `None` if the surface is missing, which has been reported then.
fn read_all_tables_unless_surface_missing(file: &TomlSection<'_, '_>) -> Option<Scene> {
    file.read_required_number_or_nan("version", AllowedNumbers::Within(VERSION, VERSION));
    let name = file.read_required_text_or_empty("name");
    let plies = file.read_tables("layer");
    let mut surface = file.read_required_table("surface").map(|section| read_surface(section, plies));
    let (sealed_depth_m, added_mass) =
        file.read_table_if_given_and_a_table("air").map_or((None, 0.0), read_sealed_depth_m_and_added_mass_kg_per_m2);
    if let Some(surface) = &mut surface {
        surface.added_mass_kg_per_m2 = added_mass;
    }
    let kind = surface.as_ref().map_or(SurfaceKind::Plate, |surface| surface.kind);
    let (length_m, width_m) = surface.as_ref().map_or((f64::NAN, f64::NAN), |s| (s.length_m, s.width_m));
    let mut size = SurfaceSize { kind, length_m, width_m, left: None };
    let patches = read_patches_or_report_them_on_layered_surface(file.read_tables("patch"), surface.as_ref(), &size);
    let cutouts = read_cutouts(file.read_tables("cutout"), surface.as_ref(), &size);
    size.left =
        surface.as_ref().filter(|_| !cutouts.is_empty()).map(|surface| SurfaceLayout::new(surface, &[], &cutouts));
    let screen = read_screen_or_assume_one_pixel_per_mm(file.read_table_if_given_and_a_table("screen"), &size);
    let supports = file.read_tables("support").into_iter().map(|section| read_support(section, &size)).collect();
    let edges = read_edges(file.read_tables("edge"), &size);
    let masses = file.read_tables("mass").into_iter().map(|section| read_mass(section, &size)).collect();
    let electronics = file.read_table_if_given_and_a_table("electronics").map(Electronics::read);
    let actuators = read_actuators(file.read_tables("actuator"), &size, electronics.as_ref());
    if let Some(electronics) = electronics {
        electronics.report_unknown_keys();
    }
    let press_n = file.read_table_if_given_and_a_table("press").map_or(DEFAULT_PRESS_N, read_press_force_n);
    let finger = file.read_table_if_given_and_a_table("finger").map(read_finger);
    let surface = surface?;
    Some(Scene {
        name,
        surface,
        patches,
        cutouts,
        screen,
        supports,
        edges,
        masses,
        actuators,
        press_n,
        finger,
        sealed_depth_m,
    })
}

fn read_surface(section: TomlSection<'_, '_>, plies: Vec<TomlSection<'_, '_>>) -> Surface {
    let kind = section
        .read_required_word("kind", &[("plate", SurfaceKind::Plate), ("bar", SurfaceKind::Bar)])
        .unwrap_or(SurfaceKind::Plate);
    let side = |key| section.read_required_number_or_nan(key, AllowedNumbers::Within(1.0, MAX_SIDE_MM)) / 1e3;
    let (length_m, width_m) = (side("length_mm"), side("width_mm"));
    let layers = read_layers(plies, kind);
    let own_damping =
        section.read_table_if_given_and_a_table("damping").map_or(SurfaceDamping::None, read_surface_damping);
    let (thickness_m, material, damping) = if layers.is_empty() {
        (
            section.read_required_number_or_nan("thickness_mm", THICKNESS_MM) / 1e3,
            read_material(&section, kind),
            own_damping,
        )
    } else {
        let laminate = Laminate::from_plies(kind, &layers);
        let damping =
            choose_layered_surface_damping_and_report_conflict(&section, &layers, laminate.loss_factor, own_damping);
        (
            report_conflicting_keys_and_sum_layer_thickness_m(&section, &layers),
            laminate.to_uniform_material(kind),
            damping,
        )
    };
    section.report_unknown_keys();
    Surface { kind, length_m, width_m, thickness_m, material, layers, damping, added_mass_kg_per_m2: 0.0 }
}

fn read_material(surface: &TomlSection<'_, '_>, kind: SurfaceKind) -> Material {
    let nothing = Material { youngs_modulus_pa: f64::NAN, poisson_ratio: f64::NAN, density_kg_m3: f64::NAN };
    surface.read_required_table("material").map_or(nothing, |table| {
        let material = Material {
            youngs_modulus_pa: table.read_required_number_or_nan("youngs_modulus_pa", YOUNGS_MODULUS_PA),
            poisson_ratio: match kind {
                SurfaceKind::Plate => table.read_required_number_or_nan("poisson_ratio", POISSON_RATIO),
                SurfaceKind::Bar => table.read_optional_number_or_nan("poisson_ratio", 0.0, POISSON_RATIO),
            },
            density_kg_m3: table.read_required_number_or_nan("density_kg_m3", DENSITY_KG_M3),
        };
        table.report_unknown_keys();
        material
    })
}

/// The damping of a surface whose layers may have losses, which are `loss_factor` together: of these or of the surface's own.
fn choose_layered_surface_damping_and_report_conflict(
    surface: &TomlSection<'_, '_>,
    plies: &[Ply],
    loss_factor: f64,
    damping_of_surface_itself: SurfaceDamping,
) -> SurfaceDamping {
    if plies.iter().all(|ply| ply.loss_factor == 0.0) {
        return damping_of_surface_itself;
    }
    if damping_of_surface_itself != SurfaceDamping::None {
        let text = String::from(
            "surface.damping and loss_factor of a [[layer]] are both given, but only one of them is allowed, because each \
             sets the damping of the surface: leave out [surface.damping], or loss_factor in every [[layer]]",
        );
        surface.mistake_report().add_mistake_at(&surface.byte_range_of_value_or_section("damping"), text);
    }
    SurfaceDamping::LossFactor(loss_factor)
}

fn read_surface_damping(section: TomlSection<'_, '_>) -> SurfaceDamping {
    let has = [
        section.has_key_marking_known("loss_factor"),
        section.has_key_marking_known("modal_ratio"),
        section.has_key_marking_known("rayleigh_alpha") | section.has_key_marking_known("rayleigh_beta"),
    ];
    let loss_factor = section.read_optional_number_or_nan("loss_factor", 0.0, LOSS_FACTOR);
    let modal_ratio = read_modal_ratio(&section);
    let alpha = section.read_optional_number_or_nan("rayleigh_alpha", 0.0, AllowedNumbers::Within(0.0, 1e6));
    let beta = section.read_optional_number_or_nan("rayleigh_beta", 0.0, AllowedNumbers::Within(0.0, 1.0));
    // A kind that is there but zero is as good as not there.
    let chosen = [loss_factor != 0.0, modal_ratio != ModalRatio::from_single_ratio(0.0), alpha != 0.0 || beta != 0.0];
    if chosen.iter().filter(|chosen| **chosen).count() > 1 {
        let kinds = ["loss_factor", "modal_ratio", "rayleigh_alpha/rayleigh_beta"];
        let given: Vec<_> = kinds.into_iter().zip(has).filter(|(_, has)| *has).map(|(kind, _)| kind).collect();
        let place = given
            .last()
            .map_or(0..0, |kind| section.byte_range_of_value_or_section(kind.split('/').next().unwrap_or(kind)));
        let text = format!(
            "{}: {} are given, but at most one kind of damping is allowed",
            section.path_in_messages(),
            given.join(" and ")
        );
        section.mistake_report().add_mistake_at(&place, text);
    }
    section.report_unknown_keys();
    match chosen {
        [true, ..] => SurfaceDamping::LossFactor(loss_factor),
        [_, true, _] => SurfaceDamping::ModalRatio(modal_ratio),
        [.., true] => SurfaceDamping::Rayleigh { alpha, beta },
        _ => SurfaceDamping::None,
    }
}

/// One number for all modes, or pairs of frequency and number.
fn read_modal_ratio(section: &TomlSection<'_, '_>) -> ModalRatio {
    const KEY: &str = "modal_ratio";
    if !section.is_value_a_list_marking_known(KEY) {
        return ModalRatio::from_single_ratio(section.read_optional_number_or_nan(KEY, 0.0, MODAL_RATIO));
    }
    let pairs = section.number_pairs_if_all_allowed_without_report(KEY, MODE_HZ, MODAL_RATIO);
    pairs.as_deref().and_then(ModalRatio::from_table_if_ascending_with_1_to_10_pairs).unwrap_or_else(|| {
        let wanted = format!(
            "a number {MODAL_RATIO}, or a list of 1 to {MOST_POINTS} pairs [frequency in Hz, damping ratio] with \
             rising frequencies; each frequency must be {MODE_HZ}, and each ratio must be {MODAL_RATIO}"
        );
        section.report_wrong_list(KEY, &wanted);
        ModalRatio::from_single_ratio(0.0)
    })
}

fn read_screen_or_assume_one_pixel_per_mm(section: Option<TomlSection<'_, '_>>, size: &SurfaceSize) -> Screen {
    let whole = Screen {
        // A pixel per mm where the file has no screen.
        width_px: pixels_at_one_per_mm(size.length_m),
        height_px: pixels_at_one_per_mm(size.width_m),
        x_m: 0.0,
        y_m: 0.0,
        width_m: size.length_m,
        height_m: size.width_m,
    };
    let Some(section) = section else { return whole };
    let mut screen = Screen {
        width_px: section.read_required_positive_count_or_1("width_px", MAX_PIXELS),
        height_px: section.read_required_positive_count_or_1("height_px", MAX_PIXELS),
        ..whole
    };
    let area = [
        section.has_key_marking_known("x_mm"),
        section.has_key_marking_known("y_mm"),
        section.has_key_marking_known("width_mm"),
        section.has_key_marking_known("height_mm"),
    ];
    if area.contains(&true) {
        let part = |key, side_m: f64, default_m: f64, allowed| {
            section.read_optional_number_or_nan(key, default_m * 1e3, allowed) / 1e3 + 0.0 * side_m
        };
        screen.x_m = part("x_mm", size.length_m, 0.0, allowed_mm_along_side(size.length_m));
        screen.y_m = part("y_mm", size.width_m, 0.0, allowed_mm_along_side(size.width_m));
        screen.width_m = part("width_mm", size.length_m, size.length_m - screen.x_m, AllowedNumbers::Positive);
        screen.height_m = part("height_mm", size.width_m, size.width_m - screen.y_m, AllowedNumbers::Positive);
        for (key, start_key, start, extent, side) in [
            ("width_mm", "x_mm", screen.x_m, &mut screen.width_m, size.length_m),
            ("height_mm", "y_mm", screen.y_m, &mut screen.height_m, size.width_m),
        ] {
            let end = start + *extent;
            if end > side * (1.0 + ROUNDING) {
                let text = format!(
                    "{} makes the active area end at {} mm, but the surface ends at {} mm",
                    section.key_with_path(key),
                    end * 1e3,
                    side * 1e3
                );
                section.mistake_report().add_mistake_at(&section.byte_range_of_value_or_section(key), text);
            } else if *extent <= 0.0 {
                let text = format!(
                    "{} is {}, but must be below {}: otherwise the active area of the screen is empty",
                    section.key_with_path(start_key),
                    start * 1e3,
                    side * 1e3
                );
                section.mistake_report().add_mistake_at(&section.byte_range_of_value_or_section(start_key), text);
            } else {
                *extent = trim_extent_to_side(start, *extent, side);
            }
        }
    }
    section.report_unknown_keys();
    screen
}

/// `extent`, less what rounding made of it too much: the last pixel is to lie on the surface, not a rounding error
/// beyond it, where no plan is made. Takes a step or two.
fn trim_extent_to_side(start: f64, mut extent: f64, side: f64) -> f64 {
    while start + extent > side {
        extent -= start + extent - side;
    }
    extent
}

/// Pixels of a side where the file has no screen: one for each mm.
#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a side of at most 10 m; `as` saturates")]
fn pixels_at_one_per_mm(side_m: f64) -> u32 {
    ((side_m * 1e3).round() as u32).max(1)
}

fn read_support(section: TomlSection<'_, '_>, size: &SurfaceSize) -> Support {
    let (x_m, y_m) = size.read_position_m_and_report_if_in_cutout(&section);
    let support = Support {
        x_m,
        y_m,
        stiffness_n_per_m: section.read_required_number_or_nan("stiffness_n_per_m", STIFFNESS),
        damping_n_s_per_m: section.read_optional_number_or_nan("damping_n_s_per_m", 0.0, DAMPING),
        rotational_stiffness_n_m_per_rad: section.read_optional_number_or_nan(
            "rotational_stiffness_n_m_per_rad",
            0.0,
            STIFFNESS,
        ),
        loss_factor: section.read_optional_number_or_nan("loss_factor", 0.0, LOSS_FACTOR),
    };
    section.report_unknown_keys();
    support
}

fn read_edges(sections: Vec<TomlSection<'_, '_>>, size: &SurfaceSize) -> Vec<Edge> {
    let sides: &[(&str, Side)] = match size.kind {
        SurfaceKind::Plate => {
            &[("left", Side::Left), ("right", Side::Right), ("top", Side::Top), ("bottom", Side::Bottom)]
        }
        SurfaceKind::Bar => &[("left", Side::Left), ("right", Side::Right)],
    };
    let mut edges: Vec<Edge> = Vec::new();
    for section in sections {
        let side = section.read_required_word("side", sides);
        let word = section.read_required_word("kind", &[("pinned", 0), ("clamped", 1), ("elastic", 2)]);
        let kind = match word {
            Some(0) => Some(EdgeKind::Pinned),
            Some(1) => Some(EdgeKind::Clamped),
            Some(_) => Some(read_elastic_edge(&section, size.kind)),
            None => None,
        };
        if let (Some(side), Some(kind)) = (side, kind) {
            if edges.iter().any(|edge| edge.side == side) {
                section.mistake_report().add_mistake_at(
                    &section.byte_range_of_value_or_section("side"),
                    format!(
                        "{}: an earlier [[edge]] has the same side, but each side may have only one [[edge]]",
                        section.key_with_path("side")
                    ),
                );
            }
            if !size.do_cutouts_leave_part_of_side(side) {
                let text = format!(
                    "{}: the cut-outs remove this whole side, so the side cannot have an [[edge]]",
                    section.key_with_path("side")
                );
                section.mistake_report().add_mistake_at(&section.byte_range_of_value_or_section("side"), text);
            }
            edges.push(Edge { side, kind });
        }
        section.report_unknown_keys();
    }
    edges
}

/// A plate's edge springs are per metre of edge, a bar's are at its end.
fn read_elastic_edge(section: &TomlSection<'_, '_>, kind: SurfaceKind) -> EdgeKind {
    let (stiffness, rotational) = match kind {
        SurfaceKind::Plate => ("stiffness_n_per_m2", "rotational_stiffness_n_per_rad"),
        SurfaceKind::Bar => ("stiffness_n_per_m", "rotational_stiffness_n_m_per_rad"),
    };
    EdgeKind::Elastic {
        stiffness: section.read_optional_number_or_nan(stiffness, 0.0, STIFFNESS),
        rotational_stiffness: section.read_optional_number_or_nan(rotational, 0.0, STIFFNESS),
        loss_factor: section.read_optional_number_or_nan("loss_factor", 0.0, LOSS_FACTOR),
    }
}

fn read_mass(section: TomlSection<'_, '_>, size: &SurfaceSize) -> Mass {
    let (x_m, y_m) = size.read_position_m_and_report_if_in_cutout(&section);
    let mass = Mass { x_m, y_m, mass_kg: section.read_required_number_or_nan("mass_g", MASS_G) / 1e3 };
    section.report_unknown_keys();
    mass
}

fn read_press_force_n(section: TomlSection<'_, '_>) -> f64 {
    let force_n =
        section.read_optional_number_or_nan("force_n", DEFAULT_PRESS_N, AllowedNumbers::Within(0.0, MOST_PRESS_N));
    section.report_unknown_keys();
    force_n
}

/// Depth of the sealed cavity in m, if there is one, and mass that moves with the surface in kg/m^2.
fn read_sealed_depth_m_and_added_mass_kg_per_m2(section: TomlSection<'_, '_>) -> (Option<f64>, f64) {
    let depth_m = section
        .has_key_marking_known("sealed_depth_mm")
        .then(|| section.read_required_number_or_nan("sealed_depth_mm", SEALED_DEPTH_MM) / 1e3);
    let added_mass = section.read_optional_number_or_nan("added_mass_kg_per_m2", 0.0, ADDED_MASS);
    section.report_unknown_keys();
    (depth_m, added_mass)
}

fn read_finger(section: TomlSection<'_, '_>) -> Finger {
    let finger = Finger {
        mass_kg: section.read_optional_number_or_nan("mass_g", 0.0, FINGER_MASS_G) / 1e3,
        damping_n_s_per_m: section.read_optional_number_or_nan("damping_n_s_per_m", 0.0, FINGER_DAMPING),
        stiffness_n_per_m: section.read_optional_number_or_nan("stiffness_n_per_m", 0.0, FINGER_STIFFNESS),
    };
    section.report_unknown_keys();
    finger
}

fn read_actuators(
    sections: Vec<TomlSection<'_, '_>>,
    size: &SurfaceSize,
    electronics: Option<&Electronics<'_, '_>>,
) -> Vec<Actuator> {
    let mut actuators: Vec<Actuator> = Vec::new();
    for section in sections {
        let mount =
            section.read_required_word("mount", &[("inertial", Mount::Inertial), ("grounded", Mount::Grounded)]);
        // A grounded ERA without a mass is a spring with a force; an inertial one has nothing to push off from.
        let moving_mass =
            if mount == Some(Mount::Inertial) { AllowedNumbers::Within(1e-9, MOST_MASS_G) } else { MASS_G };
        let id = section.read_required_text_or_empty("id");
        let (x_m, y_m) = size.read_position_m_and_report_if_in_cutout(&section);
        let max_voltage_v = section.read_required_number_or_nan("max_voltage_v", AllowedNumbers::Within(1.0, 10_000.0));
        let air_gap_um = section.read_required_number_or_nan("air_gap_um", AllowedNumbers::Within(1.0, 1e5));
        let stop = AllowedNumbers::Within(LEAST_STOP_UM, if air_gap_um.is_nan() { f64::MAX } else { air_gap_um });
        let stop_um =
            section.has_key_marking_known("stop_um").then(|| section.read_required_number_or_nan("stop_um", stop));
        let bias = AllowedNumbers::Within(0.0, if max_voltage_v.is_nan() { f64::MAX } else { max_voltage_v });
        let mut actuator = Actuator {
            id,
            x_m,
            y_m,
            mount: mount.unwrap_or(Mount::Grounded),
            moving_mass_kg: section.read_required_number_or_nan("moving_mass_g", moving_mass) / 1e3,
            stiffness_n_per_m: section.read_required_number_or_nan("stiffness_n_per_m", STIFFNESS),
            damping_n_s_per_m: section.read_optional_number_or_nan("damping_n_s_per_m", 0.0, DAMPING),
            housing_mass_kg: section.read_optional_number_or_nan("housing_mass_g", 0.0, MASS_G) / 1e3,
            electrode_area_m2: section.read_required_number_or_nan("electrode_area_mm2", AREA_MM2) / 1e6,
            air_gap_m: air_gap_um / 1e6,
            max_voltage_v,
            stop_m: stop_um.map(|um| um / 1e6),
            bias_voltage_v: section.read_optional_number_or_nan("bias_voltage_v", 0.0, bias),
            cable_capacitance_f: section.read_optional_number_or_nan(
                "cable_capacitance_pf",
                DEFAULT_CABLE_CAPACITANCE_F * 1e12,
                CABLE_PF,
            ) * 1e-12,
            charging: ChargingTimes::default(),
        };
        if let Some(electronics) = electronics {
            let capacitance_f = actuator.capacitance_of_electrode_with_cable_f();
            actuator.charging =
                electronics.compute_charging_times_and_report_too_long_ones(&section, &actuator.id, capacitance_f);
        }
        if actuator.bias_voltage_v > 0.0 && actuator.effective_stiffness_n_per_m() <= 0.0 {
            let text = format!(
                "{} is {}, but must be below {:.1} V: from this limit on, the electrodes cancel the stiffness of the \
                 springs ({} N/m) and pull the mass onto an electrode",
                section.key_with_path("bias_voltage_v"),
                actuator.bias_voltage_v,
                actuator.voltage_at_which_softening_cancels_springs_v(),
                actuator.stiffness_n_per_m
            );
            section.mistake_report().add_mistake_at(&section.byte_range_of_value_or_section("bias_voltage_v"), text);
        }
        if !actuator.id.is_empty() && actuators.iter().any(|other| other.id == actuator.id) {
            let text = format!(
                "{} is {:?}, but an earlier [[actuator]] already has this id",
                section.key_with_path("id"),
                actuator.id
            );
            section.mistake_report().add_mistake_at(&section.byte_range_of_value_or_section("id"), text);
        }
        actuators.push(actuator);
        section.report_unknown_keys();
    }
    actuators
}
