//! What the surface is made of where: patches laid over it, cut-outs taken from it.

use super::{Scene, Side, Surface, SurfaceKind};

/// Borders nearer to each other than this part of the side are one.
pub const SAME_PLACE: f64 = 1e-6;

/// What the surface is at a place.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SurfaceLayer {
    /// In m.
    pub thickness_m: f64,
    /// A bar's width here in m; a plate's whole width.
    pub width_m: f64,
    /// What it is made of.
    pub material: super::Material,
    /// What a plate of layers resists bending with, where no such material does.
    pub orthotropic: Option<super::PlateRigidities>,
    /// Mass of the air that moves with it, in kg/m^2.
    pub added_kg_m2: f64,
}

impl SurfaceLayer {
    /// Mass per area in kg/m^2, air that moves with it included.
    #[must_use]
    pub fn mass_per_area_with_air_kg_m2(&self) -> f64 {
        self.mass_per_area_without_air_kg_m2() + self.added_kg_m2
    }

    /// Mass per area in kg/m^2 of what it is made of, without air.
    #[must_use]
    pub fn mass_per_area_without_air_kg_m2(&self) -> f64 {
        self.material.density_kg_m3 * self.thickness_m
    }
}

/// The surface in rectangles, each of one kind: a grid of the patches' and cut-outs' borders where what they part
/// differs.
#[derive(Clone, Debug, PartialEq)]
pub struct SurfaceLayout {
    is_bar: bool,
    /// Borders across x, the first 0 and the last the length.
    x_m: Vec<f64>,
    /// Borders across y.
    y_m: Vec<f64>,
    /// Row by row; `None` is cut away.
    parts: Vec<Option<SurfaceLayer>>,
}

/// A point where borders meet, or end.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LayoutVertex {
    /// Where, in m.
    pub at: (f64, f64),
    /// What is left above, right above, left below and right below it.
    pub around: [Option<SurfaceLayer>; 4],
}

impl LayoutVertex {
    /// Whether two parts meet here in nothing but this point.
    #[must_use]
    pub fn is_pinch_point(&self) -> bool {
        let [a, b, c, d] = self.around.map(|part| part.is_some());
        a == d && b == c && a != b
    }

    /// Whether no border turns or ends here.
    #[must_use]
    pub fn has_no_turning_or_ending_border(&self) -> bool {
        let [a, b, c, d] = self.around;
        a == b && c == d || a == c && b == d
    }
}

impl SurfaceLayout {
    /// The layout of a surface; later patches lie over earlier ones, cut-outs over all.
    pub(super) fn new(surface: &Surface, patches: &[super::Patch], cutouts: &[super::Cutout]) -> Self {
        let is_bar = surface.kind == SurfaceKind::Bar;
        let base = SurfaceLayer {
            thickness_m: surface.thickness_m,
            width_m: surface.width_m,
            material: surface.material,
            orthotropic: surface.rigidities_if_layered_plate_is_anisotropic(),
            added_kg_m2: surface.added_mass_kg_per_m2,
        };
        let along = |side: f64, spans: &mut dyn Iterator<Item = [f64; 2]>| {
            let mut lines = vec![0.0, side];
            for at in spans.flatten() {
                if lines.iter().all(|line| (line - at).abs() > SAME_PLACE * side) && at > 0.0 && at < side {
                    lines.push(at);
                }
            }
            lines.sort_by(f64::total_cmp);
            lines
        };
        let in_x =
            patches.iter().map(super::Patch::range_in_x_m).chain(cutouts.iter().map(super::Cutout::range_in_x_m));
        let x_m = along(surface.length_m, &mut in_x.into_iter());
        let y_m = if is_bar {
            vec![0.0, surface.width_m]
        } else {
            let in_y =
                patches.iter().map(super::Patch::range_in_y_m).chain(cutouts.iter().map(super::Cutout::range_in_y_m));
            along(surface.width_m, &mut in_y.into_iter())
        };
        let middles = |lines: &[f64]| -> Vec<f64> { lines.windows(2).map(|at| 0.5 * (at[0] + at[1])).collect() };
        let within = |span: [f64; 2], at: f64| at > span[0] && at < span[1];
        let mut parts = Vec::new();
        for y in middles(&y_m) {
            for x in middles(&x_m) {
                let covers = |in_x, in_y| within(in_x, x) && (is_bar || within(in_y, y));
                let patch = patches.iter().rev().find(|patch| covers(patch.range_in_x_m(), patch.range_in_y_m()));
                let is_cut = cutouts.iter().any(|cutout| covers(cutout.range_in_x_m(), cutout.range_in_y_m()));
                let layer = patch.map_or(base, |patch| SurfaceLayer {
                    thickness_m: patch.thickness_m,
                    width_m: if is_bar { patch.width_m } else { base.width_m },
                    material: patch.material,
                    ..base
                });
                parts.push((!is_cut).then_some(layer));
            }
        }
        let mut layout = Self { is_bar, x_m, y_m, parts };
        layout.remove_redundant_borders();
        layout
    }

