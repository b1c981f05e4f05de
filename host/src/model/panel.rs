//! The panel model that the rest of the program uses.

use super::assembly::{Assembled, Dashpot, assemble, bar_rigidity, plate_rigidity};
use super::damping::{Damping, same_ratio};
use super::eigen::{Modes, Operator, modes};
use super::reduced::ReducedModel;
use super::rigid::{RigidModes, rigid_modes};
use super::sparse::{Entries, Factor};
use super::{Accuracy, ModelError};
use crate::scene::{Scene, SurfaceDamping, SurfaceKind};
use nalgebra::DMatrix;

/// Most unknowns: a mesh of 200 x 200 cells, which a laptop factors in seconds.
const MOST_UNKNOWNS: usize = 160_000;
/// Highest frequency that a model is built for, in Hz: two hundred times what the skin feels.
const MAX_HZ: f64 = 200_000.0;
/// A reduced model keeps all modes up to this multiple of the highest frequency; what lies above is carried by residual
/// shapes, whose error falls with the fourth power of it (two residual terms).
const MODES_BEYOND: f64 = 2.5;
/// A bar costs next to nothing: it gets this many times the cells of a plate's longer side.
const BAR_CELLS: f64 = 4.0;

/// A mode of the panel with everything attached to it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Mode {
    /// Undamped frequency in Hz; exactly 0 for a motion that nothing holds.
    pub frequency_hz: f64,
    /// Damping ratio: phi' C phi / (2 omega) plus eta phi' K_s phi / (2 omega^2), for a mass-normalised shape phi; 0 for a
    /// rigid mode.
    pub damping_ratio: f64,
}

/// A meshed and factored panel.
#[derive(Debug)]
pub struct PanelModel {
    scene: Scene,
    assembled: Assembled,
    factor: Factor,
    shift: f64,
    /// Modes that the shift is too far from, or that are known in closed form.
    slow: Modes,
    cell_m: f64,
}

impl PanelModel {
    /// Meshes the scene for frequencies up to `max_hz`.
    ///
    /// # Errors
    /// [`ModelError`]: a frequency out of range, a mesh that would be too fine, or matrices that cannot be factored.
    pub fn build(scene: &Scene, accuracy: Accuracy, max_hz: f64) -> Result<Self, ModelError> {
        if !(max_hz > 0.0 && max_hz <= MAX_HZ) {
            return Err(ModelError::Frequency { what: "highest frequency", value: max_hz, min: 0.0, max: MAX_HZ });
        }
        let cell_m = cell_size(scene, accuracy, max_hz)?;
        Self::with_cells(scene, cell_m)
    }

    fn with_cells(scene: &Scene, cell_m: f64) -> Result<Self, ModelError> {
        let assembled = assemble(scene, cell_m)?;
        let shift = shift(scene);
        let factor = shifted(&assembled, shift)?;
        let slow = slow_modes(scene, &assembled, shift)?;
        Ok(Self { scene: scene.clone(), assembled, factor, shift, slow, cell_m })
    }

    /// Number of unknowns.
    #[must_use]
    pub fn dofs(&self) -> usize {
        self.assembled.unknowns()
    }

    /// All modes up to `max_hz`, ascending, rigid ones first.
    ///
    /// # Errors
    /// [`ModelError`] if the iteration does not settle.
    pub fn modes(&self, max_hz: f64) -> Result<Vec<Mode>, ModelError> {
        let found = self.raw_modes(max_hz)?;
        let damping = self.damping(&found.vectors, MODES_BEYOND * max_hz)?;
        // Slow modes are kept whatever was asked for.
        let highest = (std::f64::consts::TAU * max_hz).powi(2);
        Ok(found
            .lambda
            .iter()
            .enumerate()
            .take_while(|(_, lambda)| **lambda <= highest)
            .map(|(i, lambda)| {
                let omega = lambda.sqrt();
                let ratio = damping.viscous[(i, i)] / (2.0 * omega) + damping.structural[(i, i)] / (2.0 * lambda);
                Mode {
                    frequency_hz: omega / std::f64::consts::TAU,
                    damping_ratio: if *lambda > 0.0 { ratio.max(0.0) } else { 0.0 },
                }
            })
            .collect())
    }

