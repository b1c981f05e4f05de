//! From a scene to sparse matrices.
//!
//! A plate's cell has 16 unknowns (Bogner, Fox, Schmit 1965): w, w_x, w_y and w_xy at its corners, the tensor products of
//! the bar's cubic functions. With the one-dimensional matrices A (bend), B (mixed), G (slope), M (mass) of `hermite`, the
//! thin plate's energy D/2 * integral of w_xx^2 + w_yy^2 + 2 nu w_xx w_yy + 2 (1 - nu) w_xy^2 is assembled from
//! D [A(x)M + M(x)A + nu (B(x)B' + B'(x)B) + 2 (1 - nu) G(x)G].

use super::ModelError;
use super::hermite::{CellMatrices, Matrix4, cell_matrices, values};
use super::mesh::{Forced, Lines};
use super::sparse::{Entries, Symmetric};
use crate::scene::{Actuator, EdgeKind, Mount, Scene, Side, SurfaceKind};

/// Non-zero entries of a vector over the free unknowns.
pub type SparseVector = Vec<(usize, f64)>;

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

/// A viscous dashpot: force = coefficient times the velocity of vector . u, along the vector.
#[derive(Clone, Debug)]
pub struct Dashpot {
    /// What its velocity is.
    pub vector: SparseVector,
    /// In N s/m.
    pub coefficient: f64,
}

/// What an ERA does to the unknowns.
#[derive(Clone, Debug)]
pub struct ActuatorVectors {
    /// Load of 1 N.
    pub force: SparseVector,
    /// Travel of the mass relative to its electrodes is the product of this with the unknowns.
    pub travel: SparseVector,
}

/// The panel's matrices.
#[derive(Clone, Debug)]
pub struct Assembled {
    /// The mesh.
    pub grid: Grid,
    /// Everything's stiffness.
    pub stiffness: Symmetric,
    /// Everything's mass.
    pub mass: Symmetric,
    /// The surface's own stiffness.
    pub surface_stiffness: Symmetric,
    /// The surface's own mass.
    pub surface_mass: Symmetric,
    /// All dashpots.
    pub dashpots: Vec<Dashpot>,
    /// All actuators, in the scene's order.
    pub actuators: Vec<ActuatorVectors>,
    /// Unknowns of inertial ERAs' moving masses: (unknown, index of the actuator).
    pub moving_masses: Vec<(usize, usize)>,
}

impl Assembled {
    /// All unknowns.
    #[must_use]
    pub fn unknowns(&self) -> usize {
        self.stiffness.order()
    }
}

/// Cells as wide as `cell_m` or smaller.
///
/// # Errors
/// As the matrices' assembly.
pub fn assemble(scene: &Scene, cell_m: f64) -> Result<Assembled, ModelError> {
    let grid = Grid::new(scene, cell_m);
    let (surface_stiffness, surface_mass) = surface_matrices(scene, &grid);
    let mut parts = Parts {
        grid: &grid,
        unknowns: grid.free,
        stiffness: surface_stiffness.clone(),
        mass: surface_mass.clone(),
        dashpots: Vec::new(),
        moving_masses: Vec::new(),
    };
    for edge in &scene.edges {
        if let EdgeKind::Elastic { stiffness, rotational_stiffness } = edge.kind {
            parts.elastic_edge(edge.side, stiffness, rotational_stiffness);
        }
    }
    for support in &scene.supports {
        parts.support(support);
    }
    for mass in &scene.masses {
        parts.mass.add_outer(&grid.at_node(mass.x_m, mass.y_m), mass.mass_kg);
    }
    let actuators = scene.actuators.iter().enumerate().map(|(i, actuator)| parts.actuator(i, actuator)).collect();
    let n = parts.unknowns;
    Ok(Assembled {
        stiffness: parts.stiffness.build(n)?,
        mass: parts.mass.build(n)?,
        surface_stiffness: surface_stiffness.build(n)?,
        surface_mass: surface_mass.build(n)?,
        dashpots: parts.dashpots,
        moving_masses: parts.moving_masses,
        actuators,
        grid,
    })
}

/// Flexural rigidity of a plate in N m: E h^3 / (12 (1 - nu^2)).
#[must_use]
pub fn plate_rigidity(scene: &Scene) -> f64 {
    let (surface, material) = (&scene.surface, &scene.surface.material);
    let nu = material.poisson_ratio;
    material.youngs_modulus_pa * surface.thickness_m.powi(3) / (12.0 * (1.0 - nu * nu))
}

