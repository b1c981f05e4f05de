//! The mesh of a surface and the numbering of its unknowns.

use super::fineness::Fineness;
use super::mesh::{GridLines, MERGE};
use super::neighbours::{PlaceClusters, distance_between_points, merge_attachments_into_places_firmest_first};
use super::placement::{build_singular_functions_of_attachments, cell_size_at_attachments_m, required_grid_lines};
use super::points::{StiffPoint, StiffPointUnknowns};
use super::sections::{CellSections, WaveRigidities};
use super::shape::CellElement;
use super::singular::SingularFunction;
use super::sparse::{MatrixEntries, SparseVector};
use super::thin_cells::ThinCells;
use crate::scene::{EdgeKind, Scene, Side, SurfaceKind};
use std::collections::{BTreeMap, HashSet};

/// Springs stiffer than this, in rigidity over the longer side squared, act on unknowns of their own: a plate gives way at a
/// point with about ten of these, and rounding is 1e-16 of the spring.
const STIFF: f64 = 1e5;

/// What of a deflection.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum DeflectionDerivative {
    /// Itself.
    Value,
    /// Its slope along x.
    SlopeX,
    /// Its slope along y.
    SlopeY,
}

/// The grid lines across x and across y.
fn build_mesh_lines_along_x_and_y(scene: &Scene, fineness: Fineness) -> [GridLines; 2] {
    let [in_x, in_y] = required_grid_lines(scene, &scene.layout(), fineness);
    [
        GridLines::new(scene.surface.length_m, fineness.cell_m, &in_x),
        GridLines::new(scene.surface.width_m, fineness.cell_m, &in_y),
    ]
}

/// Number of unknowns of a mesh before edges and cut-outs remove some.
#[must_use]
pub fn count_mesh_unknowns_before_edges_and_cutouts(scene: &Scene, fineness: Fineness) -> usize {
    let [x, y] = build_mesh_lines_along_x_and_y(scene, fineness);
    let along = |lines: &GridLines| lines.count_cells() * (fineness.order - 1) + 2;
    along(&x) * if scene.surface.kind == SurfaceKind::Bar { 1 } else { along(&y) }
}

/// The mesh with its numbering of unknowns; fixed unknowns have no number.
#[derive(Clone, Debug)]
pub struct Grid {
    /// Lines across x.
    pub x: GridLines,
    /// Lines across y; `None` for a bar.
    pub y: Option<GridLines>,
    /// The cells' functions.
    pub element: CellElement,
    /// The same across a strip.
    straight: CellElement,
    /// What the cells are made of.
    pub sections: CellSections,
    /// Number of each unknown: the tensor products of the directions' functions, x running fastest.
    numbers: Vec<Option<usize>>,
    /// What point forces do; their unknowns come after the tensor products.
    singular: Vec<SingularFunction>,
    /// Where something is attached, nearly equal places as one.
    attached: Vec<(f64, f64)>,
    /// Deflections that are unknowns of their own.
    points: StiffPointUnknowns,
    /// Cells of a bar that are much thinner than the others.
    pub(super) thin: ThinCells,
    /// Free unknowns of the surface.
    pub free: usize,
}

impl Grid {
    /// The mesh, the edges' fixed unknowns left out.
    #[must_use]
    pub(super) fn new(scene: &Scene, fineness: Fineness) -> Self {
        let layout = scene.layout();
        let [mut x, mut y] = build_mesh_lines_along_x_and_y(scene, fineness);
        if scene.surface.kind == SurfaceKind::Plate {
            x.is_strip =
                x.count_cells() == 1 && !has_supported_or_elastic_edge_on_any_side(scene, [Side::Left, Side::Right]);
            y.is_strip =
                y.count_cells() == 1 && !has_supported_or_elastic_edge_on_any_side(scene, [Side::Top, Side::Bottom]);
        }
        let y = (scene.surface.kind == SurfaceKind::Plate).then_some(y);
        let (element, straight) = (
            CellElement::new(fineness.order),
            CellElement::new_with_two_rigid_body_functions_for_single_free_cell(fineness.order),
        );
        let sections = CellSections::new(scene.surface.kind, &layout, &x, y.as_ref());
        let singular =
            if y.is_some() { build_singular_functions_of_attachments(scene, &layout, fineness) } else { Vec::new() };
        let (numbers, points, thin, free) = (Vec::new(), StiffPointUnknowns::default(), ThinCells::default(), 0);
        let attached = merge_attachments_into_places_firmest_first(scene).into_iter().map(|place| place.at).collect();
        let mut grid = Self { x, y, element, straight, sections, numbers, singular, attached, points, thin, free };
        let mut fixed = grid.mark_unknowns_fixed_by_edges(scene);
        grid.mark_unknowns_inside_cutouts(&mut fixed);
        grid.numbers = fixed
            .into_iter()
            .map(|fixed| {
                let number = (!fixed).then_some(grid.free);
                grid.free += usize::from(!fixed);
                number
            })
            .collect();
        grid.free += grid.singular.len();
        if grid.y.is_some() {
            grid.points = grid.build_stiff_point_unknowns_of_plate(scene, fineness);
        } else {
            let numbers: Vec<_> = (0..grid.x.at.len())
                .map(|line| {
                    [0, 1].map(|own| {
                        grid.unknown_of_function_product_unless_fixed(
                            grid.index_of_deflection_function_at_line(line) + own,
                            0,
                        )
                    })
                })
                .collect();
            (grid.thin, grid.points) = ThinCells::find_cells_much_shorter_than_mesh_and_change_of_unknowns(
                &grid.x.at,
                &grid.x.scale,
                fineness.cell_m,
                &numbers,
            );
        }
        grid
    }

