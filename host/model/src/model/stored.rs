//! Reduced models as plain numbers, to be kept on disk, and back again.
//!
//! What follows from the scene in no time (the meshes and their functions) is not kept but made again. Everything that is
//! read is looked at before it is used: sizes that agree, numbers that are finite.

use super::bounded::Step;
use super::damping::{Coupling, Structured};
use super::grid::Grid;
use super::levels::Levels;
use super::{Accuracy, ReducedModel};
use crate::scene::Scene;
use nalgebra::{DMatrix, DVector};
use num_complex::Complex64;
use serde::{Deserialize, Serialize};
use std::sync::Arc;

/// What was read cannot be what was written.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum Implausible {
    /// A size that does not go with the others.
    #[error("{what}: {found} instead of {expected}")]
    Size {
        /// Of what.
        what: &'static str,
        /// As read.
        found: usize,
        /// As it has to be.
        expected: usize,
    },
    /// A number that is infinite or none at all.
    #[error("{0}: a number is not finite")]
    NotFinite(&'static str),
    /// Something else that does not follow from the scene.
    #[error("{0} differs from what the scene gives")]
    Differs(&'static str),
}

/// Holds a size against the one that goes with the others.
///
/// # Errors
/// [`Implausible::Size`].
pub fn expect_size(what: &'static str, found: usize, expected: usize) -> Result<(), Implausible> {
    if found == expected { Ok(()) } else { Err(Implausible::Size { what, found, expected }) }
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
    /// [`Implausible`], naming `what`.
    pub fn restore(self, what: &'static str, rows: usize, columns: usize) -> Result<DMatrix<f64>, Implausible> {
        expect_size(what, self.rows, rows)?;
        let values = numbers(what, self.values, rows.saturating_mul(columns))?;
        Ok(DMatrix::from_vec(rows, columns, values))
    }
}

/// `count` finite numbers.
///
/// # Errors
/// [`Implausible`], naming `what`.
pub fn numbers(what: &'static str, values: Vec<f64>, count: usize) -> Result<Vec<f64>, Implausible> {
    expect_size(what, values.len(), count)?;
    if values.iter().all(|value| value.is_finite()) { Ok(values) } else { Err(Implausible::NotFinite(what)) }
}

/// Complex numbers as pairs.
#[must_use]
pub fn pairs(values: &DVector<Complex64>) -> Vec<[f64; 2]> {
    values.iter().map(|z| [z.re, z.im]).collect()
}

/// `count` finite complex numbers.
///
/// # Errors
/// [`Implausible`], naming `what`.
pub fn complex(what: &'static str, pairs: &[[f64; 2]], count: usize) -> Result<DVector<Complex64>, Implausible> {
    expect_size(what, pairs.len(), count)?;
    if !pairs.iter().flatten().all(|value| value.is_finite()) {
        return Err(Implausible::NotFinite(what));
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
    fn of(structured: &Structured) -> Self {
        let coupling = |coupling: &Coupling| StoredCoupling {
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

    fn restore(self, n: usize) -> Result<Structured, Implausible> {
        let vector = |values| Ok(DVector::from_vec(numbers("damping", values, n)?));
        let coupling = |coupling: StoredCoupling| {
            let StoredCoupling { shape, viscous, structural } = coupling;
            numbers("coupling", vec![viscous, structural], 2)?;
            Ok(Coupling { shape: vector(shape)?, viscous, structural })
        };
        Ok(Structured {
            viscous: vector(self.viscous)?,
            structural: vector(self.structural)?,
            couplings: self.couplings.into_iter().map(coupling).collect::<Result<_, Implausible>>()?,
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
            structured: model.structured.as_ref().map(StoredDamping::of),
            force: (&model.force).into(),
            travel: (&model.travel).into(),
            shapes: (&*model.shapes).into(),
        }
    }
}

impl StoredModel {
    fn restore(self, scene: &Scene, step: &Step) -> Result<ReducedModel, Implausible> {
        let (n, p) = (self.lambda.len(), scene.actuators.len());
        let grid = Grid::new(scene, step.fineness);
        if step.dofs < grid.free {
            return Err(Implausible::Size { what: "unknowns", found: step.dofs, expected: grid.free });
        }
        Ok(ReducedModel {
            lambda: DVector::from_vec(numbers("squared frequencies", self.lambda, n)?),
            structural: self.structural.restore("hysteretic damping", n, n)?,
            viscous: self.viscous.restore("viscous damping", n, n)?,
            structured: self.structured.map(|damping| damping.restore(n)).transpose()?,
            force: self.force.restore("forces", n, p)?,
            travel: self.travel.restore("travel", p, n)?,
            shapes: Arc::new(self.shapes.restore("mode shapes", n, step.dofs)?),
            grid: Arc::new(grid),
            // Of designs of a bare panel alone, which are not stored.
            local: Vec::new(),
        })
    }
}

/// The coarser models of [`Levels`] as plain numbers: what tells how wrong answers may be. The finest, from which answers and limits follow, is not kept: whoever
/// could change the file would change them.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct StoredLevels {
    /// Finer first.
    coarser: [StoredModel; 2],
    steps: Vec<Step>,
}

impl StoredLevels {
    /// The same of models that have been taken apart; `steps` are coarsest first.
    #[must_use]
    pub fn new(coarser: &[ReducedModel; 2], steps: &[Step]) -> Self {
        Self { coarser: [(&coarser[0]).into(), (&coarser[1]).into()], steps: steps.to_vec() }
    }

    /// The levels that [`Levels::build`] makes of the same, the finest of them computed from the scene.
    ///
    /// # Errors
    /// [`Implausible`], if they cannot be that.
    pub fn restore(self, scene: &Scene, accuracy: Accuracy, max_hz: f64) -> Result<Levels, Implausible> {
        expect_size("levels", self.steps.len(), self.coarser.len() + 1)?;
        let meshes = Levels::meshes(scene, accuracy, max_hz).map_err(|_| Implausible::Differs("mesh"))?;
        if self.steps.iter().rev().zip(meshes).any(|(step, mesh)| step.fineness != mesh) {
            return Err(Implausible::Differs("mesh"));
        }
        let (estimator, fine) =
            Levels::build_finest(scene, meshes[0], max_hz).map_err(|_| Implausible::Differs("model"))?;
        let [middle, coarse] = self.coarser;
        let coarser = [middle.restore(scene, &self.steps[1])?, coarse.restore(scene, &self.steps[0])?];
        Ok(Levels { fine, coarser, estimator, steps: self.steps })
    }
}
