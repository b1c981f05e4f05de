//! From a scene to sparse matrices.
//!
//! A plate's cell has the tensor products of the bar's functions; with cubics alone they are w, w_x, w_y and w_xy at its
//! corners (Bogner, Fox, Schmit 1965). With the one-dimensional matrices A (bend), B (mixed), G (slope), M (mass) of
//! [`super::shape`], the
//! thin plate's energy D/2 * integral of w_xx^2 + w_yy^2 + 2 nu w_xx w_yy + 2 (1 - nu) w_xy^2 is assembled from
//! D [A(x)M + M(x)A + nu (B(x)B' + B'(x)B) + 2 (1 - nu) G(x)G], and that of layers likewise ([`super::sections::Bending`]). Across a line between two thicknesses the functions make
//! w, both slopes and, at the line's nodes, w_xy continuous, as they are in the plate (w_x is, and so is its derivative along
//! the line); w_xx across it is free to jump, as it must where the rigidity does.

use super::ModelError;
use super::attached::{Attached, actuators, passive};
use super::enriched::{EdgeSprings, add_singular, integrate_singular};
use super::fineness::Fineness;
use super::grid::{Derivative, Grid};
use super::mesh::Lines;
use super::sections::{Bending, Section};
use super::shape::{CellMatrices, gauss};
use super::sparse::{Entries, SparseVector, Symmetric};
use crate::scene::{EdgeKind, Scene, Side};
use std::sync::Arc;

/// A spring, dashpot and mass on one motion d = vector . u: forces stiffness d, damping d' and mass d'' along the vector.
#[derive(Clone, Debug, Default)]
pub struct Attachment {
    /// What moves it.
    pub vector: SparseVector,
    /// In N/m; N m/rad if the motion is a slope.
    pub stiffness: f64,
    /// Of the stiffness: that times 1 + j eta.
    pub loss_factor: f64,
    /// In N s/m.
    pub damping: f64,
    /// In kg.
    pub mass: f64,
    /// Whether the motion is a slope.
    pub is_slope: bool,
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
    pub grid: Arc<Grid>,
    /// Everything's stiffness, but that of sealed air.
    pub stiffness: Symmetric,
    /// Everything's mass.
    pub mass: Symmetric,
    /// The stiffness of springs along edges, those of one loss factor in one matrix.
    pub edges: Vec<EdgeStiffness>,
    /// Sealed air: a spring on the mean deflection of the surface, which is a matter of every unknown and would leave no entry of a
    /// stiffness matrix empty.
    pub air: Option<Attachment>,
    /// What is attached at points.
    pub attached: AttachedVectors,
}

/// Springs along edges, all of one loss factor.
#[derive(Clone, Debug)]
pub struct EdgeStiffness {
    /// Over all unknowns.
    pub stiffness: Symmetric,
    /// What it is times 1 + j eta with.
    pub loss_factor: f64,
}

/// What is attached at points, over a mesh's unknowns.
#[derive(Clone, Debug)]
pub struct AttachedVectors {
    /// All of it.
    pub attachments: Vec<Attachment>,
    /// How many of them, the first ones, are supports and masses; the others are of ERAs.
    pub without_actuators: usize,
    /// All actuators, in the scene's order.
    pub actuators: Vec<ActuatorVectors>,
    /// Unknowns of inertial ERAs' moving masses: (unknown, index of the actuator).
    pub moving_masses: Vec<(usize, usize)>,
    /// All unknowns: the mesh's, and those of the moving masses after them.
    pub unknowns: usize,
}

impl AttachedVectors {
    /// What `scene` attaches to the surface of a mesh, which need not have been made for it.
    pub(super) fn of(grid: &Grid, scene: &Scene) -> Self {
        let mut parts = Parts { grid, unknowns: grid.free, attachments: Vec::new(), moving_masses: Vec::new() };
        for attached in passive(scene) {
            parts.add(&attached);
        }
        let without_actuators = parts.attachments.len();
        let actuators = actuators(scene).enumerate().map(|(i, attached)| parts.actuator(i, &attached)).collect();
        let Parts { unknowns, attachments, moving_masses, .. } = parts;
        Self { attachments, without_actuators, actuators, moving_masses, unknowns }
    }