    /// The element of the cells along these lines.
    pub(super) fn choose_element_with_rigid_body_functions_for_strip_else_ordinary(
        &self,
        lines: &GridLines,
    ) -> &CellElement {
        if lines.is_strip { &self.straight } else { &self.element }
    }

    /// The stiffly held points of a plate; on a bar each attachment has a line, and its deflection is an unknown anyway.
    fn build_stiff_point_unknowns_of_plate(&self, scene: &Scene, fineness: Fineness) -> StiffPointUnknowns {
        let (length, width) = self.length_and_width_or_1_m();
        let stiff = STIFF * WaveRigidities::find_extremes_and_mean_over_layers_of_scene(scene).softest
            / length.max(width).powi(2);
        let mut clusters = PlaceClusters::new(cell_size_at_attachments_m(scene, fineness));
        let (mut points, mut deflections, mut rows): (Vec<StiffPoint>, Vec<SparseVector>, Vec<SparseVector>) =
            Default::default();
        for place in merge_attachments_into_places_firmest_first(scene).into_iter().filter(|place| place.held > stiff) {
            let deflection = self.deflection_or_slope_row_at(place.at.0, place.at.1, DeflectionDerivative::Value);
            if deflection.is_empty() {
                continue;
            }
            let beside =
                clusters.add_place_and_find_nearest_earlier_in_cluster(place.at).map(|near| (near.nearest, near.ratio));
            rows.push(match beside {
                None => deflection.clone(),
                Some((other, ratio)) => subtract_and_divide(&deflection, &deflections[other], ratio),
            });
            points.push(StiffPoint { at: place.at, beside });
            deflections.push(deflection);
        }
        // Products of two bubbles live in one cell.
        let inner: HashSet<usize> = self.unknowns_inside_single_cells().collect();
        StiffPointUnknowns::new(&points, &rows, |unknown| inner.contains(&unknown))
    }

    /// Unknowns whose functions are zero outside of one cell.
    fn unknowns_inside_single_cells(&self) -> impl Iterator<Item = usize> {
        let per_cell = self.element.element_order() - 1;
        let in_x = self.count_functions_along_x();
        self.numbers.iter().enumerate().filter_map(move |(place, number)| {
            let is_bubble = |function: usize| function % per_cell >= 2;
            number.filter(|_| is_bubble(place % in_x) && is_bubble(place / in_x))
        })
    }

    /// The row that gives the deflection where something is attached.
    #[must_use]
    pub fn deflection_row_of_attachment(&self, x_m: f64, y_m: f64) -> SparseVector {
        let (x_m, y_m) = self.merged_attachment_position_m(x_m, y_m);
        self.points
            .deflection_row_if_stiff_point_at(x_m, y_m)
            .unwrap_or_else(|| self.deflection_or_slope_row_at(x_m, y_m, DeflectionDerivative::Value))
    }

    /// Transforms a matrix over the mesh's functions to one over the unknowns.
    pub(super) fn transform_matrix_to_unknowns(&self, entries: MatrixEntries) -> MatrixEntries {
        self.points.transform_matrix_to_new_unknowns(entries)
    }

    /// Transforms a row over the mesh's functions to one over the unknowns.
    pub(super) fn transform_row_to_unknowns(&self, row: SparseVector) -> SparseVector {
        self.points.transform_row_to_new_unknowns(row)
    }

    /// Number of functions of point forces.
    pub(super) fn count_point_force_functions(&self) -> usize {
        self.singular.len()
    }

