//! The panel model that the rest of the program uses.

use super::assembly::{PanelMatrices, assemble_panel_matrices};
use super::damping::{DampingMatrices, DistributedSprings};
use super::eigen::{Modes, ShiftInvertOperator, extend_known_modes_up_to};
use super::fineness::Fineness;
use super::grid::{DeflectionDerivative, Grid};
use super::poles::{Pole, compute_poles_of_followed_modes_if_solvable};
use super::reduced::ReducedModel;
use super::rigid::{RigidModes, find_rigid_modes_and_eigenvalue_bounds_of_slow_motions};
use super::sections::{WaveRigidities, choose_spectral_shift_rad2_per_s2};
use super::sparse::{CholeskyFactor, MatrixEntries, SparseVector};
use super::{Accuracy, Bound, ModelError};
use crate::scene::{Scene, SurfaceDamping, SurfaceKind};
use nalgebra::DMatrix;
use std::sync::Arc;

/// Times the thickness below which a wave is too short for a thin surface's theory.
const SHORTEST_WAVE: f64 = 6.0;
/// Most unknowns: what a laptop factors in seconds.
const MOST_UNKNOWNS: usize = 160_000;
/// Highest frequency that a model is built for, in Hz: two hundred times what the skin feels.
const MAX_HZ: f64 = 200_000.0;
/// Bending waves in a cell at the highest frequency. With order 7 a free plate's response is right to 1e-3 there, with 9 to
/// 1e-4 (`cargo xtask bench model`).
const WAVES_PER_CELL: f64 = 1.1;
/// Most modes, about: time grows with their cube (2 x 1.2 m of 3 mm at 1.4 kHz keeps some 600).
const MOST_MODES: f64 = 1000.0;
/// Least cells along the longer side.
const LEAST_CELLS: f64 = 2.0;
/// Modes of a reduced model, besides one for each order.
const LEAST_MODES: usize = 3;
/// Part of a shape's modal mass below which that of the surface itself is rounding.
const LEAST_MASS: f64 = 1e-12;
/// Part of its aspect that rounding on a narrow strip's mesh goes with: with the cube of the aspect it was seen to be 1e-8 at
/// 4000, which is 1e-19 of the cube, and counts as 2e-13.
const IN_STRIPS: f64 = 0.05;
/// Modes that poles are computed over, as a multiple of the highest frequency asked for: so much, and more for each order.
const POLES_BEYOND: f64 = 1.0;
const POLES_BEYOND_PER_ORDER: f64 = 0.08;
/// Residual shapes of each load there.
const SHAPES_FOR_POLES: usize = 3;
/// Why a pole of a single level has no bound.
const ONE_LEVEL: &str = "no other mesh was computed for a comparison";
/// Residual shapes of each load of a reduced model.
const SHAPES: usize = 2;
/// The same for a ratio of damping, the root of a matrix that acts outside their span as well: with two, responses of a grounded
/// ERA on a free edge were wrong by five times as much.
const SHAPES_FOR_MODAL_RATIO: usize = 3;
/// So many modes in the band that twice the residual shapes cost less than twice the modes.
const MANY_MODES: f64 = 150.0;
/// Attachments of a plate beyond which cells are smaller for their sake, and with which they shrink no further.
const MANY_POINTS: usize = 16;
const MOST_POINTS: usize = 300;
/// Side of those cells, over the root of the area for each attachment.
const CELL_PER_POINT: f64 = 1.0;

/// A mode of the panel with everything attached to it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PanelMode {
    /// Undamped frequency in Hz; exactly 0 for a motion that nothing holds.
    pub frequency_hz: f64,
    /// Damping ratio of the pole that continues from it ([`Pole::damping_ratio`]); 0 for a rigid mode.
    pub damping_ratio: f64,
    /// That pole: what damping makes of the mode ([`super::poles`]).
    pub pole: Pole,
    /// Bound on the error of that pole, relative to its modulus; unknown of a single level.
    pub pole_bound: Bound,
    /// Springs so soft hold it that it was computed with a surface that stays straight.
    pub straight: bool,
    /// Frequency in Hz of the same shape without what the masses attached weigh: how stiff it is against the panel's own
    /// bending, which is what rounding in the panel's stiffness is held against. A heavy mass moves slowly on a stiff panel.
    pub unloaded_hz: f64,
}

