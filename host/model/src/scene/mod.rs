//! Scene files: what the surface is, what holds it and what drives it.
//!
//! The format is TOML, `version = 1`; `docs/src/scene.md` is its reference. [`Scene`] is the same in SI units and plain
//! data. Every mistake in a file is told with its key, value, allowed range and line, all of them at once.

mod actuator;
mod air;
mod electronics;
mod finger;
mod laminate;
mod layers;
mod layout;
mod modal_ratio;
mod nearest_name;
mod parse;
mod patch;
mod place;
pub mod random;
mod ranges;
pub mod read;
mod rectangles;
mod scaled;
mod screen;

pub use actuator::{Actuator, ChargingTimes, DEFAULT_CABLE_CAPACITANCE_F, EPS0, Mount};
pub use air::BULK_MODULUS_PA;
pub use finger::Finger;
pub use laminate::{Laminate, PlateRigidities, Ply, PlyElasticity};
pub use layout::{LayoutVertex, SAME_PLACE, SurfaceLayer, SurfaceLayout};
pub use modal_ratio::ModalRatio;
pub use nearest_name::find_nearest_name;
pub use patch::{Cutout, Patch};
pub use place::{PlaceError, ROUNDING, SurfacePoint, check_and_snap_coordinate_along_side, equidistant_numbers};
pub use read::describe_toml_syntax_mistake;
pub use read::{FileMistake, SceneError};
pub use screen::{PixelError, Screen, ScreenError};

use crate::text_file::read_text_file;
use serde::Serialize;
use std::path::Path;

/// The example plate, as in `examples/scenes/plate.toml`.
pub const EXAMPLE_PLATE: &str = include_str!("../../../../examples/scenes/plate.toml");
/// The same plate with its actuators where one would put them first, from which studies begin, as in `examples/scenes/starting_plate.toml`.
pub const STARTING_PLATE: &str = include_str!("../../../../examples/scenes/starting_plate.toml");
/// The example bar, as in `examples/scenes/bar.toml`.
pub const EXAMPLE_BAR: &str = include_str!("../../../../examples/scenes/bar.toml");
/// The hardest press in N where a scene names none: fingers touch with 0.5 to 1 N, and press a button with up to 5.
pub const DEFAULT_PRESS_N: f64 = 5.0;
/// The hardest press in N that a scene may name: what a person can bring to bear.
pub const MOST_PRESS_N: f64 = 1000.0;
/// Most actuators that are planned for and driven: the channels of a board. The model takes any number.
pub const MAX_ACTUATORS: usize = era_shared::MAX_CHANNELS;

/// A scene in SI units. Positions are in m from the surface's top-left corner, x to the right, y down.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Scene {
    /// Its name.
    pub name: String,
    /// The panel itself.
    pub surface: Surface,
    /// Rectangles of other thickness or material, later ones over earlier ones.
    pub patches: Vec<Patch>,
    /// Rectangles that are cut away.
    pub cutouts: Vec<Cutout>,
    /// Which pixels lie where on it.
    pub screen: Screen,
    /// Point spring-dampers to ground, in the file's order: messages and previews name them by it. What one does is in
    /// `model/attached.rs`, which is read by `assembly.rs` (matrices), `rigid.rs` (what holds the surface), `neighbours.rs` and `placement.rs`
    /// (functions of point forces, mesh lines) and `estimator.rs` (moments at points).
    pub supports: Vec<Support>,
    /// Line supports.
    pub edges: Vec<Edge>,
    /// Point masses.
    pub masses: Vec<Mass>,
    /// ERAs; actuator i is on channel i of the board.
    pub actuators: Vec<Actuator>,
    /// The hardest press of a finger, anywhere on the surface, that gaps have to bear, in N.
    pub press_n: f64,
    /// What rests on the place that is touched. Modes, maps of what can be reached and whatever else is not about one touch are of the
    /// panel without it; [`Scene::replace_finger_by_masses_and_supports_at_places`] is the panel with it.
    pub finger: Option<Finger>,
    /// Depth of the sealed cavity behind the panel in m, if there is one.
    pub sealed_depth_m: Option<f64>,
}

/// What kind of structure the surface is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[cfg_attr(feature = "schema", derive(utoipa::ToSchema))]
#[serde(rename_all = "lowercase")]
pub enum SurfaceKind {
    /// A thin plate (Kirchhoff).
    Plate,
    /// A slender bar along x (Euler-Bernoulli).
    Bar,
}

