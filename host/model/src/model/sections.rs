//! What each cell is made of, and what the whole surface's waves are like.

use super::mesh::GridLines;
use crate::scene::{PlateRigidities, Scene, SurfaceKind, SurfaceLayer, SurfaceLayout};

/// What a cell is made of.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CellSection {
    /// Flexural rigidity in N m (plate), E h^3 / (12 (1 - nu^2)), or bending stiffness in N m^2 (bar), E b h^3 / 12. Of layers that
    /// differ along x and y the geometric mean of D11 and D22.
    pub rigidity: f64,
    /// Mass per area (plate) or length (bar), in kg/m^2 or kg/m.
    pub per_area: f64,
    /// How a plate bends in the one direction and in the other.
    pub bending: RelativeBending,
}

/// A plate's rigidities over one of them: with w_xx, w_yy and w_xy twice its energy is x w_xx^2 + y w_yy^2 + 2 poisson w_xx w_yy +
/// twist w_xy^2 times that.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RelativeBending {
    /// D11.
    pub x: f64,
    /// D22.
    pub y: f64,
    /// D12; Poisson's ratio of an isotropic plate.
    pub poisson: f64,
    /// 4 D66: 2 (1 - nu) of an isotropic plate.
    pub twist: f64,
}

impl RelativeBending {
    /// The bending of an isotropic plate with this Poisson's ratio.
    #[must_use]
    pub const fn from_poisson_ratio(poisson: f64) -> Self {
        Self { x: 1.0, y: 1.0, poisson, twist: 2.0 * (1.0 - poisson) }
    }

    /// Rigidities relative to one of them.
    fn from_rigidities_divided_by(divisor: f64, rigidities: &PlateRigidities) -> Self {
        let PlateRigidities { d11, d12, d22, d66 } = rigidities;
        Self { x: d11 / divisor, y: d22 / divisor, poisson: d12 / divisor, twist: 4.0 * d66 / divisor }
    }

    /// Whether the plate is isotropic.
    #[must_use]
    pub fn is_isotropic(&self) -> bool {
        *self == Self::from_poisson_ratio(self.poisson)
    }

    /// Bending moments of curvatures: about one axis, about the other, and twice the twisting moment.
    #[inline(always)]
    pub fn relative_bending_moments_and_twice_twisting_moment(
        &self,
        curvature_x: f64,
        curvature_y: f64,
        twist_curvature: f64,
    ) -> [f64; 3] {
        [
            self.x * curvature_x + self.poisson * curvature_y,
            self.y * curvature_y + self.poisson * curvature_x,
            self.twist * twist_curvature,
        ]
    }

    fn to_relative_rigidities(self) -> PlateRigidities {
        PlateRigidities { d11: self.x, d12: self.poisson, d22: self.y, d66: 0.25 * self.twist }
    }

    /// The rigidity of the isotropic plate with as many modes: by Weyl's law a plate's count goes with the mean of 1 over its square root.
    fn relative_rigidity_of_isotropic_plate_with_as_many_modes(&self) -> f64 {
        let rigidities = self.to_relative_rigidities();
        let part = |k: u32| {
            let angle = std::f64::consts::FRAC_PI_2 * (f64::from(k) + 0.5) / f64::from(DIRECTIONS);
            1.0 / rigidities.rigidity_in_direction(angle.cos().powi(2)).sqrt()
        };
        ((0..DIRECTIONS).map(part).sum::<f64>() / f64::from(DIRECTIONS)).powi(-2)
    }
}

/// Directions of a quarter turn that means are over: what is smooth around the circle converges as a power of their number.
const DIRECTIONS: u32 = 48;

impl CellSection {
    /// The section of a cell made of this layer.
    #[must_use]
    pub fn from_layer(kind: SurfaceKind, layer: &SurfaceLayer) -> Self {
        let nu = layer.material.poisson_ratio;
        let slab = layer.material.youngs_modulus_pa * layer.thickness_m.powi(3) / 12.0;
        let per_area = layer.mass_per_area_with_air_kg_m2();
        match kind {
            SurfaceKind::Plate => {
                let rigidity = slab / (1.0 - nu * nu);
                let bending =
                    layer.orthotropic.as_ref().map(|of| RelativeBending::from_rigidities_divided_by(rigidity, of));
                Self { rigidity, per_area, bending: bending.unwrap_or(RelativeBending::from_poisson_ratio(nu)) }
            }
            SurfaceKind::Bar => Self {
                rigidity: slab * layer.width_m,
                per_area: per_area * layer.width_m,
                bending: RelativeBending::from_poisson_ratio(nu),
            },
        }
    }

