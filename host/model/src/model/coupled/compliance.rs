//! How far the surface of a design yields to a steady force, where the force is.
//!
//! Of a bare panel with modes phi (all up to several times the highest frequency) and, beside these, the residual flexibility R, a steady
//! force of 1 N at p and forces -g of what holds the panel at points v move it by w = phi q + R (force), with
//!
//! Lambda q = phi_p - Phi_v g,  v = Phi_v' q + R_vp - R_vv g,  g = k v,
//!
//! so that with S = 1/k + R_vv: (Lambda + Phi_v S^-1 Phi_v') q = phi_p - Phi_v S^-1 R_vp, and the yield is phi_p . q + R_pp - R_pv g. No mode is
//! left out: what a sum over a model's modes misses at the force's own place, 1 % or so, is in R. No mass and no damping has part in it:
//! what hangs on springs of its own follows.
//!
//! R is what (K + s M)^-1 has beside the modes, whose squared frequencies are far above s: too small by a part s / lambda_next. What the mesh
//! misses right at a point force is extrapolated from two orders; of what holds a plate as well, but not between that and the pressed point. A
//! force f where the mesh misses m f is in doubt by as much, and forces at several places together by no more than (sum of f sqrt(m))^2: the bound.

use super::{BarePanel, LoadShapes, find_index_of_load_with_same_surface_entries, multiply_row_with_column};
use crate::model::ModelError;
use crate::model::assembly::AttachedVectors;
use crate::model::eigen::DenseEigenpairs;
use crate::model::grid::DeflectionDerivative;
use crate::model::panel::PanelModel;
use crate::model::sparse::SparseVector;
use crate::scene::Scene;
use nalgebra::{DMatrix, DVector};
use std::sync::{Arc, PoisonError};

/// Points that are solved for at once.
const BLOCK: usize = 32;
/// Part of a number that is left of it after elimination where rounding is all that is left: a motion that nothing holds.
const LEFT: f64 = 1e-12;
/// Part of the largest below which a principal flexibility of what holds the panel counts as none: points that are one.
const SAME: f64 = 1e-12;
/// Part of what is extrapolated for the mesh by which that may be wrong.
const UNSURE: f64 = 1.0;

/// How far points of a surface yield.
#[derive(Clone, Debug)]
pub struct SurfaceCompliance {
    /// To 1 N at the point itself, in m; infinite where nothing holds the panel. Row by row, x first; NaN where there is no surface.
    pub m_per_n: Vec<f64>,
    /// What they may be off by, in m/N.
    pub error_m_per_n: Vec<f64>,
}

/// What is known of the points of a grid on the bare panel.
#[derive(Debug)]
pub(super) struct CompliancePoints {
    x_m: Vec<f64>,
    y_m: Vec<f64>,
    rows: Vec<SparseVector>,
    /// Modes x points.
    modes: DMatrix<f64>,
    /// R_pp in m/N on the mesh, ...
    residual: Vec<f64>,
    /// ... and what the mesh misses of it.
    missing: Vec<f64>,
}

