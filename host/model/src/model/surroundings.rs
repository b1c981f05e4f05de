//! The clear space around an attachment: a rectangle of one material, as far as its point force's function may reach.

use super::edges::edge_kind_unless_free;
use super::mesh::MERGE;
use super::singular::{FunctionEnd, FunctionReach};
use crate::scene::{EdgeKind, Scene, Side, SurfaceLayer, SurfaceLayout};

/// Borders in one direction that are looked at; beyond the last a function does not reach.
const MOST_BORDERS: usize = 4;

/// What a rectangle's side is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum BorderKind {
    /// The plate goes on.
    None,
    /// Another thickness or material, or the corner of a cut-out.
    Other,
    /// The plate ends and may move.
    Free,
    /// It ends and does not move.
    Pinned,
    /// It ends, and neither moves nor turns.
    Clamped,
}

/// The space around a point.
#[derive(Clone, Copy, Debug)]
pub struct ClearRectangle {
    /// The point, on the border where it is as good as on it.
    pub at: (f64, f64),
    /// Ends in m: left, right, top, bottom.
    pub ends: [f64; 4],
    /// What is there.
    pub borders: [BorderKind; 4],
    /// What it is made of.
    pub layer: SurfaceLayer,
}

/// The sides in the order of a rectangle's ends.
pub const SIDES: [Side; 4] = [Side::Left, Side::Right, Side::Top, Side::Bottom];

/// Position of a side in [`SIDES`].
fn side_index(side: Side) -> usize {
    match side {
        Side::Left => 0,
        Side::Right => 1,
        Side::Top => 2,
        Side::Bottom => 3,
    }
}

impl ClearRectangle {
    /// The rectangle within `wanted` (left, right, top, bottom) whose nearest [`BorderKind::Other`] is farthest; `None` for a
    /// point on such a border or on a corner.
    pub fn find_rectangle_with_most_clearance_unless_at_material_border(
        scene: &Scene,
        layout: &SurfaceLayout,
        at: (f64, f64),
        wanted_ends_m: [f64; 4],
    ) -> Option<Self> {
        let at = (
            snap_to_line_within_merging_distance(layout.border_lines_and_outer_edges_x_m(), at.0),
            snap_to_line_within_merging_distance(layout.border_lines_and_outer_edges_y_m(), at.1),
        );
        let ends = [
            list_nearest_candidate_ends(layout.border_lines_and_outer_edges_x_m(), at.0, wanted_ends_m[0]),
            list_nearest_candidate_ends(layout.border_lines_and_outer_edges_x_m(), at.0, wanted_ends_m[1]),
            list_nearest_candidate_ends(layout.border_lines_and_outer_edges_y_m(), at.1, wanted_ends_m[2]),
            list_nearest_candidate_ends(layout.border_lines_and_outer_edges_y_m(), at.1, wanted_ends_m[3]),
        ];
        let mut best: Option<(f64, f64, Self)> = None;
        for left in &ends[0] {
            for right in ends[1].iter().filter(|right| *right > left) {
                for top in &ends[2] {
                    for bottom in ends[3].iter().filter(|bottom| *bottom > top) {
                        let ends = [*left, *right, *top, *bottom];
                        let Some(found) = Self::from_ends_if_one_layer_and_point_off_material_border(
                            scene,
                            layout,
                            at,
                            ends,
                            wanted_ends_m,
                        ) else {
                            continue;
                        };
                        let (clear, area) = (
                            found.distance_from_point_to_other_material_or_infinity_m(),
                            (right - left) * (bottom - top),
                        );
                        if best.as_ref().is_none_or(|best| (clear, area) > (best.0, best.1)) {
                            best = Some((clear, area, found));
                        }
                    }
                }
            }
        }
        best.map(|(.., found)| found)
    }

