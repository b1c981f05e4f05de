//! What the scene asks of a plate's mesh: lines where a bar's shape has joints, along patches and cut-outs and towards
//! singular corners, and the functions of point forces with the images that borders add.

use super::attached::attached;
use super::corners::{Corner, Kind, corners, layers};
use super::fineness::Fineness;
use super::mesh::{Forced, Lines, MERGE};
use super::neighbours::{Clusters, NEAR, Pair, distance, pairs, places};
use super::orthotropic::Medium;
use super::sections::{Section, Waves};
use super::singular::{Singular, Source};
use super::surroundings::{Border, SIDES, Surroundings};
use crate::scene::{Layout, Scene, Side, SurfaceKind};

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
const GIVES_WAY: f64 = 100.0;

/// The width over a regular cell of a narrow strip of one layer; `None` for other surfaces.
pub(super) fn narrow_strip(scene: &Scene, fineness: Fineness) -> Option<f64> {
    let part = scene.surface.length_m.min(scene.surface.width_m) / fineness.cell_m;
    let is_plain = scene.surface.kind == SurfaceKind::Plate && scene.patches.is_empty() && scene.cutouts.is_empty();
    (is_plain && part < NARROW).then_some(part)
}

/// Width of the cells around attachments, in m, which their functions are measured in: the regular ones', but on narrow
/// strips.
pub(super) fn cell_at_attachments(scene: &Scene, fineness: Fineness) -> f64 {
    narrow_strip(scene, fineness).map_or(1.0, |part| STRIP_CELL * part) * fineness.cell_m
}

/// Lines along x and y that cells shrink towards on narrow strips: at attachments, one for those that share a cell.
fn along_strip(scene: &Scene, fineness: Fineness) -> [Vec<Forced>; 2] {
    let cell = cell_at_attachments(scene, fineness);
    let mut lines = [Vec::new(), Vec::new()];
    if let Some(part) = narrow_strip(scene, fineness) {
        let width = if part < BAR_LIKE { f64::INFINITY } else { cell };
        let along_x = scene.surface.length_m > scene.surface.width_m;
        let own: &mut Vec<Forced> = &mut lines[usize::from(!along_x)];
        let mut all: Vec<f64> = attachments(scene).map(|at| if along_x { at.0 } else { at.1 }).collect();
        all.sort_by(f64::total_cmp);
        for at in all {
            if own.last().is_none_or(|last| at - last.at > cell) {
                own.push(Forced { at, width });
            }
        }
    }
    lines
}

/// What a place that is off by a part of a cell does to a frequency, over that part: 1.1 waves in a cell turn by 7 in it, and the square of a
/// deflection counts.
const OFF_PLACE: f64 = 14.0;
/// Places of all attachments.
pub(super) fn attachments(scene: &Scene) -> impl Iterator<Item = (f64, f64)> {
    attached(scene).map(|attached| attached.at)
}

/// Lines that the scene forces, along x and along y.
pub(super) fn forced(scene: &Scene, layout: &Layout, fineness: Fineness) -> [Vec<Forced>; 2] {
    let line = |at: &f64| Forced { at: *at, width: f64::INFINITY };
    let mut forced = [layout.x_m(), layout.y_m()].map(|lines| lines.iter().map(line).collect::<Vec<_>>());
    if scene.surface.kind == SurfaceKind::Bar {
        // A bar's third derivative jumps at a force and is smooth on either side.
        forced[0].extend(places(scene).into_iter().map(|place| line(&place.at.0)));
        return forced;
    }
    let width = |layers: usize| fineness.cell_m / 4.0_f64.powi(i32::try_from(layers).unwrap_or(i32::MAX));
    let all = corners(layout);
    let at_corners = all.iter().map(|corner| (corner.at, layers(scene, corner, fineness.layers)));
    let at_corners = at_corners.filter(|(_, layers)| *layers > 0).map(|(at, layers)| (at, width(layers)));
    let least = width(fineness.layers.min(MOST_LAYERS));
    let beside_patches =
        attachments(scene).filter_map(|at| Some((at, clear(scene, layout, &all, fineness, at)?.max(least))));
    // No strip thinner than the cells are to be: rounding in K grows with the cube of its aspect.
    let beside_patches = beside_patches
        .map(|(at, width)| ((near_border(layout.x_m(), at.0, width), near_border(layout.y_m(), at.1, width)), width));
    for (at, width) in at_corners.chain(beside_patches) {
        for (lines, at) in forced.iter_mut().zip([at.0, at.1]) {
            lines.push(Forced { at, width });
        }
    }
    for (lines, strip) in forced.iter_mut().zip(along_strip(scene, fineness)) {
        lines.extend(strip);
    }
    forced
}