    /// All vectors, of attachments and of actuators.
    pub(super) fn vectors_mut(&mut self) -> impl Iterator<Item = &mut SparseVector> {
        let own = self.attachments.iter_mut().map(|attachment| &mut attachment.vector);
        own.chain(self.actuators.iter_mut().flat_map(|actuator| [&mut actuator.force, &mut actuator.travel]))
    }

    /// Those of them that are of ERAs.
    pub(super) fn of_actuators(&self) -> &[Attachment] {
        self.attachments.get(self.without_actuators..).unwrap_or(&[])
    }
}

impl Assembled {
    /// All unknowns.
    #[must_use]
    pub fn unknowns(&self) -> usize {
        self.stiffness.order()
    }
}

/// The panel on a mesh of the given fineness.
///
/// # Errors
/// As the matrices' assembly.
pub fn assemble(scene: &Scene, fineness: Fineness) -> Result<Assembled, ModelError> {
    let grid = Grid::new(scene, fineness);
    let (stiffness, mass) = surface_matrices(&grid);
    let (mut stiffness, mut mass) = (grid.over_unknowns(stiffness), grid.over_unknowns(mass));
    if grid.y.is_none() {
        let numbers = |cell| bar_numbers(&grid, cell);
        grid.thin.add_bending(&mut stiffness, &cells(&grid, &grid.x), |cell| grid.sections.at(cell, 0), numbers);
    }
    let edges = elastic_edges(scene, &grid);
    edges.iter().for_each(|(edges, _)| stiffness.add_all(edges, 1.0));
    let attached = AttachedVectors::of(&grid, scene);
    let n = attached.unknowns;
    for attachment in &attached.attachments {
        stiffness.add_outer(&attachment.vector, attachment.stiffness);
        mass.add_outer(&attachment.vector, attachment.mass);
    }
    let edges = edges
        .into_iter()
        .map(|(edges, loss_factor)| Ok(EdgeStiffness { stiffness: edges.build(n)?, loss_factor }))
        .collect::<Result<_, ModelError>>()?;
    let air = scene.air_stiffness_n_per_m().map(|stiffness| sealed_air(&grid, stiffness));
    Ok(Assembled { edges, air, stiffness: stiffness.build(n)?, mass: mass.build(n)?, attached, grid: Arc::new(grid) })
}

/// Air that resists the mean deflection with `stiffness` in N/m.
fn sealed_air(grid: &Grid, stiffness: f64) -> Attachment {
    let in_x = integrals_along(grid, &grid.x);
    let in_y = grid.y.as_ref().map_or_else(|| vec![(1.0, vec![1.0])], |y| integrals_along(grid, y));
    let (mut sums, mut size) = (vec![0.0; grid.free], 0.0);
    for (cell_y, (height, own_y)) in in_y.iter().enumerate() {
        for (cell_x, (length, own_x)) in in_x.iter().enumerate() {
            if grid.sections.at(cell_x, cell_y).is_none() {
                continue;
            }
            size += length * height;
            for (a, along_x) in own_x.iter().enumerate() {
                for (b, along_y) in own_y.iter().enumerate() {
                    if let Some(number) = grid.number(grid.function(cell_x, a), grid.function(cell_y, b)) {
                        sums[number] += along_x * along_y;
                    }
                }
            }
        }
    }
    if let Some(y) = &grid.y {
        // Exactly: with a mean that is off otherwise on every mesh, spaces that hold each other would not make levels that do.
        integrate_singular(grid, y).into_iter().for_each(|(number, integral)| sums[number] += integral);
    }
    let mean = sums.into_iter().enumerate().filter(|(_, sum)| *sum != 0.0).map(|(i, sum)| (i, sum / size)).collect();
    Attachment { vector: grid.row_over_unknowns(mean), stiffness, ..Attachment::default() }
}

/// Each cell's length along lines, and the integrals of its functions over it: exactly, as they are polynomials.
fn integrals_along(grid: &Grid, lines: &Lines) -> Vec<(f64, Vec<f64>)> {
    let (rule, element) = (gauss(grid.element.order()), grid.element_along(lines));
    let cells = lines.at.windows(2).zip(lines.scale.windows(2)).map(|(at, scale)| {
        let length = at[1] - at[0];
        let mut sums = vec![0.0; element.order() + 1];
        for (place, weight) in &rule {
            let [values, ..] = element.derivatives(*place, length, [scale[0], scale[1]]);
            sums.iter_mut().zip(values).for_each(|(sum, value)| *sum += weight * length * value);
        }
        (length, sums)
    });
    cells.collect()
}

