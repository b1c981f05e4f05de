//! What the scene asks of a plate's mesh: lines where a bar's shape has joints, along patches and cut-outs and towards
//! singular corners, and the functions of point forces with the images that borders add.

use super::attached::all_point_attachments;
use super::corners::{CornerKind, PlateCorner, count_graded_cell_layers_towards_corner, find_plate_corners};
use super::fineness::Fineness;
use super::mesh::{GridLines, MERGE, RequiredLine};
use super::neighbours::{
    CloseAttachmentPair, NEAR, PlaceClusters, distance_between_points, find_noncoincident_attachment_pairs_within,
    merge_attachments_into_places_firmest_first,
};
use super::orthotropic::PlateMedium;
use super::sections::{CellSection, WaveRigidities};
use super::singular::{SingularFunction, SingularSource};
use super::surroundings::{BorderKind, ClearRectangle, SIDES};
use crate::scene::{Scene, Side, SurfaceKind, SurfaceLayout};

/// A singular function reaches over at least this many regular cells, or to the borders.
const LEAST_REACH: f64 = 2.9;
/// An attachment nearer to a border than this part of a regular cell has a mirror image as near behind it, which its
/// function needs too; nearer to a patch, whose images are not known, the cells shrink towards it.
const NEAR_BORDER: f64 = 0.7;
/// An attachment nearer to two borders than this part of a regular cell feels the image behind the corner, which it lacks.
const NEAR_CORNER: f64 = 0.3;

/// A function that has to end within this part of a regular cell bends so much there (its energy goes with the inverse cube)
/// that rounding shows; the cells that shrink towards the attachment do without it.
const NARROWEST: f64 = 1.0 / 16.0;
/// Most cells that shrink towards an attachment beside a patch.
const MOST_LAYERS: usize = 2;

/// A strip narrower than this part of a cell has smaller ones where something is attached: around it the strip bends as a
/// plate, over a stretch of some widths, and beyond as a bar, whose third derivative jumps there.
const NARROW: f64 = 0.25;
/// Width of those cells over the strip's.
const STRIP_CELL: f64 = 2.0;
/// A strip narrower than this part of a cell is a bar there too: a line, and no function. Next to what it gives way over a wave
/// of length l, l^3 / 248 D b (b its width), it gives way around the point by some 0.3 b^2 / D: 100 (b / cell)^3, or 4e-6.
const BAR_LIKE: f64 = 1.0 / 300.0;
/// The factor in that.
const CELL_COMPLIANCE_FACTOR: f64 = 100.0;

/// Width of a narrow strip of one layer, in regular cells; `None` for other surfaces.
pub(super) fn width_in_cells_if_plain_narrow_strip(scene: &Scene, fineness: Fineness) -> Option<f64> {
    let part = scene.surface.length_m.min(scene.surface.width_m) / fineness.cell_m;
    let is_plain = scene.surface.kind == SurfaceKind::Plate && scene.patches.is_empty() && scene.cutouts.is_empty();
    (is_plain && part < NARROW).then_some(part)
}

/// Width of the cells around attachments, in m, which their functions are measured in: the regular ones', but on narrow
/// strips.
pub(super) fn cell_size_at_attachments_m(scene: &Scene, fineness: Fineness) -> f64 {
    width_in_cells_if_plain_narrow_strip(scene, fineness).map_or(1.0, |part| STRIP_CELL * part) * fineness.cell_m
}

/// Lines along x and y that cells shrink towards on narrow strips: at attachments, one for those that share a cell.
fn required_lines_on_narrow_strip(scene: &Scene, fineness: Fineness) -> [Vec<RequiredLine>; 2] {
    let cell = cell_size_at_attachments_m(scene, fineness);
    let mut lines = [Vec::new(), Vec::new()];
    if let Some(part) = width_in_cells_if_plain_narrow_strip(scene, fineness) {
        let width = if part < BAR_LIKE { f64::INFINITY } else { cell };
        let along_x = scene.surface.length_m > scene.surface.width_m;
        let own: &mut Vec<RequiredLine> = &mut lines[usize::from(!along_x)];
        let mut all: Vec<f64> = attachment_positions_m(scene).map(|at| if along_x { at.0 } else { at.1 }).collect();
        all.sort_by(f64::total_cmp);
        for at in all {
            if own.last().is_none_or(|last| at - last.at > cell) {
                own.push(RequiredLine { at, width });
            }
        }
    }
    lines
}

