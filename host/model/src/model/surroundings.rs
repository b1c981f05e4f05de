//! The clear space around an attachment: a rectangle of one material, as far as its point force's function may reach.

use super::edges::edge_kind;
use super::mesh::MERGE;
use super::singular::{End, Reach};
use crate::scene::{EdgeKind, Layer, Layout, Scene, Side};

/// Borders in one direction that are looked at; beyond the last a function does not reach.
const MOST_BORDERS: usize = 4;

/// What a rectangle's side is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Border {
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
pub struct Surroundings {
    /// The point, on the border where it is as good as on it.
    pub at: (f64, f64),
    /// Ends in m: left, right, top, bottom.
    pub ends: [f64; 4],
    /// What is there.
    pub borders: [Border; 4],
    /// What it is made of.
    pub layer: Layer,
}

/// The sides in the order of a rectangle's ends.
pub const SIDES: [Side; 4] = [Side::Left, Side::Right, Side::Top, Side::Bottom];

fn index(side: Side) -> usize {
    match side {
        Side::Left => 0,
        Side::Right => 1,
        Side::Top => 2,
        Side::Bottom => 3,
    }
}

impl Surroundings {
    /// The rectangle within `wanted` (left, right, top, bottom) whose nearest [`Border::Other`] is farthest; `None` for a
    /// point on such a border or on a corner.
    pub fn of(scene: &Scene, layout: &Layout, at: (f64, f64), wanted: [f64; 4]) -> Option<Self> {
        let at = (snapped(layout.x_m(), at.0), snapped(layout.y_m(), at.1));
        let ends = [
            candidates(layout.x_m(), at.0, wanted[0]),
            candidates(layout.x_m(), at.0, wanted[1]),
            candidates(layout.y_m(), at.1, wanted[2]),
            candidates(layout.y_m(), at.1, wanted[3]),
        ];
        let mut best: Option<(f64, f64, Self)> = None;
        for left in &ends[0] {
            for right in ends[1].iter().filter(|right| *right > left) {
                for top in &ends[2] {
                    for bottom in ends[3].iter().filter(|bottom| *bottom > top) {
                        let ends = [*left, *right, *top, *bottom];
                        let Some(found) = Self::rectangle(scene, layout, at, ends, wanted) else { continue };
                        let (clear, area) = (found.clear(), (right - left) * (bottom - top));
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
    fn rectangle(scene: &Scene, layout: &Layout, at: (f64, f64), ends: [f64; 4], wanted: [f64; 4]) -> Option<Self> {
        let mut inside = layout.inside(ends);
        let layer = inside.next()??;
        if inside.any(|part| part != Some(layer)) {
            return None;
        }
        let size = [layout.x_m()[layout.x_m().len() - 1], layout.y_m()[layout.y_m().len() - 1]];
        let limits = [0.0, size[0], 0.0, size[1]];
        let mut found = Self { at, ends, borders: [Border::None; 4], layer };
        for (k, side) in SIDES.into_iter().enumerate() {
            found.borders[k] = if ends[k] == limits[k] {
                match edge_kind(scene, side) {
                    None | Some(EdgeKind::Elastic { .. }) => Border::Free,
                    Some(EdgeKind::Pinned) => Border::Pinned,
                    Some(EdgeKind::Clamped) => Border::Clamped,
                }
            } else {
                // A hair beyond the end; layouts have no two borders so near to each other.
                let hair = 0.5 * MERGE * size[k / 2];
                let mut beyond = ends;
                match side {
                    Side::Left | Side::Top => (beyond[k + 1], beyond[k]) = (ends[k], ends[k] - hair),
                    Side::Right | Side::Bottom => (beyond[k - 1], beyond[k]) = (ends[k], ends[k] + hair),
                }
                if layout.inside(beyond).all(|part| part.is_none()) {
                    Border::Free
                } else if ends[k] == wanted[k] {
                    Border::None
                } else if found.distance(side) == 0.0 {
                    return None;
                } else {
                    Border::Other
                }
            };
        }
        Some(found)
    }

    /// Distance of the point from an end in m.
    pub fn distance(&self, side: Side) -> f64 {
        let k = index(side);
        (if k < 2 { self.at.0 } else { self.at.1 } - self.ends[k]).abs()
    }

    /// The end at a side in m.
    pub fn end(&self, side: Side) -> f64 {
        self.ends[index(side)]
    }

    /// What is at a side.
    pub fn border(&self, side: Side) -> Border {
        self.borders[index(side)]
    }

    /// Distance of the nearest border of another part, infinite if there is none.
    pub fn clear(&self) -> f64 {
        let others = SIDES.into_iter().filter(|side| self.border(*side) == Border::Other);
        others.map(|side| self.distance(side)).fold(f64::INFINITY, f64::min)
    }

    /// Where a function lives that ends as the borders ask for, other than at the borders that it answers to by itself.
    pub fn reach(&self, is_answered: impl Fn(Side) -> bool) -> [Reach; 2] {
        let end = |side: Side| match self.border(side) {
            _ if is_answered(side) => End::Open,
            Border::Free => End::Open,
            Border::Pinned => End::Pinned,
            Border::None | Border::Other | Border::Clamped => End::Flat,
        };
        let along = |centre: f64, from: Side, to: Side| Reach {
            centre,
            from: self.end(from),
            to: self.end(to),
            at_from: end(from),
            at_to: end(to),
        };
        [along(self.at.0, Side::Left, Side::Right), along(self.at.1, Side::Top, Side::Bottom)]
    }
}

/// On a border that it is as good as on.
fn snapped(lines: &[f64], at: f64) -> f64 {
    let merged = MERGE * lines[lines.len() - 1];
    lines.iter().copied().find(|line| (line - at).abs() <= merged).unwrap_or(at)
}

/// Where a rectangle may end between a point and a wanted end: there, or at the borders on the way.
fn candidates(lines: &[f64], at: f64, wanted: f64) -> Vec<f64> {
    let (low, high) = (at.min(wanted), at.max(wanted));
    let mut between: Vec<f64> = lines.iter().copied().filter(|line| *line >= low && *line <= high).collect();
    between.push(wanted);
    between.sort_by(|a, b| (a - at).abs().total_cmp(&(b - at).abs()));
    between.dedup();
    between.truncate(MOST_BORDERS + 1);
    between
}