/// Springs along edges by their loss factors, where there are any.
fn elastic_edges(scene: &Scene, grid: &Grid) -> Vec<(Entries, f64)> {
    let mut out: Vec<(Entries, f64)> = Vec::new();
    for edge in &scene.edges {
        let EdgeKind::Elastic { stiffness, rotational_stiffness, loss_factor } = edge.kind else { continue };
        let known = out.iter().position(|(_, known)| known.total_cmp(&loss_factor).is_eq());
        let at = known.unwrap_or_else(|| {
            out.push((Entries::default(), loss_factor));
            out.len() - 1
        });
        elastic_edge(grid, edge.side, stiffness, rotational_stiffness, &mut out[at].0);
    }
    let over_unknowns = out.into_iter().map(|(entries, loss_factor)| (grid.over_unknowns(entries), loss_factor));
    over_unknowns.filter(|(entries, _)| entries.iter().next().is_some()).collect()
}

fn cells(grid: &Grid, lines: &Lines) -> Vec<CellMatrices> {
    let pairs = lines.at.windows(2).zip(lines.scale.windows(2));
    pairs.map(|(at, scale)| grid.element_along(lines).matrices(at[1] - at[0], [scale[0], scale[1]])).collect()
}

fn surface_matrices(grid: &Grid) -> (Entries, Entries) {
    let (mut stiffness, mut mass) = (Entries::default(), Entries::default());
    let in_x = cells(grid, &grid.x);
    let n = grid.element.order() + 1;
    match &grid.y {
        None => {
            for (cell, matrices) in in_x.iter().enumerate() {
                let Some(Section { rigidity, per_area, .. }) = grid.sections.at(cell, 0) else { continue };
                let numbers = bar_numbers(grid, cell);
                // Thin cells' bending comes over other unknowns.
                if !grid.thin.contains(cell) {
                    add_block(&mut stiffness, &numbers, |a, b| rigidity * matrices.bend[(a, b)]);
                }
                add_block(&mut mass, &numbers, |a, b| per_area * matrices.mass[(a, b)]);
            }
        }
        Some(y) => {
            let in_y = cells(grid, y);
            for (cell_y, my) in in_y.iter().enumerate() {
                for (cell_x, mx) in in_x.iter().enumerate() {
                    let Some(section) = grid.sections.at(cell_x, cell_y) else { continue };
                    let numbers: Vec<_> = (0..n * n)
                        .map(|k| grid.number(grid.function(cell_x, k / n), grid.function(cell_y, k % n)))
                        .collect();
                    add_plate_cell((mx, my), section, &numbers, &mut stiffness, &mut mass);
                }
            }
            add_singular(grid, y, &mut stiffness, &mut mass);
        }
    }
    (stiffness, mass)
}

/// The unknowns of the functions of a bar's cell.
fn bar_numbers(grid: &Grid, cell: usize) -> Vec<Option<usize>> {
    (0..=grid.element.order()).map(|a| grid.number(grid.function(cell, a), 0)).collect()
}