impl BarePanel {
    /// How far the points of a grid (m, columns and rows) yield to a steady force on each, in the design `scene` of this panel.
    ///
    /// # Errors
    /// As [`Self::couple_to_design`].
    pub fn compute_static_compliance_at_grid_points(
        &self,
        scene: &Scene,
        x_m: &[f64],
        y_m: &[f64],
    ) -> Result<SurfaceCompliance, ModelError> {
        self.check_same_bare_panel(scene)?;
        let points = self.get_or_compute_compliance_points(x_m, y_m);
        let attached = AttachedVectors::assemble_supports_masses_and_actuators_of_scene(self.model.grid(), scene);
        let (free, modes) = (self.count_unknowns(), self.count_modes());
        let all = self.collect_distinct_load_shapes_of_attachments_and_edges(&attached.attachments, free);
        let missing = self.extrapolate_plate_flexibility_missed_by_mesh_if_lower_mesh_matches(&attached, scene, &all);
        // What holds the panel: springs to the ground. One to a mass that nothing else holds bears nothing.
        let mut stiffness = vec![0.0; all.len()];
        for attachment in
            attached.attachments.iter().filter(|own| own.vector.iter().all(|(unknown, _)| *unknown < free))
        {
            if let Some(k) = find_index_of_load_with_same_surface_entries(&all, &attachment.vector, free) {
                stiffness[k] += attachment.stiffness;
            }
        }
        let held: Vec<usize> = (0..all.len()).filter(|k| stiffness[*k] > 0.0).collect();
        let loads: Vec<&LoadShapes> = held.iter().map(|k| &*all[*k]).collect();
        let flexible = DMatrix::from_fn(loads.len(), loads.len(), |i, j| {
            let missing = missing.as_ref().map_or(0.0, |missing| missing[(held[i], held[j])]);
            let spring = if i == j { 1.0 / stiffness[held[i]] } else { 0.0 };
            spring + missing + multiply_row_with_column(&loads[i].load, &loads[j].shapes, 0)
        });
        let stiff = pseudo_invert_flexibility_matrix(&flexible)?;
        let at_loads = DMatrix::from_fn(modes, loads.len(), |mode, k| loads[k].modes[mode]);
        let between = DMatrix::from_fn(loads.len(), points.rows.len(), |k, p| {
            multiply_row_with_column(&points.rows[p], &loads[k].shapes, 0)
        });
        let pull = &stiff * &between;
        let mut hold = &at_loads * &stiff * at_loads.transpose();
        for (k, lambda) in self.modes.lambda.iter().enumerate() {
            hold[(k, k)] += lambda;
        }
        let diagonal = hold.diagonal();
        let right = &points.modes - &at_loads * &pull;
        // A motion that nothing holds has no steady state.
        let factor = hold.cholesky().filter(|factor| {
            let left = factor.l_dirty().diagonal();
            left.iter().zip(diagonal.iter()).all(|(left, own)| left * left > LEFT * own)
        });
        let solved = factor.map(|factor| factor.solve(&right));
        // What the pressed point and each place that holds are in doubt by: for the mesh, and, as a part of R, for the shift.
        let most = points.missing.iter().fold(0.0, |most: f64, own| most.max(own.abs()));
        let missing_at = |k: usize| missing.as_ref().map_or(most, |missing| missing[(held[k], held[k])].abs());
        let residual_at = |k: usize| multiply_row_with_column(&loads[k].load, &loads[k].shapes, 0).abs();
        let shift = self.model.spectral_shift_rad2_per_s2();
        let of_shift = shift / self.modes.lambda.iter().copied().fold(shift, f64::max);
        let (mut m_per_n, mut error_m_per_n) = (Vec::new(), Vec::new());
        for p in 0..points.rows.len() {
            let (found, error) = match &solved {
                _ if points.rows[p].is_empty() => {
                    (if self.is_point_on_surface(&points, p) { 0.0 } else { f64::NAN }, 0.0)
                }
                None => (f64::INFINITY, f64::INFINITY),
                Some(solved) => {
                    let q = solved.column(p);
                    // With g = S^-1 (Phi_v' q + R_vp) the yield is right . q + R_pp - R_pv S^-1 R_vp.
                    let own = points.residual[p] + points.missing[p] - between.column(p).dot(&pull.column(p));
                    let holds = &stiff * at_loads.tr_mul(&q) + pull.column(p);
                    let all = |own: f64, at: &dyn Fn(usize) -> f64| {
                        let held: f64 = holds.iter().enumerate().map(|(k, g)| g.abs() * at(k).sqrt()).sum();
                        (own.abs().sqrt() + held).powi(2)
                    };
                    let error =
                        UNSURE * all(points.missing[p], &missing_at) + of_shift * all(points.residual[p], &residual_at);
                    (right.column(p).dot(&q) + own, error)
                }
            };
            m_per_n.push(found);
            // Edges on springs so stiff that they were taken for supports: stiffness goes with the square of a frequency.
            error_m_per_n.push(error + 2.0 * self.model.relative_frequency_error_independent_of_mesh() * found.abs());
        }
        Ok(SurfaceCompliance { m_per_n, error_m_per_n })
    }

    /// Whether a point of the grid is on the surface, not in a cut-out.
    fn is_point_on_surface(&self, points: &CompliancePoints, point_index: usize) -> bool {
        let columns = points.x_m.len();
        self.scene
            .layout()
            .layer_at_unless_cut_out(points.x_m[point_index % columns], points.y_m[point_index / columns])
            .is_some()
    }