/// The nearest border if it is within `width`, or the place itself.
fn near_border(lines: &[f64], at: f64, width: f64) -> f64 {
    let nearest = lines.iter().copied().min_by(|a, b| (a - at).abs().total_cmp(&(b - at).abs()));
    nearest.filter(|line| (line - at).abs() <= width).unwrap_or(at)
}

/// Distance of an attachment from a patch, or a cut-out's corner, that is too near for its function to reach over; `None`
/// where it is not.
fn clear(scene: &Scene, layout: &Layout, corners: &[Corner], fineness: Fineness, at: (f64, f64)) -> Option<f64> {
    if layout.is_uniform() {
        return None;
    }
    let merged = MERGE * scene.surface.length_m.max(scene.surface.width_m);
    let is_on = |corner: &Corner| (corner.at.0 - at.0).abs().max((corner.at.1 - at.1).abs()) <= merged;
    if corners.iter().any(|corner| matches!(corner.kind, Kind::Convex(_)) && is_on(corner)) {
        return None;
    }
    let reach = LEAST_REACH * fineness.cell_m;
    let (length, width) = (scene.surface.length_m, scene.surface.width_m);
    let wanted =
        [(at.0 - reach).max(0.0), (at.0 + reach).min(length), (at.1 - reach).max(0.0), (at.1 + reach).min(width)];
    let clear = Surroundings::of(scene, layout, at, wanted).map_or(0.0, |around| around.clear());
    (clear < NEAR_BORDER * fineness.cell_m).then_some(clear)
}

/// Whether shapes are singular in a way that the mesh has no functions for: at patches and cut-outs, and where something is
/// attached near a corner whose images are not all there.
#[must_use]
pub fn is_singular(scene: &Scene, fineness: Fineness) -> bool {
    if scene.surface.kind == SurfaceKind::Bar {
        return false;
    }
    let layout = scene.layout();
    let near = NEAR_CORNER * cell_at_attachments(scene, fineness);
    let corners = corners(&layout);
    let beside_corner = |at: (f64, f64)| {
        corners.iter().any(|corner| {
            if !matches!(corner.kind, Kind::Convex(_)) {
                return false;
            }
            let distances = [(at.0 - corner.at.0).abs(), (at.1 - corner.at.1).abs()];
            // On a corner is regular. Beside a pinned edge images are all there, but meet in cells too large for them.
            distances.iter().all(|distance| *distance < near) && distances.iter().any(|distance| *distance > 0.0)
        })
    };
    !layout.is_uniform() || attachments(scene).any(beside_corner)
}

