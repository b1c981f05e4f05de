//! A panel whose attachments change from design to design: solved once without any, then coupled to each design's.
//!
//! Modes phi of the bare panel and, for a point x with the load b, the residual shapes z1 = (K + s M)^-1 b without the modes and
//! z2 = (K + s M)^-1 M z1 span the motions of every design: what a spring, a dashpot, a mass or an ERA does is a force at its
//! point. Over this basis a design is the bare panel's matrices plus one outer product for each attachment (Craig and
//! Chang 1977; "residual flexibility" in de Klerk, Rixen and Voormeeren 2008): a small dense eigenproblem gives the same kind of
//! [`ReducedModel`] as the scene's own finite elements do.
//!
//! A point's shapes depend on nothing but the point, and are kept: supports that stay where they are cost nothing.

mod compliance;

pub use compliance::SurfaceCompliance;

use super::assembly::{AttachedVectors, Attachment};
use super::attached::{PointAttachment, actuator_attachments, supports_and_masses};
use super::damping::DampingMatrices;
use super::eigen::{DenseEigenpairs, Modes};
use super::grid::Grid;
use super::panel::{PanelModel, choose_fineness};
use super::reduced::ReducedModel;
use super::sparse::SparseVector;
use super::{Accuracy, Fineness, ModelError};
use crate::scene::{Scene, SurfaceKind};
use nalgebra::{DMatrix, DVector};
use std::collections::HashMap;
use std::sync::{Arc, Mutex, PoisonError};

/// Residual shapes of each load.
const SHAPES: usize = 2;
/// Part of its length by which a residual shape has to differ from those before it, squared: lengths are known from products alone,
/// to the rounding of those.
const DEPENDENT: f64 = 1e-10;
/// Springs are no stiffer than this over the panel's own flexibility at their points: what still moves there is as small a part of
/// what would move without, and the rounding of sums with larger numbers would be all that is left of the slow modes.
const RIGID: f64 = 1e7;
/// Numbers of shapes that are kept, 256 MB: of 8000 points at 1000 unknowns, of 50 at the most that a panel may have.
const KEPT: usize = 32 << 20;
/// Part of the largest squared frequency below which one is zero: a motion that nothing holds, of which rounding leaves 1e-16 or so of the
/// largest. With the local motions at 20 times 400 Hz that is 0.008 Hz.
const FREE: f64 = 1e-12;
/// How much lower the order of the other mesh is.
const LOWER: usize = 4;
/// Of a point force's deflection the elements' order p misses a part that falls as (p - SHORT)^-FALLS on a plate, ...
const SHORT: f64 = 1.3;
const FALLS: i32 = 2;
/// ... and faster on a bar, where it is the third derivative that jumps.
const FALLS_ON_BARS: i32 = 3;
/// Frequency of what is missing there, as a multiple of the highest asked for.
const LOCAL: f64 = 20.0;

/// A panel without anything attached at points.
#[derive(Debug)]
pub struct BarePanel {
    scene: Scene,
    model: PanelModel,
    /// The same at a lower order.
    lower: PanelModel,
    max_hz: f64,
    modes: Modes,
    mass_modes: DMatrix<f64>,
    /// What the surface's losses leave unbalanced along its edges, whatever the design.
    along_edges: Vec<SparseVector>,
    points: Mutex<HashMap<LoadKey, Arc<LoadShapes>>>,
    /// Of the grid whose yield was asked for last.
    yields: Mutex<Option<Arc<compliance::CompliancePoints>>>,
}

/// Where a load is and what it pushes: its entries, bit by bit.
type LoadKey = Vec<(usize, u64)>;

/// What a load does to the bare panel.
#[derive(Debug)]
struct LoadShapes {
    load: SparseVector,
    /// Over the modes.
    modes: DVector<f64>,
    /// z1, z2: unknowns x shapes.
    shapes: DMatrix<f64>,
    /// M z1, M z2.
    mass_shapes: DMatrix<f64>,
}

/// A basis for one design, and the bare panel's matrices over it: of the modes and of the residual shapes, which are
/// M-orthogonal to those.
struct ResidualBasis {
    loads: Vec<Arc<LoadShapes>>,
    /// Residual shapes that are orthonormal by M, as sums of the loads': (loads x shapes) x kept.
    sums: DMatrix<f64>,
    /// Bare stiffness over them, kept x kept.
    stiffness: DMatrix<f64>,
}

