//! From a scene to sparse matrices.
//!
//! A plate's cell has the tensor products of the bar's functions; with cubics alone they are w, w_x, w_y and w_xy at its
//! corners (Bogner, Fox, Schmit 1965). With the one-dimensional matrices A (bend), B (mixed), G (slope), M (mass) of
//! [`super::shape`], the
//! thin plate's energy D/2 * integral of w_xx^2 + w_yy^2 + 2 nu w_xx w_yy + 2 (1 - nu) w_xy^2 is assembled from
//! D [A(x)M + M(x)A + nu (B(x)B' + B'(x)B) + 2 (1 - nu) G(x)G], and that of layers likewise ([`super::sections::RelativeBending`]). Across a line between two thicknesses the functions make
//! w, both slopes and, at the line's nodes, w_xy continuous, as they are in the plate (w_x is, and so is its derivative along
//! the line); w_xx across it is free to jump, as it must where the rigidity does.

use super::ModelError;
use super::attached::{PointAttachment, actuator_attachments, supports_and_masses};
use super::enriched::{
    EdgeSprings, add_singular_function_matrices, unknowns_and_area_integrals_of_singular_functions_per_cell,
};
use super::fineness::Fineness;
use super::grid::{DeflectionDerivative, Grid};
use super::mesh::GridLines;
use super::sections::{CellSection, RelativeBending};
use super::shape::{CellMatrices, gauss_legendre_rule_on_unit_interval};
use super::sparse::{MatrixEntries, SparseSymmetricMatrix, SparseVector};
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
pub struct PanelMatrices {
    /// The mesh.
    pub grid: Arc<Grid>,
    /// Everything's stiffness, but that of sealed air.
    pub stiffness: SparseSymmetricMatrix,
    /// Everything's mass.
    pub mass: SparseSymmetricMatrix,
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
    pub stiffness: SparseSymmetricMatrix,
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
    pub(super) fn assemble_supports_masses_and_actuators_of_scene(grid: &Grid, scene: &Scene) -> Self {
        let mut parts =
            AttachmentBuilder { grid, unknowns: grid.free, attachments: Vec::new(), moving_masses: Vec::new() };
        for attached in supports_and_masses(scene) {
            parts.add_point_attachment_returning_travel_row_against_mass_or_ground(&attached);
        }
        let without_actuators = parts.attachments.len();
        let actuators = actuator_attachments(scene)
            .enumerate()
            .map(|(i, attached)| parts.add_actuator_returning_force_and_travel(i, &attached))
            .collect();
        let AttachmentBuilder { unknowns, attachments, moving_masses, .. } = parts;
        Self { attachments, without_actuators, actuators, moving_masses, unknowns }
    }

    /// All vectors: those of the attachments, and loads and travels of the actuators.
    pub(super) fn all_vectors_mut(&mut self) -> impl Iterator<Item = &mut SparseVector> {
        let own = self.attachments.iter_mut().map(|attachment| &mut attachment.vector);
        own.chain(self.actuators.iter_mut().flat_map(|actuator| [&mut actuator.force, &mut actuator.travel]))
    }

    /// The attachments that are parts of ERAs.
    pub(super) fn actuator_attachments(&self) -> &[Attachment] {
        self.attachments.get(self.without_actuators..).unwrap_or(&[])
    }
}

impl PanelMatrices {
    /// Number of unknowns: those of the mesh and those of the moving masses.
    #[must_use]
    pub fn count_unknowns(&self) -> usize {
        self.stiffness.dimension()
    }
}

/// The panel on a mesh of the given fineness.
///
/// # Errors
/// As the matrices' assembly.
pub fn assemble_panel_matrices(scene: &Scene, fineness: Fineness) -> Result<PanelMatrices, ModelError> {
    let grid = Grid::new(scene, fineness);
    let (stiffness, mass) = assemble_surface_stiffness_and_mass(&grid);
    let (mut stiffness, mut mass) =
        (grid.transform_matrix_to_unknowns(stiffness), grid.transform_matrix_to_unknowns(mass));
    if grid.y.is_none() {
        let numbers = |cell| unknowns_of_bar_cell(&grid, cell);
        grid.thin.add_bending_stiffness_of_thin_cells(
            &mut stiffness,
            &compute_cell_matrices(&grid, &grid.x),
            |cell| grid.sections.section_of_cell_unless_cut_away(cell, 0),
            numbers,
        );
    }
    let edges = assemble_elastic_edges_by_loss_factor(scene, &grid);
    edges.iter().for_each(|(edges, _)| stiffness.add_scaled_entries(edges, 1.0));
    let attached = AttachedVectors::assemble_supports_masses_and_actuators_of_scene(&grid, scene);
    let n = attached.unknowns;
    for attachment in &attached.attachments {
        stiffness.add_outer_product(&attachment.vector, attachment.stiffness);
        mass.add_outer_product(&attachment.vector, attachment.mass);
    }
    let edges = edges
        .into_iter()
        .map(|(edges, loss_factor)| Ok(EdgeStiffness { stiffness: edges.build_matrix(n)?, loss_factor }))
        .collect::<Result<_, ModelError>>()?;
    let air = scene.sealed_air_stiffness_if_any_n_per_m().map(|stiffness| build_sealed_air_spring(&grid, stiffness));
    Ok(PanelMatrices {
        edges,
        air,
        stiffness: stiffness.build_matrix(n)?,
        mass: mass.build_matrix(n)?,
        attached,
        grid: Arc::new(grid),
    })
}