    /// Number of stiffly held points that have unknowns of their own.
    pub(super) fn count_stiff_points(&self) -> usize {
        self.points.len()
    }

    /// The singular functions that reach into a rectangle (x from, x to, y from, y to), with their unknowns.
    pub(super) fn unknowns_and_singular_functions_reaching_into_rectangle(
        &self,
        bounds: [f64; 4],
    ) -> impl Iterator<Item = (usize, &SingularFunction)> {
        let first = self.free - self.singular.len();
        self.singular
            .iter()
            .enumerate()
            .filter(move |(_, f)| f.x.overlaps_range(bounds[0], bounds[1]) && f.y.overlaps_range(bounds[2], bounds[3]))
            .map(move |(k, f)| (first + k, f))
    }

    /// Number of functions along lines: value and slope at each line, and each cell's bubbles.
    fn count_functions_along(&self, lines: &GridLines) -> usize {
        lines.count_cells() * (self.element.element_order() - 1) + 2
    }

    /// Index along the lines of a cell's function.
    #[must_use]
    pub fn function_index_along_one_axis(&self, cell: usize, function_of_cell: usize) -> usize {
        let per_cell = self.element.element_order() - 1;
        cell * per_cell
            + match function_of_cell {
                0 | 1 => function_of_cell,
                2 | 3 => per_cell + function_of_cell - 2,
                bubble => bubble - 2,
            }
    }

    /// Index of the function that is the deflection at a line; the slope's is the next.
    pub(super) fn index_of_deflection_function_at_line(&self, line_index: usize) -> usize {
        line_index * (self.element.element_order() - 1)
    }

    /// Number of functions along x.
    fn count_functions_along_x(&self) -> usize {
        self.count_functions_along(&self.x)
    }

    /// Number of functions along y; 1 on a bar.
    fn count_functions_along_y(&self) -> usize {
        self.y.as_ref().map_or(1, |y| self.count_functions_along(y))
    }

    /// Which unknowns pinned and clamped edges take away: pinned those that do not vanish at the edge, clamped also those
    /// whose slope across it does not.
    fn mark_unknowns_fixed_by_edges(&self, scene: &Scene) -> Vec<bool> {
        let (in_x, in_y) = (self.count_functions_along_x(), self.count_functions_along_y());
        let mut fixed = vec![false; in_x * in_y];
        for edge in &scene.edges {
            let taken = match edge.kind {
                EdgeKind::Pinned => 1,
                EdgeKind::Clamped => 2,
                EdgeKind::Elastic { .. } => continue,
            };
            for across in (0..taken).map(|k| self.index_of_deflection_function_at_edge(edge.side) + k) {
                match edge.side {
                    Side::Left | Side::Right => (0..in_y).for_each(|j| fixed[j * in_x + across] = true),
                    Side::Top | Side::Bottom => (0..in_x).for_each(|i| fixed[across * in_x + i] = true),
                }
            }
        }
        fixed
    }

    /// Marks as fixed the unknowns that belong to no cell because cut-outs have removed all of theirs.
    fn mark_unknowns_inside_cutouts(&self, fixed: &mut [bool]) {
        if !self.sections.has_cut_away_cells() {
            return;
        }
        let (in_x, n) = (self.count_functions_along_x(), self.element.element_order() + 1);
        let mut is_there = vec![false; fixed.len()];
        for cell_y in 0..self.y.as_ref().map_or(0, GridLines::count_cells) {
            for cell_x in (0..self.x.count_cells())
                .filter(|cell_x| self.sections.section_of_cell_unless_cut_away(*cell_x, cell_y).is_some())
            {
                for (a, b) in (0..n * n).map(|k| (k / n, k % n)) {
                    is_there[self.function_index_along_one_axis(cell_y, b) * in_x
                        + self.function_index_along_one_axis(cell_x, a)] = true;
                }
            }
        }
        fixed.iter_mut().zip(is_there).for_each(|(fixed, is_there)| *fixed |= !is_there);
    }

    /// Whether a cell along a side exists, so is not cut out.
    pub(super) fn is_edge_cell_present(&self, side: Side, cell: usize) -> bool {
        let last_y = self.y.as_ref().map_or(0, |y| y.count_cells() - 1);
        let section = match side {
            Side::Left => self.sections.section_of_cell_unless_cut_away(0, cell),
            Side::Right => self.sections.section_of_cell_unless_cut_away(self.x.count_cells() - 1, cell),
            Side::Top => self.sections.section_of_cell_unless_cut_away(cell, 0),
            Side::Bottom => self.sections.section_of_cell_unless_cut_away(cell, last_y),
        };
        section.is_some()
    }

