//! Designs of a panel that stays the same: what changes is coupled to it.

use super::{EvaluateError, Evaluator, Figures, figures};
use crate::spec::Wanted;
use era_model::model::{Accuracy, BarePanel};
use era_model::scene::Scene;
use era_planner::{PlanTable, TableOptions};
use std::sync::{Arc, Mutex, PoisonError};

/// Panels that are kept: more than materials or thicknesses that a study usually goes through side by side.
const KEPT: usize = 16;

/// Solves a panel once, and couples to it what each design attaches.
#[derive(Debug)]
pub struct Quick {
    options: TableOptions,
    accuracy: Accuracy,
    /// Those used last at the end.
    panels: Mutex<Vec<(Scene, Arc<BarePanel>)>>,
}

impl Quick {
    /// For a band of frequencies.
    #[must_use]
    pub const fn new(options: TableOptions) -> Self {
        Self { options, accuracy: Accuracy::FAST, panels: Mutex::new(Vec::new()) }
    }

    /// The panel of a scene, whatever is attached to it.
    fn panel(&self, scene: &Scene) -> Result<Arc<BarePanel>, EvaluateError> {
        let is_own = |known: &Scene| {
            known.surface == scene.surface
                && known.patches == scene.patches
                && known.cutouts == scene.cutouts
                && known.edges == scene.edges
        };
        let mut panels = self.panels.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(at) = panels.iter().position(|(known, _)| is_own(known)) {
            let found = panels.remove(at);
            let panel = Arc::clone(&found.1);
            panels.push(found);
            return Ok(panel);
        }
        // Others may build the same at the same time, which gives the same.
        drop(panels);
        let panel = Arc::new(BarePanel::build(scene, self.accuracy, self.options.to_hz)?);
        let mut panels = self.panels.lock().unwrap_or_else(PoisonError::into_inner);
        if panels.len() >= KEPT {
            panels.remove(0);
        }
        panels.push((scene.clone(), Arc::clone(&panel)));
        Ok(panel)
    }
}

impl Evaluator for Quick {
    fn evaluate(&self, scene: &Scene, wanted: &[Wanted]) -> Result<Figures, EvaluateError> {
        let table = PlanTable::build(scene, self.panel(scene)?.coupled(scene)?, self.options)?;
        figures(scene, &table, wanted)
    }
}
