//! One design of a study, and what came of it.

use crate::evaluate::Figures;
use crate::space::Design;
use serde::{Deserialize, Serialize};

/// What came of a design.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub enum DesignOutcome {
    /// Its figures, in the study's order.
    Found {
        /// With everything as it is meant to be.
        figures: Figures,
        /// The least of each over all samples of what may be off; empty if nothing may.
        low: Vec<f64>,
        /// The most of each.
        high: Vec<f64>,
    },
    /// Why it has none.
    Failed(String),
}

/// One design.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct DesignRow {
    /// Where it is in the unit cube; empty for the scene as it is in its file.
    pub point: Vec<f64>,
    /// What it is.
    pub design: Design,
    /// What came of it.
    pub outcome: DesignOutcome,
}

impl DesignRow {
    /// Its figures; `None` if it failed.
    #[must_use]
    pub const fn figures_unless_failed(&self) -> Option<&Figures> {
        match &self.outcome {
            DesignOutcome::Found { figures, .. } => Some(figures),
            DesignOutcome::Failed(_) => None,
        }
    }

    /// Least and most of a figure over the samples of what may be off.
    #[must_use]
    pub fn least_and_most_of_figure_over_samples_unless_failed(&self, figure_index: usize) -> Option<(f64, f64)> {
        match &self.outcome {
            DesignOutcome::Found { figures, low, high } => {
                let own = *figures.values.get(figure_index)?;
                Some((low.get(figure_index).copied().unwrap_or(own), high.get(figure_index).copied().unwrap_or(own)))
            }
            DesignOutcome::Failed(_) => None,
        }
    }
}