/// What a mesh is made of.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
pub struct MeshCounts {
    /// Cells along x and along y.
    pub cells: [usize; 2],
    /// Functions of point forces.
    pub point_functions: usize,
    /// Deflections that are unknowns of their own.
    pub stiff_points: usize,
    /// Rigid and slow modes known before the iteration.
    pub known_modes: usize,
}

/// A meshed and factored panel.
#[derive(Debug)]
pub struct PanelModel {
    /// What a frequency may be wrong by for edges on springs that were taken for supports.
    unresolved: f64,
    /// With supports in place of such edges.
    scene: Scene,
    assembled: PanelMatrices,
    factor: CholeskyFactor,
    shift: f64,
    /// Modes that the shift is too far from, or that are known in closed form.
    slow: Modes,
    /// Largest eigenvalue of those known in closed form; negative if there are none.
    straight: f64,
    fineness: Fineness,
}

/// How a reduced model is made.
#[derive(Clone, Copy)]
struct ReductionSettings {
    /// Modes are kept up to this multiple of the highest frequency.
    modes_beyond: f64,
    /// Residual shapes of each load.
    shapes_each: usize,
}

impl PanelModel {
    /// How a reduced model for frequencies up to `max_hz` is made. All modes up to a multiple r of that are kept; what lies above
    /// is carried by n residual shapes of each load, whose error falls as r^-4n. The multiple grows with the order of the
    /// elements, so that the difference between two orders shows both errors.
    #[expect(clippy::cast_precision_loss, reason = "a dozen at most")]
    fn choose_reduction_settings(&self, max_hz: f64) -> ReductionSettings {
        let modes_beyond = 0.75 + 0.25 * self.fineness.order as f64;
        let shapes_each = match self.scene.surface.damping {
            SurfaceDamping::ModalRatio(_) => SHAPES_FOR_MODAL_RATIO,
            SurfaceDamping::None | SurfaceDamping::LossFactor(_) | SurfaceDamping::Rayleigh { .. } => SHAPES,
        };
        if are_more_residual_shapes_cheaper_than_modes_below(&self.scene, max_hz) {
            // At r = 4, (r / 2)^-8n is r^-4n: as good with half the modes.
            ReductionSettings { modes_beyond: 0.5 * modes_beyond, shapes_each: 2 * shapes_each }
        } else {
            ReductionSettings { modes_beyond, shapes_each }
        }
    }

    /// Meshes the scene for frequencies up to `max_hz` with the elements that usually meet the tolerance;
    /// [`super::bounded`] makes sure that they do.
    ///
    /// # Errors
    /// [`ModelError`]: a frequency out of range, a mesh that would be too fine, or matrices that cannot be factored.
    pub fn build(scene: &Scene, accuracy: Accuracy, max_hz: f64) -> Result<Self, ModelError> {
        Self::build_with_fineness(
            scene,
            choose_fineness(scene, accuracy.choose_element_order_for_tolerance(), 1.0, max_hz)?,
        )
    }

    /// Meshes the scene with cells and elements of the given fineness.
    ///
    /// # Errors
    /// As [`PanelModel::build`].
    pub fn build_with_fineness(scene: &Scene, fineness: Fineness) -> Result<Self, ModelError> {
        let unresolved = super::edges::relative_frequency_error_of_replaced_edge_springs(scene);
        let scene = super::edges::replace_rigid_edge_springs_with_supports_or_limit_them(scene);
        let assembled = assemble_panel_matrices(&scene, fineness)?;
        let shift = choose_spectral_shift_rad2_per_s2(&scene);
        let factor = factor_shifted_stiffness(&assembled, shift)?;
        let (slow, straight) = compute_rigid_and_slow_modes_and_largest_rigid_eigenvalue(&scene, &assembled, shift)?;
        Ok(Self { unresolved, scene, assembled, factor, shift, slow, straight, fineness })
    }

    /// Number of unknowns.
    #[must_use]
    pub fn count_unknowns(&self) -> usize {
        self.assembled.count_unknowns()
    }