    /// The rectangle with these ends, if it has one layer and a function can end there.
    #[expect(clippy::float_cmp, reason = "ends are the very numbers that were wanted")]
    fn from_ends_if_one_layer_and_point_off_material_border(
        scene: &Scene,
        layout: &SurfaceLayout,
        at: (f64, f64),
        ends: [f64; 4],
        wanted: [f64; 4],
    ) -> Option<Self> {
        let mut inside = layout.layers_overlapping_rectangle_with_none_for_cut_away_parts(ends);
        let layer = inside.next()??;
        if inside.any(|part| part != Some(layer)) {
            return None;
        }
        let size = [
            layout.border_lines_and_outer_edges_x_m()[layout.border_lines_and_outer_edges_x_m().len() - 1],
            layout.border_lines_and_outer_edges_y_m()[layout.border_lines_and_outer_edges_y_m().len() - 1],
        ];
        let limits = [0.0, size[0], 0.0, size[1]];
        let mut found = Self { at, ends, borders: [BorderKind::None; 4], layer };
        for (k, side) in SIDES.into_iter().enumerate() {
            found.borders[k] = if ends[k] == limits[k] {
                match edge_kind_unless_free(scene, side) {
                    None | Some(EdgeKind::Elastic { .. }) => BorderKind::Free,
                    Some(EdgeKind::Pinned) => BorderKind::Pinned,
                    Some(EdgeKind::Clamped) => BorderKind::Clamped,
                }
            } else {
                // A hair beyond the end; layouts have no two borders so near to each other.
                let hair = 0.5 * MERGE * size[k / 2];
                let mut beyond = ends;
                match side {
                    Side::Left | Side::Top => (beyond[k + 1], beyond[k]) = (ends[k], ends[k] - hair),
                    Side::Right | Side::Bottom => (beyond[k - 1], beyond[k]) = (ends[k], ends[k] + hair),
                }
                if layout.layers_overlapping_rectangle_with_none_for_cut_away_parts(beyond).all(|part| part.is_none()) {
                    BorderKind::Free
                } else if ends[k] == wanted[k] {
                    BorderKind::None
                } else if found.distance_from_point_to_side_m(side) == 0.0 {
                    return None;
                } else {
                    BorderKind::Other
                }
            };
        }
        Some(found)
    }

    /// Distance in m of the point from a side.
    pub fn distance_from_point_to_side_m(&self, side: Side) -> f64 {
        let k = side_index(side);
        (if k < 2 { self.at.0 } else { self.at.1 } - self.ends[k]).abs()
    }

    /// Position in m of the rectangle's end at a side.
    pub fn side_position_m(&self, side: Side) -> f64 {
        self.ends[side_index(side)]
    }

    /// The kind of border at a side.
    pub fn border_kind_at_side(&self, side: Side) -> BorderKind {
        self.borders[side_index(side)]
    }

    /// Distance of the nearest border of another part, infinite if there is none.
    pub fn distance_from_point_to_other_material_or_infinity_m(&self) -> f64 {
        let others = SIDES.into_iter().filter(|side| self.border_kind_at_side(*side) == BorderKind::Other);
        others.map(|side| self.distance_from_point_to_side_m(side)).fold(f64::INFINITY, f64::min)
    }

    /// Where a function lives that ends as the borders ask for, other than at the borders that it answers to by itself.
    pub fn choose_end_blending_of_point_force_function_in_x_and_y(
        &self,
        is_satisfied_by_images: impl Fn(Side) -> bool,
    ) -> [FunctionReach; 2] {
        let end = |side: Side| match self.border_kind_at_side(side) {
            _ if is_satisfied_by_images(side) => FunctionEnd::Open,
            BorderKind::Free => FunctionEnd::Open,
            BorderKind::Pinned => FunctionEnd::Pinned,
            BorderKind::None | BorderKind::Other | BorderKind::Clamped => FunctionEnd::Flat,
        };
        let along = |centre: f64, from: Side, to: Side| FunctionReach {
            centre,
            from: self.side_position_m(from),
            to: self.side_position_m(to),
            at_from: end(from),
            at_to: end(to),
        };
        [along(self.at.0, Side::Left, Side::Right), along(self.at.1, Side::Top, Side::Bottom)]
    }
}

/// The line that a position is as good as on, or the position itself.
fn snap_to_line_within_merging_distance(lines: &[f64], position: f64) -> f64 {
    let merged = MERGE * lines[lines.len() - 1];
    lines.iter().copied().find(|line| (line - position).abs() <= merged).unwrap_or(position)
}

/// Where a rectangle may end between a point and a wanted end: there, or at the borders on the way.
fn list_nearest_candidate_ends(lines: &[f64], position: f64, wanted_end: f64) -> Vec<f64> {
    let (low, high) = (position.min(wanted_end), position.max(wanted_end));
    let mut between: Vec<f64> = lines.iter().copied().filter(|line| *line >= low && *line <= high).collect();
    between.push(wanted_end);
    between.sort_by(|a, b| (a - position).abs().total_cmp(&(b - position).abs()));
    between.dedup();
    between.truncate(MOST_BORDERS + 1);
    between
}