    /// Removes borders with the same material on both sides.
    fn remove_redundant_borders(&mut self) {
        for i in (1..self.x_m.len() - 1).rev() {
            if (0..self.y_m.len() - 1).all(|j| {
                self.layer_in_rectangle_unless_cut_away_or_outside(i - 1, j)
                    == self.layer_in_rectangle_unless_cut_away_or_outside(i, j)
            }) {
                let columns = self.x_m.len() - 1;
                let mut place = 0;
                self.parts.retain(|_| {
                    place += 1;
                    (place - 1) % columns != i
                });
                self.x_m.remove(i);
            }
        }
        for j in (1..self.y_m.len() - 1).rev() {
            let columns = self.x_m.len() - 1;
            if (0..columns).all(|i| {
                self.layer_in_rectangle_unless_cut_away_or_outside(i, j - 1)
                    == self.layer_in_rectangle_unless_cut_away_or_outside(i, j)
            }) {
                self.parts.drain(j * columns..(j + 1) * columns);
                self.y_m.remove(j);
            }
        }
    }

    /// The layer of the rectangle in a column and a row; `None` if it is cut away or beyond the surface.
    fn layer_in_rectangle_unless_cut_away_or_outside(&self, column: usize, row: usize) -> Option<SurfaceLayer> {
        let columns = self.x_m.len() - 1;
        if column < columns { self.parts.get(row * columns + column).copied().flatten() } else { None }
    }

    /// Borders across x in m, the surface's own first and last.
    #[must_use]
    pub fn border_lines_and_outer_edges_x_m(&self) -> &[f64] {
        &self.x_m
    }

    /// Borders across y in m, the surface's own first and last.
    #[must_use]
    pub fn border_lines_and_outer_edges_y_m(&self) -> &[f64] {
        &self.y_m
    }

    /// Whether it is its own mirror image along an axis, 0 for x.
    #[must_use]
    pub fn is_mirror_symmetric(&self, axis: usize) -> bool {
        let (columns, rows) = (self.x_m.len() - 1, self.y_m.len() - 1);
        let lines = if axis == 0 { &self.x_m } else { &self.y_m };
        let side = lines[lines.len() - 1];
        let image = |i: usize, j: usize| if axis == 0 { (columns - 1 - i, j) } else { (i, rows - 1 - j) };
        lines.iter().zip(lines.iter().rev()).all(|(low, high)| (low + high - side).abs() <= SAME_PLACE * side)
            && (0..rows).flat_map(|j| (0..columns).map(move |i| (i, j))).all(|(i, j)| {
                let (k, l) = image(i, j);
                self.layer_in_rectangle_unless_cut_away_or_outside(i, j)
                    == self.layer_in_rectangle_unless_cut_away_or_outside(k, l)
            })
    }

    /// Whether the surface is one rectangle of one layer.
    #[must_use]
    pub fn is_one_rectangle_of_one_layer(&self) -> bool {
        self.parts.len() == 1
    }

