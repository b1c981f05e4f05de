//! Designs with the whole scene's own elements, in three levels, and a bound on what is most wanted.

use super::{EvaluateError, Evaluator, Figures, figures, sag};
use crate::spec::{Drives, Figure, Settings, Wanted};
use era_model::model::levels::Levels;
use era_model::model::{Accuracy, BarePanel};
use era_model::scene::Scene;
use era_planner::study::Maps;
use era_planner::study::weakest::map_g;
use era_planner::table::touched::Touched;
use era_planner::{PlanError, PlanTable, TableOptions, Target};
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

    /// The panel alone, for what is coupled to it: sags, and a finger on one place after the other. `None` where neither is asked for.
    fn bare(&self, scene: &Scene, wanted: &[Wanted]) -> Result<Option<BarePanel>, EvaluateError> {
        let is_needed = scene.finger.is_some() || sag::is_wanted(wanted);
        let build = || BarePanel::build(scene, self.accuracy, self.options.to_hz);
        Ok(is_needed.then(build).transpose()?)
    }

    /// The figures of a scene with this table, and the bound on the relative error of its sags.
    fn figures(
        &self,
        scene: &Scene,
        table: &PlanTable,
        bare: Option<&BarePanel>,
        wanted: &[Wanted],
    ) -> Result<(Figures, Option<f64>), EvaluateError> {
        let fingered = touched(scene, table, bare).map(|touched| (touched, self.options));
        let mut found = figures(table, fingered, wanted)?;
        let bound = match bare.filter(|_| sag::is_wanted(wanted)) {
            Some(panel) => sag::fill(&mut found, wanted, scene, self.options.to_hz, panel)?,
            None => None,
        };
        Ok((found, bound))
    }

    /// The figures of a scene, a bound, and the map of what can be had.
    ///
    /// # Errors
    /// [`EvaluateError`].
    pub fn verified(&self, scene: &Scene, wanted: &[Wanted]) -> Result<Verified, EvaluateError> {
        let table = self.table(scene)?;
        let bare = self.bare(scene, wanted)?;
        let (mut figures, sag_bound) = self.figures(scene, &table, bare.as_ref(), wanted)?;
        let touched = touched(scene, &table, bare.as_ref());
        let (map, known) = match touched {
            None => (map_g(&table).ok_or(PlanError::NoFrequencies)?, None),
            Some(touched) => {
                let maps = Maps::touched(&table, None, touched, self.accuracy, self.options)?;
                (maps.strongest_g, Some(maps.error_bound))
            }
        };
        let least = map.iter().enumerate().filter_map(|(point, peak)| Some((point, (*peak)?)));
        let (weakest, peak) = least.min_by(|a, b| a.1.total_cmp(&b.1)).ok_or(PlanError::NoFrequencies)?;
        let (x_m, y_m) = table.grid.place_m(weakest);
        let bound = match known {
            // The strongest drive there is the plan for more than there is.
            None => table.plan(&[Target { x_m, y_m, intensity_g: Some(ALL_THERE_IS_G) }])?.error_bound,
            Some(bounds) => bounds.get(weakest).copied().flatten(),
        };
        let is_bounded = |wanted: &Wanted| {
            wanted.figure == Figure::WeakestG
                && (wanted.setting, wanted.drives) == (Settings::EveryTouch, Drives::Distinct)
        };
        if touched.is_some() {
            // Of the table that the bound is of.
            let of_bound = figures.values.iter_mut().zip(wanted).filter(|(_, wanted)| is_bounded(wanted));
            of_bound.for_each(|(value, _)| *value = peak);
            figures.weakest_mm = figures.weakest_mm.map(|_| [x_m * 1e3, y_m * 1e3]);
        }
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
        let bare = self.bare(scene, wanted)?;
        Ok(self.figures(scene, &self.table(scene)?, bare.as_ref(), wanted)?.0)
    }
}

/// The panel with the scene's finger, where it has one, on one place after the other.
fn touched<'a>(scene: &'a Scene, table: &'a PlanTable, bare: Option<&'a BarePanel>) -> Option<Touched<'a>> {
    bare.filter(|_| scene.finger.is_some()).map(|panel| Touched::new(panel, scene, table))
}