/// Whether two attachments of a plate are so near to each other, and not at one place, that their functions overlap in a cell.
#[must_use]
pub fn has_close_points(scene: &Scene, fineness: Fineness) -> bool {
    if scene.surface.kind == SurfaceKind::Bar {
        return false;
    }
    let merged = MERGE * scene.surface.length_m.max(scene.surface.width_m);
    let at: Vec<(f64, f64)> = attachments(scene).collect();
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
pub fn unresolved(scene: &Scene, fineness: Fineness) -> f64 {
    if scene.surface.kind == SurfaceKind::Bar {
        return merged(scene, fineness);
    }
    merged(scene, fineness) + between_places(scene, fineness)
}

/// What a frequency may be wrong by for attachments that count as at one place and are not: each is off by their distance, which is to the wave as the
/// change of a deflection to itself, and together they hold no slope.
fn merged(scene: &Scene, fineness: Fineness) -> f64 {
    let (longest, waves) = (scene.surface.length_m.max(scene.surface.width_m), Waves::of(scene));
    let lever = match scene.surface.kind {
        SurfaceKind::Plate => 1.0,
        SurfaceKind::Bar => fineness.cell_m,
    };
    let of_pair = |pair: Pair| {
        let held = pair.held * pair.distance_m * pair.distance_m * lever / waves.softest;
        OFF_PLACE * pair.distance_m / fineness.cell_m + held / (1.0 + held)
    };
    pairs(scene, MERGE * longest).into_iter().map(of_pair).sum()
}

/// The same for places of a plate that are near to each other.
fn between_places(scene: &Scene, fineness: Fineness) -> f64 {
    let layout = scene.layout();
    let spaces = Spaces::new(scene, &layout, fineness);
    let places = places(scene);
    if spaces.is_bar_like {
        let (part, waves) = (narrow_strip(scene, fineness).unwrap_or(0.0), Waves::of(scene));
        // What gives way at a point may be softer than what bends along the strip.
        let softer = waves.stiffest / waves.softest;
        return if places.is_empty() { 0.0 } else { GIVES_WAY * softer * part.powi(3) };
    }
    let near = NEAR * spaces.cell_m;
    let rigidity = Waves::of(scene).softest;
    let mut worst = 0.0_f64;
    for (k, place) in places.iter().enumerate() {
        // The first of two is held the more firmly.
        for other in &places[k + 1..] {
            let distance = distance(place.at, other.at);
            if distance <= near && (spaces.around(place.at).is_none() || spaces.around(other.at).is_none()) {
                let part = other.held * distance * distance / rigidity;
                worst = worst.max(part / (1.0 + part));
            }
        }
    }
    worst
}

/// The spaces that functions of point forces may take.
struct Spaces<'a> {
    scene: &'a Scene,
    layout: &'a Layout,
    /// Lines that every order has: where functions end.
    lines: [Lines; 2],
    /// Width of the cells around attachments in m.
    cell_m: f64,
    /// A strip so narrow that there are none.
    is_bar_like: bool,
}

impl<'a> Spaces<'a> {
    fn new(scene: &'a Scene, layout: &'a Layout, fineness: Fineness) -> Self {
        let regular = |side: f64, borders: &[f64], strip: Vec<Forced>| {
            let borders = borders.iter().map(|at| Forced { at: *at, width: f64::INFINITY });
            Lines::new(side, fineness.cell_m, &borders.chain(strip).collect::<Vec<_>>())
        };
        let [in_x, in_y] = along_strip(scene, fineness);
        let x = regular(scene.surface.length_m, layout.x_m(), in_x);
        let y = regular(scene.surface.width_m, layout.y_m(), in_y);
        let is_bar_like = narrow_strip(scene, fineness).is_some_and(|part| part < BAR_LIKE);
        Self { scene, layout, lines: [x, y], cell_m: cell_at_attachments(scene, fineness), is_bar_like }
    }

    /// The space around a place; `None` where it has no function.
    fn around(&self, at: (f64, f64)) -> Option<Surroundings> {
        if self.is_bar_like {
            return None;
        }
        let least = LEAST_REACH * self.cell_m;
        let [[left, right], [top, bottom]] = [wanted(&self.lines[0], at.0, least), wanted(&self.lines[1], at.1, least)];
        let around = Surroundings::of(self.scene, self.layout, at, [left, right, top, bottom])?;
        if around.clear() < NARROWEST * self.cell_m {
            return None;
        }
        let touched: Vec<Side> = SIDES.into_iter().filter(|side| around.distance(*side) == 0.0).collect();
        match touched.as_slice() {
            [] => Some(around),
            [side] if around.border(*side) == Border::Free => Some(around),
            // A corner, where a force only twists, or an edge that does not move.
            _ => None,
        }
    }
}