impl BarePanel {
    /// The panel of `scene`, whatever is attached to it, for frequencies up to `max_hz`, with the elements that usually meet the
    /// tolerance.
    ///
    /// # Errors
    /// As [`PanelModel::build`].
    pub fn build(scene: &Scene, accuracy: Accuracy, max_hz: f64) -> Result<Self, ModelError> {
        let bare = copy_without_attachments(scene);
        let (order, part) = match (scene.surface.kind, accuracy.relative_tolerance_or_tightest()) {
            // A point force's third derivative jumps inside a cell: small ones, which cost a bar next to nothing.
            (SurfaceKind::Bar, _) => (11, 0.34),
            (SurfaceKind::Plate, 1e-2..) => (9, 1.0),
            (SurfaceKind::Plate, 1e-3..) => (11, 1.0),
            (SurfaceKind::Plate, _) => (13, 0.5),
        };
        Self::new(&bare, choose_fineness(&bare, order, part, max_hz)?, max_hz)
    }

    /// The same with elements of one's own choice.
    ///
    /// # Errors
    /// As [`PanelModel::build_with_fineness`].
    pub fn new(scene: &Scene, fineness: Fineness, max_hz: f64) -> Result<Self, ModelError> {
        let bare = copy_without_attachments(scene);
        let model = PanelModel::build_with_fineness(&bare, fineness)?;
        let order = fineness.order.saturating_sub(LOWER).max(3);
        let lower = PanelModel::build_with_fineness(&bare, Fineness { order, ..fineness })?;
        let modes = model.compute_modes_for_reduction(max_hz)?;
        let mass_modes = model.shift_invert_operator().mass.multiply_columns(&modes.vectors);
        let along_edges = model.find_load_vectors_of_damping_forces_that_couple_modes(&modes, max_hz);
        Ok(Self {
            scene: bare,
            model,
            lower,
            max_hz,
            modes,
            mass_modes,
            along_edges,
            points: Mutex::default(),
            yields: Mutex::default(),
        })
    }

    /// Number of unknowns of its mesh.
    #[must_use]
    pub fn count_unknowns(&self) -> usize {
        self.model.count_unknowns()
    }

    /// Number of modes that are kept.
    #[must_use]
    pub fn count_modes(&self) -> usize {
        self.modes.lambda.len()
    }

