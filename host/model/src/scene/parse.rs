//! The scene file's keys and what they may be.

use super::laminate::{Laminate, Ply};
use super::layers::{layers, thickness_m};
use super::layout::Layout;
use super::modal_ratio::{MOST_POINTS, ModalRatio};
use super::place::ROUNDING;
use super::ranges::{DENSITY_KG_M3, LOSS_FACTOR, POISSON_RATIO, Size, THICKNESS_MM, YOUNGS_MODULUS_PA, side_range};
use super::read::{self, Allowed, Report, SceneError, Section};
use super::rectangles::{cutouts, patches};
use super::{
    Actuator, DEFAULT_PRESS_N, Edge, EdgeKind, Finger, MOST_PRESS_N, Mass, Material, Mount, Scene, Screen, Side,
    Support, Surface, SurfaceDamping, SurfaceKind,
};

/// The version of scene files that is read.
const VERSION: f64 = 1.0;
/// Largest side of a panel in mm; beyond it this is not a touch surface and someone has mixed up units.
const MAX_SIDE_MM: f64 = 10_000.0;
/// A thousand tonnes, in g: for masses that only stand for "held still".
const MOST_MASS_G: f64 = 1e12;
const MASS_G: Allowed = Allowed::Within(0.0, MOST_MASS_G);
/// All springs, in N/m, N m/rad and per metre: the model is tested up to 1e18.
const STIFFNESS: Allowed = Allowed::Within(0.0, 1e20);
/// All dashpots, in N s/m.
const DAMPING: Allowed = Allowed::Within(0.0, 1e12);
/// A finger, in g, N s/m and N/m: a hundred times what is measured on fingertips, which is more than a whole arm. Beyond it someone has mixed up
/// units.
const FINGER_MASS_G: Allowed = Allowed::Within(0.0, 1000.0);
const FINGER_DAMPING: Allowed = Allowed::Within(0.0, 1000.0);
const FINGER_STIFFNESS: Allowed = Allowed::Within(0.0, 1e6);
/// Damping ratios of modes; from 1 on they do not swing.
const MODAL_RATIO: Allowed = Allowed::Within(0.0, 10.0);
/// Frequencies that such a ratio is told for, in Hz: what can be computed, and beyond.
const MODE_HZ: Allowed = Allowed::Within(0.0, 1e6);
/// Sealed air behind the panel: from a film of it to a room.
const SEALED_DEPTH_MM: Allowed = Allowed::Within(0.01, MAX_SIDE_MM);
/// Air that moves with the surface, in kg/m^2: a hundred times what a piston as large as any panel moves.
const ADDED_MASS: Allowed = Allowed::Within(0.0, 1000.0);
/// Electrodes up to a square metre.
const AREA_MM2: Allowed = Allowed::Within(1e-6, 1e6);
/// A stop nearer to a mass's middle leaves it no room.
const LEAST_STOP_UM: f64 = 0.1;
/// Most pixels along a side.
const MAX_PIXELS: u32 = 100_000;

pub(super) fn scene(source: &str, text: &str) -> Result<Scene, SceneError> {
    let document = read::document(source, text)?;
    let report = Report::new(text);
    let file = Section::new(&report, document.get_ref(), String::new(), 0..0);
    let scene = whole(&file);
    file.close();
    report.finish(source)?;
    // Every part that is missing has been reported.
    scene.ok_or_else(|| SceneError::of(source, 0, "incomplete".into()))
}

