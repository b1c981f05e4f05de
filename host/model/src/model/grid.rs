//! The mesh of a surface and the numbering of its unknowns.

use super::fineness::Fineness;
use super::mesh::{Lines, MERGE};
use super::neighbours::{Clusters, distance, places};
use super::placement::{cell_at_attachments, forced, singular};
use super::points::{Held, Points};
use super::sections::{Sections, Waves};
use super::shape::Element;
use super::singular::Singular;
use super::sparse::{Entries, SparseVector};
use super::thin_cells::ThinCells;
use crate::scene::{EdgeKind, Scene, Side, SurfaceKind};
use std::collections::{BTreeMap, HashSet};

/// Springs stiffer than this, in rigidity over the longer side squared, act on unknowns of their own: a plate gives way at a
/// point with about ten of these, and rounding is 1e-16 of the spring.
const STIFF: f64 = 1e5;

/// What of a deflection.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Derivative {
    /// Itself.
    Value,
    /// Its slope along x.
    SlopeX,
    /// Its slope along y.
    SlopeY,
}

/// The lines across x and across y.
fn lines(scene: &Scene, fineness: Fineness) -> [Lines; 2] {
    let [in_x, in_y] = forced(scene, &scene.layout(), fineness);
    [
        Lines::new(scene.surface.length_m, fineness.cell_m, &in_x),
        Lines::new(scene.surface.width_m, fineness.cell_m, &in_y),
    ]
}

/// Unknowns of a mesh, before edges and cut-outs take some away.
#[must_use]
pub fn expected_unknowns(scene: &Scene, fineness: Fineness) -> usize {
    let [x, y] = lines(scene, fineness);
    let along = |lines: &Lines| lines.cells() * (fineness.order - 1) + 2;
    along(&x) * if scene.surface.kind == SurfaceKind::Bar { 1 } else { along(&y) }
}