    /// All kinds that there are, each with its area in m^2 (a bar's length in m), one entry for each rectangle.
    pub fn areas_or_bar_lengths_with_layers(&self) -> impl Iterator<Item = (f64, SurfaceLayer)> {
        let columns = self.x_m.len() - 1;
        self.parts.iter().enumerate().filter_map(move |(k, part)| {
            let (i, j) = (k % columns, k / columns);
            let height = if self.is_bar { 1.0 } else { self.y_m[j + 1] - self.y_m[j] };
            part.map(|layer| ((self.x_m[i + 1] - self.x_m[i]) * height, layer))
        })
    }

    /// Mass in kg of what is there and of the air that moves with it.
    #[must_use]
    pub fn mass_with_air_kg(&self) -> f64 {
        self.sum_over_surface(SurfaceLayer::mass_per_area_with_air_kg_m2)
    }

    /// Mass in kg of what is there, without air.
    #[must_use]
    pub fn mass_without_air_kg(&self) -> f64 {
        self.sum_over_surface(SurfaceLayer::mass_per_area_without_air_kg_m2)
    }

    /// The sum over the surface of a quantity per area.
    fn sum_over_surface(&self, per_area: impl Fn(&SurfaceLayer) -> f64) -> f64 {
        let width = |layer: &SurfaceLayer| if self.is_bar { layer.width_m } else { 1.0 };
        self.areas_or_bar_lengths_with_layers().map(|(size, layer)| size * width(&layer) * per_area(&layer)).sum()
    }

    /// The layer at a point; on a border that of any side that exists, `None` in a cut-out.
    #[must_use]
    pub fn layer_at_unless_cut_out(&self, x_m: f64, y_m: f64) -> Option<SurfaceLayer> {
        let beside = |lines: &[f64], at: f64| -> [usize; 2] {
            let merged = SAME_PLACE * lines[lines.len() - 1];
            let before = lines.partition_point(|line| *line <= at - merged).saturating_sub(1);
            let after = lines.partition_point(|line| *line <= at + merged).saturating_sub(1);
            [before.min(lines.len() - 2), after.min(lines.len() - 2)]
        };
        let (in_x, in_y) = (beside(&self.x_m, x_m), if self.is_bar { [0; 2] } else { beside(&self.y_m, y_m) });
        in_y.iter()
            .rev()
            .flat_map(|j| in_x.iter().rev().map(move |i| (*i, *j)))
            .find_map(|(i, j)| self.layer_in_rectangle_unless_cut_away_or_outside(i, j))
    }

    /// What is left of a side: from and to in m, along it.
    #[must_use]
    pub fn remaining_stretches_of_side_m(&self, side: Side) -> Vec<[f64; 2]> {
        let (last_x, last_y) = (self.x_m.len() - 2, self.y_m.len() - 2);
        let lines = if matches!(side, Side::Left | Side::Right) { &self.y_m } else { &self.x_m };
        let is_left = |k: usize| {
            let part = match side {
                Side::Left => self.layer_in_rectangle_unless_cut_away_or_outside(0, k),
                Side::Right => self.layer_in_rectangle_unless_cut_away_or_outside(last_x, k),
                Side::Top => self.layer_in_rectangle_unless_cut_away_or_outside(k, 0),
                Side::Bottom => self.layer_in_rectangle_unless_cut_away_or_outside(k, last_y),
            };
            part.is_some()
        };
        lines.windows(2).enumerate().filter(|(k, _)| is_left(*k)).map(|(_, at)| [at[0], at[1]]).collect()
    }

    /// The layers that a rectangle (x from, x to, y from, y to) has in its inside.
    pub fn layers_overlapping_rectangle_with_none_for_cut_away_parts(
        &self,
        rectangle: [f64; 4],
    ) -> impl Iterator<Item = Option<SurfaceLayer>> {
        let [from_x, to_x, from_y, to_y] = rectangle;
        let columns = self.x_m.len() - 1;
        self.parts.iter().enumerate().filter_map(move |(k, part)| {
            let (i, j) = (k % columns, k / columns);
            let overlaps =
                self.x_m[i] < to_x && self.x_m[i + 1] > from_x && self.y_m[j] < to_y && self.y_m[j + 1] > from_y;
            overlaps.then_some(*part)
        })
    }