    /// A small model for frequencies up to `max_hz`: all modes to 2.5 times that, and residual shapes of the actuators, the
    /// dashpots and `points` (m).
    ///
    /// # Errors
    /// [`ModelError`] if the iteration does not settle.
    pub fn reduce(&self, max_hz: f64, points: &[(f64, f64)]) -> Result<ReducedModel, ModelError> {
        let found = self.raw_modes(MODES_BEYOND * max_hz)?;
        let loads: Vec<_> = self
            .assembled
            .actuators
            .iter()
            .map(|actuator| actuator.force.clone())
            .chain(self.assembled.dashpots.iter().map(|dashpot| dashpot.vector.clone()))
            .chain(points.iter().map(|(x, y)| self.assembled.grid.deflection_at(*x, *y)))
            .collect();
        let (lambda, vectors) = super::reduced::basis(self.operator(), &found, &loads);
        let damping = self.damping(&vectors, MODES_BEYOND * max_hz)?;
        Ok(ReducedModel::new(lambda, vectors, damping, &self.assembled))
    }

    fn operator(&self) -> Operator<'_> {
        Operator { factor: &self.factor, mass: &self.assembled.mass, shift: self.shift }
    }

    fn raw_modes(&self, max_hz: f64) -> Result<Modes, ModelError> {
        modes(self.operator(), &self.slow, (std::f64::consts::TAU * max_hz).powi(2))
    }

    /// The damping of the scene, projected onto the columns of `vectors`; `max_hz` is how far modes are worth computing for it.
    fn damping(&self, vectors: &DMatrix<f64>, max_hz: f64) -> Result<Damping, ModelError> {
        let n = vectors.ncols();
        let mut damping = Damping { viscous: DMatrix::zeros(n, n), structural: DMatrix::zeros(n, n) };
        for Dashpot { vector, coefficient } in &self.assembled.dashpots {
            let along = row_times(vector, vectors);
            damping.viscous += *coefficient * along.transpose() * along;
        }
        match self.scene.surface.damping {
            SurfaceDamping::None => {}
            SurfaceDamping::LossFactor(eta) => {
                damping.structural = eta * self.project(&self.assembled.surface_stiffness, vectors);
            }
            SurfaceDamping::Rayleigh { alpha, beta } => {
                damping.viscous += alpha * self.project(&self.assembled.surface_mass, vectors);
                damping.viscous += beta * self.project(&self.assembled.surface_stiffness, vectors);
            }
            SurfaceDamping::ModalRatio(ratio) => damping.viscous += self.modal_damping(ratio, vectors, max_hz)?,
        }
        Ok(damping)
    }

    /// V' A V for a matrix of the surface, which knows nothing of what rigid motions do.
    fn project(&self, matrix: &super::sparse::Symmetric, vectors: &DMatrix<f64>) -> DMatrix<f64> {
        let surface = vectors.rows(0, matrix.order()).into_owned();
        surface.tr_mul(&matrix.times(&surface))
    }

    /// The same ratio on every mode of the surface with its supports and masses but without ERAs.
    fn modal_damping(&self, ratio: f64, vectors: &DMatrix<f64>, max_hz: f64) -> Result<DMatrix<f64>, ModelError> {
        // The same mesh (its lines follow the attachments, ERAs included) with the ERAs taken off it.
        let mut bare = self.scene.clone();
        for actuator in &mut bare.actuators {
            actuator.mount = crate::scene::Mount::Grounded;
            actuator.moving_mass_kg = 0.0;
            actuator.housing_mass_kg = 0.0;
            actuator.stiffness_n_per_m = 0.0;
            actuator.damping_n_s_per_m = 0.0;
        }
        let supported = Self::with_cells(&bare, self.cell_m)?;
        let found = supported.raw_modes(max_hz)?;
        let surface = vectors.rows(0, supported.dofs()).into_owned();
        Ok(same_ratio(ratio, &supported.assembled, &found, &surface))
    }
}

