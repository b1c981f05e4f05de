//! Corners of a plate: where moments are unbounded, and where two borders meet.
//!
//! At a corner of angle alpha a shape goes as r^(l + 1) F(theta) with moments as r^(l - 1). Between two free edges, about the
//! bisector: F = A cos (l + 1) theta + B cos (l - 1) theta gives, at theta = beta = alpha / 2 and with
//! kappa = (3 + nu) / (1 - nu),
//!
//! * no moment: -A (l + 1) cos (l + 1) beta + B (kappa - l) cos (l - 1) beta = 0,
//! * no shear: A (l + 1) sin (l + 1) beta + B (kappa + l) sin (l - 1) beta = 0,
//!
//! whose determinant is kappa sin (l alpha) - l sin alpha; F with sines has the other sign (Williams 1952). For the 270
//! degrees of a cut-out's corner and nu = 0.3 the least root is l = 0.638 (and 0.699): moments go as r^-0.36. At a convex
//! corner of 90 degrees no root is below 1. A corner of a patch is a wedge of two materials: between 1, where they are
//! alike, and 0.54, where one is rigid (kappa = 1 above, with the sign of clamped edges).

use super::edges::{edge_kind_unless_free, needs_fine_cells_at_elastic_corner};
use crate::scene::{EdgeKind, LayoutVertex, Scene, Side, SurfaceKind, SurfaceLayer, SurfaceLayout};

/// What is at a corner.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum CornerKind {
    /// Material on one of four sides, its borders `[across x, across y]`: those of the surface, or a cut-out's (`None`).
    Convex([Option<Side>; 2]),
    /// Material on three of four sides.
    Reentrant,
    /// Two materials or thicknesses, whose common border turns or ends.
    Patch,
}

/// A corner of the plate, of a cut-out or of a patch.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PlateCorner {
    /// In m.
    pub at: (f64, f64),
    /// What is there.
    pub kind: CornerKind,
}

/// All corners of a plate, its cut-outs and its patches.
pub fn find_plate_corners(layout: &SurfaceLayout) -> Vec<PlateCorner> {
    let (right, bottom) =
        (layout.border_lines_and_outer_edges_x_m().len() - 1, layout.border_lines_and_outer_edges_y_m().len() - 1);
    let size = (layout.border_lines_and_outer_edges_x_m()[right], layout.border_lines_and_outer_edges_y_m()[bottom]);
    layout
        .vertices_at_crossings_of_border_lines()
        .filter_map(|vertex| {
            Some(PlateCorner {
                at: vertex.at,
                kind: classify_convex_reentrant_or_patch_corner_at_vertex(&vertex, size)?,
            })
        })
        .collect()
}

/// What kind of corner a vertex is; `None` if it is none.
#[expect(clippy::float_cmp, reason = "borders are exactly at 0 and at the side's length")]
fn classify_convex_reentrant_or_patch_corner_at_vertex(
    vertex: &LayoutVertex,
    (length, width): (f64, f64),
) -> Option<CornerKind> {
    let solid: Vec<(usize, SurfaceLayer)> =
        vertex.around.iter().enumerate().filter_map(|(k, part)| part.map(|layer| (k, layer))).collect();
    let (first, layer) = *solid.first()?;
    if solid.iter().any(|(_, other)| *other != layer) {
        return (!vertex.has_no_turning_or_ending_border()).then_some(CornerKind::Patch);
    }
    let (x, y) = vertex.at;
    match solid.len() {
        1 => {
            // Of the four around it, 0 and 2 are left of the corner, 0 and 1 above it.
            let across_x = match first {
                0 | 2 => (x == length).then_some(Side::Right),
                _ => (x == 0.0).then_some(Side::Left),
            };
            let across_y = match first {
                0 | 1 => (y == width).then_some(Side::Bottom),
                _ => (y == 0.0).then_some(Side::Top),
            };
            Some(CornerKind::Convex([across_x, across_y]))
        }
        3 => Some(CornerKind::Reentrant),
        _ => None,
    }
}

/// Most cells that shrink towards a corner where a clamped and a free edge meet: with more, rounding in K (1e-16 times the
/// cube of a cell's aspect) shows.
const MOST_LAYERS: usize = 3;
/// The same at a cut-out's corner, of which there are four, each with lines through the whole mesh: two layers and an order p
/// leave (4^-2)^(2 l) p^(-4 l), or 2e-4 at p = 7, of the energy that is singular, itself a small part.
const MOST_LAYERS_REENTRANT: usize = 2;
/// The same at a patch's corner, which is nearer to regular.
const MOST_LAYERS_PATCH: usize = 1;

/// Cells that shrink towards a corner, of at most `most_layers`: 0 where moments are bounded, other than between a clamped and a
/// free edge, at the end of an edge on stiff springs, where a border turns inwards and at patches.
pub fn count_graded_cell_layers_towards_corner(scene: &Scene, corner: &PlateCorner, most_layers: usize) -> usize {
    match corner.kind {
        CornerKind::Reentrant => most_layers.min(MOST_LAYERS_REENTRANT),
        CornerKind::Patch => most_layers.min(MOST_LAYERS_PATCH),
        CornerKind::Convex(sides) => {
            let kinds = sides.map(|side| side.and_then(|side| edge_kind_unless_free(scene, side)));
            let is_clamped = |kind: &Option<EdgeKind>| matches!(kind, Some(EdgeKind::Clamped));
            // Springs along an edge change nothing about what is singular, but may be nearly so.
            let is_free = |kind: &Option<EdgeKind>| matches!(kind, None | Some(EdgeKind::Elastic { .. }));
            let is_singular = kinds.iter().any(is_clamped) && kinds.iter().any(is_free);
            if is_singular || needs_fine_cells_at_elastic_corner(scene, sides) {
                most_layers.min(MOST_LAYERS)
            } else {
                0
            }
        }
    }
}

/// Whether the plate has a corner with unbounded moments.
#[must_use]
pub fn has_singular_corner(scene: &Scene) -> bool {
    scene.surface.kind == SurfaceKind::Plate
        && find_plate_corners(&scene.layout())
            .iter()
            .any(|corner| count_graded_cell_layers_towards_corner(scene, corner, 1) > 0)
}
