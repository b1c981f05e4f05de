//! What the scene asks of a plate's mesh: lines where a bar's shape has joints and towards singular corners, and the
//! functions of point forces with the images that borders add.

use super::grid::Fineness;
use super::mesh::{Forced, Lines, MERGE};
use super::singular::{End, Reach, Singular, Source, clamped_edge, free_edge};
use crate::scene::{EdgeKind, Scene, Side, SurfaceKind};

/// A singular function reaches over at least this many regular cells, or to the borders.
const LEAST_REACH: f64 = 2.9;
/// An attachment nearer to a border than this part of a regular cell has a mirror image as near behind it, which its
/// function needs too.
const NEAR_BORDER: f64 = 0.7;

/// An attachment nearer to two borders than this part of a regular cell feels the image behind the corner, which it lacks.
const NEAR_CORNER: f64 = 0.3;

/// Places of all attachments.
pub(super) fn attachments(scene: &Scene) -> impl Iterator<Item = (f64, f64)> {
    let supports = scene.supports.iter().map(|s| (s.x_m, s.y_m));
    let masses = scene.masses.iter().map(|m| (m.x_m, m.y_m));
    supports.chain(masses).chain(scene.actuators.iter().map(|a| (a.x_m, a.y_m)))
}

/// Lines that the scene forces, along x and along y.
pub(super) fn forced(scene: &Scene, fineness: Fineness) -> [Vec<Forced>; 2] {
    let surface = &scene.surface;
    let mut forced = [Vec::new(), Vec::new()];
    if surface.kind == SurfaceKind::Bar {
        // A bar's third derivative jumps at a force and is smooth on either side.
        forced[0] = attachments(scene).map(|(at, _)| Forced { at, width: f64::INFINITY }).collect();
        return forced;
    }
    let size = [surface.length_m, surface.width_m];
    if fineness.layers > 0 {
        let width = fineness.cell_m / 4.0_f64.powi(i32::try_from(fineness.layers).unwrap_or(i32::MAX));
        for (sides, at) in CORNERS.iter().zip([[0.0, 0.0], [0.0, size[1]], [size[0], 0.0], size]) {
            if is_singular_corner(scene, *sides) {
                for (lines, at) in forced.iter_mut().zip(at) {
                    lines.push(Forced { at, width });
                }
            }
        }
    }
    forced
}

/// The sides that meet at each corner.
const CORNERS: [[Side; 2]; 4] =
    [[Side::Left, Side::Top], [Side::Left, Side::Bottom], [Side::Right, Side::Top], [Side::Right, Side::Bottom]];

/// Where a clamped and a free edge meet, moments are unbounded.
fn is_singular_corner(scene: &Scene, [a, b]: [Side; 2]) -> bool {
    is_clamped(scene, a) && is_free(scene, b) || is_free(scene, a) && is_clamped(scene, b)
}

/// Whether the plate has such a corner.
#[must_use]
pub fn has_singular_corner(scene: &Scene) -> bool {
    scene.surface.kind == SurfaceKind::Plate && CORNERS.iter().any(|sides| is_singular_corner(scene, *sides))
}

/// Whether shapes are singular in a way that the mesh has neither functions nor small cells for: where something is
/// attached near a corner whose images are not all there.
#[must_use]
pub fn is_singular(scene: &Scene, fineness: Fineness) -> bool {
    let near = NEAR_CORNER * fineness.cell_m;
    let beside_corner = |at: (f64, f64)| {
        CORNERS.iter().any(|sides| {
            let distances = sides.map(|side| distance(scene, side, at));
            // On a corner is regular, and so is whatever a pinned edge mirrors.
            distances.iter().all(|distance| *distance < near)
                && distances.iter().any(|distance| *distance > 0.0)
                && !sides.iter().any(|side| matches!(edge_kind(scene, *side), Some(EdgeKind::Pinned)))
        })
    };
    scene.surface.kind == SurfaceKind::Plate && attachments(scene).any(beside_corner)
}

fn edge_kind(scene: &Scene, side: Side) -> Option<EdgeKind> {
    scene.edges.iter().find(|edge| edge.side == side).map(|edge| edge.kind)
}

fn is_clamped(scene: &Scene, side: Side) -> bool {
    matches!(edge_kind(scene, side), Some(EdgeKind::Clamped))
}

/// Whether the edge may move; springs along it change nothing about what is singular.
fn is_free(scene: &Scene, side: Side) -> bool {
    matches!(edge_kind(scene, side), None | Some(EdgeKind::Elastic { .. }))
}