    /// Points where lines cross, those on the surface's border included, with what is around them.
    pub fn vertices_at_crossings_of_border_lines(&self) -> impl Iterator<Item = LayoutVertex> {
        // Beyond the last column or row `part` has nothing, as before the first.
        let part = |i: usize, j: usize| {
            if i == 0 || j == 0 { None } else { self.layer_in_rectangle_unless_cut_away_or_outside(i - 1, j - 1) }
        };
        let rows = self.y_m.iter().enumerate();
        rows.flat_map(move |(j, y)| {
            self.x_m.iter().enumerate().map(move |(i, x)| LayoutVertex {
                at: (*x, *y),
                around: [part(i, j), part(i + 1, j), part(i, j + 1), part(i + 1, j + 1)],
            })
        })
    }

    /// How many pieces the surface is in; pieces that meet in a point only are two.
    #[must_use]
    pub fn count_connected_pieces(&self) -> usize {
        let (columns, rows) = (self.x_m.len() - 1, self.y_m.len() - 1);
        let mut seen: Vec<bool> = self.parts.iter().map(Option::is_none).collect();
        let mut pieces = 0;
        for start in 0..self.parts.len() {
            let mut open = Vec::new();
            if !seen[start] {
                pieces += 1;
                seen[start] = true;
                open.push(start);
            }
            while let Some(k) = open.pop() {
                let (i, j) = (k % columns, k / columns);
                let beside = [
                    (i > 0).then(|| k - 1),
                    (i + 1 < columns).then_some(k + 1),
                    (j > 0).then(|| k - columns),
                    (j + 1 < rows).then_some(k + columns),
                ];
                for next in beside.into_iter().flatten() {
                    if !std::mem::replace(&mut seen[next], true) {
                        open.push(next);
                    }
                }
            }
        }
        pieces
    }
}

impl Scene {
    /// What the surface is made of where.
    #[must_use]
    pub fn layout(&self) -> SurfaceLayout {
        SurfaceLayout::new(&self.surface, &self.patches, &self.cutouts)
    }

    /// Mass of the surface in kg with the air that moves along, without what is attached to it.
    #[must_use]
    pub fn surface_mass_with_air_kg(&self) -> f64 {
        self.layout().mass_with_air_kg()
    }

    /// Mass of the surface in kg as it is weighed: without the air that moves along, and without what is attached to it.
    #[must_use]
    pub fn surface_mass_without_air_kg(&self) -> f64 {
        self.layout().mass_without_air_kg()
    }

    /// Area of what is there, in m^2; a bar's is that of its own width, steps or not.
    #[must_use]
    pub fn surface_area_less_cutouts_ignoring_bar_steps_m2(&self) -> f64 {
        match self.surface.kind {
            SurfaceKind::Plate => self.layout().areas_or_bar_lengths_with_layers().map(|(area, _)| area).sum(),
            SurfaceKind::Bar => self.surface.length_m * self.surface.width_m,
        }
    }