/// Air that resists the mean deflection with `stiffness_n_per_m` in N/m.
fn build_sealed_air_spring(grid: &Grid, stiffness_n_per_m: f64) -> Attachment {
    let in_x = cell_lengths_and_integrals_of_their_functions(grid, &grid.x);
    let in_y = grid
        .y
        .as_ref()
        .map_or_else(|| vec![(1.0, vec![1.0])], |y| cell_lengths_and_integrals_of_their_functions(grid, y));
    let (mut sums, mut size) = (vec![0.0; grid.free], 0.0);
    for (cell_y, (height, own_y)) in in_y.iter().enumerate() {
        for (cell_x, (length, own_x)) in in_x.iter().enumerate() {
            if grid.sections.section_of_cell_unless_cut_away(cell_x, cell_y).is_none() {
                continue;
            }
            size += length * height;
            for (a, along_x) in own_x.iter().enumerate() {
                for (b, along_y) in own_y.iter().enumerate() {
                    if let Some(number) = grid.unknown_of_function_product_unless_fixed(
                        grid.function_index_along_one_axis(cell_x, a),
                        grid.function_index_along_one_axis(cell_y, b),
                    ) {
                        sums[number] += along_x * along_y;
                    }
                }
            }
        }
    }
    if let Some(y) = &grid.y {
        // Exactly: with a mean that is off otherwise on every mesh, spaces that hold each other would not make levels that do.
        unknowns_and_area_integrals_of_singular_functions_per_cell(grid, y)
            .into_iter()
            .for_each(|(number, integral)| sums[number] += integral);
    }
    let mean = sums.into_iter().enumerate().filter(|(_, sum)| *sum != 0.0).map(|(i, sum)| (i, sum / size)).collect();
    Attachment { vector: grid.transform_row_to_unknowns(mean), stiffness: stiffness_n_per_m, ..Attachment::default() }
}

/// Each cell's length along lines, and the integrals of its functions over it: exactly, as they are polynomials.
fn cell_lengths_and_integrals_of_their_functions(grid: &Grid, lines: &GridLines) -> Vec<(f64, Vec<f64>)> {
    let (rule, element) = (
        gauss_legendre_rule_on_unit_interval(grid.element.element_order()),
        grid.choose_element_with_rigid_body_functions_for_strip_else_ordinary(lines),
    );
    let cells = lines.at.windows(2).zip(lines.scale.windows(2)).map(|(at, scale)| {
        let length = at[1] - at[0];
        let mut sums = vec![0.0; element.element_order() + 1];
        for (place, weight) in &rule {
            let [values, ..] = element.values_and_derivatives_at(*place, length, [scale[0], scale[1]]);
            sums.iter_mut().zip(values).for_each(|(sum, value)| *sum += weight * length * value);
        }
        (length, sums)
    });
    cells.collect()
}

/// Springs along edges by their loss factors, where there are any.
fn assemble_elastic_edges_by_loss_factor(scene: &Scene, grid: &Grid) -> Vec<(MatrixEntries, f64)> {
    let mut out: Vec<(MatrixEntries, f64)> = Vec::new();
    for edge in &scene.edges {
        let EdgeKind::Elastic { stiffness, rotational_stiffness, loss_factor } = edge.kind else { continue };
        let known = out.iter().position(|(_, known)| known.total_cmp(&loss_factor).is_eq());
        let at = known.unwrap_or_else(|| {
            out.push((MatrixEntries::default(), loss_factor));
            out.len() - 1
        });
        add_elastic_edge_stiffness(grid, edge.side, stiffness, rotational_stiffness, &mut out[at].0);
    }
    let over_unknowns =
        out.into_iter().map(|(entries, loss_factor)| (grid.transform_matrix_to_unknowns(entries), loss_factor));
    over_unknowns.filter(|(entries, _)| entries.iter().next().is_some()).collect()
}