    /// What is known of the points of a grid: kept from the last question, or newly computed.
    fn get_or_compute_compliance_points(&self, x_m: &[f64], y_m: &[f64]) -> Arc<CompliancePoints> {
        let known = self.yields.lock().unwrap_or_else(PoisonError::into_inner).clone();
        if let Some(known) = known.filter(|known| known.x_m == x_m && known.y_m == y_m) {
            return known;
        }
        let found = Arc::new(CompliancePoints::new(self, x_m, y_m));
        *self.yields.lock().unwrap_or_else(PoisonError::into_inner) = Some(Arc::clone(&found));
        found
    }
}

impl CompliancePoints {
    fn new(panel: &BarePanel, x_m: &[f64], y_m: &[f64]) -> Self {
        let rows_of = |model: &PanelModel| -> Vec<SparseVector> {
            let points = y_m.iter().flat_map(|y| x_m.iter().map(move |x| (*x, *y)));
            points.map(|(x, y)| model.grid().deflection_or_slope_row_at(x, y, DeflectionDerivative::Value)).collect()
        };
        let rows = rows_of(&panel.model);
        let (shift, lambda) = (panel.model.spectral_shift_rad2_per_s2(), &panel.modes.lambda);
        let modes = {
            let mut modes = DMatrix::zeros(lambda.len(), rows.len());
            for (mut column, row) in modes.column_iter_mut().zip(&rows) {
                for (unknown, value) in row {
                    column.axpy(*value, &panel.modes.vectors.row(*unknown).transpose(), 1.0);
                }
            }
            modes
        };
        let own = compute_shifted_static_flexibility_at_each_row(&panel.model, &rows);
        let below = panel
            .extrapolation_factor_unless_single_mesh()
            .map(|part| (part, compute_shifted_static_flexibility_at_each_row(&panel.lower, &rows_of(&panel.lower))));
        let (mut residual, mut missing) = (Vec::with_capacity(rows.len()), Vec::with_capacity(rows.len()));
        for (p, own) in own.iter().enumerate() {
            let in_modes: f64 =
                modes.column(p).iter().zip(lambda).map(|(shape, lambda)| shape * shape / (lambda + shift)).sum();
            residual.push(own - in_modes);
            missing.push(below.as_ref().map_or(0.0, |(part, below)| part * (own - below[p])));
        }
        Self { x_m: x_m.to_vec(), y_m: y_m.to_vec(), rows, modes, residual, missing }
    }
}

/// Static deflection per newton of the shifted panel at each row's own point: r (K + s M)^-1 r'.
fn compute_shifted_static_flexibility_at_each_row(model: &PanelModel, rows: &[SparseVector]) -> Vec<f64> {
    let mut found = Vec::with_capacity(rows.len());
    for rows in rows.chunks(BLOCK) {
        let mut right = DMatrix::zeros(model.count_unknowns(), rows.len());
        for (mut column, row) in right.column_iter_mut().zip(rows) {
            row.iter().for_each(|(unknown, value)| column[*unknown] += value);
        }
        let solved = model.shift_invert_operator().factor.solve_for_columns(&right);
        found.extend(right.column_iter().zip(solved.column_iter()).map(|(right, solved)| right.dot(&solved)));
    }
    found
}

/// The inverse of a symmetric matrix of flexibilities, over what of it is not rounding.
fn pseudo_invert_flexibility_matrix(flexible: &DMatrix<f64>) -> Result<DMatrix<f64>, ModelError> {
    let n = flexible.nrows();
    if n == 0 {
        return Ok(DMatrix::zeros(0, 0));
    }
    // Slopes are in other units than deflections.
    let scale = DVector::from_fn(n, |i, _| 1.0 / flexible[(i, i)].abs().max(f64::MIN_POSITIVE).sqrt());
    let scaled = DMatrix::from_fn(n, n, |i, j| 0.5 * (flexible[(i, j)] + flexible[(j, i)]) * scale[i] * scale[j]);
    let eigen = DenseEigenpairs::from_symmetric_matrix_if_converged(&scaled)
        .ok_or_else(|| ModelError::Factorisation { reason: "flexibility matrix of the supports".to_owned() })?;
    let most = eigen.values.amax();
    let part = DVector::from_fn(n, |k, _| if eigen.values[k] > SAME * most { 1.0 / eigen.values[k] } else { 0.0 });
    let inverse = &eigen.vectors * DMatrix::from_diagonal(&part) * eigen.vectors.transpose();
    Ok(DMatrix::from_fn(n, n, |i, j| inverse[(i, j)] * scale[i] * scale[j]))
}
