//! Designs with the whole scene's own elements, in three levels, and a bound on what is most wanted.

use super::{EvaluateError, Evaluator, Figures, FingeredScene, compute_plan_table_figures_others_nan, sag};
use crate::spec::{Figure, WantedFigure};
use era_model::model::levels::ReducedLevels;
use era_model::model::{Accuracy, BarePanel, compute_modes_with_error_bounds};
use era_model::scene::Scene;
use era_planner::maps::ReachMaps;
use era_planner::maps::touched::TouchedReach;
use era_planner::maps::weakest::strongest_peak_at_each_grid_point_if_frequencies_usable_g;
use era_planner::reach::Measure;
use era_planner::table::touched::TouchedPanel;
use era_planner::{PlanError, PlanTable, TableOptions, Target};
use serde::{Deserialize, Serialize};

/// Part of the tolerance for which models are made where it is not met at first.
const FINER: f64 = 0.1;
/// More than any panel gives, in g.
const ALL_THERE_IS_G: f64 = 1e6;

/// Solves every scene anew to 1e-3.
#[derive(Clone, Copy, Debug)]
pub struct ThoroughEvaluator {
    options: TableOptions,
    accuracy: Accuracy,
}

/// Figures of a finalist.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct VerifiedFigures {
    /// As they were wanted.
    pub figures: Figures,
    /// Bound on the relative error of the strongest peak at the weakest place, in g, where that is wanted with a setting for every touch; `None` where
    /// there is none.
    pub bound: Option<f64>,
    /// Bounds on the relative errors of the figures, in their order: of the peak in g at the weakest place where each touch has a setting of its
    /// own, of frequencies of modes, and of sags; `None` of all others, and where there is none.
    pub bounds: Vec<Option<f64>>,
    /// At every point of a grid the strongest peak in g, row by row; `None` in cut-outs. Empty where no figure of settings is wanted, and without frequencies
    /// for all actuators.
    pub strongest_g: Vec<Option<f64>>,
    /// Columns of that grid in mm.
    pub x_mm: Vec<f64>,
    /// Its rows in mm.
    pub y_mm: Vec<f64>,
}

impl VerifiedFigures {
    /// Whether the errors of all figures that can have a bound, of those that are `wanted`, are within a tolerance; `None` where one of them has none, and
    /// where there is none of them.
    #[must_use]
    pub fn is_tolerance_met_by_boundable_figures_if_any_and_all_bounded(
        &self,
        wanted: &[WantedFigure],
        tolerance: f64,
    ) -> Option<bool> {
        let each = wanted.iter().zip(&self.figures.values).zip(&self.bounds);
        // A mode that there is not has no frequency.
        let bounded = each.filter(|((wanted, value), _)| wanted.can_have_error_bound() && value.is_finite());
        let bounds: Vec<f64> = bounded.map(|(_, bound)| *bound).collect::<Option<_>>()?;
        Some(bounds.into_iter().reduce(f64::max)? <= tolerance)
    }
}

impl ThoroughEvaluator {
    /// For a band of frequencies.
    #[must_use]
    pub const fn new(options: TableOptions) -> Self {
        Self { options, accuracy: Accuracy::BALANCED }
    }

    /// The relative tolerance that its models are made for.
    #[must_use]
    pub const fn relative_tolerance(&self) -> f64 {
        self.accuracy.relative_tolerance_or_tightest()
    }

    /// The plan table of a scene from models of three levels.
    fn build_plan_table(&self, scene: &Scene) -> Result<PlanTable, EvaluateError> {
        let levels = ReducedLevels::build(scene, self.accuracy, self.options.to_hz)?;
        Ok(PlanTable::from_levels(scene, levels, self.options)?)
    }

    /// The panel alone, for what is coupled to it: sags, and a finger on one place after the other. `None` where neither is asked for.
    fn build_bare_panel_if_finger_or_sag_is_wanted(
        &self,
        scene: &Scene,
        wanted: &[WantedFigure],
    ) -> Result<Option<BarePanel>, EvaluateError> {
        let is_needed = scene.finger.is_some() || sag::is_any_sag_wanted(wanted);
        let build = || BarePanel::build(scene, self.accuracy, self.options.to_hz);
        Ok(is_needed.then(build).transpose()?)
    }

