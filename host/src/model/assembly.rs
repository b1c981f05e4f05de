//! From a scene to sparse matrices.
//!
//! A plate's cell has 16 unknowns (Bogner, Fox, Schmit 1965): w, w_x, w_y and w_xy at its corners, the tensor products of
//! the bar's cubic functions. With the one-dimensional matrices A (bend), B (mixed), G (slope), M (mass) of `hermite`, the
//! thin plate's energy D/2 * integral of w_xx^2 + w_yy^2 + 2 nu w_xx w_yy + 2 (1 - nu) w_xy^2 is assembled from
//! D [A(x)M + M(x)A + nu (B(x)B' + B'(x)B) + 2 (1 - nu) G(x)G].

use super::ModelError;
use super::grid::{Grid, SparseVector};
use super::hermite::{CellMatrices, Matrix4, cell_matrices};
use super::mesh::Lines;
use super::sparse::{Entries, Symmetric};
use crate::scene::{Actuator, EdgeKind, Mount, Scene, Side};

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