    /// Cells along x and y (1 on a bar), functions of point forces, and stiffly held points with unknowns of their own.
    #[must_use]
    pub fn count_cells_point_functions_stiff_points_and_known_modes(&self) -> MeshCounts {
        let grid = &self.assembled.grid;
        MeshCounts {
            cells: [grid.x.count_cells(), grid.y.as_ref().map_or(1, super::mesh::GridLines::count_cells)],
            point_functions: grid.count_point_force_functions(),
            stiff_points: grid.count_stiff_points(),
            known_modes: self.slow.lambda.len(),
        }
    }

    /// What a frequency may be wrong by, relative, at attachments, whatever the mesh: rigid points very near to each other in a
    /// corner or at a patch, strips that are modelled as bars around points; and for edges on springs that are all but rigid. 0
    /// where there is nothing of the kind.
    #[must_use]
    pub fn relative_frequency_error_independent_of_mesh(&self) -> f64 {
        self.unresolved
            + super::placement::relative_frequency_error_at_attachments_no_finer_mesh_removes(
                &self.scene,
                self.fineness,
            )
    }

    /// The mesh.
    #[must_use]
    pub fn fineness(&self) -> Fineness {
        self.fineness
    }

    /// Order of the elements.
    #[must_use]
    pub fn element_order(&self) -> usize {
        self.fineness.order
    }

    /// The panel's longer side over the mesh's least cell; a strip's width does not count, whose functions are made for it.
    #[must_use]
    pub fn effective_mesh_aspect_for_rounding(&self) -> f64 {
        let grid = &self.assembled.grid;
        let all = [Some(&grid.x), grid.y.as_ref()].into_iter().flatten().filter(|lines| !lines.is_strip);
        let lengths = all.flat_map(|lines| lines.at.windows(2).map(|at| at[1] - at[0]).enumerate());
        // A bar's thin cells show no rounding.
        let least =
            lengths.filter(|(cell, _)| grid.y.is_some() || !grid.thin.is_thin_cell(*cell)).map(|(_, length)| length);
        let least = least.fold(f64::INFINITY, f64::min);
        let (length, width) = grid.length_and_width_or_1_m();
        let aspect = (if grid.y.is_some() { length.max(width) } else { length }) / least;
        // Functions of point forces that end after some widths of a strip do not meet those of the other cells.
        let is_narrow = super::placement::width_in_cells_if_plain_narrow_strip(&self.scene, self.fineness).is_some();
        if is_narrow { (aspect * IN_STRIPS).max(1.0) } else { aspect }
    }

    /// All modes up to `max_hz`, ascending, rigid ones first, each with the pole that continues from it.
    ///
    /// # Errors
    /// [`ModelError`] if the iteration does not settle.
    pub fn compute_mode_frequencies_and_poles(&self, max_hz: f64) -> Result<Vec<PanelMode>, ModelError> {
        let found = self.compute_undamped_modes(max_hz)?;
        let poles = self.compute_poles_of_modes(&found, max_hz)?;
        let attached = found.vectors.column_iter().map(|shape| -> f64 {
            let along = |vector: &[(usize, f64)]| vector.iter().map(|(i, value)| shape[*i] * value).sum::<f64>();
            self.assembled.attached.attachments.iter().map(|part| part.mass * along(&part.vector).powi(2)).sum()
        });
        let attached: Vec<f64> = attached.collect();
        // Slow modes are kept whatever was asked for.
        let highest = (std::f64::consts::TAU * max_hz).powi(2);
        Ok(found
            .lambda
            .iter()
            .zip(poles)
            .enumerate()
            .take_while(|(_, (lambda, _))| **lambda <= highest)
            .map(|(i, (lambda, pole))| {
                let omega = lambda.sqrt();
                PanelMode {
                    frequency_hz: omega / std::f64::consts::TAU,
                    damping_ratio: pole.damping_ratio,
                    pole,
                    pole_bound: Bound::Unknown(ONE_LEVEL),
                    straight: *lambda <= self.straight,
                    unloaded_hz: omega / std::f64::consts::TAU / (1.0 - attached[i]).max(LEAST_MASS).sqrt(),
                }
            })
            .collect())
    }