/// The functions of all attachments, one set for each place: of a cluster's first place its own, of the others the difference
/// quotient of theirs and their neighbour's, which ends where the first one's does.
pub(super) fn singular(scene: &Scene, layout: &Layout, fineness: Fineness) -> Vec<Singular> {
    let spaces = Spaces::new(scene, layout, fineness);
    let cell_m = spaces.cell_m;
    let mut clusters = Clusters::new(cell_m);
    let mut functions: Vec<Singular> = Vec::new();
    // Of each function: the space around its place, and the sources of a force there.
    let mut alone: Vec<(Surroundings, Vec<Source>)> = Vec::new();
    for place in places(scene) {
        let Some(own) = spaces.around(place.at) else { continue };
        let function = match clusters.add(place.at) {
            None => {
                let near = Images::of(&own, NEAR_BORDER * cell_m);
                let [x, y] = own.reach(|side| near.answered(side));
                let scale = 0.5 * (x.to - x.from).min(y.to - y.from);
                let sources = near.sources(&own, scale);
                alone.push((own, sources.clone()));
                Singular { sources, x, y, scale, finest: f64::INFINITY }
            }
            Some(beside) => {
                let first = &functions[beside.first];
                let around = Surroundings { at: own.at, ..alone[beside.first].0 };
                let near = Images::of(&alone[beside.first].0, NEAR_BORDER * cell_m);
                let sources = near.sources(&around, first.scale);
                let other = alone[beside.nearest].1.iter().map(|source| source.times(-1.0 / beside.ratio));
                let difference = sources.iter().map(|source| source.times(1.0 / beside.ratio)).chain(other).collect();
                alone.push((around, sources));
                Singular { sources: difference, finest: beside.distance_m, ..first.clone() }
            }
        };
        functions.push(function);
    }
    functions
}

/// From the first line at least `least` below `at` to the first one at least that much above it, or to the borders.
fn wanted(lines: &Lines, at: f64, least: f64) -> [f64; 2] {
    let (first, last) = (lines.at[0], lines.at[lines.cells()]);
    let inner = lines.at.get(1..lines.cells()).unwrap_or_default();
    let below = inner.iter().rev().copied().find(|line| at - line >= least);
    let above = inner.iter().copied().find(|line| line - at >= least);
    [below.unwrap_or(first), above.unwrap_or(last)]
}

/// The borders near a point force that its function answers to by mirror images, as half-planes' solutions do.
struct Images {
    free: Vec<Side>,
    pinned: Vec<Side>,
    clamped: Option<Side>,
}

impl Images {
    fn of(around: &Surroundings, near: f64) -> Self {
        let mut close = SIDES.to_vec();
        close.retain(|side| around.distance(*side) < near);
        close.sort_by(|a, b| around.distance(*a).total_cmp(&around.distance(*b)));
        // Mirror images about a clamped edge answer to no other edge.
        let clamped = close.iter().copied().find(|side| around.border(*side) == Border::Clamped);
        let others = |border: Border| -> Vec<Side> {
            let sides = close.iter().copied().filter(|_| clamped.is_none());
            sides.filter(|side| around.border(*side) == border).collect()
        };
        // Two mirrors that face each other have images without end: the farther one is left to blending.
        let mut pinned = others(Border::Pinned);
        let mut seen = [false; 2];
        pinned
            .retain(|side| !std::mem::replace(&mut seen[usize::from(matches!(side, Side::Left | Side::Right))], true));
        Self { free: others(Border::Free), pinned, clamped }
    }

    fn answered(&self, side: Side) -> bool {
        self.pinned.contains(&side) || self.clamped == Some(side)
    }

    fn sources(&self, around: &Surroundings, scale: f64) -> Vec<Source> {
        let medium = Medium::of(Section::of(SurfaceKind::Plate, &around.layer).bending);
        let inside = Source::inside(around.at);
        let image = |side: Side| (inside.mirrored(side, around.end(side)).centre, around.distance(side) / scale);
        let mut sources = medium.inside(around.at, self.clamped.unwrap_or(Side::Left));
        for side in &self.free {
            let (image, distance) = image(*side);
            sources.extend(medium.free_edge(*side, image, distance, scale));
        }
        for side in &self.pinned {
            let mirrored: Vec<_> = sources.iter().map(|source| source.mirrored(*side, around.end(*side))).collect();
            sources.extend(mirrored);
        }
        if let Some(side) = self.clamped {
            let (image, distance) = image(side);
            sources.extend(medium.clamped_edge(side, image, distance, scale));
        }
        sources
    }
}