    /// The reduced model of `scene`: as [`PanelModel::reduce_with_residual_shapes_of_actuators_damping_and_points`] makes it, for the frequencies and with the units of that.
    ///
    /// # Errors
    /// [`ModelError::OtherPanel`] if its surface, patches, cut-outs or edges are not this panel's; [`ModelError::Factorisation`] if
    /// numbers are beyond what can be computed with.
    pub fn couple_to_design(&self, scene: &Scene) -> Result<ReducedModel, ModelError> {
        self.check_same_bare_panel(scene)?;
        let grid = self.model.grid();
        let mut attached = AttachedVectors::assemble_supports_masses_and_actuators_of_scene(grid, scene);
        let free = self.count_unknowns();
        let basis = ResidualBasis::new(
            self.collect_distinct_load_shapes_of_attachments_and_edges(&attached.attachments, free),
            self.model.spectral_shift_rad2_per_s2(),
        );
        let local = self.compute_local_modes_missed_by_mesh(&attached, scene, &basis.loads);
        let (modes, residual, carried) = (self.count_modes(), basis.sums.ncols(), attached.unknowns - free);
        let size = modes + residual + carried + local.ncols();
        // What elements miss where a force acts: an unknown of its own at each place.
        for vector in attached.all_vectors_mut() {
            let own = find_index_of_load_with_same_surface_entries(&basis.loads, vector, free);
            vector.extend(own.map(|k| (free + carried + k, 1.0)));
        }
        attached.unknowns += basis.loads.len();
        let along = |vector: &SparseVector| {
            let mut out = DVector::zeros(size);
            if let Some(load) =
                find_index_of_load_with_same_surface_entries(&basis.loads, vector, free).map(|k| &basis.loads[k])
            {
                out.rows_mut(0, modes).copy_from(&load.modes);
                out.rows_mut(modes, residual).copy_from(&basis.residual_shape_deflections_at_load(load));
            }
            for (unknown, value) in vector.iter().filter(|(unknown, _)| *unknown >= free) {
                let row = unknown - free;
                if row < carried {
                    out[modes + residual + row] = *value;
                } else {
                    out.rows_mut(modes + residual + carried, local.ncols())
                        .copy_from(&local.row(row - carried).transpose());
                }
            }
            out
        };
        let mut stiffness = DMatrix::zeros(size, size);
        let mut mass = DMatrix::identity(size, size);
        (0..carried).for_each(|k| mass[(modes + residual + k, modes + residual + k)] = 0.0);
        for (k, lambda) in self.modes.lambda.iter().enumerate() {
            stiffness[(k, k)] = *lambda;
        }
        stiffness.view_mut((modes, modes), (residual, residual)).copy_from(&basis.stiffness);
        for k in modes + residual + carried..size {
            stiffness[(k, k)] = self.squared_frequency_of_local_motions_rad2_per_s2();
        }
        for attachment in &mut attached.attachments {
            let shape = along(&attachment.vector);
            let most = RIGID
                / self
                    .total_static_flexibility_at_surface_load_or_zero(&attachment.vector, free, &basis)
                    .max(f64::MIN_POSITIVE);
            // For its losses too, which are a part of the energy in it.
            attachment.stiffness = attachment.stiffness.min(most);
            stiffness.ger(attachment.stiffness, &shape, &shape, 1.0);
            mass.ger(attachment.mass, &shape, &shape, 1.0);
        }
        let (lambda, vectors) = solve_generalised_eigenproblem(stiffness, mass)?;
        let mut all = DMatrix::zeros(attached.unknowns, lambda.len());
        let mut surface = all.rows_mut(0, free);
        surface.gemm(1.0, &self.modes.vectors, &vectors.rows(0, modes), 0.0);
        let parts = &basis.sums * vectors.rows(modes, residual);
        for (k, load) in basis.loads.iter().enumerate() {
            surface.gemm(1.0, &load.shapes, &parts.rows(SHAPES * k, SHAPES), 1.0);
        }
        all.rows_mut(free, carried).copy_from(&vectors.rows(modes + residual, carried));
        let local = &local * vectors.rows(modes + residual + carried, local.ncols());
        all.rows_mut(free + carried, basis.loads.len()).copy_from(&local);
        let damping = DampingMatrices::project_onto_vectors(
            scene.surface.damping,
            &attached,
            self.model.edge_and_sealed_air_springs(),
            &lambda,
            &all,
        );
        let mut model = ReducedModel::new(lambda, all, damping, &attached, Arc::clone(grid));
        for (point_m, load) in list_attachment_points_with_load_indices(grid, scene, &basis.loads, free) {
            model.add_deflection_missed_by_mesh_at_point(point_m, local.row(load).transpose());
        }
        Ok(model)
    }

    /// Whether a scene is a design of this panel: nothing but what is attached at points differs.
    #[must_use]
    pub fn is_panel_of_design(&self, scene: &Scene) -> bool {
        self.check_same_bare_panel(scene).is_ok()
    }

    /// Refuses a scene whose surface, patches, cut-outs, edges or sealed air are not this panel's.
    fn check_same_bare_panel(&self, scene: &Scene) -> Result<(), ModelError> {
        let own = &self.scene;
        let parts = [
            ("surface", own.surface == scene.surface),
            ("patch", own.patches == scene.patches),
            ("cutout", own.cutouts == scene.cutouts),
            ("edge", own.edges == scene.edges),
            ("air", own.sealed_depth_m == scene.sealed_depth_m),
        ];
        parts.iter().find(|(_, is_same)| !is_same).map_or(Ok(()), |(part, _)| Err(ModelError::OtherPanel { part }))
    }

    /// Squared frequency in rad^2/s^2 that the local motions get: far above all that is asked for.
    fn squared_frequency_of_local_motions_rad2_per_s2(&self) -> f64 {
        (LOCAL * std::f64::consts::TAU * self.max_hz).powi(2)
    }

