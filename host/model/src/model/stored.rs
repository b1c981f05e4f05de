//! Reduced models as plain numbers, to be kept on disk, and back again.
//!
//! What follows from the scene in no time (the meshes and their functions) is not kept but made again. Everything that is
//! read is looked at before it is used: sizes that agree, numbers that are finite.

use super::bounded::RefinementLevel;
use super::damping::{DampingCoupling, StructuredDamping};
use super::grid::Grid;
use super::levels::ReducedLevels;
use super::{Accuracy, ReducedModel};
use crate::scene::Scene;
use nalgebra::{DMatrix, DVector};
use num_complex::Complex64;
use serde::{Deserialize, Serialize};
use std::sync::Arc;

/// What was read cannot be what was written.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum ImplausibleStore {
    /// A size that does not go with the others.
    #[error("in the file, the size of the data for {what} is {found}, but must be {expected}")]
    Size {
        /// Of what.
        what: &'static str,
        /// As read.
        found: usize,
        /// As it has to be.
        expected: usize,
    },
    /// A number that is infinite or none at all.
    #[error("in the file, the data for {0} contain an impossible value (infinite, NaN or negative)")]
    NotFinite(&'static str),
    /// Something else that does not follow from the scene.
    #[error("in the file, the data for {0} do not agree with the scene")]
    Differs(&'static str),
}

/// Holds a size against the one that goes with the others.
///
/// # Errors
/// [`ImplausibleStore::Size`].
pub fn check_stored_size(what: &'static str, found: usize, expected: usize) -> Result<(), ImplausibleStore> {
    if found == expected { Ok(()) } else { Err(ImplausibleStore::Size { what, found, expected }) }
}

/// A matrix, column by column.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct StoredMatrix {
    rows: usize,
    values: Vec<f64>,
}

impl From<&DMatrix<f64>> for StoredMatrix {
    fn from(matrix: &DMatrix<f64>) -> Self {
        Self { rows: matrix.nrows(), values: matrix.as_slice().to_vec() }
    }
}

impl StoredMatrix {
    /// The matrix, which has to have `rows` x `columns` finite entries.
    ///
    /// # Errors
    /// [`ImplausibleStore`], naming `what`.
    pub fn restore_matrix(
        self,
        what: &'static str,
        rows: usize,
        columns: usize,
    ) -> Result<DMatrix<f64>, ImplausibleStore> {
        check_stored_size(what, self.rows, rows)?;
        let values = check_count_and_finiteness(what, self.values, rows.saturating_mul(columns))?;
        Ok(DMatrix::from_vec(rows, columns, values))
    }
}

/// `count` finite numbers.
///
/// # Errors
/// [`ImplausibleStore`], naming `what`.
pub fn check_count_and_finiteness(
    what: &'static str,
    values: Vec<f64>,
    count: usize,
) -> Result<Vec<f64>, ImplausibleStore> {
    check_stored_size(what, values.len(), count)?;
    if values.iter().all(|value| value.is_finite()) { Ok(values) } else { Err(ImplausibleStore::NotFinite(what)) }
}

/// Complex numbers as pairs of real and imaginary part.
#[must_use]
pub fn complex_to_pairs(values: &DVector<Complex64>) -> Vec<[f64; 2]> {
    values.iter().map(|z| [z.re, z.im]).collect()
}

/// `count` finite complex numbers.
///
/// # Errors
/// [`ImplausibleStore`], naming `what`.
pub fn restore_complex_vector(
    what: &'static str,
    pairs: &[[f64; 2]],
    count: usize,
) -> Result<DVector<Complex64>, ImplausibleStore> {
    check_stored_size(what, pairs.len(), count)?;
    if !pairs.iter().flatten().all(|value| value.is_finite()) {
        return Err(ImplausibleStore::NotFinite(what));
    }
    Ok(DVector::from_iterator(count, pairs.iter().map(|[re, im]| Complex64::new(*re, *im))))
}

#[derive(Clone, Debug, Serialize, Deserialize)]
struct StoredCoupling {
    shape: Vec<f64>,
    viscous: f64,
    structural: f64,
}

#[derive(Clone, Debug, Serialize, Deserialize)]
struct StoredDamping {
    viscous: Vec<f64>,
    structural: Vec<f64>,
    couplings: Vec<StoredCoupling>,
}

impl StoredDamping {
    fn from_structured_damping(structured: &StructuredDamping) -> Self {
        let coupling = |coupling: &DampingCoupling| StoredCoupling {
            shape: coupling.shape.as_slice().to_vec(),
            viscous: coupling.viscous,
            structural: coupling.structural,
        };
        Self {
            viscous: structured.viscous.as_slice().to_vec(),
            structural: structured.structural.as_slice().to_vec(),
            couplings: structured.couplings.iter().map(coupling).collect(),
        }
    }