    /// A small model for frequencies up to `max_hz`: all modes to a multiple of that, and residual shapes of the actuators, of
    /// what dashpots and the surface's losses leave unbalanced, and of `points` (m).
    ///
    /// # Errors
    /// [`ModelError`] if the iteration does not settle.
    pub fn reduce_with_residual_shapes_of_actuators_damping_and_points(
        &self,
        max_hz: f64,
        points: &[(f64, f64)],
    ) -> Result<ReducedModel, ModelError> {
        let shapes_each = self.choose_reduction_settings(max_hz).shapes_each;
        let found = self.compute_modes_for_reduction(max_hz)?;
        let loads: Vec<_> = self
            .assembled
            .attached
            .actuators
            .iter()
            .map(|actuator| actuator.force.clone())
            .chain(self.find_load_vectors_of_damping_forces_that_couple_modes(&found, max_hz))
            .chain(self.actuator_loads_if_damping_is_modal())
            .chain(
                points
                    .iter()
                    .map(|(x, y)| self.assembled.grid.deflection_or_slope_row_at(*x, *y, DeflectionDerivative::Value)),
            )
            .collect();
        let (lambda, vectors) =
            super::reduced::build_reduction_basis(self.shift_invert_operator(), &found, &loads, shapes_each);
        let damping = self.project_damping_onto_vectors(&lambda, &vectors);
        Ok(ReducedModel::new(lambda, vectors, damping, &self.assembled.attached, Arc::clone(&self.assembled.grid)))
    }

    /// The undamped modes that a reduced model for frequencies up to `max_hz` keeps.
    pub(super) fn compute_modes_for_reduction(&self, max_hz: f64) -> Result<Modes, ModelError> {
        // A short bar may have no mode in the band at all: a few are kept all the same, more at higher orders, so that the
        // difference between orders shows what the modes left out do.
        let least = self.fineness.order + LEAST_MODES;
        self.compute_undamped_modes(
            (self.choose_reduction_settings(max_hz).modes_beyond * max_hz)
                .max(estimate_frequency_of_mode_hz(&self.scene, least)),
        )
    }

    /// The poles that continue from modes up to `max_hz`: over these, others above them, and the residual shapes of what dashpots and losses
    /// leave unbalanced, where there are such.
    #[expect(clippy::cast_precision_loss, reason = "a dozen at most")]
    fn compute_poles_of_modes(&self, modes: &Modes, max_hz: f64) -> Result<Vec<Pole>, ModelError> {
        let failed = || ModelError::Factorisation { reason: "poles of the damped modes".to_owned() };
        let loads: Vec<_> = self
            .find_load_vectors_of_damping_forces_that_couple_modes(modes, max_hz)
            .into_iter()
            .chain(self.actuator_loads_if_damping_is_modal())
            .collect();
        let count = modes.lambda.len();
        if loads.is_empty() {
            return compute_poles_of_followed_modes_if_solvable(
                &modes.lambda,
                &self.project_damping_onto_vectors(&modes.lambda, &modes.vectors),
                count,
                count,
            )
            .ok_or_else(failed);
        }
        // More at higher orders, as of a reduced model.
        let beyond = POLES_BEYOND + POLES_BEYOND_PER_ORDER * self.fineness.order as f64;
        let most_hz = beyond * max_hz;
        let more = if estimate_mode_count_below(&self.scene, most_hz) > MOST_MODES {
            modes.clone()
        } else {
            self.compute_undamped_modes(most_hz)?
        };
        let (lambda, vectors) =
            super::reduced::build_reduction_basis(self.shift_invert_operator(), &more, &loads, SHAPES_FOR_POLES);
        compute_poles_of_followed_modes_if_solvable(
            &lambda,
            &self.project_damping_onto_vectors(&lambda, &vectors),
            more.lambda.len(),
            count,
        )
        .ok_or_else(failed)
    }

    /// The loads whose shapes modal damping needs: those of the ERAs, where damping is a ratio of the modes without them.
    fn actuator_loads_if_damping_is_modal(&self) -> impl Iterator<Item = SparseVector> {
        let is_modal = matches!(self.scene.surface.damping, SurfaceDamping::ModalRatio(_));
        let of_actuators = self.assembled.attached.actuator_attachments().iter();
        of_actuators.filter(move |_| is_modal).map(|attachment| attachment.vector.clone())
    }