/// A sparse row times a matrix.
pub(super) fn row_times(row: &[(usize, f64)], matrix: &DMatrix<f64>) -> nalgebra::RowDVector<f64> {
    let mut out = nalgebra::RowDVector::zeros(matrix.ncols());
    for (index, value) in row {
        out += matrix.row(*index) * *value;
    }
    out
}

fn shifted(assembled: &Assembled, shift: f64) -> Result<Factor, ModelError> {
    let mut entries = Entries::default();
    entries.add_all(&assembled.stiffness.entries(), 1.0);
    entries.add_all(&assembled.mass.entries(), shift);
    entries.build(assembled.unknowns())?.factor()
}

/// The modes that shift-invert about `shift` does not know well: free ones, nearly free ones, and slow ones, of heavy
/// masses or on soft springs, by a second factorisation with a shift of their own size.
fn slow_modes(scene: &Scene, assembled: &Assembled, shift: f64) -> Result<Modes, ModelError> {
    let RigidModes { known, slow } = rigid_modes(scene, assembled, shift);
    let Some(slowest) = slow.iter().copied().reduce(f64::min) else { return Ok(known) };
    // Below a billionth of the usual shift K + s M would be indefinite by rounding.
    let own = slowest.max(1e-9 * shift);
    let factor = shifted(assembled, own)?;
    let fastest = slow.iter().copied().fold(0.0, f64::max);
    modes(Operator { factor: &factor, mass: &assembled.mass, shift: own }, &known, fastest)
}

/// Rigidity over mass per area (plate) or length (bar), in m^4/s^2.
fn wave_ratio(scene: &Scene) -> f64 {
    let (surface, density) = (&scene.surface, scene.surface.material.density_kg_m3);
    match surface.kind {
        SurfaceKind::Plate => plate_rigidity(scene) / (density * surface.thickness_m),
        SurfaceKind::Bar => bar_rigidity(scene) / (density * surface.thickness_m * surface.width_m),
    }
}

/// The shift in rad^2/s^2: a quarter of the first bending frequency of the free surface, squared (omega L^2 / sqrt(D/m) =
/// 22.4). Small enough to separate the low modes, large enough that K + s M is definite whatever holds the panel.
fn shift(scene: &Scene) -> f64 {
    let length = scene.surface.length_m.max(scene.surface.width_m);
    (22.4 / (length * length)).powi(2) * wave_ratio(scene) / 16.0
}

fn cell_size(scene: &Scene, accuracy: Accuracy, max_hz: f64) -> Result<f64, ModelError> {
    let (length, width) = (scene.surface.length_m, scene.surface.width_m);
    let omega = std::f64::consts::TAU * max_hz;
    let wavelength = std::f64::consts::TAU * (wave_ratio(scene) / (omega * omega)).powf(0.25);
    let is_bar = scene.surface.kind == SurfaceKind::Bar;
    let longest = if is_bar { length } else { length.max(width) };
    let cells = if is_bar { BAR_CELLS * accuracy.cells() } else { accuracy.cells() };
    let cell_m = (longest / cells).min(wavelength / accuracy.cells_per_wave());
    let across = if is_bar { 0.5 } else { (width / cell_m).max(4.0) };
    let unknowns = 4.0 * (length / cell_m).max(4.0) * across;
    #[allow(
        clippy::cast_precision_loss,
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "`as` saturates"
    )]
    if unknowns > MOST_UNKNOWNS as f64 {
        return Err(ModelError::TooFine {
            max_hz,
            wavelength_mm: wavelength * 1e3,
            unknowns: unknowns as usize,
            limit: MOST_UNKNOWNS,
        });
    }
    Ok(cell_m)
}