/// What a place that is off by a part of a cell does to a frequency, over that part: 1.1 waves in a cell turn by 7 in it, and the square of a
/// deflection counts.
const OFF_PLACE: f64 = 14.0;
/// Positions in m of all attachments.
pub(super) fn attachment_positions_m(scene: &Scene) -> impl Iterator<Item = (f64, f64)> {
    all_point_attachments(scene).map(|attached| attached.at)
}

/// Lines along x and along y that the mesh must have for this scene.
pub(super) fn required_grid_lines(scene: &Scene, layout: &SurfaceLayout, fineness: Fineness) -> [Vec<RequiredLine>; 2] {
    let line = |at: &f64| RequiredLine { at: *at, width: f64::INFINITY };
    let mut forced = [layout.border_lines_and_outer_edges_x_m(), layout.border_lines_and_outer_edges_y_m()]
        .map(|lines| lines.iter().map(line).collect::<Vec<_>>());
    if scene.surface.kind == SurfaceKind::Bar {
        // A bar's third derivative jumps at a force and is smooth on either side.
        forced[0].extend(merge_attachments_into_places_firmest_first(scene).into_iter().map(|place| line(&place.at.0)));
        return forced;
    }
    let width = |layers: usize| fineness.cell_m / 4.0_f64.powi(i32::try_from(layers).unwrap_or(i32::MAX));
    let all = find_plate_corners(layout);
    let at_corners =
        all.iter().map(|corner| (corner.at, count_graded_cell_layers_towards_corner(scene, corner, fineness.layers)));
    let at_corners = at_corners.filter(|(_, layers)| *layers > 0).map(|(at, layers)| (at, width(layers)));
    let least = width(fineness.layers.min(MOST_LAYERS));
    let beside_patches = attachment_positions_m(scene).filter_map(|at| {
        Some((at, distance_to_patch_or_cutout_corner_if_too_near_m(scene, layout, &all, fineness, at)?.max(least)))
    });
    // No strip thinner than the cells are to be: rounding in K grows with the cube of its aspect.
    let beside_patches = beside_patches.map(|(at, width)| {
        (
            (
                snap_to_nearest_line_within(layout.border_lines_and_outer_edges_x_m(), at.0, width),
                snap_to_nearest_line_within(layout.border_lines_and_outer_edges_y_m(), at.1, width),
            ),
            width,
        )
    });
    for (at, width) in at_corners.chain(beside_patches) {
        for (lines, at) in forced.iter_mut().zip([at.0, at.1]) {
            lines.push(RequiredLine { at, width });
        }
    }
    for (lines, strip) in forced.iter_mut().zip(required_lines_on_narrow_strip(scene, fineness)) {
        lines.extend(strip);
    }
    forced
}

/// The nearest border if it is within a distance, or the position itself.
fn snap_to_nearest_line_within(lines: &[f64], position_m: f64, distance_m: f64) -> f64 {
    let nearest = lines.iter().copied().min_by(|a, b| (a - position_m).abs().total_cmp(&(b - position_m).abs()));
    nearest.filter(|line| (line - position_m).abs() <= distance_m).unwrap_or(position_m)
}

/// Distance of an attachment from a patch, or a cut-out's corner, that is too near for its function to reach over; `None`
/// where it is not.
fn distance_to_patch_or_cutout_corner_if_too_near_m(
    scene: &Scene,
    layout: &SurfaceLayout,
    corners: &[PlateCorner],
    fineness: Fineness,
    at: (f64, f64),
) -> Option<f64> {
    if layout.is_one_rectangle_of_one_layer() {
        return None;
    }
    let merged = MERGE * scene.surface.length_m.max(scene.surface.width_m);
    let is_on = |corner: &PlateCorner| (corner.at.0 - at.0).abs().max((corner.at.1 - at.1).abs()) <= merged;
    if corners.iter().any(|corner| matches!(corner.kind, CornerKind::Convex(_)) && is_on(corner)) {
        return None;
    }
    let reach = LEAST_REACH * fineness.cell_m;
    let (length, width) = (scene.surface.length_m, scene.surface.width_m);
    let wanted =
        [(at.0 - reach).max(0.0), (at.0 + reach).min(length), (at.1 - reach).max(0.0), (at.1 + reach).min(width)];
    let clear = ClearRectangle::find_rectangle_with_most_clearance_unless_at_material_border(scene, layout, at, wanted)
        .map_or(0.0, |around| around.distance_from_point_to_other_material_or_infinity_m());
    (clear < NEAR_BORDER * fineness.cell_m).then_some(clear)
}

