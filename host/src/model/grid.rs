//! The mesh of a surface and the numbering of its unknowns.

use super::hermite::values;
use super::mesh::{Forced, Lines, MERGE};
use crate::scene::{EdgeKind, Scene, Side, SurfaceKind};

/// Non-zero entries of a vector over the free unknowns.
pub type SparseVector = Vec<(usize, f64)>;

/// Width of the cells next to a driven point, in regular cells: a point force bends a plate as r^2 log r, which regular
/// cells resolve only to second order.
const DRIVEN: f64 = 0.25;
/// Width of the cells around attachments that are nearer to each other than a regular cell, in their distance: two stiff
/// ones act as a couple, whose compliance goes with the logarithm of that distance.
const CLOSE: f64 = 0.25;

/// The mesh with its numbering of unknowns; fixed unknowns have no number.
#[derive(Clone, Debug)]
pub struct Grid {
    /// Lines across x.
    pub x: Lines,
    /// Lines across y; `None` for a bar.
    pub y: Option<Lines>,
    /// Number of each unknown: node by node, rows of constant y one after the other; per node w, s w_x and, for a plate,
    /// s w_y and s s w_xy.
    numbers: Vec<Option<usize>>,
    /// Free unknowns of the surface.
    pub free: usize,
}

impl Grid {
    /// Lines through every attachment, cells of `cell_m` or smaller, and the edges' fixed unknowns left out.
    #[must_use]
    pub(super) fn new(scene: &Scene, cell_m: f64) -> Self {
        let surface = &scene.surface;
        let points = attachments(scene, cell_m);
        let forced = |at: fn(&Attachment) -> f64| -> Vec<Forced> {
            points.iter().map(|point| Forced { at: at(point), width: point.width }).collect()
        };
        // Four cells across the narrow side of a strip still carry its lowest waves in that direction.
        let cell = |side: f64| cell_m.min(side / 4.0);
        let x = Lines::new(surface.length_m, cell(surface.length_m), &forced(|p| p.x_m));
        let y = match surface.kind {
            SurfaceKind::Bar => None,
            SurfaceKind::Plate => Some(Lines::new(surface.width_m, cell(surface.width_m), &forced(|p| p.y_m))),
        };
        let mut grid = Self { x, y, numbers: Vec::new(), free: 0 };
        let fixed = grid.fixed(scene);
        grid.numbers = fixed
            .into_iter()
            .map(|fixed| {
                let number = (!fixed).then_some(grid.free);
                grid.free += usize::from(!fixed);
                number
            })
            .collect();
        grid
    }

    fn rows(&self) -> usize {
        self.y.as_ref().map_or(1, |y| y.at.len())
    }

    fn per_node(&self) -> usize {
        if self.y.is_some() { 4 } else { 2 }
    }

    /// Which unknowns pinned and clamped edges take away: pinned the deflection and its derivative along the edge, clamped
    /// also the slope across it and the twist.
    fn fixed(&self, scene: &Scene) -> Vec<bool> {
        let (columns, rows, per_node) = (self.x.at.len(), self.rows(), self.per_node());
        let mut fixed = vec![false; columns * rows * per_node];
        for edge in &scene.edges {
            let clamped = match edge.kind {
                EdgeKind::Pinned => false,
                EdgeKind::Clamped => true,
                EdgeKind::Elastic { .. } => continue,
            };
            for (i, j) in self.edge_nodes(edge.side) {
                for unknown in 0..per_node {
                    // Bit 0: differentiated along x, bit 1: along y.
                    let across = if matches!(edge.side, Side::Left | Side::Right) { unknown & 1 } else { unknown >> 1 };
                    if clamped || across == 0 {
                        fixed[(j * columns + i) * per_node + unknown] = true;
                    }
                }
            }
        }
        fixed
    }

    pub(super) fn edge_nodes(&self, side: Side) -> Vec<(usize, usize)> {
        let (columns, rows) = (self.x.at.len(), self.rows());
        match side {
            Side::Left => (0..rows).map(|j| (0, j)).collect(),
            Side::Right => (0..rows).map(|j| (columns - 1, j)).collect(),
            Side::Top => (0..columns).map(|i| (i, 0)).collect(),
            Side::Bottom => (0..columns).map(|i| (i, rows - 1)).collect(),
        }
    }

    /// The number of an unknown of node (i, j); `None` if it is fixed.
    #[must_use]
    pub fn number(&self, i: usize, j: usize, unknown: usize) -> Option<usize> {
        self.numbers.get((j * self.x.at.len() + i) * self.per_node() + unknown).copied().flatten()
    }

