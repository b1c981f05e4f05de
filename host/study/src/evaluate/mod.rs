//! What a design is worth: figures of a scene.
//!
//! [`Evaluator`] is what a study asks; [`QuickEvaluator`] models what changes, [`ThoroughEvaluator`] the whole scene in three levels, as a plan does.
//! [`parts`] are figures that need no model.

mod figures;
pub mod parts;
mod quick;
mod sag;
mod thorough;

pub use figures::{FingeredScene, compute_plan_table_figures_others_nan};
pub use quick::QuickEvaluator;
pub use thorough::{ThoroughEvaluator, VerifiedFigures};

use crate::spec::WantedFigure;
use era_model::model::ModelError;
use era_model::scene::Scene;
use era_planner::PlanError;
use era_planner::maps::clicks::ClickMapError;
use era_planner::table::touched::TouchedError;
use serde::{Deserialize, Serialize};

/// The figures of a scene.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Figures {
    /// As many as were wanted, in their order.
    pub values: Vec<f64>,
    /// The weakest place in mm, if one was looked for.
    pub weakest_mm: Option<[f64; 2]>,
}

/// Why a scene has no figures.
#[derive(Debug, thiserror::Error)]
pub enum EvaluateError {
    /// It cannot be modelled.
    #[error(transparent)]
    Model(#[from] ModelError),
    /// Its response cannot be computed.
    #[error(transparent)]
    Response(#[from] era_model::response::ResponseError),
    /// It cannot be planned for.
    #[error(transparent)]
    Plan(#[from] PlanError),
    /// Its clicks cannot be designed.
    #[error(transparent)]
    Clicks(#[from] ClickMapError),
    /// Whoever asked does not want it, or not any more.
    #[error("{0}")]
    Refused(String),
    /// A figure has no value.
    #[error("{figure} has no value: {reason}")]
    Figure {
        /// Its column.
        figure: String,
        /// Why.
        reason: &'static str,
    },
}

impl EvaluateError {
    /// Whether it says nothing of the scene, because somebody has stopped the computation ([`era_model::stop::StopRequest`]).
    #[must_use]
    pub const fn is_of_stopped_computation(&self) -> bool {
        matches!(
            self,
            Self::Model(ModelError::Stopped)
                | Self::Plan(PlanError::Stopped)
                | Self::Clicks(ClickMapError::Plan(PlanError::Stopped))
        )
    }
}

impl From<TouchedError> for EvaluateError {
    fn from(error: TouchedError) -> Self {
        match error {
            TouchedError::Model(error) => error.into(),
            TouchedError::Response(error) => error.into(),
        }
    }
}

/// Whoever knows the figures of scenes. Called from many threads at once; the same scene always has the same figures, bit for bit.
pub trait Evaluator: Sync {
    /// The figures of a scene, in the order in which they are wanted.
    ///
    /// # Errors
    /// [`EvaluateError`]: the design fails, and a row of the study says why.
    fn compute_scene_figures(&self, scene: &Scene, wanted: &[WantedFigure]) -> Result<Figures, EvaluateError>;
}
