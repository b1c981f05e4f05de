//! What each cell is made of, and what the whole surface's waves are like.

use super::mesh::Lines;
use crate::scene::{Layer, Layout, Scene, SurfaceKind};

/// What a cell is made of.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Section {
    /// Flexural rigidity in N m (plate), E h^3 / (12 (1 - nu^2)), or bending stiffness in N m^2 (bar), E b h^3 / 12.
    pub rigidity: f64,
    /// Mass per area (plate) or length (bar), in kg/m^2 or kg/m.
    pub per_area: f64,
    /// Poisson's ratio.
    pub poisson: f64,
}

impl Section {
    /// Of a layer.
    #[must_use]
    pub fn of(kind: SurfaceKind, layer: &Layer) -> Self {
        let nu = layer.material.poisson_ratio;
        let slab = layer.material.youngs_modulus_pa * layer.thickness_m.powi(3) / 12.0;
        match kind {
            SurfaceKind::Plate => {
                Self { rigidity: slab / (1.0 - nu * nu), per_area: layer.per_area_kg_m2(), poisson: nu }
            }
            SurfaceKind::Bar => {
                Self { rigidity: slab * layer.width_m, per_area: layer.per_area_kg_m2() * layer.width_m, poisson: nu }
            }
        }
    }
}

/// The sections of a mesh's cells; `None` where the surface is cut away.
#[derive(Clone, Debug)]
pub struct Sections {
    columns: usize,
    of: Vec<Option<Section>>,
    has_cutouts: bool,
}

impl Sections {
    /// Every border of the layout must have a line.
    #[must_use]
    pub fn new(kind: SurfaceKind, layout: &Layout, x: &Lines, y: Option<&Lines>) -> Self {
        let middles = |lines: &Lines| -> Vec<f64> { lines.at.windows(2).map(|at| 0.5 * (at[0] + at[1])).collect() };
        let in_x = middles(x);
        let mut of = Vec::new();
        for y in y.map_or_else(|| vec![0.0], middles) {
            of.extend(in_x.iter().map(|x| layout.at(*x, y).map(|layer| Section::of(kind, &layer))));
        }
        Self { columns: in_x.len(), has_cutouts: of.contains(&None), of }
    }

    /// Of a cell.
    #[must_use]
    pub fn at(&self, cell_x: usize, cell_y: usize) -> Option<Section> {
        self.of.get(cell_y * self.columns + cell_x).copied().flatten()
    }

    /// Whether cells are cut away.
    #[must_use]
    pub fn has_cutouts(&self) -> bool {
        self.has_cutouts
    }
}

/// Rigidity over mass per area (plate) or length (bar), in m^4/s^2, over a surface that may have several.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Waves {
    /// The least: that of the shortest waves.
    pub least: f64,
    /// That of the uniform surface with as many modes below a frequency: by Weyl's law a plate's count goes with the sum of
    /// area times (m / D)^1/2, a bar's with that of length times (m / D)^1/4.
    pub mean: f64,
    /// The softest part under the heaviest one's weight.
    pub slowest: f64,
    /// The least rigidity.
    pub softest: f64,
}

impl Waves {
    /// Of a scene's surface.
    #[must_use]
    pub fn of(scene: &Scene) -> Self {
        let kind = scene.surface.kind;
        let layout = scene.layout();
        let all: Vec<(f64, Section)> = layout.layers().map(|(size, layer)| (size, Section::of(kind, &layer))).collect();
        let least = all.iter().map(|(_, s)| s.rigidity / s.per_area).fold(f64::INFINITY, f64::min);
        let softest = all.iter().map(|(_, s)| s.rigidity).fold(f64::INFINITY, f64::min);
        let heaviest = all.iter().map(|(_, s)| s.per_area).fold(0.0, f64::max);
        let (size, power) = match kind {
            SurfaceKind::Plate => (scene.surface.length_m * scene.surface.width_m, 0.5),
            SurfaceKind::Bar => (scene.surface.length_m, 0.25),
        };
        // Relative to the least, so that one layer alone loses no digit.
        let weighted: f64 = all.iter().map(|(size, s)| size * (least * s.per_area / s.rigidity).powf(power)).sum();
        Self { least, mean: least * (size / weighted).powf(1.0 / power), slowest: softest / heaviest, softest }
    }
}

/// Least shift, as a part of what a uniform surface with as many modes has.
const LEAST_SHIFT: f64 = 1e-5;

/// The shift in rad^2/s^2: a quarter of the first bending frequency of the free surface, squared (omega L^2 / sqrt(D/m) =
/// 22.4). Small enough to separate the low modes, large enough that K + s M is definite whatever holds the panel.
pub(super) fn shift(scene: &Scene) -> f64 {
    let length = scene.surface.length_m.max(scene.surface.width_m);
    // With patches the softest part may bend under the heaviest one; a shift much below the other modes separates nothing.
    let waves = Waves::of(scene);
    (22.4 / (length * length)).powi(2) * waves.slowest.max(LEAST_SHIFT * waves.mean) / 16.0
}