/// The one-dimensional matrices of each cell between these lines.
fn compute_cell_matrices(grid: &Grid, lines: &GridLines) -> Vec<CellMatrices> {
    let pairs = lines.at.windows(2).zip(lines.scale.windows(2));
    pairs
        .map(|(at, scale)| {
            grid.choose_element_with_rigid_body_functions_for_strip_else_ordinary(lines)
                .cell_matrices(at[1] - at[0], [scale[0], scale[1]])
        })
        .collect()
}

/// Stiffness and mass of the surface over the functions of its mesh, without what is attached.
fn assemble_surface_stiffness_and_mass(grid: &Grid) -> (MatrixEntries, MatrixEntries) {
    let (mut stiffness, mut mass) = (MatrixEntries::default(), MatrixEntries::default());
    let in_x = compute_cell_matrices(grid, &grid.x);
    let n = grid.element.element_order() + 1;
    match &grid.y {
        None => {
            for (cell, matrices) in in_x.iter().enumerate() {
                let Some(CellSection { rigidity, per_area, .. }) =
                    grid.sections.section_of_cell_unless_cut_away(cell, 0)
                else {
                    continue;
                };
                let numbers = unknowns_of_bar_cell(grid, cell);
                // Thin cells' bending comes over other unknowns.
                if !grid.thin.is_thin_cell(cell) {
                    add_dense_block(&mut stiffness, &numbers, |a, b| rigidity * matrices.bend[(a, b)]);
                }
                add_dense_block(&mut mass, &numbers, |a, b| per_area * matrices.mass[(a, b)]);
            }
        }
        Some(y) => {
            let in_y = compute_cell_matrices(grid, y);
            for (cell_y, my) in in_y.iter().enumerate() {
                for (cell_x, mx) in in_x.iter().enumerate() {
                    let Some(section) = grid.sections.section_of_cell_unless_cut_away(cell_x, cell_y) else { continue };
                    let numbers: Vec<_> = (0..n * n)
                        .map(|k| {
                            grid.unknown_of_function_product_unless_fixed(
                                grid.function_index_along_one_axis(cell_x, k / n),
                                grid.function_index_along_one_axis(cell_y, k % n),
                            )
                        })
                        .collect();
                    add_plate_cell_stiffness_and_mass((mx, my), section, &numbers, &mut stiffness, &mut mass);
                }
            }
            add_singular_function_matrices(grid, y, &mut stiffness, &mut mass);
        }
    }
    (stiffness, mass)
}

/// The unknowns of the functions of a bar's cell.
fn unknowns_of_bar_cell(grid: &Grid, cell: usize) -> Vec<Option<usize>> {
    (0..=grid.element.element_order())
        .map(|a| grid.unknown_of_function_product_unless_fixed(grid.function_index_along_one_axis(cell, a), 0))
        .collect()
}

/// Adds a plate's cell: tensor products of matrices along x (functions a and c) and along y (b and d).
fn add_plate_cell_stiffness_and_mass(
    (x, y): (&CellMatrices, &CellMatrices),
    section: CellSection,
    unknown_indices: &[Option<usize>],
    stiffness: &mut MatrixEntries,
    mass: &mut MatrixEntries,
) {
    let n = x.mass.nrows();
    let CellSection { rigidity, per_area, bending: RelativeBending { x: along_x, y: along_y, poisson, twist } } =
        section;
    for (a, rows) in unknown_indices.chunks_exact(n).enumerate() {
        for (c, columns) in unknown_indices.chunks_exact(n).enumerate() {
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
                    stiffness.add_entry_without_its_transpose(*row, *column, rigidity * energy);
                    mass.add_entry_without_its_transpose(*row, *column, per_area * own * y.mass[(b, d)]);
                }
            }
        }
    }
}

/// Adds `entry_value(row, column)` for each pair of functions of a cell; fixed functions have no unknown.
fn add_dense_block(entries: &mut MatrixEntries, unknowns: &[Option<usize>], entry_value: impl Fn(usize, usize) -> f64) {
    for (a, row) in unknowns.iter().enumerate() {
        for (b, column) in unknowns.iter().enumerate() {
            if let (Some(row), Some(column)) = (row, column) {
                entries.add_entry_without_its_transpose(*row, *column, entry_value(a, b));
            }
        }
    }
}