/// Adds a plate's cell: tensor products of matrices along x (functions a and c) and along y (b and d).
fn add_plate_cell(
    (x, y): (&CellMatrices, &CellMatrices),
    section: Section,
    numbers: &[Option<usize>],
    stiffness: &mut Entries,
    mass: &mut Entries,
) {
    let n = x.mass.nrows();
    let Section { rigidity, per_area, bending: Bending { x: along_x, y: along_y, poisson, twist } } = section;
    for (a, rows) in numbers.chunks_exact(n).enumerate() {
        for (c, columns) in numbers.chunks_exact(n).enumerate() {
            let (bend, slope, own) = (along_x * x.bend[(a, c)], twist * x.slope[(a, c)], x.mass[(a, c)]);
            let across = along_y * own;
            let mixed = [poisson * x.mixed[(a, c)], poisson * x.mixed[(c, a)]];
            for (b, row) in rows.iter().enumerate() {
                for (d, column) in columns.iter().enumerate() {
                    let (Some(row), Some(column)) = (row, column) else { continue };
                    let energy = bend * y.mass[(b, d)]
                        + across * y.bend[(b, d)]
                        + mixed[0] * y.mixed[(d, b)]
                        + mixed[1] * y.mixed[(b, d)]
                        + slope * y.slope[(b, d)];
                    stiffness.add(*row, *column, rigidity * energy);
                    mass.add(*row, *column, per_area * own * y.mass[(b, d)]);
                }
            }
        }
    }
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

/// Springs along an edge: the integral of k w^2 + k_r w_n^2, which has the mass matrix of the lines along it. At a bar's
/// end it is a single point.
fn elastic_edge(grid: &Grid, side: Side, stiffness: f64, rotational: f64, entries: &mut Entries) {
    let ends_x = matches!(side, Side::Left | Side::Right);
    let (across, along) = if ends_x { (Some(&grid.x), grid.y.as_ref()) } else { (grid.y.as_ref(), Some(&grid.x)) };
    let here = grid.edge_function(side);
    let end = if matches!(side, Side::Left | Side::Top) { 0 } else { across.map_or(0, Lines::cells) };
    let scale = across.map_or(1.0, |lines| lines.scale[end]);
    let number = |across: usize, along: usize| {
        if ends_x { grid.number(across, along) } else { grid.number(along, across) }
    };
    for (function, value) in [(here, stiffness), (here + 1, rotational / (scale * scale))] {
        let Some(along) = along else {
            if let Some(number) = number(function, 0) {
                entries.add(number, number, value);
            }
            continue;
        };
        for (cell, matrices) in cells(grid, along).iter().enumerate().filter(|(cell, _)| grid.has_edge(side, *cell)) {
            let numbers: Vec<_> =
                (0..=grid.element.order()).map(|a| number(function, grid.function(cell, a))).collect();
            add_block(entries, &numbers, |a, b| value * matrices.mass[(a, b)]);
        }
    }
    if let (Some(lines), Some(across)) = (along, across) {
        let springs = EdgeSprings {
            grid,
            lines,
            along_y: ends_x,
            position: across.at[end],
            stiffness,
            rotational,
            slope_unit: 1.0 / scale,
        };
        springs.add(|k, along| number(here + k, along), |cell| grid.has_edge(side, cell), entries);
    }
}

/// What is attached, under construction.
struct Parts<'a> {
    grid: &'a Grid,
    unknowns: usize,
    attachments: Vec<Attachment>,
    moving_masses: Vec<(usize, usize)>,
}

impl Parts<'_> {
    /// Keeps what does anything: on a clamped point nothing moves.
    fn attach(&mut self, attachment: Attachment) {
        let Attachment { vector, stiffness, damping, mass, .. } = &attachment;
        if !vector.is_empty() && (*stiffness > 0.0 || *damping > 0.0 || *mass > 0.0) {
            self.attachments.push(attachment);
        }
    }

    /// Adds something at a point; what a force between it and its other side acts on, and what the travel between them is.
    fn add(&mut self, attached: &Attached) -> Vec<(usize, f64)> {
        let (x_m, y_m) = attached.at;
        let surface = self.grid.attachment(x_m, y_m);
        self.attach(Attachment {
            vector: surface.clone(),
            stiffness: attached.stiffness_n_per_m,
            loss_factor: attached.loss_factor,
            damping: attached.damping_n_s_per_m,
            mass: attached.mass_kg,
            is_slope: false,
        });
        let (stiffness, loss_factor) = (attached.turning_n_m_per_rad, attached.loss_factor);
        if stiffness > 0.0 {
            let (x_m, y_m) = self.grid.attached_at(x_m, y_m);
            for slope in [Derivative::SlopeX, Derivative::SlopeY] {
                let vector = self.grid.row_at(x_m, y_m, slope);
                self.attach(Attachment { vector, stiffness, loss_factor, is_slope: true, ..Attachment::default() });
            }
        }
        let Some(carried) = attached.carried else { return surface };
        let own = self.unknowns;
        self.unknowns += 1;
        self.attach(Attachment { vector: vec![(own, 1.0)], mass: carried.mass_kg, ..Attachment::default() });
        let mut between = surface;
        between.push((own, -1.0));
        self.attach(Attachment {
            vector: between.clone(),
            stiffness: carried.stiffness_n_per_m,
            damping: carried.damping_n_s_per_m,
            ..Attachment::default()
        });
        between
    }

    fn actuator(&mut self, index: usize, attached: &Attached) -> ActuatorVectors {
        if attached.carried.is_some() {
            self.moving_masses.push((self.unknowns, index));
        }
        let between = self.add(attached);
        ActuatorVectors { force: between.clone(), travel: between }
    }
}