    /// The deflection's function at an edge, in the direction across it; the slope's is the next.
    pub(super) fn index_of_deflection_function_at_edge(&self, side: Side) -> usize {
        match side {
            Side::Left | Side::Top => 0,
            Side::Right => self.count_functions_along_x() - 2,
            Side::Bottom => self.count_functions_along_y().saturating_sub(2),
        }
    }

    /// The unknown of the product of two functions; `None` if it is fixed.
    #[must_use]
    pub fn unknown_of_function_product_unless_fixed(&self, function_x: usize, function_y: usize) -> Option<usize> {
        self.numbers.get(function_y * self.count_functions_along_x() + function_x).copied().flatten()
    }

    /// Position of an attachment on the mesh: attachments at nearly one place get the same position.
    #[must_use]
    pub fn merged_attachment_position_m(&self, x_m: f64, y_m: f64) -> (f64, f64) {
        if self.attached.is_empty() {
            // A mesh that was made without knowing of it.
            return (x_m, y_m);
        }
        if self.y.is_none() {
            let line = self.x.at[self.x.nearest_line_index(x_m)];
            return (if (line - x_m).abs() <= MERGE * self.length_and_width_or_1_m().0 { line } else { x_m }, 0.0);
        }
        let merged = MERGE * self.length_and_width_or_1_m().0.max(self.length_and_width_or_1_m().1);
        self.attached
            .iter()
            .copied()
            .find(|at| distance_between_points(*at, (x_m, y_m)) <= merged)
            .unwrap_or((x_m, y_m))
    }

    /// Length and width of the surface in m; the width is 1 on a bar, which has none of its own.
    #[must_use]
    pub fn length_and_width_or_1_m(&self) -> (f64, f64) {
        (self.x.at[self.x.count_cells()], self.y.as_ref().map_or(1.0, |y| y.at[y.count_cells()]))
    }

    /// Where the functions are looked at for a place, which rounding may have put beyond an edge or into a cut-out whose border
    /// it is on ([`crate::scene::SurfaceLayout::layer_at_unless_cut_out`] has it so, too); `None` in a cut-out. Beyond an edge the cells' polynomials would go
    /// on and the functions of point forces end: half of a shape.
    fn snap_to_surface_unless_in_cutout_m(&self, x_m: f64, y_m: f64) -> Option<(f64, f64)> {
        let along = |lines: &GridLines, at: f64| at.clamp(0.0, lines.at[lines.count_cells()]);
        let (x, y) = (along(&self.x, x_m), self.y.as_ref().map_or(y_m, |y| along(y, y_m)));
        if !self.sections.has_cut_away_cells() || self.is_in_present_cell(x, y) {
            return Some((x, y));
        }
        let on_line = |lines: &GridLines, at: f64| {
            let line = lines.at[lines.nearest_line_index(at)];
            if (line - at).abs() <= MERGE * lines.at[lines.count_cells()] { line } else { at }
        };
        let near = (on_line(&self.x, x), self.y.as_ref().map_or(y, |lines| on_line(lines, y)));
        [(near.0, y), (x, near.1), near].into_iter().find(|(x, y)| self.is_in_present_cell(*x, *y))
    }

    /// Whether any cell that contains the point, on its border or inside, exists.
    fn is_in_present_cell(&self, x_m: f64, y_m: f64) -> bool {
        let beside = |lines: &GridLines, at: f64| {
            let (cell, place) = lines.find_cell_index_and_fraction_within(at);
            [if place == 0.0 { cell.saturating_sub(1) } else { cell }, cell]
        };
        let (in_x, in_y) = (beside(&self.x, x_m), self.y.as_ref().map_or([0; 2], |y| beside(y, y_m)));
        in_y.iter().any(|j| in_x.iter().any(|i| self.sections.section_of_cell_unless_cut_away(*i, *j).is_some()))
    }