    /// The figures of a scene with this table, and the bound on the relative error of its sags.
    fn compute_figures_and_relative_error_bound_of_sags(
        &self,
        scene: &Scene,
        table: &PlanTable,
        bare: Option<&BarePanel>,
        touched_reach_in_g: Option<&TouchedReach>,
        wanted: &[WantedFigure],
    ) -> Result<(Figures, Option<f64>), EvaluateError> {
        let fingered = touched_panel_if_scene_has_finger(scene, table, bare).map(|touched| FingeredScene {
            touched,
            options: self.options,
            in_g: touched_reach_in_g,
        });
        let mut found = compute_plan_table_figures_others_nan(table, fingered, wanted)?;
        let bound = match bare.filter(|_| sag::is_any_sag_wanted(wanted)) {
            Some(panel) => sag::fill_in_wanted_sags_and_find_relative_error_bound_if_finite(
                &mut found,
                wanted,
                scene,
                self.options.to_hz,
                panel,
            )?,
            None => None,
        };
        Ok((found, bound))
    }

    /// The figures of a scene, a bound, and the map of what can be had. Where a bound is beyond the tolerance, or there is none, all is computed once more with models for a
    /// tenth of it, and what has the smaller bound is told; not with a finger, where that would take minutes.
    ///
    /// # Errors
    /// [`EvaluateError`].
    pub fn compute_figures_refining_once_if_weakest_peak_misses_tolerance(
        &self,
        scene: &Scene,
        wanted: &[WantedFigure],
    ) -> Result<VerifiedFigures, EvaluateError> {
        let found = self.compute_figures_and_bounds_without_refining(scene, wanted)?;
        let is_open = found.bound.is_none_or(|bound| bound > self.relative_tolerance());
        if !is_open
            || !wanted.iter().any(WantedFigure::is_weakest_peak_in_g_of_setting_per_touch_at_distinct_frequencies)
            || scene.finger.is_some()
        {
            return Ok(found);
        }
        let bound = found.bound.unwrap_or(f64::INFINITY);
        let finer = Self { accuracy: Accuracy::from_tolerance(FINER * self.relative_tolerance())?, ..*self };
        // What is there is not lost where finer models are too large.
        let again = finer
            .compute_figures_and_bounds_without_refining(scene, wanted)
            .ok()
            .filter(|again| again.bound.is_some_and(|own| own < bound));
        Ok(again.unwrap_or(found))
    }

