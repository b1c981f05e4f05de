//! Figures of a scene whose plan table is known.

use super::{EvaluateError, Figures};
use crate::spec::{Figure, FrequencyGrouping, SettingScope, WantedFigure};
use era_planner::effects::{EffectRequest, NamedEffect};
use era_planner::maps::single_frequency::Phases;
use era_planner::maps::touched::TouchedReach;
use era_planner::maps::weakest::{
    WeakestPlace, find_weakest_place_of_touched_reach,
    weakest_place_with_one_frequency_per_place_if_frequencies_usable,
    weakest_place_with_one_setting_for_surface_if_frequencies_usable,
    weakest_place_with_setting_per_place_if_frequencies_usable,
    weakest_touched_place_with_one_frequency_per_place_if_frequencies_usable,
};
use era_planner::maps::{ClickMap, rigid};
use era_planner::perception::threshold_multiple_to_db_unless_at_rest;
use era_planner::reach::Measure;
use era_planner::table::touched::TouchedPanel;
use era_planner::{PlanError, PlanTable, TableOptions, Target};
use std::borrow::Cow;

/// Part of what can be had at a place at which its contrast is told: so little that no limit changes it, as in maps.
const LITTLE_G: f64 = 1e-6;
/// Why clicks have no sound.
const NO_CLICK_OF_WINDOWS: &str = "the sound is computed only for a click that consists of single windows of the \
                                   electrodes, but at no place could such a click be designed";

/// A scene whose finger is on the place that a figure is about.
#[derive(Clone, Copy, Debug)]
pub struct FingeredScene<'a> {
    /// One place after the other.
    pub touched: TouchedPanel<'a>,
    /// Frequencies of plans.
    pub options: TableOptions,
    /// What can be had in g, if that is known.
    pub in_g: Option<&'a TouchedReach>,
}

/// The figures of a scene, in the order in which they are wanted. Those of [`super::parts`] and sags are NaN. `table` is that of the panel that
/// nothing touches.
///
/// # Errors
/// [`EvaluateError`].
pub fn compute_plan_table_figures_others_nan(
    table: &PlanTable,
    fingered: Option<FingeredScene<'_>>,
    wanted: &[WantedFigure],
) -> Result<Figures, EvaluateError> {
    let mut known = FigureCache { table, fingered, weakest: Vec::new(), clicks: None };
    let values = wanted
        .iter()
        .map(|wanted| known.compute_figure_or_nan_for_sag_mass_and_cost(wanted))
        .collect::<Result<_, _>>()?;
    let first = known.weakest.first().map(|(_, _, _, weakest)| [weakest.at_m.0 * 1e3, weakest.at_m.1 * 1e3]);
    Ok(Figures { values, weakest_mm: first })
}

fn find_weakest_place_with_finger_on_each_point_if_frequencies_usable(
    table: &PlanTable,
    fingered: FingeredScene<'_>,
    measure: Measure,
) -> Result<Option<WeakestPlace>, EvaluateError> {
    if let Some(known) = fingered.in_g.filter(|_| measure == Measure::G) {
        return Ok(find_weakest_place_of_touched_reach(table, known));
    }
    let reach = TouchedReach::compute_at_each_point_if_frequencies_usable(table, fingered.touched, None, measure)?;
    Ok(reach.and_then(|reach| find_weakest_place_of_touched_reach(table, &reach)))
}

struct FigureCache<'a> {
    table: &'a PlanTable,
    fingered: Option<FingeredScene<'a>>,
    weakest: Vec<(SettingScope, FrequencyGrouping, Measure, WeakestPlace)>,
    clicks: Option<ClickMap>,
}