    /// The deflection, or a slope, anywhere on the surface: the functions' values there; none in a cut-out. What rounding took
    /// beyond an edge is on it.
    #[must_use]
    pub fn deflection_or_slope_row_at(&self, x_m: f64, y_m: f64, derivative: DeflectionDerivative) -> SparseVector {
        let Some((x_m, y_m)) = self.snap_to_surface_unless_in_cutout_m(x_m, y_m) else { return Vec::new() };
        let along = |lines: &GridLines, at: f64, slope: bool| {
            let (cell, place) = lines.find_cell_index_and_fraction_within(at);
            let width = lines.at[cell + 1] - lines.at[cell];
            let [values, slopes, _] = self
                .choose_element_with_rigid_body_functions_for_strip_else_ordinary(lines)
                .values_and_derivatives_at(place, width, [lines.scale[cell], lines.scale[cell + 1]]);
            (cell, if slope { slopes } else { values })
        };
        let (cell_x, in_x) = along(&self.x, x_m, derivative == DeflectionDerivative::SlopeX);
        let (cell_y, in_y) = match &self.y {
            Some(y) => along(y, y_m, derivative == DeflectionDerivative::SlopeY),
            None if derivative == DeflectionDerivative::SlopeY => return Vec::new(),
            None => (0, vec![1.0]),
        };
        let mut out = Vec::with_capacity(in_x.len() * in_y.len());
        for (b, value_y) in in_y.iter().enumerate().filter(|(_, value)| **value != 0.0) {
            for (a, value_x) in in_x.iter().enumerate().filter(|(_, value)| **value != 0.0) {
                if let Some(number) = self.unknown_of_function_product_unless_fixed(
                    self.function_index_along_one_axis(cell_x, a),
                    self.function_index_along_one_axis(cell_y, b),
                ) {
                    out.push((number, value_x * value_y));
                }
            }
        }
        for (k, f) in self.singular.iter().enumerate() {
            let jet = f.evaluate_jet_at(x_m, y_m);
            let value = match derivative {
                DeflectionDerivative::Value => jet.value,
                DeflectionDerivative::SlopeX => jet.x,
                DeflectionDerivative::SlopeY => jet.y,
            };
            if value != 0.0 {
                out.push((self.free - self.singular.len() + k, value));
            }
        }
        self.points.transform_row_to_new_unknowns(out)
    }

    /// Along lines, the functions that a linear deflection is made of: each with its place, and the length that a slope is
    /// multiplied with to give the next function's part.
    fn deflection_functions_with_position_and_slope_scale(&self, lines: &GridLines) -> Vec<(usize, f64, Option<f64>)> {
        if lines.is_strip {
            let half = 0.5 * lines.at[1];
            return vec![(0, half, Some(half))];
        }
        let places = lines.at.iter().zip(&lines.scale).enumerate();
        places.map(|(i, (at, scale))| (self.index_of_deflection_function_at_line(i), *at, Some(*scale))).collect()
    }

    /// Values of the unknowns for the rigid deflection c + cx x + cy y.
    #[must_use]
    pub fn unknown_values_of_rigid_deflection(&self, c: f64, cx: f64, cy: f64) -> Vec<f64> {
        let mut out = vec![0.0; self.free];
        let in_y = self
            .y
            .as_ref()
            .map_or_else(|| vec![(0, 0.0, None)], |y| self.deflection_functions_with_position_and_slope_scale(y));
        for (here_y, y_at, slope_y) in in_y {
            for (here_x, x_at, slope_x) in self.deflection_functions_with_position_and_slope_scale(&self.x) {
                let slope_x = slope_x
                    .map(|scale| (self.unknown_of_function_product_unless_fixed(here_x + 1, here_y), cx * scale));
                let slope_y = slope_y
                    .map(|scale| (self.unknown_of_function_product_unless_fixed(here_x, here_y + 1), cy * scale));
                let value = (self.unknown_of_function_product_unless_fixed(here_x, here_y), c + cx * x_at + cy * y_at);
                for (number, value) in [Some(value), slope_x, slope_y].into_iter().flatten() {
                    if let Some(number) = number {
                        out[number] = value;
                    }
                }
            }
        }
        self.thin.unknowns_relative_to_other_end().for_each(|unknown| out[unknown] = 0.0);
        for (unknown, value) in self.points.unknowns_and_values_for_linear_deflection(c, cx, cy) {
            out[unknown] = value;
        }
        out
    }
}

/// Whether the scene has an edge on one of these sides.
fn has_supported_or_elastic_edge_on_any_side(scene: &Scene, sides: [Side; 2]) -> bool {
    scene.edges.iter().any(|edge| sides.contains(&edge.side))
}

/// The sparse vector (a - b) / ratio.
fn subtract_and_divide(a: &[(usize, f64)], b: &[(usize, f64)], ratio: f64) -> SparseVector {
    let mut sums: BTreeMap<usize, f64> = a.iter().copied().collect();
    for (index, value) in b {
        *sums.entry(*index).or_insert(0.0) -= value;
    }
    sums.into_iter().map(|(index, value)| (index, value / ratio)).filter(|(_, value)| *value != 0.0).collect()
}