    /// What the mesh misses of the deflection that forces at the loads' places make there, as mass-normalised motions of
    /// [`Self::squared_frequency_of_local_motions_rad2_per_s2`]: loads x motions.
    fn compute_local_modes_missed_by_mesh(
        &self,
        attached: &AttachedVectors,
        scene: &Scene,
        loads: &[Arc<LoadShapes>],
    ) -> DMatrix<f64> {
        let nothing = DMatrix::zeros(loads.len(), 0);
        let Some(missing) =
            self.extrapolate_plate_flexibility_missed_by_mesh_if_lower_mesh_matches(attached, scene, loads)
        else {
            return nothing;
        };
        let Some(eigen) =
            DenseEigenpairs::from_symmetric_matrix_if_converged(&(0.5 * (&missing + missing.transpose())))
        else {
            return nothing;
        };
        let most = eigen.values.amax();
        let kept: Vec<usize> = (0..loads.len()).filter(|k| eigen.values[*k] > DEPENDENT * most).collect();
        let mut motions = eigen.vectors.select_columns(&kept);
        for (mut column, k) in motions.column_iter_mut().zip(&kept) {
            column.scale_mut((eigen.values[*k] * self.squared_frequency_of_local_motions_rad2_per_s2()).sqrt());
        }
        motions
    }

    /// What the mesh misses of the deflection at the loads' places under forces there, in m/N: loads x loads. Extrapolated from two orders of
    /// the elements; `None` on a bar, whose elements miss too little to be told in a
    /// response.
    fn extrapolate_plate_flexibility_missed_by_mesh_if_lower_mesh_matches(
        &self,
        attached: &AttachedVectors,
        scene: &Scene,
        load_shapes: &[Arc<LoadShapes>],
    ) -> Option<DMatrix<f64>> {
        let (n, free, lower_free) = (load_shapes.len(), self.count_unknowns(), self.lower.count_unknowns());
        let part =
            self.extrapolation_factor_unless_single_mesh().filter(|_| self.scene.surface.kind == SurfaceKind::Plate)?;
        let lower = AttachedVectors::assemble_supports_masses_and_actuators_of_scene(self.lower.grid(), scene);
        if lower.attachments.len() != attached.attachments.len() {
            return None;
        }
        let mut loads = DMatrix::zeros(lower_free, n);
        for (own, below) in attached.attachments.iter().zip(&lower.attachments).filter(|(own, _)| !own.is_slope) {
            if let Some(k) = find_index_of_load_with_same_surface_entries(load_shapes, &own.vector, free) {
                loads.column_mut(k).fill(0.0);
                let on_surface = below.vector.iter().filter(|(unknown, _)| *unknown < lower_free);
                on_surface.for_each(|(unknown, value)| loads[(*unknown, k)] = *value);
            }
        }
        let below = loads.tr_mul(&self.lower.shift_invert_operator().factor.solve_for_columns(&loads));
        Some(DMatrix::from_fn(n, n, |i, j| {
            let is_known = loads.column(i).amax() > 0.0 && loads.column(j).amax() > 0.0;
            if is_known {
                part * (self.static_deflection_at_one_load_under_other(&load_shapes[i], &load_shapes[j])
                    - below[(i, j)])
            } else {
                0.0
            }
        }))
    }

    /// What the finer mesh misses of a point force's deflection, over the difference between the meshes; `None` if there is one mesh only.
    #[expect(clippy::cast_precision_loss, reason = "orders of elements")]
    fn extrapolation_factor_unless_single_mesh(&self) -> Option<f64> {
        if self.lower.element_order() >= self.model.element_order() {
            return None;
        }
        let power = if self.scene.surface.kind == SurfaceKind::Bar { FALLS_ON_BARS } else { FALLS };
        let [below, own] =
            [self.lower.element_order(), self.model.element_order()].map(|order| (order as f64 - SHORT).powi(-power));
        Some(own / (below - own))
    }

    /// Deflection at one load's place for the other, of the bare panel with its shift, static.
    fn static_deflection_at_one_load_under_other(&self, at_load: &LoadShapes, under_load: &LoadShapes) -> f64 {
        let shift = self.model.spectral_shift_rad2_per_s2();
        let modes = at_load.modes.iter().zip(under_load.modes.iter()).zip(&self.modes.lambda);
        modes.map(|((a, b), lambda)| a * b / (lambda + shift)).sum::<f64>()
            + multiply_row_with_column(&at_load.load, &under_load.shapes, 0)
    }

    /// Static deflection per newton of the bare, shifted panel at a load; 0 for a vector that is not on the surface.
    fn total_static_flexibility_at_surface_load_or_zero(
        &self,
        vector: &SparseVector,
        surface_unknown_count: usize,
        basis: &ResidualBasis,
    ) -> f64 {
        find_index_of_load_with_same_surface_entries(&basis.loads, vector, surface_unknown_count)
            .map_or(0.0, |k| self.static_deflection_at_one_load_under_other(&basis.loads[k], &basis.loads[k]))
    }