/// Bending stiffness of a bar in N m^2: E b h^3 / 12.
#[must_use]
pub fn bar_rigidity(scene: &Scene) -> f64 {
    scene.surface.material.youngs_modulus_pa * scene.surface.width_m * scene.surface.thickness_m.powi(3) / 12.0
}

impl Grid {
    fn new(scene: &Scene, cell_m: f64) -> Self {
        let surface = &scene.surface;
        let supports = scene.supports.iter().map(|s| (s.x_m, s.y_m, s.damping_n_s_per_m > 0.0));
        let masses = scene.masses.iter().map(|m| (m.x_m, m.y_m, false));
        let actuators = scene.actuators.iter().map(|a| (a.x_m, a.y_m, true));
        let points: Vec<(f64, f64, bool)> = supports.chain(masses).chain(actuators).collect();
        let forced = |at: fn(&(f64, f64, bool)) -> f64, side: f64| -> Vec<Forced> {
            // At an edge or corner the deflection under a point force is smooth enough for regular cells.
            let inside = |at: f64| at > 1e-6 * side && at < (1.0 - 1e-6) * side;
            points.iter().map(|p| Forced { at: at(p), graded: p.2 && inside(at(p)) }).collect()
        };
        // Four cells across the narrow side of a strip still carry its lowest waves in that direction.
        let cell = |side: f64| cell_m.min(side / 4.0);
        let x = Lines::new(surface.length_m, cell(surface.length_m), &forced(|p| p.0, surface.length_m));
        let y = match surface.kind {
            SurfaceKind::Bar => None,
            SurfaceKind::Plate => {
                Some(Lines::new(surface.width_m, cell(surface.width_m), &forced(|p| p.1, surface.width_m)))
            }
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

    fn edge_nodes(&self, side: Side) -> Vec<(usize, usize)> {
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

    fn node(&self, x_m: f64, y_m: f64) -> (usize, usize) {
        (self.x.nearest(x_m), self.y.as_ref().map_or(0, |y| y.nearest(y_m)))
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

fn cells(lines: &Lines) -> Vec<CellMatrices> {
    lines
        .at
        .windows(2)
        .zip(lines.scale.windows(2))
        .map(|(at, scale)| cell_matrices(at[1] - at[0], [scale[0], scale[1]]))
        .collect()
}

fn surface_matrices(scene: &Scene, grid: &Grid) -> (Entries, Entries) {
    let (surface, material) = (&scene.surface, &scene.surface.material);
    let (mut stiffness, mut mass) = (Entries::default(), Entries::default());
    let in_x = cells(&grid.x);
    match &grid.y {
        None => {
            let rigidity = bar_rigidity(scene);
            let per_length = material.density_kg_m3 * surface.width_m * surface.thickness_m;
            for (cell, matrices) in in_x.iter().enumerate() {
                let numbers: Vec<_> = (0..4).map(|a| grid.number(cell + a / 2, 0, a % 2)).collect();
                add_block(&mut stiffness, &numbers, |a, b| rigidity * matrices.bend[a][b]);
                add_block(&mut mass, &numbers, |a, b| per_length * matrices.mass[a][b]);
            }
        }
        Some(y) => {
            let rigidity = plate_rigidity(scene);
            let per_area = material.density_kg_m3 * surface.thickness_m;
            let nu = material.poisson_ratio;
            for (cell_y, my) in cells(y).iter().enumerate() {
                for (cell_x, mx) in in_x.iter().enumerate() {
                    let numbers: Vec<_> = (0..16)
                        .map(|k| {
                            let (a, b) = (k / 4, k % 4);
                            grid.number(cell_x + a / 2, cell_y + b / 2, a % 2 + 2 * (b % 2))
                        })
                        .collect();
                    add_block(&mut stiffness, &numbers, |k, l| rigidity * plate_energy(mx, my, nu, k, l));
                    add_block(&mut mass, &numbers, |k, l| per_area * product(&mx.mass, &my.mass, k, l));
                }
            }
        }
    }
    (stiffness, mass)
}

fn product(x: &Matrix4, y: &Matrix4, k: usize, l: usize) -> f64 {
    x[k / 4][l / 4] * y[k % 4][l % 4]
}

fn plate_energy(x: &CellMatrices, y: &CellMatrices, nu: f64, k: usize, l: usize) -> f64 {
    let (a, b, c, d) = (k / 4, k % 4, l / 4, l % 4);
    product(&x.bend, &y.mass, k, l)
        + product(&x.mass, &y.bend, k, l)
        + nu * (x.mixed[a][c] * y.mixed[d][b] + x.mixed[c][a] * y.mixed[b][d])
        + 2.0 * (1.0 - nu) * product(&x.slope, &y.slope, k, l)
}

fn add_block(entries: &mut Entries, numbers: &[Option<usize>], value: impl Fn(usize, usize) -> f64) {
    for (a, row) in numbers.iter().enumerate() {
        for (b, column) in numbers.iter().enumerate() {
            if let (Some(row), Some(column)) = (row, column) {
                entries.add(*row, *column, value(a, b));
            }
        }
    }
}

/// Matrices under construction: the surface and what is attached to it.
struct Parts<'a> {
    grid: &'a Grid,
    unknowns: usize,
    stiffness: Entries,
    mass: Entries,
    dashpots: Vec<Dashpot>,
    moving_masses: Vec<(usize, usize)>,
}

impl Parts<'_> {
    fn support(&mut self, support: &crate::scene::Support) {
        let here = self.grid.at_node(support.x_m, support.y_m);
        self.stiffness.add_outer(&here, support.stiffness_n_per_m);
        let (i, j) = self.grid.node(support.x_m, support.y_m);
        let slopes = [(1, Some(self.grid.x.scale[i])), (2, self.grid.y.as_ref().map(|y| y.scale[j]))];
        for (unknown, scale) in slopes {
            if let (Some(scale), Some(number)) = (scale, scale.and_then(|_| self.grid.number(i, j, unknown))) {
                // The unknown is the slope times its scale.
                self.stiffness.add(number, number, support.rotational_stiffness_n_m_per_rad / (scale * scale));
            }
        }
        if support.damping_n_s_per_m > 0.0 && !here.is_empty() {
            self.dashpots.push(Dashpot { vector: here, coefficient: support.damping_n_s_per_m });
        }
    }

    /// Springs along an edge: the integral of k w^2 + k_r w_n^2, which has the mass matrix of the lines along it. At a bar's
    /// end it is a single point.
    fn elastic_edge(&mut self, side: Side, stiffness: f64, rotational: f64) {
        let ends_x = matches!(side, Side::Left | Side::Right);
        let across = if ends_x { 1 } else { 2 };
        let nodes = self.grid.edge_nodes(side);
        let Some((&(first_i, first_j), last)) = nodes.first().zip(nodes.len().checked_sub(1)) else { return };
        let scale_across =
            if ends_x { self.grid.x.scale[first_i] } else { self.grid.y.as_ref().map_or(1.0, |y| y.scale[first_j]) };
        let per_slope = rotational / (scale_across * scale_across);
        let along = if ends_x { self.grid.y.as_ref() } else { Some(&self.grid.x) };
        let Some(along) = along else {
            for (unknown, value) in [(0, stiffness), (across, per_slope)] {
                if let Some(number) = self.grid.number(first_i, first_j, unknown) {
                    self.stiffness.add(number, number, value);
                }
            }
            return;
        };
        for (cell, matrices) in cells(along).iter().enumerate().take(last) {
            for (offset, value) in [(0, stiffness), (across, per_slope)] {
                let numbers: Vec<_> = (0..4)
                    .map(|a| {
                        let (i, j) = nodes[cell + a / 2];
                        self.grid.number(i, j, offset + (a % 2) * (3 - across))
                    })
                    .collect();
                add_block(&mut self.stiffness, &numbers, |a, b| value * matrices.mass[a][b]);
            }
        }
    }

    fn actuator(&mut self, index: usize, actuator: &Actuator) -> ActuatorVectors {
        let surface = self.grid.at_node(actuator.x_m, actuator.y_m);
        let (between, force) = match actuator.mount {
            Mount::Inertial => {
                let own = self.unknowns;
                self.unknowns += 1;
                self.moving_masses.push((own, index));
                self.mass.add_outer(&surface, actuator.housing_mass_kg);
                self.mass.add(own, own, actuator.moving_mass_kg);
                let mut between = surface;
                between.push((own, -1.0));
                (between.clone(), between)
            }
            Mount::Grounded => {
                self.mass.add_outer(&surface, actuator.housing_mass_kg + actuator.moving_mass_kg);
                (surface.clone(), surface)
            }
        };
        self.stiffness.add_outer(&between, actuator.stiffness_n_per_m);
        if actuator.damping_n_s_per_m > 0.0 && !between.is_empty() {
            self.dashpots.push(Dashpot { vector: between.clone(), coefficient: actuator.damping_n_s_per_m });
        }
        ActuatorVectors { force, travel: between }
    }
}
