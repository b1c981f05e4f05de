//! Figures of a scene whose plan table is known.

use super::{EvaluateError, Figures};
use crate::spec::{Figure, FrequencyGrouping, SettingScope, WantedFigure};
use era_planner::perception::level_db;
use era_planner::reach::Measure;
use era_planner::study::rigid;
use era_planner::study::single_frequency::Phases;
use era_planner::study::touched::TouchedReach;
use era_planner::study::weakest::{
    Weakest, every_touch, every_touch_at_one_frequency, every_touch_at_one_frequency_touched, every_touch_touched,
    one_setting,
};
use era_planner::table::touched::Touched;
use era_planner::{PlanError, PlanTable, TableOptions, Target};
use std::borrow::Cow;

/// Part of what can be had at a place at which its contrast is told: so little that no limit changes it, as in maps.
const LITTLE_G: f64 = 1e-6;

/// A scene whose finger is on the place that a figure is about.
#[derive(Clone, Copy, Debug)]
pub struct FingeredScene<'a> {
    /// One place after the other.
    pub touched: Touched<'a>,
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
pub fn compute_figures(
    table: &PlanTable,
    fingered: Option<FingeredScene<'_>>,
    wanted: &[WantedFigure],
) -> Result<Figures, EvaluateError> {
    let mut known = FigureCache { table, fingered, weakest: Vec::new() };
    let values = wanted.iter().map(|wanted| known.compute_figure(wanted)).collect::<Result<_, _>>()?;
    let first = known.weakest.first().map(|(_, _, _, weakest)| [weakest.at_m.0 * 1e3, weakest.at_m.1 * 1e3]);
    Ok(Figures { values, weakest_mm: first })
}

fn find_weakest_place_with_finger(
    table: &PlanTable,
    fingered: FingeredScene<'_>,
    measure: Measure,
) -> Result<Option<Weakest>, EvaluateError> {
    if let Some(known) = fingered.in_g.filter(|_| measure == Measure::G) {
        return Ok(every_touch_touched(table, known));
    }
    let reach = TouchedReach::of(table, fingered.touched, None, measure)?;
    Ok(reach.and_then(|reach| every_touch_touched(table, &reach)))
}

struct FigureCache<'a> {
    table: &'a PlanTable,
    fingered: Option<FingeredScene<'a>>,
    weakest: Vec<(SettingScope, FrequencyGrouping, Measure, Weakest)>,
}

impl FigureCache<'_> {
    fn compute_figure(&mut self, wanted: &WantedFigure) -> Result<f64, EvaluateError> {
        let nothing = |reason| EvaluateError::Figure { figure: wanted.column_name(), reason };
        Ok(match wanted.figure {
            Figure::WeakestG => self.cached_weakest_place(wanted.setting, wanted.drives, Measure::G)?.peak,
            Figure::WeakestDb => {
                let peak = self.cached_weakest_place(wanted.setting, wanted.drives, Measure::Thresholds)?.peak;
                level_db(peak).ok_or_else(|| nothing("nothing moves at the weakest place"))?
            }
            Figure::PowerW => {
                self.cached_weakest_place(wanted.setting, FrequencyGrouping::Distinct, Measure::G)?.power_w
            }
            Figure::VoltageV => {
                self.cached_weakest_place(wanted.setting, FrequencyGrouping::Distinct, Measure::G)?.voltage_v
            }
            Figure::ContrastDb => self.plan_weak_touch(wanted)?.1.predicted.contrast_db,
            Figure::RiseMs => {
                let (table, plan) = self.plan_weak_touch(wanted)?;
                let rise = era_planner::report::compute_times(&table, &plan).reaches_90_ms;
                rise.ok_or_else(|| nothing("the motion never settles, or cannot be followed"))?
            }
            Figure::RigidModeHz => rigid::last_rigid_hz(self.table).unwrap_or(0.0),
            Figure::BendingModeHz => rigid::first_bending_hz(self.table)
                .ok_or_else(|| nothing("no mode bends the panel within the model"))?,
            Figure::SagUm | Figure::MassG | Figure::Cost => f64::NAN,
        })
    }

    fn cached_weakest_place(
        &mut self,
        setting: SettingScope,
        drives: FrequencyGrouping,
        measure: Measure,
    ) -> Result<&Weakest, EvaluateError> {
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
                    (SettingScope::One, ..) => one_setting(table, measure),
                    (SettingScope::EveryTouch, None, None) => every_touch(table, measure),
                    (SettingScope::EveryTouch, None, Some(fingered)) => {
                        find_weakest_place_with_finger(table, fingered, measure)?
                    }
                    (SettingScope::EveryTouch, Some(phases), None) => {
                        every_touch_at_one_frequency(table, measure, phases)
                    }
                    (SettingScope::EveryTouch, Some(phases), Some(fingered)) => {
                        every_touch_at_one_frequency_touched(table, fingered.touched, measure, phases)?
                    }
                };
                self.weakest.push((setting, drives, measure, found.ok_or(PlanError::NoFrequencies)?));
                self.weakest.len() - 1
            }
        };
        Ok(&self.weakest[at].3)
    }

    /// The plan for a weak touch at a place, and the table that it is of.
    fn plan_weak_touch(&self, wanted: &WantedFigure) -> Result<(Cow<'_, PlanTable>, era_planner::Plan), EvaluateError> {
        let [x_mm, y_mm] = wanted.at_mm.unwrap_or_default();
        let touch = Target { x_m: x_mm / 1e3, y_m: y_mm / 1e3, intensity_g: Some(LITTLE_G) };
        let table = match self.fingered {
            None => Cow::Borrowed(self.table),
            Some(own) => Cow::Owned(own.touched.table((touch.x_m, touch.y_m), own.options)?),
        };
        let plan = table.plan(&[touch])?;
        Ok((table, plan))
    }
}