    /// The shapes of everything that pushes the surface, each load once: those of attachments first.
    fn collect_distinct_load_shapes_of_attachments_and_edges(
        &self,
        attachments: &[Attachment],
        surface_unknown_count: usize,
    ) -> Vec<Arc<LoadShapes>> {
        let mut out: Vec<Arc<LoadShapes>> = Vec::new();
        let on_surface = |attachment: &Attachment| -> SparseVector {
            attachment.vector.iter().copied().filter(|(unknown, _)| *unknown < surface_unknown_count).collect()
        };
        for load in attachments.iter().map(on_surface).chain(self.along_edges.iter().cloned()) {
            if !load.is_empty() && out.iter().all(|other| other.load != load) {
                out.push(self.get_or_compute_shapes_of_load(load));
            }
        }
        out
    }

    /// Modal and residual shapes of a load: kept ones, or newly computed ones.
    fn get_or_compute_shapes_of_load(&self, load: SparseVector) -> Arc<LoadShapes> {
        let key: LoadKey = load.iter().map(|(unknown, value)| (*unknown, value.to_bits())).collect();
        if let Some(known) = self.points.lock().unwrap_or_else(PoisonError::into_inner).get(&key) {
            return Arc::clone(known);
        }
        let operator = self.model.shift_invert_operator();
        let mut right = DMatrix::zeros(self.count_unknowns(), 1);
        load.iter().for_each(|(unknown, value)| right[(*unknown, 0)] += value);
        let modes = self.modes.vectors.tr_mul(&right).column(0).into_owned();
        let mut shapes = DMatrix::zeros(self.count_unknowns(), SHAPES);
        let mut mass_shapes = shapes.clone();
        for k in 0..SHAPES {
            // The modes are taken out before a solution as well as after it: of the second shape they are (lambda_next / s)^2.
            right -= &self.mass_modes * self.modes.vectors.tr_mul(&right);
            let mut shape = operator.factor.solve_for_columns(&right);
            shape -= &self.modes.vectors * self.mass_modes.tr_mul(&shape);
            right = operator.mass.multiply_columns(&shape);
            shapes.set_column(k, &shape.column(0));
            mass_shapes.set_column(k, &right.column(0));
        }
        let found = Arc::new(LoadShapes { load, modes, shapes, mass_shapes });
        let mut points = self.points.lock().unwrap_or_else(PoisonError::into_inner);
        if points.len() * 2 * SHAPES * self.count_unknowns() >= KEPT {
            points.clear();
        }
        points.insert(key, Arc::clone(&found));
        found
    }
}

impl ResidualBasis {
    fn new(loads: Vec<Arc<LoadShapes>>, shift: f64) -> Self {
        let n = SHAPES * loads.len();
        // (K + s M) z1 = b and (K + s M) z2 = M z1, so that every product with K is a deflection or a product with M.
        let (mut shifted, mut mass) = (DMatrix::zeros(n, n), DMatrix::zeros(n, n));
        for (i, one) in loads.iter().enumerate() {
            for (j, other) in loads.iter().enumerate().take(i + 1) {
                for a in 0..SHAPES {
                    for b in 0..SHAPES {
                        let (row, column) = (SHAPES * i + a, SHAPES * j + b);
                        let inertia = one.mass_shapes.column(a).dot(&other.shapes.column(b));
                        let held = match a {
                            0 => multiply_row_with_column(&one.load, &other.shapes, b),
                            _ => one.mass_shapes.column(a - 1).dot(&other.shapes.column(b)),
                        };
                        (mass[(row, column)], mass[(column, row)]) = (inertia, inertia);
                        (shifted[(row, column)], shifted[(column, row)]) = (held, held);
                    }
                }
            }
        }
        let scale = DVector::from_fn(n, |i, _| 1.0 / mass[(i, i)].max(f64::MIN_POSITIVE).sqrt());
        let scaled = |matrix: &DMatrix<f64>| DMatrix::from_fn(n, n, |i, j| matrix[(i, j)] * scale[i] * scale[j]);
        let Some(eigen) = DenseEigenpairs::from_symmetric_matrix_if_converged(&scaled(&mass)).filter(|_| n > 0) else {
            return Self { loads, sums: DMatrix::zeros(n, 0), stiffness: DMatrix::zeros(0, 0) };
        };
        let kept: Vec<usize> = (0..n).filter(|k| eigen.values[*k] > DEPENDENT).collect();
        let mut sums = eigen.vectors.select_columns(&kept);
        for (mut column, k) in sums.column_iter_mut().zip(&kept) {
            column.component_mul_assign(&scale);
            column.scale_mut(1.0 / eigen.values[*k].sqrt());
        }
        let stiffness = sums.tr_mul(&(&shifted * &sums)) - shift * DMatrix::identity(kept.len(), kept.len());
        Self { loads, sums, stiffness }
    }

