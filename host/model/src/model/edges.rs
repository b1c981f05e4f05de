//! Edges on springs so stiff that they hold like supports: from a scene to one whose springs the mesh can resolve.
//!
//! Where an elastic edge ends at a free one, the corner's force 2 D (1 - nu) w_xy is borne by the springs of a length
//! b = (D / k)^1/3, the only one that D in N m and k in N/m^2 make. The edge gives way there by about R / (k b), so that modes are
//! slower than with a rigid edge by a part that goes with (b / L)^2: much more than D / (k L^3), what the edge's middle gives way.

use super::sections::WaveRigidities;
use crate::scene::{EdgeKind, Scene, Side, SurfaceKind};

/// How an edge is held.
pub fn edge_kind_unless_free(scene: &Scene, side: Side) -> Option<EdgeKind> {
    scene.edges.iter().find(|edge| edge.side == side).map(|edge| edge.kind)
}

/// Part of a frequency that an edge on springs is below a pinned one's, over (b / L)^2: 2.0 on the first bending mode of a plate of
/// 317 x 203 mm for 1e8 and for 1e10 N/m^2, less on others.
const EDGE_COMPLIANCE_FACTOR: f64 = 3.0;
/// The same of a bar's end, over EI / (k L^3): up to the square of the waves along it (pi^4 for the first mode, some thousands for the
/// fifth).
const BAR_END_COMPLIANCE_FACTOR: f64 = 1e4;
/// Largest b / L at which springs are taken for a support: 1e-7 of a frequency. Stiffer ones would show rounding in K instead
/// (4e-5 of a response at 6e-5, and a matrix that cannot be factored at 1e-5).
const RIGID: f64 = 2e-4;
/// Largest D / (r L), and on bars EI / (k L^3), at which they are.
const RIGID_SLOPE: f64 = 1e-11;
/// Largest b / L at which a mesh needs cells that shrink towards the corner: elements of order 9 resolve a fiftieth of a cell, and a cell
/// may be half of L. (At 0.013 without them a response on the edge was off by 1.2e-3, with a bound of 5e-4.)
const THIN: f64 = 0.02;

/// What stiffnesses are held against.
struct EdgeStiffnessScale {
    is_plate: bool,
    /// The least, which springs are held against, and the largest, which says how much they give way.
    rigidity: f64,
    stiffest: f64,
    length: f64,
}

impl EdgeStiffnessScale {
    fn from_scene(scene: &Scene) -> Self {
        let surface = &scene.surface;
        let is_plate = surface.kind == SurfaceKind::Plate;
        let length = if is_plate { surface.length_m.min(surface.width_m) } else { surface.length_m };
        let waves = WaveRigidities::find_extremes_and_mean_over_layers_of_scene(scene);
        Self { is_plate, rigidity: waves.softest, stiffest: waves.stiffest, length }
    }

    /// How far springs of this stiffness give way, relative: b / L, and on a bar EI / (k L^3).
    fn relative_characteristic_length_or_bar_deflection_at_softest(&self, stiffness: f64) -> f64 {
        self.relative_characteristic_length_or_bar_deflection_for_rigidity(self.rigidity, stiffness)
    }

    /// Relative deflection b / L (on a bar EI / (k L^3)) for a given rigidity of the surface.
    fn relative_characteristic_length_or_bar_deflection_for_rigidity(&self, rigidity: f64, stiffness: f64) -> f64 {
        let part = rigidity / (stiffness * self.length.powi(3));
        if self.is_plate { part.cbrt() } else { part }
    }

    /// Stiffness above which springs along an edge are replaced by a support.
    fn stiffness_above_which_edge_is_rigid(&self) -> f64 {
        let part = if self.is_plate { RIGID.powi(3) } else { RIGID_SLOPE };
        self.rigidity / (part * self.length.powi(3))
    }

    /// Stiffness above which rotational springs along an edge are replaced by a clamped edge.
    fn rotational_stiffness_above_which_edge_is_rigid(&self) -> f64 {
        self.rigidity / (RIGID_SLOPE * self.length)
    }
}

/// The scene with pinned and clamped edges in place of elastic edges that are as good as rigid.
pub fn replace_rigid_edge_springs_with_supports_or_limit_them(scene: &Scene) -> Scene {
    let scale = EdgeStiffnessScale::from_scene(scene);
    let (rigid, rigid_slope) =
        (scale.stiffness_above_which_edge_is_rigid(), scale.rotational_stiffness_above_which_edge_is_rigid());
    let mut ideal = scene.clone();
    for edge in &mut ideal.edges {
        if let EdgeKind::Elastic { stiffness, rotational_stiffness, loss_factor } = edge.kind {
            edge.kind = match (stiffness > rigid, rotational_stiffness) {
                (true, 0.0) => EdgeKind::Pinned,
                (true, slope) if slope > rigid_slope => EdgeKind::Clamped,
                _ => EdgeKind::Elastic {
                    stiffness: stiffness.min(rigid),
                    rotational_stiffness: rotational_stiffness.min(rigid_slope),
                    loss_factor,
                },
            };
        }
    }
    ideal
}

/// Relative error of a frequency because stiff springs along edges were replaced by supports.
pub fn relative_frequency_error_of_replaced_edge_springs(scene: &Scene) -> f64 {
    let scale = EdgeStiffnessScale::from_scene(scene);
    let part = |kind: &EdgeKind| -> f64 {
        let EdgeKind::Elastic { stiffness, rotational_stiffness, .. } = *kind else { return 0.0 };
        let slope = if rotational_stiffness > scale.rotational_stiffness_above_which_edge_is_rigid() {
            RIGID_SLOPE
        } else {
            0.0
        };
        if stiffness <= scale.stiffness_above_which_edge_is_rigid() {
            return slope;
        }
        let part = scale.relative_characteristic_length_or_bar_deflection_for_rigidity(scale.stiffest, stiffness);
        slope + if scale.is_plate { EDGE_COMPLIANCE_FACTOR * part * part } else { BAR_END_COMPLIANCE_FACTOR * part }
    };
    scene.edges.iter().map(|edge| part(&edge.kind)).sum()
}

/// Whether the force at a corner between two sides is borne by springs over a length that cells have to shrink for.
pub fn needs_fine_cells_at_elastic_corner(scene: &Scene, sides: [Option<Side>; 2]) -> bool {
    let scale = EdgeStiffnessScale::from_scene(scene);
    let kinds = sides.map(|side| side.and_then(|side| edge_kind_unless_free(scene, side)));
    // A support beside it bears the force by itself.
    if kinds.iter().any(|kind| matches!(kind, Some(EdgeKind::Pinned | EdgeKind::Clamped))) {
        return false;
    }
    kinds.iter().flatten().any(|kind| match kind {
        EdgeKind::Elastic { stiffness, .. } => {
            *stiffness > 0.0 && scale.relative_characteristic_length_or_bar_deflection_at_softest(*stiffness) < THIN
        }
        EdgeKind::Pinned | EdgeKind::Clamped => false,
    })
}