impl FigureCache<'_> {
    fn compute_figure_or_nan_for_sag_mass_and_cost(&mut self, wanted: &WantedFigure) -> Result<f64, EvaluateError> {
        let nothing = |reason| EvaluateError::Figure { figure: wanted.column_name(), reason };
        Ok(match wanted.figure {
            Figure::WeakestG => self.get_or_search_weakest_place(wanted.setting, wanted.drives, Measure::G)?.peak,
            Figure::WeakestDb => {
                let peak = self.get_or_search_weakest_place(wanted.setting, wanted.drives, Measure::Thresholds)?.peak;
                threshold_multiple_to_db_unless_at_rest(peak).ok_or_else(|| {
                    nothing("the actuators cannot move the surface at the place with the weakest peak")
                })?
            }
            Figure::PowerW => {
                self.get_or_search_weakest_place(wanted.setting, FrequencyGrouping::Distinct, Measure::G)?.power_w
            }
            Figure::VoltageV => {
                self.get_or_search_weakest_place(wanted.setting, FrequencyGrouping::Distinct, Measure::G)?.voltage_v
            }
            Figure::ContrastDb => {
                self.plan_weak_touch_at_figure_place_returning_table_with_finger_there(wanted)?.1.predicted.contrast_db
            }
            Figure::RiseMs => {
                let (table, plan) = self.plan_weak_touch_at_figure_place_returning_table_with_finger_there(wanted)?;
                let rise =
                    era_planner::report::compute_rise_and_decay_times_at_first_target(&table, &plan).reaches_90_ms;
                rise.ok_or_else(|| nothing("the motion does not settle, or cannot be computed"))?
            }
            Figure::CrispShare => self.get_or_compute_click_map()?.crisp_share(),
            Figure::ClickWeakestG => self
                .get_or_compute_click_map()?
                .find_weakest_place()
                .map(|place| place.peak_g)
                .ok_or_else(|| nothing("all places of the map are in cut-outs"))?,
            Figure::ClickSoundDb => self
                .get_or_compute_click_map()?
                .sound_db_of_mean_square_velocity_over_places_if_any()
                .ok_or_else(|| nothing(NO_CLICK_OF_WINDOWS))?,
            Figure::RigidModeHz => rigid::last_rigid_mode_moving_surface_if_any_hz(self.table).unwrap_or(0.0),
            Figure::BendingModeHz => rigid::first_bending_mode_moving_surface_if_any_hz(self.table)
                .ok_or_else(|| nothing("the model contains no mode that bends the panel"))?,
            Figure::SagUm | Figure::MassG | Figure::Cost => f64::NAN,
        })
    }

    /// Clicks of the standard strength over the surface.
    fn get_or_compute_click_map(&mut self) -> Result<&ClickMap, EvaluateError> {
        let map = match self.clicks.take() {
            Some(map) => map,
            None => ClickMap::compute(self.table, EffectRequest::with_defaults(NamedEffect::Click), None)?,
        };
        Ok(self.clicks.insert(map))
    }

    fn get_or_search_weakest_place(
        &mut self,
        setting: SettingScope,
        drives: FrequencyGrouping,
        measure: Measure,
    ) -> Result<&WeakestPlace, EvaluateError> {
        let at = self.weakest.iter().position(|(own, by, unit, _)| (*own, *by, *unit) == (setting, drives, measure));
        let at = match at {
            Some(at) => at,
            None => {
                let phases = match drives {
                    FrequencyGrouping::Distinct => None,
                    FrequencyGrouping::OneFrequency => Some(Phases::Chosen),
                    FrequencyGrouping::InPhase => Some(Phases::Equal),
                };
                let table = self.table;
                let found = match (setting, phases, self.fingered) {
                    (SettingScope::One, ..) => {
                        weakest_place_with_one_setting_for_surface_if_frequencies_usable(table, measure)
                    }
                    (SettingScope::EveryTouch, None, None) => {
                        weakest_place_with_setting_per_place_if_frequencies_usable(table, measure)
                    }
                    (SettingScope::EveryTouch, None, Some(fingered)) => {
                        find_weakest_place_with_finger_on_each_point_if_frequencies_usable(table, fingered, measure)?
                    }
                    (SettingScope::EveryTouch, Some(phases), None) => {
                        weakest_place_with_one_frequency_per_place_if_frequencies_usable(table, measure, phases)
                    }
                    (SettingScope::EveryTouch, Some(phases), Some(fingered)) => {
                        weakest_touched_place_with_one_frequency_per_place_if_frequencies_usable(
                            table,
                            fingered.touched,
                            measure,
                            phases,
                        )?
                    }
                };
                self.weakest.push((setting, drives, measure, found.ok_or(PlanError::NoFrequencies)?));
                self.weakest.len() - 1
            }
        };
        Ok(&self.weakest[at].3)
    }

    /// The plan for a weak touch at a place, and the table that it is of.
    fn plan_weak_touch_at_figure_place_returning_table_with_finger_there(
        &self,
        wanted_figure: &WantedFigure,
    ) -> Result<(Cow<'_, PlanTable>, era_planner::Plan), EvaluateError> {
        let [x_mm, y_mm] = wanted_figure.at_mm.unwrap_or_default();
        let touch = Target { x_m: x_mm / 1e3, y_m: y_mm / 1e3, intensity_g: Some(LITTLE_G) };
        let table = match self.fingered {
            None => Cow::Borrowed(self.table),
            Some(own) => {
                Cow::Owned(own.touched.build_plan_table_at_touched_place((touch.x_m, touch.y_m), own.options)?)
            }
        };
        let plan = table.plan(&[touch])?;
        Ok((table, plan))
    }
}