    /// Loads that dashpots and the surface's losses leave unbalanced.
    pub(super) fn find_load_vectors_of_damping_forces_that_couple_modes(
        &self,
        modes: &Modes,
        max_hz: f64,
    ) -> Vec<SparseVector> {
        super::damping::find_load_vectors_of_damping_forces_that_couple_modes(
            &self.scene,
            &self.assembled,
            modes,
            max_hz,
        )
    }

    /// The mesh.
    pub(super) fn grid(&self) -> &Arc<Grid> {
        &self.assembled.grid
    }

    /// The springs that are not attached at points: along edges, and sealed air.
    pub(super) fn edge_and_sealed_air_springs(&self) -> DistributedSprings<'_> {
        DistributedSprings { edges: &self.assembled.edges, air: self.assembled.air.as_ref() }
    }

    /// The shift s of K + s M in rad^2/s^2.
    pub(super) fn spectral_shift_rad2_per_s2(&self) -> f64 {
        self.shift
    }

    /// The factored operator (K + s M)^-1 M for the eigenvalue iteration.
    pub(super) fn shift_invert_operator(&self) -> ShiftInvertOperator<'_> {
        ShiftInvertOperator { factor: &self.factor, mass: &self.assembled.mass, shift: self.shift }
    }

    /// All undamped modes up to a frequency, refused if there are too many.
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "`as` saturates")]
    fn compute_undamped_modes(&self, max_hz: f64) -> Result<Modes, ModelError> {
        let expected = estimate_mode_count_below(&self.scene, max_hz);
        if expected > MOST_MODES {
            return Err(ModelError::TooManyModes { max_hz, modes: expected as usize, limit: MOST_MODES as usize });
        }
        extend_known_modes_up_to(self.shift_invert_operator(), &self.slow, (std::f64::consts::TAU * max_hz).powi(2))
    }

    /// The scene's damping over mass-normalised `vectors` of the squared frequencies `lambda`.
    fn project_damping_onto_vectors(&self, lambda: &[f64], vectors: &DMatrix<f64>) -> DampingMatrices {
        DampingMatrices::project_onto_vectors(
            self.scene.surface.damping,
            &self.assembled.attached,
            self.edge_and_sealed_air_springs(),
            lambda,
            vectors,
        )
    }
}

/// Factors K + shift M, sealed air included.
fn factor_shifted_stiffness(assembled: &PanelMatrices, shift: f64) -> Result<CholeskyFactor, ModelError> {
    let mut entries = MatrixEntries::default();
    entries.add_scaled_entries(&assembled.stiffness.to_entries(), 1.0);
    entries.add_scaled_entries(&assembled.mass.to_entries(), shift);
    let factor = entries.build_matrix(assembled.count_unknowns())?.factorise_and_check_residual()?;
    Ok(match &assembled.air {
        None => factor,
        Some(air) => factor.add_rank_one_spring(assembled.count_unknowns(), &air.vector, air.stiffness),
    })
}

/// The modes that shift-invert about `shift` does not know well: free ones, nearly free ones, and slow ones, of heavy
/// masses or on soft springs, by a second factorisation with a shift of their own size.
fn compute_rigid_and_slow_modes_and_largest_rigid_eigenvalue(
    scene: &Scene,
    assembled: &PanelMatrices,
    shift: f64,
) -> Result<(Modes, f64), ModelError> {
    let RigidModes { known, slow } = find_rigid_modes_and_eigenvalue_bounds_of_slow_motions(scene, assembled, shift);
    let straight = known.lambda.iter().copied().fold(-1.0, f64::max);
    let Some(slowest) = slow.iter().copied().reduce(f64::min) else { return Ok((known, straight)) };
    // Below a billionth of the usual shift K + s M would be indefinite by rounding.
    let own = slowest.max(1e-9 * shift);
    let factor = factor_shifted_stiffness(assembled, own)?;
    let fastest = slow.iter().copied().fold(0.0, f64::max);
    Ok((
        extend_known_modes_up_to(
            ShiftInvertOperator { factor: &factor, mass: &assembled.mass, shift: own },
            &known,
            fastest,
        )?,
        straight,
    ))
}