/// Springs along an edge: the integral of k w^2 + k_r w_n^2, which has the mass matrix of the lines along it. At a bar's
/// end it is a single point.
fn add_elastic_edge_stiffness(grid: &Grid, side: Side, stiffness: f64, rotational: f64, entries: &mut MatrixEntries) {
    let ends_x = matches!(side, Side::Left | Side::Right);
    let (across, along) = if ends_x { (Some(&grid.x), grid.y.as_ref()) } else { (grid.y.as_ref(), Some(&grid.x)) };
    let here = grid.index_of_deflection_function_at_edge(side);
    let end = if matches!(side, Side::Left | Side::Top) { 0 } else { across.map_or(0, GridLines::count_cells) };
    let scale = across.map_or(1.0, |lines| lines.scale[end]);
    let number = |across: usize, along: usize| {
        if ends_x {
            grid.unknown_of_function_product_unless_fixed(across, along)
        } else {
            grid.unknown_of_function_product_unless_fixed(along, across)
        }
    };
    for (function, value) in [(here, stiffness), (here + 1, rotational / (scale * scale))] {
        let Some(along) = along else {
            if let Some(number) = number(function, 0) {
                entries.add_entry_without_its_transpose(number, number, value);
            }
            continue;
        };
        for (cell, matrices) in compute_cell_matrices(grid, along)
            .iter()
            .enumerate()
            .filter(|(cell, _)| grid.is_edge_cell_present(side, *cell))
        {
            let numbers: Vec<_> = (0..=grid.element.element_order())
                .map(|a| number(function, grid.function_index_along_one_axis(cell, a)))
                .collect();
            add_dense_block(entries, &numbers, |a, b| value * matrices.mass[(a, b)]);
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
        springs.add_stiffness_of_singular_functions_along_edge(
            |k, along| number(here + k, along),
            |cell| grid.is_edge_cell_present(side, cell),
            entries,
        );
    }
}

/// What is attached, under construction.
struct AttachmentBuilder<'a> {
    grid: &'a Grid,
    unknowns: usize,
    attachments: Vec<Attachment>,
    moving_masses: Vec<(usize, usize)>,
}

impl AttachmentBuilder<'_> {
    /// Adds an attachment unless it has no effect: on a clamped point nothing moves.
    fn add_attachment_unless_without_effect(&mut self, attachment: Attachment) {
        let Attachment { vector, stiffness, damping, mass, .. } = &attachment;
        if !vector.is_empty() && (*stiffness > 0.0 || *damping > 0.0 || *mass > 0.0) {
            self.attachments.push(attachment);
        }
    }

    /// Adds something at a point; what a force between it and its other side acts on, and what the travel between them is.
    fn add_point_attachment_returning_travel_row_against_mass_or_ground(
        &mut self,
        attached: &PointAttachment,
    ) -> Vec<(usize, f64)> {
        let (x_m, y_m) = attached.at;
        let surface = self.grid.deflection_row_of_attachment(x_m, y_m);
        self.add_attachment_unless_without_effect(Attachment {
            vector: surface.clone(),
            stiffness: attached.stiffness_n_per_m,
            loss_factor: attached.loss_factor,
            damping: attached.damping_n_s_per_m,
            mass: attached.mass_kg,
            is_slope: false,
        });
        let (stiffness, loss_factor) = (attached.turning_n_m_per_rad, attached.loss_factor);
        if stiffness > 0.0 {
            let (x_m, y_m) = self.grid.merged_attachment_position_m(x_m, y_m);
            for slope in [DeflectionDerivative::SlopeX, DeflectionDerivative::SlopeY] {
                let vector = self.grid.deflection_or_slope_row_at(x_m, y_m, slope);
                self.add_attachment_unless_without_effect(Attachment {
                    vector,
                    stiffness,
                    loss_factor,
                    is_slope: true,
                    ..Attachment::default()
                });
            }
        }
        let Some(carried) = attached.carried else { return surface };
        let own = self.unknowns;
        self.unknowns += 1;
        self.add_attachment_unless_without_effect(Attachment {
            vector: vec![(own, 1.0)],
            mass: carried.mass_kg,
            ..Attachment::default()
        });
        let mut between = surface;
        between.push((own, -1.0));
        self.add_attachment_unless_without_effect(Attachment {
            vector: between.clone(),
            stiffness: carried.stiffness_n_per_m,
            damping: carried.damping_n_s_per_m,
            ..Attachment::default()
        });
        between
    }

    /// Adds the parts of an ERA; returns its load per newton and the row of its travel.
    fn add_actuator_returning_force_and_travel(&mut self, index: usize, attached: &PointAttachment) -> ActuatorVectors {
        if attached.carried.is_some() {
            self.moving_masses.push((self.unknowns, index));
        }
        let between = self.add_point_attachment_returning_travel_row_against_mass_or_ground(attached);
        ActuatorVectors { force: between.clone(), travel: between }
    }
}