    /// The least rigidity against waves in any direction, the mean, and the largest.
    fn least_mean_and_largest_bending_rigidity(&self) -> [f64; 3] {
        if self.bending.is_isotropic() {
            return [self.rigidity; 3];
        }
        let [least, largest] = self.bending.to_relative_rigidities().least_and_largest_rigidity_over_directions();
        [least, self.bending.relative_rigidity_of_isotropic_plate_with_as_many_modes(), largest]
            .map(|part| part * self.rigidity)
    }
}

/// The sections of a mesh's cells; `None` where the surface is cut away.
#[derive(Clone, Debug)]
pub struct CellSections {
    columns: usize,
    of: Vec<Option<CellSection>>,
    has_cutouts: bool,
}

impl CellSections {
    /// Every border of the layout must have a line.
    #[must_use]
    pub fn new(kind: SurfaceKind, layout: &SurfaceLayout, x: &GridLines, y: Option<&GridLines>) -> Self {
        let middles = |lines: &GridLines| -> Vec<f64> { lines.at.windows(2).map(|at| 0.5 * (at[0] + at[1])).collect() };
        let in_x = middles(x);
        let mut of = Vec::new();
        for y in y.map_or_else(|| vec![0.0], middles) {
            of.extend(
                in_x.iter()
                    .map(|x| layout.layer_at_unless_cut_out(*x, y).map(|layer| CellSection::from_layer(kind, &layer))),
            );
        }
        Self { columns: in_x.len(), has_cutouts: of.contains(&None), of }
    }

    /// The section of a cell; `None` if it is cut away.
    #[must_use]
    pub fn section_of_cell_unless_cut_away(&self, cell_x: usize, cell_y: usize) -> Option<CellSection> {
        self.of.get(cell_y * self.columns + cell_x).copied().flatten()
    }

    /// Whether cells are cut away.
    #[must_use]
    pub fn has_cut_away_cells(&self) -> bool {
        self.has_cutouts
    }
}

/// Rigidity over mass per area (plate) or length (bar), in m^4/s^2, over a surface that may have several.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct WaveRigidities {
    /// The least: that of the shortest waves.
    pub least: f64,
    /// That of the uniform surface with as many modes below a frequency: by Weyl's law a plate's count goes with the sum of
    /// area times (m / D)^1/2, a bar's with that of length times (m / D)^1/4.
    pub mean: f64,
    /// The softest part under the heaviest one's weight.
    pub slowest: f64,
    /// The least rigidity.
    pub softest: f64,
    /// The largest.
    pub stiffest: f64,
}

impl WaveRigidities {
    /// The wave rigidities of a scene's surface.
    #[must_use]
    pub fn find_extremes_and_mean_over_layers_of_scene(scene: &Scene) -> Self {
        let kind = scene.surface.kind;
        let layout = scene.layout();
        let all: Vec<(f64, f64, [f64; 3])> = layout
            .areas_or_bar_lengths_with_layers()
            .map(|(size, layer)| {
                let section = CellSection::from_layer(kind, &layer);
                (size, section.per_area, section.least_mean_and_largest_bending_rigidity())
            })
            .collect();
        let least = all.iter().map(|(_, mass, [least, ..])| least / mass).fold(f64::INFINITY, f64::min);
        let softest = all.iter().map(|(.., [least, ..])| *least).fold(f64::INFINITY, f64::min);
        let stiffest = all.iter().map(|(.., [.., largest])| *largest).fold(0.0, f64::max);
        let heaviest = all.iter().map(|(_, mass, _)| *mass).fold(0.0, f64::max);
        let (size, power) = match kind {
            SurfaceKind::Plate => (scene.surface.length_m * scene.surface.width_m, 0.5),
            SurfaceKind::Bar => (scene.surface.length_m, 0.25),
        };
        // Relative to the least, so that one layer alone loses no digit.
        let weighted: f64 = all.iter().map(|(size, mass, [_, mean, _])| size * (least * mass / mean).powf(power)).sum();
        let mean = least * (size / weighted).powf(1.0 / power);
        Self { least, mean, slowest: softest / heaviest, softest, stiffest }
    }
}

/// Least shift, as a part of what a uniform surface with as many modes has.
const LEAST_SHIFT: f64 = 1e-5;

/// The shift in rad^2/s^2: a quarter of the first bending frequency of the free surface, squared (omega L^2 / sqrt(D/m) =
/// 22.4). Small enough to separate the low modes, large enough that K + s M is definite whatever holds the panel.
pub(super) fn choose_spectral_shift_rad2_per_s2(scene: &Scene) -> f64 {
    let length = scene.surface.length_m.max(scene.surface.width_m);
    // With patches the softest part may bend under the heaviest one; a shift much below the other modes separates nothing.
    let waves = WaveRigidities::find_extremes_and_mean_over_layers_of_scene(scene);
    (22.4 / (length * length)).powi(2) * waves.slowest.max(LEAST_SHIFT * waves.mean) / 16.0
}