    /// The number of the cut-out that a point lies strictly inside of, counted from 1; `None` where there is surface.
    #[must_use]
    pub fn cutout_number_counted_from_1_at(&self, x_m: f64, y_m: f64) -> Option<usize> {
        if self.cutouts.is_empty() || self.layout().layer_at_unless_cut_out(x_m, y_m).is_some() {
            return None;
        }
        let distance = |span: [f64; 2], at: f64| (span[0] - at).max(at - span[1]);
        let deepest =
            |cutout: &super::Cutout| distance(cutout.range_in_x_m(), x_m).max(distance(cutout.range_in_y_m(), y_m));
        let found = self.cutouts.iter().enumerate().min_by(|a, b| deepest(a.1).total_cmp(&deepest(b.1)));
        found.map(|(i, _)| i + 1)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::{Cutout, Material, Patch, SurfaceDamping};

    const GLASS: Material = Material { youngs_modulus_pa: 70e9, poisson_ratio: 0.22, density_kg_m3: 2500.0 };

    /// What the surface is made of at each place.
    fn build_layout(patches: &[(f64, f64, f64, f64, f64)], cutouts: &[(f64, f64, f64, f64)]) -> SurfaceLayout {
        let surface = Surface {
            kind: SurfaceKind::Plate,
            length_m: 3.0,
            width_m: 2.0,
            thickness_m: 1e-3,
            material: GLASS,
            layers: Vec::new(),
            damping: SurfaceDamping::None,
            added_mass_kg_per_m2: 0.0,
        };
        let patches: Vec<_> = patches
            .iter()
            .map(|(x_m, y_m, length_m, width_m, thickness_m)| Patch {
                x_m: *x_m,
                y_m: *y_m,
                length_m: *length_m,
                width_m: *width_m,
                thickness_m: *thickness_m,
                material: GLASS,
            })
            .collect();
        let cutouts: Vec<_> = cutouts
            .iter()
            .map(|(x_m, y_m, length_m, width_m)| Cutout {
                x_m: *x_m,
                y_m: *y_m,
                length_m: *length_m,
                width_m: *width_m,
            })
            .collect();
        SurfaceLayout::new(&surface, &patches, &cutouts)
    }

    #[test]
    fn later_patches_lie_over_earlier_ones() {
        let layout = build_layout(&[(0.0, 0.0, 3.0, 2.0, 2e-3), (0.5, 0.5, 2.0, 1.0, 1e-3)], &[(2.5, 0.0, 0.5, 0.5)]);
        assert_eq!(
            (layout.border_lines_and_outer_edges_x_m(), layout.border_lines_and_outer_edges_y_m()),
            (&[0.0, 0.5, 2.5, 3.0][..], &[0.0, 0.5, 1.5, 2.0][..])
        );
        assert_eq!(layout.layer_at_unless_cut_out(0.1, 0.1).unwrap().thickness_m, 2e-3);
        assert_eq!(layout.layer_at_unless_cut_out(1.0, 1.0).unwrap().thickness_m, 1e-3);
        assert!(
            layout.layer_at_unless_cut_out(2.7, 0.2).is_none() && layout.layer_at_unless_cut_out(2.5, 0.2).is_some()
        );
        let mass = 2500.0 * (2e-3 * (6.0 - 2.0 - 0.25) + 1e-3 * 2.0);
        assert!((layout.mass_with_air_kg() / mass - 1.0).abs() < 1e-12);
    }

    #[test]
    fn borders_that_part_nothing_are_left_out() {
        assert!(build_layout(&[(0.2, 0.3, 1.0, 1.0, 1e-3)], &[]).is_one_rectangle_of_one_layer());
        assert!(build_layout(&[(0.0, 0.0, 3.0, 2.0, 5e-3)], &[]).is_one_rectangle_of_one_layer());
        let twice = build_layout(&[(0.0, 0.0, 1.0, 2.0, 2e-3), (1.0, 0.0, 1.0, 2.0, 2e-3)], &[]);
        assert_eq!(twice.border_lines_and_outer_edges_x_m(), &[0.0, 2.0, 3.0]);
    }

    #[test]
    fn pieces_are_counted() {
        assert_eq!(build_layout(&[], &[(1.0, 0.5, 1.0, 1.0)]).count_connected_pieces(), 1);
        assert_eq!(build_layout(&[], &[(1.0, 0.0, 1.0, 2.0)]).count_connected_pieces(), 2);
        assert_eq!(build_layout(&[], &[(0.0, 0.0, 3.0, 2.0)]).count_connected_pieces(), 0);
        let diagonal = build_layout(&[], &[(0.0, 0.0, 1.0, 1.0), (1.0, 1.0, 2.0, 1.0)]);
        assert_eq!(diagonal.count_connected_pieces(), 2);
        assert!(diagonal.vertices_at_crossings_of_border_lines().any(|vertex| vertex.is_pinch_point()));
    }
}