/// Whether shapes are singular in a way that the mesh has no functions for: at patches and cut-outs, and where something is
/// attached near a corner whose images are not all there.
#[must_use]
pub fn has_singularity_without_function_at_patch_cutout_or_corner(scene: &Scene, fineness: Fineness) -> bool {
    if scene.surface.kind == SurfaceKind::Bar {
        return false;
    }
    let layout = scene.layout();
    let near = NEAR_CORNER * cell_size_at_attachments_m(scene, fineness);
    let corners = find_plate_corners(&layout);
    let beside_corner = |at: (f64, f64)| {
        corners.iter().any(|corner| {
            if !matches!(corner.kind, CornerKind::Convex(_)) {
                return false;
            }
            let distances = [(at.0 - corner.at.0).abs(), (at.1 - corner.at.1).abs()];
            // On a corner is regular. Beside a pinned edge images are all there, but meet in cells too large for them.
            distances.iter().all(|distance| *distance < near) && distances.iter().any(|distance| *distance > 0.0)
        })
    };
    !layout.is_one_rectangle_of_one_layer() || attachment_positions_m(scene).any(beside_corner)
}

/// Whether two attachments of a plate are so near to each other, and not at one place, that their functions overlap in a cell.
#[must_use]
pub fn has_attachments_with_overlapping_functions(scene: &Scene, fineness: Fineness) -> bool {
    if scene.surface.kind == SurfaceKind::Bar {
        return false;
    }
    let merged = MERGE * scene.surface.length_m.max(scene.surface.width_m);
    let at: Vec<(f64, f64)> = attachment_positions_m(scene).collect();
    let are_close = |a: &(f64, f64), b: &(f64, f64)| {
        let distance = (a.0 - b.0).hypot(a.1 - b.1);
        distance > merged && distance < NEAR_BORDER * fineness.cell_m
    };
    at.iter().enumerate().any(|(k, a)| at[k + 1..].iter().any(|b| are_close(a, b)))
}

/// What a frequency may be wrong by, relative, for what no finer mesh mends at attachments. Two firmly held places very near to
/// each other of which one has no function (in a corner, on a patch's border): together they hold a slope, with a stiffness
/// of about k d^2 against the plate's rigidity D, and the elements approach that with the logarithm of their size only; all of
/// it may be missing, up to 1. And on strips like bars what the points give way. 0 where there is neither.
#[must_use]
pub fn relative_frequency_error_at_attachments_no_finer_mesh_removes(scene: &Scene, fineness: Fineness) -> f64 {
    if scene.surface.kind == SurfaceKind::Bar {
        return relative_frequency_error_of_merged_attachments(scene, fineness);
    }
    relative_frequency_error_of_merged_attachments(scene, fineness)
        + relative_frequency_error_of_close_places_or_narrow_strip(scene, fineness)
}

/// What a frequency may be wrong by for attachments that count as at one place and are not: each is off by their distance, which is to the wave as the
/// change of a deflection to itself, and together they hold no slope.
fn relative_frequency_error_of_merged_attachments(scene: &Scene, fineness: Fineness) -> f64 {
    let (longest, waves) = (
        scene.surface.length_m.max(scene.surface.width_m),
        WaveRigidities::find_extremes_and_mean_over_layers_of_scene(scene),
    );
    let lever = match scene.surface.kind {
        SurfaceKind::Plate => 1.0,
        SurfaceKind::Bar => fineness.cell_m,
    };
    let of_pair = |pair: CloseAttachmentPair| {
        let held = pair.held * pair.distance_m * pair.distance_m * lever / waves.softest;
        OFF_PLACE * pair.distance_m / fineness.cell_m + held / (1.0 + held)
    };
    find_noncoincident_attachment_pairs_within(scene, MERGE * longest).into_iter().map(of_pair).sum()
}

/// Relative error of a frequency for places of a plate that are near to each other.
fn relative_frequency_error_of_close_places_or_narrow_strip(scene: &Scene, fineness: Fineness) -> f64 {
    let layout = scene.layout();
    let spaces = ClearSpaces::new(scene, &layout, fineness);
    let places = merge_attachments_into_places_firmest_first(scene);
    if spaces.is_bar_like {
        let (part, waves) = (
            width_in_cells_if_plain_narrow_strip(scene, fineness).unwrap_or(0.0),
            WaveRigidities::find_extremes_and_mean_over_layers_of_scene(scene),
        );
        // What gives way at a point may be softer than what bends along the strip.
        let softer = waves.stiffest / waves.softest;
        return if places.is_empty() { 0.0 } else { CELL_COMPLIANCE_FACTOR * softer * part.powi(3) };
    }
    let near = NEAR * spaces.cell_m;
    let rigidity = WaveRigidities::find_extremes_and_mean_over_layers_of_scene(scene).softest;
    let mut worst = 0.0_f64;
    for (k, place) in places.iter().enumerate() {
        // The first of two is held the more firmly.
        for other in &places[k + 1..] {
            let distance = distance_between_points(place.at, other.at);
            if distance <= near
                && (spaces.find_clear_rectangle_if_singular_function_is_possible_at(place.at).is_none()
                    || spaces.find_clear_rectangle_if_singular_function_is_possible_at(other.at).is_none())
            {
                let part = other.held * distance * distance / rigidity;
                worst = worst.max(part / (1.0 + part));
            }
        }
    }
    worst
}

