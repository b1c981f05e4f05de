//! Designs with the whole scene's own elements, in three levels, and a bound on what is most wanted.

use super::{EvaluateError, Evaluator, Figures, figures, sag};
use crate::spec::{Drives, Figure, Settings, Wanted};
use era_model::model::levels::Levels;
use era_model::model::{Accuracy, BarePanel};
use era_model::scene::Scene;
use era_planner::{PlanTable, TableOptions, Target};
use serde::{Deserialize, Serialize};

/// More than any panel gives, in g.
const ALL_THERE_IS_G: f64 = 1e6;

/// Solves every scene anew to 1e-3.
#[derive(Clone, Copy, Debug)]
pub struct Thorough {
    options: TableOptions,
    accuracy: Accuracy,
}

/// Figures of a finalist.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Verified {
    /// As they were wanted.
    pub figures: Figures,
    /// Bound on the relative error of the peak at the weakest place; `None` where there is none.
    pub bound: Option<f64>,
    /// Bounds on the relative errors of the figures, in their order: of the peak in g at the weakest place where each touch has a setting of its
    /// own, and of sags; `None` of all others, and where there is none.
    pub bounds: Vec<Option<f64>>,
    /// At every point of a grid the strongest peak in g, row by row; `None` in cut-outs.
    pub strongest_g: Vec<Option<f64>>,
    /// Columns of that grid in mm.
    pub x_mm: Vec<f64>,
    /// Its rows.
    pub y_mm: Vec<f64>,
}

impl Thorough {
    /// For a band of frequencies.
    #[must_use]
    pub const fn new(options: TableOptions) -> Self {
        Self { options, accuracy: Accuracy::BALANCED }
    }

    /// The tolerance that its models are made for.
    #[must_use]
    pub const fn tolerance(&self) -> f64 {
        self.accuracy.value()
    }

    fn table(&self, scene: &Scene) -> Result<PlanTable, EvaluateError> {
        let levels = Levels::build(scene, self.accuracy, self.options.to_hz)?;
        Ok(PlanTable::with_levels(scene, levels, self.options)?)
    }

    /// The figures of a scene with this table, and the bound on the relative error of its sags.
    fn figures(
        &self,
        scene: &Scene,
        table: &PlanTable,
        wanted: &[Wanted],
    ) -> Result<(Figures, Option<f64>), EvaluateError> {
        let mut found = figures(table, wanted)?;
        let bound = match sag::is_wanted(wanted) {
            true => {
                let panel = BarePanel::build(scene, self.accuracy, self.options.to_hz)?;
                sag::fill(&mut found, wanted, scene, self.options.to_hz, &panel)?
            }
            false => None,
        };
        Ok((found, bound))
    }

    /// The figures of a scene, a bound, and the map of what can be had.
    ///
    /// # Errors
    /// [`EvaluateError`].
    pub fn verified(&self, scene: &Scene, wanted: &[Wanted]) -> Result<Verified, EvaluateError> {
        let table = self.table(scene)?;
        let (figures, sag_bound) = self.figures(scene, &table, wanted)?;
        let map = era_planner::study::weakest::map_g(&table).ok_or(era_planner::PlanError::NoFrequencies)?;
        let columns = table.grid.x_m.len().max(1);
        let least = map.iter().enumerate().filter_map(|(point, peak)| Some((point, (*peak)?)));
        let weakest = least.min_by(|a, b| a.1.total_cmp(&b.1)).map_or(0, |(point, _)| point);
        // The strongest drive there is the plan for more than there is.
        let touch = Target {
            x_m: table.grid.x_m[weakest % columns],
            y_m: table.grid.y_m[weakest / columns],
            intensity_g: Some(ALL_THERE_IS_G),
        };
        let bound = table.plan(&[touch])?.error_bound;
        let is_bounded = |wanted: &Wanted| {
            wanted.figure == Figure::WeakestG
                && (wanted.setting, wanted.drives) == (Settings::EveryTouch, Drives::Distinct)
        };
        let bounds = wanted.iter().map(|wanted| match wanted.figure {
            Figure::SagUm => sag_bound,
            _ => bound.filter(|_| is_bounded(wanted)),
        });
        let bounds = bounds.collect();
        let mm = |lines: &[f64]| lines.iter().map(|line| line * 1e3).collect();
        let (x_mm, y_mm) = (mm(&table.grid.x_m), mm(&table.grid.y_m));
        Ok(Verified { figures, bound, bounds, strongest_g: map, x_mm, y_mm })
    }
}

impl Evaluator for Thorough {
    fn evaluate(&self, scene: &Scene, wanted: &[Wanted]) -> Result<Figures, EvaluateError> {
        Ok(self.figures(scene, &self.table(scene)?, wanted)?.0)
    }
}