    /// Deflections of the residual shapes where a load acts.
    fn residual_shape_deflections_at_load(&self, load: &LoadShapes) -> DVector<f64> {
        let each = self
            .loads
            .iter()
            .flat_map(|other| (0..SHAPES).map(|k| multiply_row_with_column(&load.load, &other.shapes, k)));
        self.sums.tr_mul(&DVector::from_iterator(SHAPES * self.loads.len(), each))
    }
}

/// The points of the surface (m) at which something is attached, each once, with the index of the load there.
fn list_attachment_points_with_load_indices(
    grid: &Grid,
    scene: &Scene,
    loads: &[Arc<LoadShapes>],
    surface_unknown_count: usize,
) -> Vec<((f64, f64), usize)> {
    let mut points: Vec<((f64, f64), usize)> = Vec::new();
    for PointAttachment { at: (x_m, y_m), .. } in supports_and_masses(scene).chain(actuator_attachments(scene)) {
        let load = find_index_of_load_with_same_surface_entries(
            loads,
            &grid.deflection_row_of_attachment(x_m, y_m),
            surface_unknown_count,
        );
        points.extend(load.map(|load| ((x_m, y_m), load)).filter(|found| !points.contains(found)));
    }
    points
}

/// Index of the load that pushes the surface like this vector; `None` if there is no such load.
fn find_index_of_load_with_same_surface_entries(
    loads: &[Arc<LoadShapes>],
    vector: &SparseVector,
    surface_unknown_count: usize,
) -> Option<usize> {
    let on_surface = || vector.iter().filter(|(unknown, _)| *unknown < surface_unknown_count);
    loads.iter().position(|load| load.load.iter().eq(on_surface()))
}

/// Solves K x = lambda M x for symmetric matrices, M positive definite: lambda ascending, vectors M-orthonormal.
fn solve_generalised_eigenproblem(
    stiffness: DMatrix<f64>,
    mass: DMatrix<f64>,
) -> Result<(Vec<f64>, DMatrix<f64>), ModelError> {
    let failed = |what: &str| ModelError::Factorisation { reason: format!("{what} of the coupled model") };
    let lower = mass.cholesky().ok_or_else(|| failed("mass matrix"))?.unpack();
    let half = lower.solve_lower_triangular(&stiffness).ok_or_else(|| failed("mass matrix"))?;
    let matrix = lower.solve_lower_triangular(&half.transpose()).ok_or_else(|| failed("mass matrix"))?;
    let matrix = 0.5 * (&matrix + matrix.transpose());
    let DenseEigenpairs { values, vectors } =
        DenseEigenpairs::from_symmetric_matrix_if_converged(&matrix).ok_or_else(|| failed("modes"))?;
    let mut order: Vec<usize> = (0..values.len()).collect();
    order.sort_by(|a, b| values[*a].total_cmp(&values[*b]));
    let vectors =
        lower.tr_solve_lower_triangular(&vectors.select_columns(&order)).ok_or_else(|| failed("mass matrix"))?;
    let least = FREE * values.amax();
    let lambda = |k: &usize| if values[*k] > least { values[*k] } else { 0.0 };
    Ok((order.iter().map(lambda).collect(), vectors))
}

/// Product of a sparse row with one column of a matrix.
fn multiply_row_with_column(row: &SparseVector, matrix: &DMatrix<f64>, column: usize) -> f64 {
    row.iter().map(|(unknown, value)| value * matrix[(*unknown, column)]).sum()
}

/// The scene without supports, masses and actuators.
fn copy_without_attachments(panel_scene: &Scene) -> Scene {
    Scene { supports: Vec::new(), masses: Vec::new(), actuators: Vec::new(), ..panel_scene.clone() }
}

#[cfg(test)]
mod tests;