fn whole(file: &Section<'_, '_>) -> Option<Scene> {
    file.number("version", Allowed::Within(VERSION, VERSION));
    let name = file.text("name");
    let plies = file.tables("layer");
    let mut surface = file.required_table("surface").map(|section| surface(section, plies));
    let (sealed_depth_m, added_mass) = file.table("air").map_or((None, 0.0), air);
    if let Some(surface) = &mut surface {
        surface.added_mass_kg_per_m2 = added_mass;
    }
    let kind = surface.as_ref().map_or(SurfaceKind::Plate, |surface| surface.kind);
    let (length_m, width_m) = surface.as_ref().map_or((f64::NAN, f64::NAN), |s| (s.length_m, s.width_m));
    let mut size = Size { kind, length_m, width_m, left: None };
    let patches = patches(file.tables("patch"), surface.as_ref(), &size);
    let cutouts = cutouts(file.tables("cutout"), surface.as_ref(), &size);
    size.left = surface.as_ref().filter(|_| !cutouts.is_empty()).map(|surface| Layout::new(surface, &[], &cutouts));
    let screen = screen(file.table("screen"), &size);
    let supports = file.tables("support").into_iter().map(|section| support(section, &size)).collect();
    let edges = edges(file.tables("edge"), &size);
    let masses = file.tables("mass").into_iter().map(|section| mass(section, &size)).collect();
    let actuators = actuators(file.tables("actuator"), &size);
    let press_n = file.table("press").map_or(DEFAULT_PRESS_N, press);
    let finger = file.table("finger").map(finger);
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

fn surface(section: Section<'_, '_>, plies: Vec<Section<'_, '_>>) -> Surface {
    let kind =
        section.word("kind", &[("plate", SurfaceKind::Plate), ("bar", SurfaceKind::Bar)]).unwrap_or(SurfaceKind::Plate);
    let side = |key| section.number(key, Allowed::Within(1.0, MAX_SIDE_MM)) / 1e3;
    let (length_m, width_m) = (side("length_mm"), side("width_mm"));
    let layers = layers(plies, kind);
    let own_damping = section.table("damping").map_or(SurfaceDamping::None, damping);
    let (thickness_m, material, damping) = if layers.is_empty() {
        (section.number("thickness_mm", THICKNESS_MM) / 1e3, material(&section, kind), own_damping)
    } else {
        let laminate = Laminate::of(kind, &layers);
        let damping = damping_of_layers(&section, &layers, laminate.loss_factor, own_damping);
        (thickness_m(&section, &layers), laminate.uniform(kind), damping)
    };
    section.close();
    Surface { kind, length_m, width_m, thickness_m, material, layers, damping, added_mass_kg_per_m2: 0.0 }
}

fn material(surface: &Section<'_, '_>, kind: SurfaceKind) -> Material {
    let nothing = Material { youngs_modulus_pa: f64::NAN, poisson_ratio: f64::NAN, density_kg_m3: f64::NAN };
    surface.required_table("material").map_or(nothing, |table| {
        let material = Material {
            youngs_modulus_pa: table.number("youngs_modulus_pa", YOUNGS_MODULUS_PA),
            poisson_ratio: match kind {
                SurfaceKind::Plate => table.number("poisson_ratio", POISSON_RATIO),
                SurfaceKind::Bar => table.number_or("poisson_ratio", 0.0, POISSON_RATIO),
            },
            density_kg_m3: table.number("density_kg_m3", DENSITY_KG_M3),
        };
        table.close();
        material
    })
}

/// The damping of a surface whose layers may have losses, which are `loss_factor` together: of these or of the surface's own.
fn damping_of_layers(
    surface: &Section<'_, '_>,
    plies: &[Ply],
    loss_factor: f64,
    own: SurfaceDamping,
) -> SurfaceDamping {
    if plies.iter().all(|ply| ply.loss_factor == 0.0) {
        return own;
    }
    if own != SurfaceDamping::None {
        let text = String::from(
            "surface.damping and loss_factor of a [[layer]] are given, but at most one of them is allowed: the layers' are the surface's",
        );
        surface.report().add(&surface.place("damping"), text);
    }
    SurfaceDamping::LossFactor(loss_factor)
}

fn damping(section: Section<'_, '_>) -> SurfaceDamping {
    let has = [
        section.has("loss_factor"),
        section.has("modal_ratio"),
        section.has("rayleigh_alpha") | section.has("rayleigh_beta"),
    ];
    let loss_factor = section.number_or("loss_factor", 0.0, LOSS_FACTOR);
    let modal_ratio = modal_ratio(&section);
    let alpha = section.number_or("rayleigh_alpha", 0.0, Allowed::Within(0.0, 1e6));
    let beta = section.number_or("rayleigh_beta", 0.0, Allowed::Within(0.0, 1.0));
    // A kind that is there but zero is as good as not there.
    let chosen = [loss_factor != 0.0, modal_ratio != ModalRatio::same(0.0), alpha != 0.0 || beta != 0.0];
    if chosen.iter().filter(|chosen| **chosen).count() > 1 {
        let kinds = ["loss_factor", "modal_ratio", "rayleigh_alpha/rayleigh_beta"];
        let given: Vec<_> = kinds.into_iter().zip(has).filter(|(_, has)| *has).map(|(kind, _)| kind).collect();
        let place = given.last().map_or(0..0, |kind| section.place(kind.split('/').next().unwrap_or(kind)));
        let text = format!(
            "{}: {} are given, but at most one kind of damping is allowed",
            section.path(),
            given.join(" and ")
        );
        section.report().add(&place, text);
    }
    section.close();
    match chosen {
        [true, ..] => SurfaceDamping::LossFactor(loss_factor),
        [_, true, _] => SurfaceDamping::ModalRatio(modal_ratio),
        [.., true] => SurfaceDamping::Rayleigh { alpha, beta },
        _ => SurfaceDamping::None,
    }
}

/// One number for all modes, or pairs of frequency and number.
fn modal_ratio(section: &Section<'_, '_>) -> ModalRatio {
    const KEY: &str = "modal_ratio";
    if !section.is_list(KEY) {
        return ModalRatio::same(section.number_or(KEY, 0.0, MODAL_RATIO));
    }
    let pairs = section.pairs(KEY, MODE_HZ, MODAL_RATIO);
    pairs.as_deref().and_then(ModalRatio::table).unwrap_or_else(|| {
        let wanted = format!(
            "a number {MODAL_RATIO}, or 1 to {MOST_POINTS} pairs of a frequency in Hz {MODE_HZ}, each higher than the one before, and such a number"
        );
        section.wrong_list(KEY, &wanted);
        ModalRatio::same(0.0)
    })
}

fn screen(section: Option<Section<'_, '_>>, size: &Size) -> Screen {
    let whole = Screen {
        // A pixel per mm where the file has no screen.
        width_px: pixels(size.length_m),
        height_px: pixels(size.width_m),
        x_m: 0.0,
        y_m: 0.0,
        width_m: size.length_m,
        height_m: size.width_m,
    };
    let Some(section) = section else { return whole };
    let mut screen = Screen {
        width_px: section.count("width_px", MAX_PIXELS),
        height_px: section.count("height_px", MAX_PIXELS),
        ..whole
    };
    let area = [section.has("x_mm"), section.has("y_mm"), section.has("width_mm"), section.has("height_mm")];
    if area.contains(&true) {
        let part = |key, side_m: f64, default_m: f64, allowed| {
            section.number_or(key, default_m * 1e3, allowed) / 1e3 + 0.0 * side_m
        };
        screen.x_m = part("x_mm", size.length_m, 0.0, side_range(size.length_m));
        screen.y_m = part("y_mm", size.width_m, 0.0, side_range(size.width_m));
        screen.width_m = part("width_mm", size.length_m, size.length_m - screen.x_m, Allowed::Positive);
        screen.height_m = part("height_mm", size.width_m, size.width_m - screen.y_m, Allowed::Positive);
        for (key, start_key, start, extent, side) in [
            ("width_mm", "x_mm", screen.x_m, &mut screen.width_m, size.length_m),
            ("height_mm", "y_mm", screen.y_m, &mut screen.height_m, size.width_m),
        ] {
            let end = start + *extent;
            if end > side * (1.0 + ROUNDING) {
                let text = format!(
                    "{} makes the active area end at {} mm, but must keep it within the surface's {} mm",
                    section.key(key),
                    end * 1e3,
                    side * 1e3
                );
                section.report().add(&section.place(key), text);
            } else if *extent <= 0.0 {
                let text = format!(
                    "{} is {}, but must be below {} to leave an active area",
                    section.key(start_key),
                    start * 1e3,
                    side * 1e3
                );
                section.report().add(&section.place(start_key), text);
            } else {
                *extent = within(start, *extent, side);
            }
        }
    }
    section.close();
    screen
}

/// `extent`, less what rounding made of it too much: the last pixel is to lie on the surface, not a rounding error
/// beyond it, where no plan is made. Takes a step or two.
fn within(start: f64, mut extent: f64, side: f64) -> f64 {
    while start + extent > side {
        extent -= start + extent - side;
    }
    extent
}

#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a side of at most 10 m; `as` saturates")]
fn pixels(side_m: f64) -> u32 {
    ((side_m * 1e3).round() as u32).max(1)
}

fn support(section: Section<'_, '_>, size: &Size) -> Support {
    let (x_m, y_m) = size.place_m(&section);
    let support = Support {
        x_m,
        y_m,
        stiffness_n_per_m: section.number("stiffness_n_per_m", STIFFNESS),
        damping_n_s_per_m: section.number_or("damping_n_s_per_m", 0.0, DAMPING),
        rotational_stiffness_n_m_per_rad: section.number_or("rotational_stiffness_n_m_per_rad", 0.0, STIFFNESS),
        loss_factor: section.number_or("loss_factor", 0.0, LOSS_FACTOR),
    };
    section.close();
    support
}

fn edges(sections: Vec<Section<'_, '_>>, size: &Size) -> Vec<Edge> {
    let sides: &[(&str, Side)] = match size.kind {
        SurfaceKind::Plate => {
            &[("left", Side::Left), ("right", Side::Right), ("top", Side::Top), ("bottom", Side::Bottom)]
        }
        SurfaceKind::Bar => &[("left", Side::Left), ("right", Side::Right)],
    };
    let mut edges: Vec<Edge> = Vec::new();
    for section in sections {
        let side = section.word("side", sides);
        let word = section.word("kind", &[("pinned", 0), ("clamped", 1), ("elastic", 2)]);
        let kind = match word {
            Some(0) => Some(EdgeKind::Pinned),
            Some(1) => Some(EdgeKind::Clamped),
            Some(_) => Some(elastic(&section, size.kind)),
            None => None,
        };
        if let (Some(side), Some(kind)) = (side, kind) {
            if edges.iter().any(|edge| edge.side == side) {
                section
                    .report()
                    .add(&section.place("side"), format!("{}: this side has an edge already", section.key("side")));
            }
            if !size.has_side(side) {
                let text = format!("{}: [[cutout]] has taken this side away", section.key("side"));
                section.report().add(&section.place("side"), text);
            }
            edges.push(Edge { side, kind });
        }
        section.close();
    }
    edges
}

/// A plate's edge springs are per metre of edge, a bar's are at its end.
fn elastic(section: &Section<'_, '_>, kind: SurfaceKind) -> EdgeKind {
    let (stiffness, rotational) = match kind {
        SurfaceKind::Plate => ("stiffness_n_per_m2", "rotational_stiffness_n_per_rad"),
        SurfaceKind::Bar => ("stiffness_n_per_m", "rotational_stiffness_n_m_per_rad"),
    };
    EdgeKind::Elastic {
        stiffness: section.number_or(stiffness, 0.0, STIFFNESS),
        rotational_stiffness: section.number_or(rotational, 0.0, STIFFNESS),
        loss_factor: section.number_or("loss_factor", 0.0, LOSS_FACTOR),
    }
}

fn mass(section: Section<'_, '_>, size: &Size) -> Mass {
    let (x_m, y_m) = size.place_m(&section);
    let mass = Mass { x_m, y_m, mass_kg: section.number("mass_g", MASS_G) / 1e3 };
    section.close();
    mass
}

fn press(section: Section<'_, '_>) -> f64 {
    let force_n = section.number_or("force_n", DEFAULT_PRESS_N, Allowed::Within(0.0, MOST_PRESS_N));
    section.close();
    force_n
}

/// Depth of the sealed cavity in m, if there is one, and mass that moves with the surface in kg/m^2.
fn air(section: Section<'_, '_>) -> (Option<f64>, f64) {
    let depth_m = section.has("sealed_depth_mm").then(|| section.number("sealed_depth_mm", SEALED_DEPTH_MM) / 1e3);
    let added_mass = section.number_or("added_mass_kg_per_m2", 0.0, ADDED_MASS);
    section.close();
    (depth_m, added_mass)
}

fn finger(section: Section<'_, '_>) -> Finger {
    let finger = Finger {
        mass_kg: section.number_or("mass_g", 0.0, FINGER_MASS_G) / 1e3,
        damping_n_s_per_m: section.number_or("damping_n_s_per_m", 0.0, FINGER_DAMPING),
        stiffness_n_per_m: section.number_or("stiffness_n_per_m", 0.0, FINGER_STIFFNESS),
    };
    section.close();
    finger
}

fn actuators(sections: Vec<Section<'_, '_>>, size: &Size) -> Vec<Actuator> {
    let mut actuators: Vec<Actuator> = Vec::new();
    for section in sections {
        let mount = section.word("mount", &[("inertial", Mount::Inertial), ("grounded", Mount::Grounded)]);
        // A grounded ERA without a mass is a spring with a force; an inertial one has nothing to push off from.
        let moving_mass = if mount == Some(Mount::Inertial) { Allowed::Within(1e-9, MOST_MASS_G) } else { MASS_G };
        let id = section.text("id");
        let (x_m, y_m) = size.place_m(&section);
        let max_voltage_v = section.number("max_voltage_v", Allowed::Within(1.0, 10_000.0));
        let air_gap_um = section.number("air_gap_um", Allowed::Within(1.0, 1e5));
        let stop = Allowed::Within(LEAST_STOP_UM, if air_gap_um.is_nan() { f64::MAX } else { air_gap_um });
        let stop_um = section.has("stop_um").then(|| section.number("stop_um", stop));
        let bias = Allowed::Within(0.0, if max_voltage_v.is_nan() { f64::MAX } else { max_voltage_v });
        let actuator = Actuator {
            id,
            x_m,
            y_m,
            mount: mount.unwrap_or(Mount::Grounded),
            moving_mass_kg: section.number("moving_mass_g", moving_mass) / 1e3,
            stiffness_n_per_m: section.number("stiffness_n_per_m", STIFFNESS),
            damping_n_s_per_m: section.number_or("damping_n_s_per_m", 0.0, DAMPING),
            housing_mass_kg: section.number_or("housing_mass_g", 0.0, MASS_G) / 1e3,
            electrode_area_m2: section.number("electrode_area_mm2", AREA_MM2) / 1e6,
            air_gap_m: air_gap_um / 1e6,
            max_voltage_v,
            stop_m: stop_um.map(|um| um / 1e6),
            bias_voltage_v: section.number_or("bias_voltage_v", 0.0, bias),
        };
        if actuator.bias_voltage_v > 0.0 && actuator.effective_stiffness_n_per_m() <= 0.0 {
            let text = format!(
                "{} is {}, but must be below {:.1} V, where the electrodes pull the mass in (its springs of {} N/m are \
                 softened to nothing)",
                section.key("bias_voltage_v"),
                actuator.bias_voltage_v,
                actuator.pull_in_voltage_v(),
                actuator.stiffness_n_per_m
            );
            section.report().add(&section.place("bias_voltage_v"), text);
        }
        if !actuator.id.is_empty() && actuators.iter().any(|other| other.id == actuator.id) {
            let text = format!("{} is {:?}, but another actuator has that id already", section.key("id"), actuator.id);
            section.report().add(&section.place("id"), text);
        }
        actuators.push(actuator);
        section.close();
    }
    actuators
}