/// About where the surface's mode of a number is, in Hz: (n pi / L)^2 on a bar, Weyl's 4 pi n / area on a plate, times the
/// root of the wave ratio.
#[expect(clippy::cast_precision_loss, reason = "a dozen or two")]
fn estimate_frequency_of_mode_hz(scene: &Scene, mode_number: usize) -> f64 {
    let (surface, pi) = (&scene.surface, std::f64::consts::PI);
    let wavenumber_squared = match surface.kind {
        SurfaceKind::Plate => 4.0 * pi * mode_number as f64 / (surface.length_m * surface.width_m),
        SurfaceKind::Bar => (mode_number as f64 * pi / surface.length_m).powi(2),
    };
    wavenumber_squared * WaveRigidities::find_extremes_and_mean_over_layers_of_scene(scene).mean.sqrt()
        / std::f64::consts::TAU
}

/// About how many modes the surface has below a frequency: [`estimate_frequency_of_mode_hz`] inverted.
fn estimate_mode_count_below(scene: &Scene, max_hz: f64) -> f64 {
    let part = max_hz / estimate_frequency_of_mode_hz(scene, 1);
    if scene.surface.kind == SurfaceKind::Bar { part.sqrt() } else { part }
}

/// Whether there are so many modes below a frequency that reduced models keep half as many beyond it, and twice the residual
/// shapes.
pub fn are_more_residual_shapes_cheaper_than_modes_below(scene: &Scene, max_hz: f64) -> bool {
    estimate_mode_count_below(scene, max_hz) > MANY_MODES
}

/// Largest cells in which functions of point forces do not crowd. They reach over a cell or so, and each pair that meets is integrated
/// over all that it shares: 66 dashpots around a panel of four cells were 2300 pairs and 12 s, of 40 cells a tenth of both.
#[expect(clippy::cast_precision_loss, reason = "a count of lines in a file")]
fn largest_cell_without_crowded_point_forces_m(scene: &Scene) -> f64 {
    let points = super::placement::attachment_positions_m(scene).count();
    if scene.surface.kind == SurfaceKind::Bar || points <= MANY_POINTS {
        return f64::INFINITY;
    }
    let area = scene.surface.length_m * scene.surface.width_m;
    CELL_PER_POINT * (area / points.min(MOST_POINTS) as f64).sqrt()
}

/// The mesh for frequencies up to `max_hz`: elements of an order, in cells that are `cell_fraction` of the usual ones.
///
/// # Errors
/// [`ModelError`]: a frequency out of range, or too many unknowns.
#[allow(
    clippy::cast_precision_loss,
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "`as` saturates"
)]
pub(super) fn choose_fineness(
    scene: &Scene,
    order: usize,
    cell_fraction: f64,
    max_hz: f64,
) -> Result<Fineness, ModelError> {
    if !(max_hz > 0.0 && max_hz <= MAX_HZ) {
        return Err(ModelError::Frequency { what: "highest frequency", value: max_hz, min: 0.0, max: MAX_HZ });
    }
    let (length, width) = (scene.surface.length_m, scene.surface.width_m);
    let omega = std::f64::consts::TAU * max_hz;
    let wavelength = std::f64::consts::TAU
        * (WaveRigidities::find_extremes_and_mean_over_layers_of_scene(scene).least / (omega * omega)).powf(0.25);
    let is_bar = scene.surface.kind == SurfaceKind::Bar;
    let longest = if is_bar { length } else { length.max(width) };
    let cell_m = cell_fraction
        * (longest / LEAST_CELLS)
            .min(wavelength * WAVES_PER_CELL)
            .min(largest_cell_without_crowded_point_forces_m(scene));
    let functions = |side: f64| (side / cell_m).ceil().max(1.0) * (order as f64 - 1.0) + 2.0;
    let unknowns = functions(length) * if is_bar { 1.0 } else { functions(width) };
    if unknowns > MOST_UNKNOWNS as f64 {
        return Err(ModelError::TooFine {
            max_hz,
            wavelength_mm: wavelength * 1e3,
            is_short: wavelength < SHORTEST_WAVE * scene.surface.thickness_m,
            unknowns: unknowns as usize,
            limit: MOST_UNKNOWNS,
        });
    }
    // One layer more with every second order, so that both parts of the error fall together.
    Ok(Fineness { cell_m, order, layers: order.saturating_sub(1) / 2 })
}