/// The functions of all attachments, one set for each place.
pub(super) fn singular(scene: &Scene, fineness: Fineness, x: &Lines, y: &Lines) -> Vec<Singular> {
    let mut places: Vec<(f64, f64)> = Vec::new();
    let merged = MERGE * scene.surface.length_m.max(scene.surface.width_m);
    for at in attachments(scene) {
        if places.iter().all(|known| (known.0 - at.0).hypot(known.1 - at.1) > merged) {
            places.push(at);
        }
    }
    let mut functions = Vec::new();
    for (x_m, y_m) in places {
        let on = |lines: &Lines, at: f64, sides: [Side; 2]| {
            let length = lines.at[lines.cells()];
            if at <= MERGE * length {
                Some(sides[0])
            } else if length - at <= MERGE * length {
                Some(sides[1])
            } else {
                None
            }
        };
        let sides = [on(x, x_m, [Side::Left, Side::Right]), on(y, y_m, [Side::Top, Side::Bottom])];
        match sides {
            [None, None] => {}
            [Some(side), None] | [None, Some(side)] if is_free(scene, side) => {}
            // A corner, where a force only twists, or an edge that does not move.
            _ => continue,
        }
        let near = images(scene, (x_m, y_m), NEAR_BORDER * fineness.cell_m);
        let reach = |lines: &Lines, at: f64, sides: [Side; 2]| {
            let ends = sides.map(|side| if near.answered(side) { End::Open } else { end(scene, side) });
            reach(lines, at, LEAST_REACH * fineness.cell_m, ends)
        };
        let x = reach(x, x_m, [Side::Left, Side::Right]);
        let y = reach(y, y_m, [Side::Top, Side::Bottom]);
        let scale = 0.5 * (x.to - x.from).min(y.to - y.from);
        let sources = near.sources(scene, (x.centre, y.centre), scale);
        functions.push(Singular { x, y, sources, scale });
    }
    functions
}

/// The borders near a point force that its function answers to by mirror images, as half-planes' solutions do.
struct Images {
    free: Vec<Side>,
    pinned: Vec<Side>,
    clamped: Option<Side>,
}

fn images(scene: &Scene, at: (f64, f64), near: f64) -> Images {
    let sides = [Side::Left, Side::Right, Side::Top, Side::Bottom];
    let mut close: Vec<(Side, f64)> = sides.map(|side| (side, distance(scene, side, at))).into_iter().collect();
    close.retain(|(_, distance)| *distance < near);
    close.sort_by(|a, b| a.1.total_cmp(&b.1));
    // Mirror images about a clamped edge answer to no other edge.
    let clamped = close.iter().map(|(side, _)| *side).find(|side| is_clamped(scene, *side));
    let others = |pinned: bool| -> Vec<Side> {
        let sides = close.iter().map(|(side, _)| *side).filter(|_| clamped.is_none());
        sides.filter(|side| is_free(scene, *side) != pinned).collect()
    };
    // Two mirrors that face each other have images without end: the farther one is left to blending.
    let mut pinned = others(true);
    let mut seen = [false; 2];
    pinned.retain(|side| !std::mem::replace(&mut seen[usize::from(matches!(side, Side::Left | Side::Right))], true));
    Images { free: others(false), pinned, clamped }
}

impl Images {
    fn answered(&self, side: Side) -> bool {
        self.pinned.contains(&side) || self.clamped == Some(side)
    }

    fn sources(&self, scene: &Scene, centre: (f64, f64), scale: f64) -> Vec<Source> {
        let (length, width) = (scene.surface.length_m, scene.surface.width_m);
        let inside = Source::inside(centre);
        let image = |side: Side| (inside.mirrored(side, length, width).centre, distance(scene, side, centre) / scale);
        let mut sources = vec![inside];
        for side in &self.free {
            let (image, distance) = image(*side);
            sources.push(free_edge(*side, image, distance, scene.surface.material.poisson_ratio));
        }
        for side in &self.pinned {
            let mirrored: Vec<_> = sources.iter().map(|source| source.mirrored(*side, length, width)).collect();
            sources.extend(mirrored);
        }
        if let Some(side) = self.clamped {
            let (image, distance) = image(side);
            sources.push(clamped_edge(side, image, distance));
        }
        sources
    }
}

fn distance(scene: &Scene, side: Side, at: (f64, f64)) -> f64 {
    match side {
        Side::Left => at.0,
        Side::Right => scene.surface.length_m - at.0,
        Side::Top => at.1,
        Side::Bottom => scene.surface.width_m - at.1,
    }
}

fn end(scene: &Scene, side: Side) -> End {
    match edge_kind(scene, side) {
        None | Some(EdgeKind::Elastic { .. }) => End::Open,
        Some(EdgeKind::Pinned) => End::Pinned,
        Some(EdgeKind::Clamped) => End::Flat,
    }
}

/// From the first line at least `least` below `at` to the first one at least that much above it, or to the borders.
fn reach(lines: &Lines, at: f64, least: f64, borders: [End; 2]) -> Reach {
    let (first, last) = (lines.at[0], lines.at[lines.cells()]);
    let inner = lines.at.get(1..lines.cells()).unwrap_or_default();
    let below = inner.iter().rev().copied().find(|line| at - line >= least);
    let above = inner.iter().copied().find(|line| line - at >= least);
    let merged = MERGE * last;
    Reach {
        centre: if at - first <= merged {
            first
        } else if last - at <= merged {
            last
        } else {
            at
        },
        from: below.unwrap_or(first),
        to: above.unwrap_or(last),
        at_from: if below.is_some() { End::Flat } else { borders[0] },
        at_to: if above.is_some() { End::Flat } else { borders[1] },
    }
}
