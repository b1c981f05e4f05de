//! Models of three orders, for answers that are asked for over and over.

use super::bounded::Step;
use super::estimator::Estimator;
use super::grid::expected_unknowns;
use super::panel::{PanelModel, fineness};
use super::{Accuracy, ModelError, ReducedModel};
use crate::scene::Scene;
use std::time::Instant;

/// Reduced models of three levels, for answers that are asked for over and over.
#[derive(Clone, Debug)]
pub struct Levels {
    /// The finest.
    pub fine: ReducedModel,
    /// The next coarser one, and the one before that.
    pub coarser: [ReducedModel; 2],
    /// What makes a bound of their differences.
    pub estimator: Estimator,
    /// The levels, coarsest first; bounds belong to each answer.
    pub steps: Vec<Step>,
}

impl Levels {
    /// About how many unknowns the finest level has, before anything is built.
    ///
    /// # Errors
    /// As [`super::bounded()`], if the mesh would be too fine.
    #[allow(clippy::cast_precision_loss, reason = "about")]
    pub fn expected_unknowns(scene: &Scene, accuracy: Accuracy, max_hz: f64) -> Result<f64, ModelError> {
        Ok(expected_unknowns(scene, fineness(scene, Self::order(accuracy), 1.0, max_hz)?) as f64)
    }

    /// Levels that meet a tolerance for frequencies up to `max_hz`, unless a panel is hardly damped.
    ///
    /// # Errors
    /// As [`super::bounded()`].
    pub fn build(scene: &Scene, accuracy: Accuracy, max_hz: f64) -> Result<Self, ModelError> {
        Self::of_order(scene, Self::order(accuracy), max_hz)
    }

    /// Order of the finest level's elements: one step finer than a first try, as nobody climbs from here.
    pub(super) fn order(accuracy: Accuracy) -> usize {
        accuracy.order() + 2
    }

    /// Levels of elements of `order` (7 and above) and of the orders 2 and 4 below it.
    ///
    /// # Errors
    /// As [`super::bounded()`].
    pub fn of_order(scene: &Scene, order: usize, max_hz: f64) -> Result<Self, ModelError> {
        let mut steps = Vec::new();
        let mut level = |order: usize| -> Result<_, ModelError> {
            let started = Instant::now();
            let fineness = fineness(scene, order, 1.0, max_hz)?;
            let model = PanelModel::with_fineness(scene, fineness)?;
            let reduced = model.reduce(max_hz, &[])?;
            let elapsed_ms = started.elapsed().as_secs_f64() * 1e3;
            steps.push(Step { fineness, parts: model.parts(), dofs: model.dofs(), elapsed_ms, bound: f64::INFINITY });
            Ok((Estimator::new(scene, &model), reduced))
        };
        let (_, coarse) = level(order - 4)?;
        let (_, middle) = level(order - 2)?;
        let (estimator, fine) = level(order)?;
        Ok(Self { fine, coarser: [middle, coarse], estimator, steps })
    }
}