/// The spaces that functions of point forces may take.
struct ClearSpaces<'a> {
    scene: &'a Scene,
    layout: &'a SurfaceLayout,
    /// Lines that every order has: where functions end.
    lines: [GridLines; 2],
    /// Width of the cells around attachments in m.
    cell_m: f64,
    /// A strip so narrow that there are none.
    is_bar_like: bool,
}

impl<'a> ClearSpaces<'a> {
    fn new(scene: &'a Scene, layout: &'a SurfaceLayout, fineness: Fineness) -> Self {
        let regular = |side: f64, borders: &[f64], strip: Vec<RequiredLine>| {
            let borders = borders.iter().map(|at| RequiredLine { at: *at, width: f64::INFINITY });
            GridLines::new(side, fineness.cell_m, &borders.chain(strip).collect::<Vec<_>>())
        };
        let [in_x, in_y] = required_lines_on_narrow_strip(scene, fineness);
        let x = regular(scene.surface.length_m, layout.border_lines_and_outer_edges_x_m(), in_x);
        let y = regular(scene.surface.width_m, layout.border_lines_and_outer_edges_y_m(), in_y);
        let is_bar_like = width_in_cells_if_plain_narrow_strip(scene, fineness).is_some_and(|part| part < BAR_LIKE);
        Self { scene, layout, lines: [x, y], cell_m: cell_size_at_attachments_m(scene, fineness), is_bar_like }
    }

    /// The clear rectangle around a place; `None` where it has no function.
    fn find_clear_rectangle_if_singular_function_is_possible_at(&self, at: (f64, f64)) -> Option<ClearRectangle> {
        if self.is_bar_like {
            return None;
        }
        let least = LEAST_REACH * self.cell_m;
        let [[left, right], [top, bottom]] = [
            range_from_line_below_to_line_above_m(&self.lines[0], at.0, least),
            range_from_line_below_to_line_above_m(&self.lines[1], at.1, least),
        ];
        let around = ClearRectangle::find_rectangle_with_most_clearance_unless_at_material_border(
            self.scene,
            self.layout,
            at,
            [left, right, top, bottom],
        )?;
        if around.distance_from_point_to_other_material_or_infinity_m() < NARROWEST * self.cell_m {
            return None;
        }
        let touched: Vec<Side> =
            SIDES.into_iter().filter(|side| around.distance_from_point_to_side_m(*side) == 0.0).collect();
        match touched.as_slice() {
            [] => Some(around),
            [side] if around.border_kind_at_side(*side) == BorderKind::Free => Some(around),
            // A corner, where a force only twists, or an edge that does not move.
            _ => None,
        }
    }
}

/// The functions of all attachments, one set for each place: of a cluster's first place its own, of the others the difference
/// quotient of theirs and their neighbour's, which ends where the first one's does.
pub(super) fn build_singular_functions_of_attachments(
    scene: &Scene,
    layout: &SurfaceLayout,
    fineness: Fineness,
) -> Vec<SingularFunction> {
    let spaces = ClearSpaces::new(scene, layout, fineness);
    let cell_m = spaces.cell_m;
    let mut clusters = PlaceClusters::new(cell_m);
    let mut functions: Vec<SingularFunction> = Vec::new();
    // Of each function: the space around its place, and the sources of a force there.
    let mut alone: Vec<(ClearRectangle, Vec<SingularSource>)> = Vec::new();
    for place in merge_attachments_into_places_firmest_first(scene) {
        let Some(own) = spaces.find_clear_rectangle_if_singular_function_is_possible_at(place.at) else { continue };
        let function = match clusters.add_place_and_find_nearest_earlier_in_cluster(place.at) {
            None => {
                let near = MirroredSides::choose_sides_to_mirror(&own, NEAR_BORDER * cell_m);
                let [x, y] = own
                    .choose_end_blending_of_point_force_function_in_x_and_y(|side| near.is_satisfied_by_images(side));
                let scale = 0.5 * (x.to - x.from).min(y.to - y.from);
                let sources = near.build_force_and_image_sources(&own, scale);
                alone.push((own, sources.clone()));
                SingularFunction { sources, x, y, scale, finest: f64::INFINITY }
            }
            Some(beside) => {
                let first = &functions[beside.first];
                let around = ClearRectangle { at: own.at, ..alone[beside.first].0 };
                let near = MirroredSides::choose_sides_to_mirror(&alone[beside.first].0, NEAR_BORDER * cell_m);
                let sources = near.build_force_and_image_sources(&around, first.scale);
                let other = alone[beside.nearest].1.iter().map(|source| source.scale_by(-1.0 / beside.ratio));
                let difference =
                    sources.iter().map(|source| source.scale_by(1.0 / beside.ratio)).chain(other).collect();
                alone.push((around, sources));
                SingularFunction { sources: difference, finest: beside.distance_m, ..first.clone() }
            }
        };
        functions.push(function);
    }
    functions
}