    fn compute_figures_and_bounds_without_refining(
        &self,
        scene: &Scene,
        wanted: &[WantedFigure],
    ) -> Result<VerifiedFigures, EvaluateError> {
        let table = self.build_plan_table(scene)?;
        let bare = self.build_bare_panel_if_finger_or_sag_is_wanted(scene, wanted)?;
        // A search at every point, which other figures do without.
        let is_mapped = wanted.iter().any(|wanted| wanted.figure.is_evaluated_at_weakest_place());
        let touched = touched_panel_if_scene_has_finger(scene, &table, bare.as_ref()).filter(|_| is_mapped);
        let reach = match touched {
            None => None,
            Some(touched) => {
                let reach =
                    TouchedReach::compute_at_each_point_if_frequencies_usable(&table, touched, None, Measure::G)?;
                Some((touched, reach.ok_or(PlanError::NoFrequencies)?))
            }
        };
        let in_g = reach.as_ref().map(|(_, reach)| reach);
        let (mut figures, sag_bound) =
            self.compute_figures_and_relative_error_bound_of_sags(scene, &table, bare.as_ref(), in_g, wanted)?;
        let (map, known) = match &reach {
            None if !is_mapped => (Vec::new(), None),
            // Drives at one frequency need no room for several.
            None => (strongest_peak_at_each_grid_point_if_frequencies_usable_g(&table).unwrap_or_default(), None),
            Some((touched, reach)) => {
                let maps = ReachMaps::from_touched_reach_bounding_error_of_weakest_point(
                    &table,
                    reach,
                    *touched,
                    self.accuracy,
                    self.options,
                )?;
                (maps.strongest_g, Some(maps.error_bound))
            }
        };
        let least = map.iter().enumerate().filter_map(|(point, peak)| Some((point, (*peak)?)));
        let weakest = least.min_by(|a, b| a.1.total_cmp(&b.1));
        let is_bounded = WantedFigure::is_weakest_peak_in_g_of_setting_per_touch_at_distinct_frequencies;
        let bound = match (weakest, known) {
            _ if !wanted.iter().any(is_bounded) => None,
            (None, _) => None,
            // The strongest drive there is the plan for more than there is.
            (Some((point, _)), None) => {
                let (x_m, y_m) = table.grid.point_position_m(point);
                table.plan(&[Target { x_m, y_m, intensity_g: Some(ALL_THERE_IS_G) }])?.error_bound
            }
            (Some((point, _)), Some(bounds)) => bounds.get(point).copied().flatten(),
        };
        if let Some((point, peak)) = weakest.filter(|_| touched.is_some()) {
            // Of the table that the bound is of.
            let of_bound = figures.values.iter_mut().zip(wanted).filter(|(_, wanted)| is_bounded(wanted));
            of_bound.for_each(|(value, _)| *value = peak);
            let (x_m, y_m) = table.grid.point_position_m(point);
            figures.weakest_mm = figures.weakest_mm.map(|_| [x_m * 1e3, y_m * 1e3]);
        }
        let bounds = wanted.iter().map(|wanted| match wanted.figure {
            Figure::SagUm => sag_bound,
            _ => bound.filter(|_| is_bounded(wanted)),
        });
        let mut bounds: Vec<Option<f64>> = bounds.collect();
        for (k, _) in wanted.iter().enumerate().filter(|(_, wanted)| wanted.figure.is_mode_frequency()) {
            if let Some((hz, own)) =
                self.find_frequency_hz_and_relative_error_bound_of_mode_near(scene, figures.values[k])
            {
                (figures.values[k], bounds[k]) = (hz, own);
            }
        }
        let mm = |lines: &[f64]| lines.iter().map(|line| line * 1e3).collect();
        let (x_mm, y_mm) = (mm(&table.grid.x_m), mm(&table.grid.y_m));
        Ok(VerifiedFigures { figures, bound, bounds, strongest_g: map, x_mm, y_mm })
    }
}

impl ThoroughEvaluator {
    /// The frequency in Hz of the mode near `near_hz` with the bound on its relative error, as `era modes` tells it; `None` where there is none, or it cannot be
    /// computed: the figure is there without it.
    fn find_frequency_hz_and_relative_error_bound_of_mode_near(
        &self,
        scene: &Scene,
        near_hz: f64,
    ) -> Option<(f64, Option<f64>)> {
        // Above it so that a mesh which puts it a little higher still has it.
        const BESIDE: f64 = 1.05;
        const LEAST_HZ: f64 = 10.0;
        let is_it = |own: f64| (own / near_hz - 1.0).abs() < BESIDE - 1.0;
        if near_hz.is_nan() || near_hz <= 0.0 {
            return None;
        }
        let found = compute_modes_with_error_bounds(scene, self.accuracy, (BESIDE * near_hz).max(LEAST_HZ)).ok()?;
        let all =
            found.answer.iter().zip(&found.bounds).map(|(mode, bound)| (mode.frequency_hz, bound.limit_if_known()));
        let nearest = all.min_by(|a, b| (a.0 - near_hz).abs().total_cmp(&(b.0 - near_hz).abs()));
        nearest.filter(|(own, _)| is_it(*own))
    }
}

impl Evaluator for ThoroughEvaluator {
    fn compute_scene_figures(&self, scene: &Scene, wanted: &[WantedFigure]) -> Result<Figures, EvaluateError> {
        let bare = self.build_bare_panel_if_finger_or_sag_is_wanted(scene, wanted)?;
        Ok(self
            .compute_figures_and_relative_error_bound_of_sags(
                scene,
                &self.build_plan_table(scene)?,
                bare.as_ref(),
                None,
                wanted,
            )?
            .0)
    }
}

/// The panel with the scene's finger, where it has one, on one place after the other.
fn touched_panel_if_scene_has_finger<'a>(
    scene: &'a Scene,
    table: &'a PlanTable,
    bare: Option<&'a BarePanel>,
) -> Option<TouchedPanel<'a>> {
    bare.filter(|_| scene.finger.is_some()).map(|panel| TouchedPanel::new(panel, scene, table))
}