/// The panel.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Surface {
    /// Plate or bar.
    pub kind: SurfaceKind,
    /// Along x in m.
    pub length_m: f64,
    /// Along y in m.
    pub width_m: f64,
    /// In m.
    pub thickness_m: f64,
    /// What it is made of; of layers the uniform material of their weight and stiffness, [`Laminate::to_uniform_material`].
    pub material: Material,
    /// Its layers from the bottom to the top, where it is not of one piece.
    pub layers: Vec<Ply>,
    /// Its own damping.
    pub damping: SurfaceDamping,
    /// Mass of the air that moves with it, in kg/m^2.
    pub added_mass_kg_per_m2: f64,
}

/// An isotropic elastic material.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Material {
    /// Young's modulus in Pa.
    pub youngs_modulus_pa: f64,
    /// Poisson's ratio; of no account for a bar.
    pub poisson_ratio: f64,
    /// Density in kg/m^3.
    pub density_kg_m3: f64,
}

/// The surface's own damping.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum SurfaceDamping {
    /// None.
    None,
    /// Hysteretic: the surface's stiffness times 1 + j eta.
    LossFactor(f64),
    /// A viscous ratio on every mode of the surface with its supports and masses, ERAs left out: the same on all, or by its frequency.
    ModalRatio(ModalRatio),
    /// C = alpha M + beta K of the surface's own matrices.
    Rayleigh {
        /// In 1/s.
        alpha: f64,
        /// In s.
        beta: f64,
    },
}

/// A point spring-damper to ground.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Support {
    /// In m.
    pub x_m: f64,
    /// In m.
    pub y_m: f64,
    /// In N/m.
    pub stiffness_n_per_m: f64,
    /// In N s/m.
    pub damping_n_s_per_m: f64,
    /// Against slopes in both directions, in N m/rad.
    pub rotational_stiffness_n_m_per_rad: f64,
    /// Hysteretic: both stiffnesses times 1 + j eta.
    pub loss_factor: f64,
}

/// A side of the surface.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[cfg_attr(feature = "schema", derive(utoipa::ToSchema))]
#[serde(rename_all = "lowercase")]
pub enum Side {
    /// x = 0.
    Left,
    /// x = length.
    Right,
    /// y = 0.
    Top,
    /// y = width.
    Bottom,
}

/// How an edge is held.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum EdgeKind {
    /// No deflection.
    Pinned,
    /// No deflection, no slope.
    Clamped,
    /// Springs along it.
    Elastic {
        /// In N/m^2 (plate) or N/m (bar).
        stiffness: f64,
        /// In N/rad (plate, per metre) or N m/rad (bar).
        rotational_stiffness: f64,
        /// Hysteretic: both stiffnesses times 1 + j eta.
        loss_factor: f64,
    },
}

impl EdgeKind {
    /// The word in the file.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            EdgeKind::Pinned => "pinned",
            EdgeKind::Clamped => "clamped",
            EdgeKind::Elastic { .. } => "elastic",
        }
    }

    /// Loss factor of the edge's springs; 0 where it has none.
    #[must_use]
    pub const fn spring_loss_factor(self) -> f64 {
        match self {
            EdgeKind::Elastic { loss_factor, .. } => loss_factor,
            EdgeKind::Pinned | EdgeKind::Clamped => 0.0,
        }
    }
}

/// A line support.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Edge {
    /// Where.
    pub side: Side,
    /// How.
    pub kind: EdgeKind,
}

/// A point mass fixed to the surface.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Mass {
    /// In m.
    pub x_m: f64,
    /// In m.
    pub y_m: f64,
    /// In kg.
    pub mass_kg: f64,
}

impl Scene {
    /// Reads a scene from text; `source_name` is what messages call it.
    ///
    /// # Errors
    /// [`SceneError`] with every mistake found.
    pub fn parse(source_name: &str, text: &str) -> Result<Self, SceneError> {
        parse::parse_scene_text(source_name, text)
    }

    /// Reads a scene file.
    ///
    /// # Errors
    /// [`SceneError`] with every mistake found, or why the file cannot be read.
    pub fn load(path: &Path) -> Result<Self, SceneError> {
        Self::parse(&path.display().to_string(), &Self::read_scene_text(path)?)
    }

    /// Reads the text of a scene file, for [`Scene::parse`].
    ///
    /// # Errors
    /// [`SceneError`] if the file cannot be read.
    pub fn read_scene_text(path: &Path) -> Result<String, SceneError> {
        read_text_file(path).map_err(|error| SceneError::from_read_error(&path.display().to_string(), &error))
    }
}