/// From the first line at least `least_reach_m` below `position_m` to the first one at least that much above it, or to the borders.
fn range_from_line_below_to_line_above_m(lines: &GridLines, position_m: f64, least_reach_m: f64) -> [f64; 2] {
    let (first, last) = (lines.at[0], lines.at[lines.count_cells()]);
    let inner = lines.at.get(1..lines.count_cells()).unwrap_or_default();
    let below = inner.iter().rev().copied().find(|line| position_m - line >= least_reach_m);
    let above = inner.iter().copied().find(|line| line - position_m >= least_reach_m);
    [below.unwrap_or(first), above.unwrap_or(last)]
}

/// The borders near a point force that its function answers to by mirror images, as half-planes' solutions do.
struct MirroredSides {
    free: Vec<Side>,
    pinned: Vec<Side>,
    clamped: Option<Side>,
}

impl MirroredSides {
    fn choose_sides_to_mirror(around: &ClearRectangle, near_m: f64) -> Self {
        let mut close = SIDES.to_vec();
        close.retain(|side| around.distance_from_point_to_side_m(*side) < near_m);
        close.sort_by(|a, b| {
            around.distance_from_point_to_side_m(*a).total_cmp(&around.distance_from_point_to_side_m(*b))
        });
        // Mirror images about a clamped edge answer to no other edge.
        let clamped = close.iter().copied().find(|side| around.border_kind_at_side(*side) == BorderKind::Clamped);
        let others = |border: BorderKind| -> Vec<Side> {
            let sides = close.iter().copied().filter(|_| clamped.is_none());
            sides.filter(|side| around.border_kind_at_side(*side) == border).collect()
        };
        // Two mirrors that face each other have images without end: the farther one is left to blending.
        let mut pinned = others(BorderKind::Pinned);
        let mut seen = [false; 2];
        pinned
            .retain(|side| !std::mem::replace(&mut seen[usize::from(matches!(side, Side::Left | Side::Right))], true));
        Self { free: others(BorderKind::Free), pinned, clamped }
    }

    /// Whether the images make the function meet this side's edge condition.
    fn is_satisfied_by_images(&self, side: Side) -> bool {
        self.pinned.contains(&side) || self.clamped == Some(side)
    }

    fn build_force_and_image_sources(&self, around: &ClearRectangle, scale: f64) -> Vec<SingularSource> {
        let medium = PlateMedium::isotropic_or_orthotropic_from_bending(
            CellSection::from_layer(SurfaceKind::Plate, &around.layer).bending,
        );
        let inside = SingularSource::from_inner_point_force(around.at);
        let image = |side: Side| {
            (
                inside.mirror_across_pinned_edge(side, around.side_position_m(side)).centre,
                around.distance_from_point_to_side_m(side) / scale,
            )
        };
        let mut sources = medium.sources_of_inner_point_force(around.at, self.clamped.unwrap_or(Side::Left));
        for side in &self.free {
            let (image, distance) = image(*side);
            sources.extend(medium.image_sources_of_free_edge(*side, image, distance, scale));
        }
        for side in &self.pinned {
            let mirrored: Vec<_> = sources
                .iter()
                .map(|source| source.mirror_across_pinned_edge(*side, around.side_position_m(*side)))
                .collect();
            sources.extend(mirrored);
        }
        if let Some(side) = self.clamped {
            let (image, distance) = image(side);
            sources.extend(medium.image_sources_of_clamped_edge(side, image, distance, scale));
        }
        sources
    }
}