/// The mesh with its numbering of unknowns; fixed unknowns have no number.
#[derive(Clone, Debug)]
pub struct Grid {
    /// Lines across x.
    pub x: Lines,
    /// Lines across y; `None` for a bar.
    pub y: Option<Lines>,
    /// The cells' functions.
    pub element: Element,
    /// The same across a strip.
    straight: Element,
    /// What the cells are made of.
    pub sections: Sections,
    /// Number of each unknown: the tensor products of the directions' functions, x running fastest.
    numbers: Vec<Option<usize>>,
    /// What point forces do; their unknowns come after the tensor products.
    singular: Vec<Singular>,
    /// Where something is attached, nearly equal places as one.
    attached: Vec<(f64, f64)>,
    /// Deflections that are unknowns of their own.
    points: Points,
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
        let [mut x, mut y] = lines(scene, fineness);
        if scene.surface.kind == SurfaceKind::Plate {
            x.is_strip = x.cells() == 1 && !has_edges(scene, [Side::Left, Side::Right]);
            y.is_strip = y.cells() == 1 && !has_edges(scene, [Side::Top, Side::Bottom]);
        }
        let y = (scene.surface.kind == SurfaceKind::Plate).then_some(y);
        let (element, straight) = (Element::new(fineness.order), Element::straight(fineness.order));
        let sections = Sections::new(scene.surface.kind, &layout, &x, y.as_ref());
        let singular = if y.is_some() { singular(scene, &layout, fineness) } else { Vec::new() };
        let (numbers, points, thin, free) = (Vec::new(), Points::default(), ThinCells::default(), 0);
        let attached = places(scene).into_iter().map(|place| place.at).collect();
        let mut grid = Self { x, y, element, straight, sections, numbers, singular, attached, points, thin, free };
        let mut fixed = grid.fixed(scene);
        grid.fix_cut_away(&mut fixed);
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
            grid.points = grid.stiff_points(scene, fineness);
        } else {
            let numbers: Vec<_> =
                (0..grid.x.at.len()).map(|line| [0, 1].map(|own| grid.number(grid.at_line(line) + own, 0))).collect();
            (grid.thin, grid.points) = ThinCells::find(&grid.x.at, &grid.x.scale, fineness.cell_m, &numbers);
        }
        grid
    }

    /// The functions of the cells along these lines.
    pub(super) fn element_along(&self, lines: &Lines) -> &Element {
        if lines.is_strip { &self.straight } else { &self.element }
    }

    /// The stiffly held points of a plate; on a bar each attachment has a line, and its deflection is an unknown anyway.
    fn stiff_points(&self, scene: &Scene, fineness: Fineness) -> Points {
        let (length, width) = self.size();
        let stiff = STIFF * Waves::of(scene).softest / length.max(width).powi(2);
        let mut clusters = Clusters::new(cell_at_attachments(scene, fineness));
        let (mut points, mut deflections, mut rows): (Vec<Held>, Vec<SparseVector>, Vec<SparseVector>) =
            Default::default();
        for place in places(scene).into_iter().filter(|place| place.held > stiff) {
            let deflection = self.row_at(place.at.0, place.at.1, Derivative::Value);
            if deflection.is_empty() {
                continue;
            }
            let beside = clusters.add(place.at).map(|near| (near.nearest, near.ratio));
            rows.push(match beside {
                None => deflection.clone(),
                Some((other, ratio)) => difference(&deflection, &deflections[other], ratio),
            });
            points.push(Held { at: place.at, beside });
            deflections.push(deflection);
        }
        // Products of two bubbles live in one cell.
        let inner: HashSet<usize> = self.inner_unknowns().collect();
        Points::new(&points, &rows, |unknown| inner.contains(&unknown))
    }

    /// Unknowns whose functions live in one cell.
    fn inner_unknowns(&self) -> impl Iterator<Item = usize> {
        let per_cell = self.element.order() - 1;
        let in_x = self.functions_x();
        self.numbers.iter().enumerate().filter_map(move |(place, number)| {
            let is_bubble = |function: usize| function % per_cell >= 2;
            number.filter(|_| is_bubble(place % in_x) && is_bubble(place / in_x))
        })
    }

    /// The deflection where something is attached.
    #[must_use]
    pub fn attachment(&self, x_m: f64, y_m: f64) -> SparseVector {
        let (x_m, y_m) = self.attached_at(x_m, y_m);
        self.points.deflection(x_m, y_m).unwrap_or_else(|| self.row_at(x_m, y_m, Derivative::Value))
    }

    /// A matrix over the functions, over the unknowns.
    pub(super) fn over_unknowns(&self, entries: Entries) -> Entries {
        self.points.matrix(entries)
    }

    /// A row over the functions, over the unknowns.
    pub(super) fn row_over_unknowns(&self, row: SparseVector) -> SparseVector {
        self.points.row(row)
    }

    /// How many functions of point forces there are.
    pub(super) fn point_functions(&self) -> usize {
        self.singular.len()
    }

    /// How many stiffly held points have unknowns of their own.
    pub(super) fn stiff_points_held(&self) -> usize {
        self.points.len()
    }

    /// The singular functions that reach into a rectangle (x from, x to, y from, y to), with their unknowns.
    pub(super) fn singular_in(&self, bounds: [f64; 4]) -> impl Iterator<Item = (usize, &Singular)> {
        let first = self.free - self.singular.len();
        self.singular
            .iter()
            .enumerate()
            .filter(move |(_, f)| f.x.overlaps(bounds[0], bounds[1]) && f.y.overlaps(bounds[2], bounds[3]))
            .map(move |(k, f)| (first + k, f))
    }

    /// Functions along lines: value and slope at each, and each cell's bubbles.
    fn functions_along(&self, lines: &Lines) -> usize {
        lines.cells() * (self.element.order() - 1) + 2
    }

    /// The function along lines that function `a` of a cell is.
    #[must_use]
    pub fn function(&self, cell: usize, a: usize) -> usize {
        let per_cell = self.element.order() - 1;
        cell * per_cell
            + match a {
                0 | 1 => a,
                2 | 3 => per_cell + a - 2,
                bubble => bubble - 2,
            }
    }

    /// The deflection's function at line `i`; the slope's is the next.
    pub(super) fn at_line(&self, i: usize) -> usize {
        i * (self.element.order() - 1)
    }

    fn functions_x(&self) -> usize {
        self.functions_along(&self.x)
    }

    fn functions_y(&self) -> usize {
        self.y.as_ref().map_or(1, |y| self.functions_along(y))
    }

    /// Which unknowns pinned and clamped edges take away: pinned those that do not vanish at the edge, clamped also those
    /// whose slope across it does not.
    fn fixed(&self, scene: &Scene) -> Vec<bool> {
        let (in_x, in_y) = (self.functions_x(), self.functions_y());
        let mut fixed = vec![false; in_x * in_y];
        for edge in &scene.edges {
            let taken = match edge.kind {
                EdgeKind::Pinned => 1,
                EdgeKind::Clamped => 2,
                EdgeKind::Elastic { .. } => continue,
            };
            for across in (0..taken).map(|k| self.edge_function(edge.side) + k) {
                match edge.side {
                    Side::Left | Side::Right => (0..in_y).for_each(|j| fixed[j * in_x + across] = true),
                    Side::Top | Side::Bottom => (0..in_x).for_each(|i| fixed[across * in_x + i] = true),
                }
            }
        }
        fixed
    }

    /// Takes away the unknowns that no cell has because cut-outs have taken all of theirs.
    fn fix_cut_away(&self, fixed: &mut [bool]) {
        if !self.sections.has_cutouts() {
            return;
        }
        let (in_x, n) = (self.functions_x(), self.element.order() + 1);
        let mut is_there = vec![false; fixed.len()];
        for cell_y in 0..self.y.as_ref().map_or(0, Lines::cells) {
            for cell_x in (0..self.x.cells()).filter(|cell_x| self.sections.at(*cell_x, cell_y).is_some()) {
                for (a, b) in (0..n * n).map(|k| (k / n, k % n)) {
                    is_there[self.function(cell_y, b) * in_x + self.function(cell_x, a)] = true;
                }
            }
        }
        fixed.iter_mut().zip(is_there).for_each(|(fixed, is_there)| *fixed |= !is_there);
    }

    /// Whether a cell along a side is there.
    pub(super) fn has_edge(&self, side: Side, cell: usize) -> bool {
        let last_y = self.y.as_ref().map_or(0, |y| y.cells() - 1);
        let section = match side {
            Side::Left => self.sections.at(0, cell),
            Side::Right => self.sections.at(self.x.cells() - 1, cell),
            Side::Top => self.sections.at(cell, 0),
            Side::Bottom => self.sections.at(cell, last_y),
        };
        section.is_some()
    }

    /// The deflection's function at an edge, in the direction across it; the slope's is the next.
    pub(super) fn edge_function(&self, side: Side) -> usize {
        match side {
            Side::Left | Side::Top => 0,
            Side::Right => self.functions_x() - 2,
            Side::Bottom => self.functions_y().saturating_sub(2),
        }
    }

    /// The number of the product of two functions; `None` if it is fixed.
    #[must_use]
    pub fn number(&self, in_x: usize, in_y: usize) -> Option<usize> {
        self.numbers.get(in_y * self.functions_x() + in_x).copied().flatten()
    }

    /// Where an attachment is on the mesh: those that are nearly at one place at the same.
    #[must_use]
    pub fn attached_at(&self, x_m: f64, y_m: f64) -> (f64, f64) {
        if self.attached.is_empty() {
            // A mesh that was made without knowing of it.
            return (x_m, y_m);
        }
        if self.y.is_none() {
            let line = self.x.at[self.x.nearest(x_m)];
            return (if (line - x_m).abs() <= MERGE * self.size().0 { line } else { x_m }, 0.0);
        }
        let merged = MERGE * self.size().0.max(self.size().1);
        self.attached.iter().copied().find(|at| distance(*at, (x_m, y_m)) <= merged).unwrap_or((x_m, y_m))
    }

    /// Length and width; the latter is 1 on a bar, which has none of its own.
    #[must_use]
    pub fn size(&self) -> (f64, f64) {
        (self.x.at[self.x.cells()], self.y.as_ref().map_or(1.0, |y| y.at[y.cells()]))
    }

    /// Where the functions are looked at for a place, which rounding may have put beyond an edge or into a cut-out whose border
    /// it is on ([`crate::scene::Layout::at`] has it so, too); `None` in a cut-out. Beyond an edge the cells' polynomials would go
    /// on and the functions of point forces end: half of a shape.
    fn on_surface(&self, x_m: f64, y_m: f64) -> Option<(f64, f64)> {
        let along = |lines: &Lines, at: f64| at.clamp(0.0, lines.at[lines.cells()]);
        let (x, y) = (along(&self.x, x_m), self.y.as_ref().map_or(y_m, |y| along(y, y_m)));
        if !self.sections.has_cutouts() || self.is_there(x, y) {
            return Some((x, y));
        }
        let on_line = |lines: &Lines, at: f64| {
            let line = lines.at[lines.nearest(at)];
            if (line - at).abs() <= MERGE * lines.at[lines.cells()] { line } else { at }
        };
        let near = (on_line(&self.x, x), self.y.as_ref().map_or(y, |lines| on_line(lines, y)));
        [(near.0, y), (x, near.1), near].into_iter().find(|(x, y)| self.is_there(*x, *y))
    }

    /// Whether any cell that has the point, on its border or inside, is there.
    fn is_there(&self, x_m: f64, y_m: f64) -> bool {
        let beside = |lines: &Lines, at: f64| {
            let (cell, place) = lines.locate(at);
            [if place == 0.0 { cell.saturating_sub(1) } else { cell }, cell]
        };
        let (in_x, in_y) = (beside(&self.x, x_m), self.y.as_ref().map_or([0; 2], |y| beside(y, y_m)));
        in_y.iter().any(|j| in_x.iter().any(|i| self.sections.at(*i, *j).is_some()))
    }

    /// The deflection, or a slope, anywhere on the surface: the functions' values there; none in a cut-out. What rounding took
    /// beyond an edge is on it.
    #[must_use]
    pub fn row_at(&self, x_m: f64, y_m: f64, what: Derivative) -> SparseVector {
        let Some((x_m, y_m)) = self.on_surface(x_m, y_m) else { return Vec::new() };
        let along = |lines: &Lines, at: f64, slope: bool| {
            let (cell, place) = lines.locate(at);
            let width = lines.at[cell + 1] - lines.at[cell];
            let [values, slopes, _] =
                self.element_along(lines).derivatives(place, width, [lines.scale[cell], lines.scale[cell + 1]]);
            (cell, if slope { slopes } else { values })
        };
        let (cell_x, in_x) = along(&self.x, x_m, what == Derivative::SlopeX);
        let (cell_y, in_y) = match &self.y {
            Some(y) => along(y, y_m, what == Derivative::SlopeY),
            None if what == Derivative::SlopeY => return Vec::new(),
            None => (0, vec![1.0]),
        };
        let mut out = Vec::with_capacity(in_x.len() * in_y.len());
        for (b, value_y) in in_y.iter().enumerate().filter(|(_, value)| **value != 0.0) {
            for (a, value_x) in in_x.iter().enumerate().filter(|(_, value)| **value != 0.0) {
                if let Some(number) = self.number(self.function(cell_x, a), self.function(cell_y, b)) {
                    out.push((number, value_x * value_y));
                }
            }
        }
        for (k, f) in self.singular.iter().enumerate() {
            let jet = f.at(x_m, y_m);
            let value = match what {
                Derivative::Value => jet.value,
                Derivative::SlopeX => jet.x,
                Derivative::SlopeY => jet.y,
            };
            if value != 0.0 {
                out.push((self.free - self.singular.len() + k, value));
            }
        }
        self.points.row(out)
    }

    /// Along lines, the functions that a linear deflection is made of: each with its place, and the length that a slope is
    /// multiplied with to give the next function's part.
    fn linear_functions(&self, lines: &Lines) -> Vec<(usize, f64, Option<f64>)> {
        if lines.is_strip {
            let half = 0.5 * lines.at[1];
            return vec![(0, half, Some(half))];
        }
        let places = lines.at.iter().zip(&lines.scale).enumerate();
        places.map(|(i, (at, scale))| (self.at_line(i), *at, Some(*scale))).collect()
    }

    /// The unknowns' values for the rigid deflection c + cx x + cy y.
    #[must_use]
    pub fn linear(&self, c: f64, cx: f64, cy: f64) -> Vec<f64> {
        let mut out = vec![0.0; self.free];
        let in_y = self.y.as_ref().map_or_else(|| vec![(0, 0.0, None)], |y| self.linear_functions(y));
        for (here_y, y_at, slope_y) in in_y {
            for (here_x, x_at, slope_x) in self.linear_functions(&self.x) {
                let slope_x = slope_x.map(|scale| (self.number(here_x + 1, here_y), cx * scale));
                let slope_y = slope_y.map(|scale| (self.number(here_x, here_y + 1), cy * scale));
                let value = (self.number(here_x, here_y), c + cx * x_at + cy * y_at);
                for (number, value) in [Some(value), slope_x, slope_y].into_iter().flatten() {
                    if let Some(number) = number {
                        out[number] = value;
                    }
                }
            }
        }
        self.thin.relative_unknowns().for_each(|unknown| out[unknown] = 0.0);
        for (unknown, value) in self.points.linear(c, cx, cy) {
            out[unknown] = value;
        }
        out
    }
}

fn has_edges(scene: &Scene, sides: [Side; 2]) -> bool {
    scene.edges.iter().any(|edge| sides.contains(&edge.side))
}

/// (a - b) / ratio.
fn difference(a: &[(usize, f64)], b: &[(usize, f64)], ratio: f64) -> SparseVector {
    let mut sums: BTreeMap<usize, f64> = a.iter().copied().collect();
    for (index, value) in b {
        *sums.entry(*index).or_insert(0.0) -= value;
    }
    sums.into_iter().map(|(index, value)| (index, value / ratio)).filter(|(_, value)| *value != 0.0).collect()
}