    fn restore_damping(self, n: usize) -> Result<StructuredDamping, ImplausibleStore> {
        let vector = |values| Ok(DVector::from_vec(check_count_and_finiteness("damping", values, n)?));
        let coupling = |coupling: StoredCoupling| {
            let StoredCoupling { shape, viscous, structural } = coupling;
            check_count_and_finiteness("coupling", vec![viscous, structural], 2)?;
            Ok(DampingCoupling { shape: vector(shape)?, viscous, structural })
        };
        Ok(StructuredDamping {
            viscous: vector(self.viscous)?,
            structural: vector(self.structural)?,
            couplings: self.couplings.into_iter().map(coupling).collect::<Result<_, ImplausibleStore>>()?,
        })
    }
}

/// A [`ReducedModel`] without its mesh.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct StoredModel {
    lambda: Vec<f64>,
    structural: StoredMatrix,
    viscous: StoredMatrix,
    structured: Option<StoredDamping>,
    force: StoredMatrix,
    travel: StoredMatrix,
    shapes: StoredMatrix,
}

impl From<&ReducedModel> for StoredModel {
    fn from(model: &ReducedModel) -> Self {
        Self {
            lambda: model.lambda.as_slice().to_vec(),
            structural: (&model.structural).into(),
            viscous: (&model.viscous).into(),
            structured: model.structured.as_ref().map(StoredDamping::from_structured_damping),
            force: (&model.force).into(),
            travel: (&model.travel).into(),
            shapes: (&*model.shapes).into(),
        }
    }
}

impl StoredModel {
    fn restore_model(self, scene: &Scene, step: &RefinementLevel) -> Result<ReducedModel, ImplausibleStore> {
        let (n, p) = (self.lambda.len(), scene.actuators.len());
        let grid = Grid::new(scene, step.fineness);
        if step.dofs < grid.free {
            return Err(ImplausibleStore::Size { what: "unknowns", found: step.dofs, expected: grid.free });
        }
        Ok(ReducedModel {
            lambda: DVector::from_vec(check_count_and_finiteness("squared frequencies", self.lambda, n)?),
            structural: self.structural.restore_matrix("hysteretic damping", n, n)?,
            viscous: self.viscous.restore_matrix("viscous damping", n, n)?,
            structured: self.structured.map(|damping| damping.restore_damping(n)).transpose()?,
            force: self.force.restore_matrix("forces", n, p)?,
            travel: self.travel.restore_matrix("travel", p, n)?,
            shapes: Arc::new(self.shapes.restore_matrix("mode shapes", n, step.dofs)?),
            grid: Arc::new(grid),
            // Of designs of a bare panel alone, which are not stored.
            local: Vec::new(),
        })
    }
}

/// The coarser models of [`ReducedLevels`] as plain numbers: what tells how wrong answers may be. The finest, from which answers and limits follow, is not kept: whoever
/// could change the file would change them.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct StoredLevels {
    /// Finer first.
    coarser: [StoredModel; 2],
    steps: Vec<RefinementLevel>,
}

impl StoredLevels {
    /// The same of models that have been taken apart; `steps` are coarsest first.
    #[must_use]
    pub fn new(coarser: &[ReducedModel; 2], steps: &[RefinementLevel]) -> Self {
        Self { coarser: [(&coarser[0]).into(), (&coarser[1]).into()], steps: steps.to_vec() }
    }

    /// The levels that [`ReducedLevels::build`] makes of the same, the finest of them computed from the scene.
    ///
    /// # Errors
    /// [`ImplausibleStore`], if they cannot be that.
    pub fn restore_coarser_and_build_finest_levels(
        self,
        scene: &Scene,
        accuracy: Accuracy,
        max_hz: f64,
    ) -> Result<ReducedLevels, ImplausibleStore> {
        check_stored_size("the meshes", self.steps.len(), self.coarser.len() + 1)?;
        let meshes = ReducedLevels::choose_three_meshes_finest_first(scene, accuracy, max_hz)
            .map_err(|_| ImplausibleStore::Differs("mesh"))?;
        if self.steps.iter().rev().zip(meshes).any(|(step, mesh)| step.fineness != mesh) {
            return Err(ImplausibleStore::Differs("mesh"));
        }
        let (estimator, fine) = ReducedLevels::build_finest_level_with_error_estimator(scene, meshes[0], max_hz)
            .map_err(|_| ImplausibleStore::Differs("model"))?;
        let [middle, coarse] = self.coarser;
        let coarser = [middle.restore_model(scene, &self.steps[1])?, coarse.restore_model(scene, &self.steps[0])?];
        Ok(ReducedLevels { fine, coarser, estimator, steps: self.steps })
    }
}
