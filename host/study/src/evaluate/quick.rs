//! Designs of a panel that stays the same: what changes is coupled to it.

use super::{EvaluateError, Evaluator, Figures, FingeredScene, compute_plan_table_figures_others_nan, sag};
use crate::spec::{Figure, WantedFigure};
use era_model::scene::Scene;
use era_planner::perception::threshold_multiple_to_db_unless_at_rest;
use era_planner::quick::{QuickError, QuickPanel};
use era_planner::reach::Measure;
use era_planner::table::touched::TouchedPanel;
use era_planner::{PlanTable, TableOptions};
use std::sync::{Arc, Mutex, PoisonError};

/// Panels that are kept: more than materials or thicknesses that a study usually goes through side by side.
const KEPT: usize = 16;

/// Solves a panel once, and couples to it what each design attaches. Where no more than the weakest place with a setting for every
/// touch is wanted, that is found without a plan table.
#[derive(Debug)]
pub struct QuickEvaluator {
    options: TableOptions,
    /// Those used last at the end.
    panels: Mutex<Vec<Arc<QuickPanel>>>,
}

impl QuickEvaluator {
    /// For a band of frequencies.
    #[must_use]
    pub const fn new(options: TableOptions) -> Self {
        Self { options, panels: Mutex::new(Vec::new()) }
    }

    /// The panel of a scene, whatever is attached to it.
    fn get_or_build_quick_panel(&self, scene: &Scene) -> Result<Arc<QuickPanel>, EvaluateError> {
        let mut panels = self.panels.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(at) = panels.iter().position(|known| known.bare_panel().is_panel_of_design(scene)) {
            let found = panels.remove(at);
            panels.push(Arc::clone(&found));
            return Ok(found);
        }
        // Others may build the same at the same time, which gives the same.
        drop(panels);
        let panel = Arc::new(QuickPanel::new(scene, self.options)?);
        let mut panels = self.panels.lock().unwrap_or_else(PoisonError::into_inner);
        if panels.len() >= KEPT {
            panels.remove(0);
        }
        panels.push(Arc::clone(&panel));
        Ok(panel)
    }
}

impl Evaluator for QuickEvaluator {
    fn compute_scene_figures(&self, scene: &Scene, wanted: &[WantedFigure]) -> Result<Figures, EvaluateError> {
        let panel = self.get_or_build_quick_panel(scene)?;
        let mut found = match wanted.iter().all(WantedFigure::needs_no_plan_table) {
            true => compute_weakest_peak_figures_others_nan(&panel, scene, wanted)?,
            false => {
                let table = PlanTable::build(scene, panel.bare_panel().couple_to_design(scene)?, self.options)?;
                let touched = scene.finger.map(|_| TouchedPanel::new(panel.bare_panel(), scene, &table));
                let fingered = touched.map(|touched| FingeredScene { touched, options: self.options, in_g: None });
                compute_plan_table_figures_others_nan(&table, fingered, wanted)?
            }
        };
        if sag::is_any_sag_wanted(wanted) {
            sag::fill_in_wanted_sags_and_find_relative_error_bound_if_finite(
                &mut found,
                wanted,
                scene,
                self.options.to_hz,
                panel.bare_panel(),
            )?;
        }
        Ok(found)
    }
}

/// Figures that need no plan table; sags and those of [`super::parts`] are NaN.
fn compute_weakest_peak_figures_others_nan(
    panel: &QuickPanel,
    scene: &Scene,
    wanted: &[WantedFigure],
) -> Result<Figures, EvaluateError> {
    let mut found = Figures { values: Vec::with_capacity(wanted.len()), weakest_mm: None };
    for wanted in wanted {
        let measure = match wanted.figure {
            Figure::WeakestG => Measure::G,
            Figure::WeakestDb => Measure::Thresholds,
            _ => {
                found.values.push(f64::NAN);
                continue;
            }
        };
        let weakest = panel.find_place_of_least_achievable_peak(scene, measure)?;
        found.weakest_mm = found.weakest_mm.or(Some([weakest.at_m.0 * 1e3, weakest.at_m.1 * 1e3]));
        found.values.push(match measure {
            Measure::G => weakest.peak,
            Measure::Thresholds => {
                threshold_multiple_to_db_unless_at_rest(weakest.peak).ok_or_else(|| EvaluateError::Figure {
                    figure: wanted.column_name(),
                    reason: "the actuators cannot move the surface at the place with the weakest peak",
                })?
            }
        });
    }
    Ok(found)
}

impl From<QuickError> for EvaluateError {
    fn from(error: QuickError) -> Self {
        match error {
            QuickError::Model(error) => error.into(),
            QuickError::Response(error) => error.into(),
            QuickError::Plan(error) => error.into(),
        }
    }
}