    /// The deflection at the node that an attachment has been given.
    #[must_use]
    pub fn at_node(&self, x_m: f64, y_m: f64) -> SparseVector {
        let (i, j) = self.node(x_m, y_m);
        self.number(i, j, 0).map(|number| (number, 1.0)).into_iter().collect()
    }

    pub(super) fn node(&self, x_m: f64, y_m: f64) -> (usize, usize) {
        (self.x.nearest(x_m), self.y.as_ref().map_or(0, |y| y.nearest(y_m)))
    }

    /// Where that node is; y is 0 on a bar.
    #[must_use]
    pub fn node_position(&self, x_m: f64, y_m: f64) -> (f64, f64) {
        let (i, j) = self.node(x_m, y_m);
        (self.x.at[i], self.y.as_ref().map_or(0.0, |y| y.at[j]))
    }

    /// Length and width; the latter is 1 on a bar, which has none of its own.
    #[must_use]
    pub fn size(&self) -> (f64, f64) {
        (self.x.at[self.x.cells()], self.y.as_ref().map_or(1.0, |y| y.at[y.cells()]))
    }

    /// The deflection anywhere on the surface: Hermite interpolation in the cell that holds the point.
    #[must_use]
    pub fn deflection_at(&self, x_m: f64, y_m: f64) -> SparseVector {
        let along = |lines: &Lines, at: f64| {
            let (cell, place) = lines.locate(at);
            let width = lines.at[cell + 1] - lines.at[cell];
            (cell, values(place, width, [lines.scale[cell], lines.scale[cell + 1]]))
        };
        let (cell_x, in_x) = along(&self.x, x_m);
        let (cell_y, in_y) = match &self.y {
            Some(y) => along(y, y_m),
            None => (0, [1.0, 0.0, 0.0, 0.0]),
        };
        let mut out = Vec::with_capacity(16);
        for (a, value_x) in in_x.iter().enumerate() {
            for (b, value_y) in in_y.iter().enumerate() {
                let value = value_x * value_y;
                if value != 0.0
                    && let Some(number) = self.number(cell_x + a / 2, cell_y + b / 2, a % 2 + 2 * (b % 2))
                {
                    out.push((number, value));
                }
            }
        }
        out
    }

    /// The unknowns' values for the rigid deflection c + cx x + cy y.
    #[must_use]
    pub fn linear(&self, c: f64, cx: f64, cy: f64) -> Vec<f64> {
        let mut out = vec![0.0; self.free];
        for j in 0..self.rows() {
            let (y_at, y_scale) = self.y.as_ref().map_or((0.0, 0.0), |y| (y.at[j], y.scale[j]));
            for (i, (x_at, x_scale)) in self.x.at.iter().zip(&self.x.scale).enumerate() {
                let values = [c + cx * x_at + cy * y_at, cx * x_scale, cy * y_scale, 0.0];
                for (unknown, value) in values.iter().enumerate().take(self.per_node()) {
                    if let Some(number) = self.number(i, j, unknown) {
                        out[number] = *value;
                    }
                }
            }
        }
        out
    }
}

/// A point that needs a node, and how wide the cells around it may be.
struct Attachment {
    x_m: f64,
    y_m: f64,
    width: f64,
}

/// All attachments, with what the mesh around them must resolve.
fn attachments(scene: &Scene, cell_m: f64) -> Vec<Attachment> {
    let driven = DRIVEN * cell_m;
    let width = |is_driven: bool| if is_driven { driven } else { f64::INFINITY };
    let supports = scene.supports.iter().map(|s| (s.x_m, s.y_m, width(s.damping_n_s_per_m > 0.0)));
    let masses = scene.masses.iter().map(|m| (m.x_m, m.y_m, f64::INFINITY));
    let actuators = scene.actuators.iter().map(|a| (a.x_m, a.y_m, driven));
    let mut all: Vec<Attachment> =
        supports.chain(masses).chain(actuators).map(|(x_m, y_m, width)| Attachment { x_m, y_m, width }).collect();
    let merged = MERGE * scene.surface.length_m.max(scene.surface.width_m);
    for i in 0..all.len() {
        for j in 0..i {
            let apart = (all[i].x_m - all[j].x_m).hypot(all[i].y_m - all[j].y_m);
            if apart > merged && apart < cell_m {
                for k in [i, j] {
                    all[k].width = all[k].width.min(CLOSE * apart);
                }
            }
        }
    }
    all
}
