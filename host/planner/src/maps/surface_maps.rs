//! Reach maps: what can be had at every point of the surface.

use super::strongest::{StrongestDrive, strongest_drive_at_each_point_unless_stopped};
use super::touched::TouchedReach;
use crate::model::{Accuracy, Bound};
use crate::plan::bound::bound_relative_peak_error_of_each_setting_at_its_point;
use crate::quick::QuickError;
use crate::reach::Measure;
use crate::reach::ReachSpace;
use crate::stop::StopRequest;
use crate::table::PlanTable;
use crate::table::touched::TouchedPanel;
use crate::table::{PointView, Region};
use crate::{PlanError, TableOptions, Target};
use rayon::prelude::*;
use serde::Serialize;
use std::fmt::Write;

/// Part of the strongest peak at which the most contrasted is asked for: so little that no limit changes it. At a hundredth one does
/// where an ERA beside a clamped edge shakes the rest of the panel so little that all of its force would go first.
const LITTLE: f64 = 1e-6;

/// What can be had at every point of the table's grid; `None` in cut-outs, and outside the region that was asked for.
#[derive(Clone, Debug, Serialize)]
pub struct ReachMaps {
    /// Columns in mm.
    pub x_mm: Vec<f64>,
    /// Rows in mm.
    pub y_mm: Vec<f64>,
    /// The actuators' ids, in the order of the frequencies below.
    pub actuators: Vec<String>,
    /// Row by row: the strongest peak in g, of drives at distinct frequencies within all limits.
    pub strongest_g: Vec<Option<f64>>,
    /// Row by row: the frequency of each actuator in Hz for that.
    pub strongest_hz: Vec<Option<Vec<f64>>>,
    /// Row by row: upper bound on the relative error of the strongest peak, its forces as they are; `None` where there is none.
    pub error_bound: Vec<Option<f64>>,
    /// Row by row: contrast in dB of the drives that shake the rest least for a weak peak at the point; `None` with a finger.
    pub contrast_db: Vec<Option<f64>>,
    /// Row by row: the frequency of each actuator in Hz for that.
    pub contrast_hz: Vec<Option<Vec<f64>>>,
}

impl ReachMaps {
    /// The maps of a table, over all of the surface or a region of it.
    ///
    /// # Errors
    /// As a plan for a point has; [`PlanError::NoFrequencies`] also where the region has no point of the table's grid.
    pub fn compute(table: &PlanTable, region: Option<Region>) -> Result<Self, PlanError> {
        let grid = &table.grid;
        let view = PointView::new(table, region).ok_or(PlanError::NoFrequencies)?;
        let space = ReachSpace::from_table(table, &view.shapes, |hz| Measure::G.weight_per_m_per_s2(hz));
        let stop = StopRequest::current_request_of_thread();
        let found = strongest_drive_at_each_point_unless_stopped(table, &space);
        if stop.is_stop_requested_or_deadline_over() {
            return Err(PlanError::Stopped);
        }
        let found: Vec<StrongestDrive> = found.into_iter().collect::<Option<_>>().ok_or(PlanError::NoFrequencies)?;
        let contrasts: Vec<(f64, Vec<f64>)> = view
            .points
            .par_iter()
            .zip(&found)
            .map(|(point, strongest)| {
                if stop.is_stop_requested_or_deadline_over() {
                    return Err(PlanError::Stopped);
                }
                let (x_m, y_m) = grid.point_position_m(*point);
                let weak = Target { x_m, y_m, intensity_g: Some(LITTLE * strongest.peak) };
                let plan = table.plan(&[weak])?;
                Ok((plan.predicted.contrast_db, plan.drives.iter().map(|drive| drive.frequency_hz).collect()))
            })
            .collect::<Result<_, PlanError>>()?;
        let settings = view.points.iter().zip(&found).map(|(point, strongest)| (*point, strongest.setting.as_slice()));
        let bounds = view.spread_view_values_over_table_grid(
            table,
            bound_relative_peak_error_of_each_setting_at_its_point(table, settings)
                .into_iter()
                .map(Bound::limit_if_known),
        );
        Ok(Self {
            error_bound: bounds.into_iter().map(Option::flatten).collect(),
            contrast_db: view
                .spread_view_values_over_table_grid(table, contrasts.iter().map(|(contrast_db, _)| *contrast_db)),
            contrast_hz: view.spread_view_values_over_table_grid(table, contrasts.into_iter().map(|(_, hz)| hz)),
            ..Self::without_contrasts(table, &view, &found)
        })
    }

    /// The same with the scene's finger on each point while it is looked at; `table` is that of the panel that nothing touches. There are no
    /// contrasts: each is a plan for a panel of its own. The weakest point is computed from the scene's own elements for `accuracy` and has an error
    /// bound, as have those that were taken for it first; others have none.
    ///
    /// # Errors
    /// As [`Self::compute`], and as [`TouchedPanel::evaluate_with_finger_on_each_place`].
    pub fn compute_with_finger_and_error_bound_of_weakest_point(
        table: &PlanTable,
        region: Option<Region>,
        touched: TouchedPanel<'_>,
        accuracy: Accuracy,
        options: TableOptions,
    ) -> Result<Self, QuickError> {
        let reach = TouchedReach::compute_at_each_point_if_frequencies_usable(table, touched, region, Measure::G)?
            .ok_or(PlanError::NoFrequencies)?;
        Self::from_touched_reach_bounding_error_of_weakest_point(table, &reach, touched, accuracy, options)
    }

    /// The same where the strongest drives, in g, are known.
    ///
    /// # Errors
    /// As [`Self::compute_with_finger_and_error_bound_of_weakest_point`].
    pub fn from_touched_reach_bounding_error_of_weakest_point(
        table: &PlanTable,
        reach: &TouchedReach,
        touched: TouchedPanel<'_>,
        accuracy: Accuracy,
        options: TableOptions,
    ) -> Result<Self, QuickError> {
        let TouchedReach { view, touches } = reach;
        let mut found = touches.clone();
        let (from_hz, to_hz) =
            table.frequencies_hz.first().zip(table.frequencies_hz.last()).ok_or(PlanError::NoFrequencies)?;
        let mut bounds: Vec<Option<Bound>> = vec![None; found.len()];
        // What is the weakest may change as it is computed anew: to one that nearly was.
        loop {
            let each = found.iter().enumerate().min_by(|a, b| a.1.peak.total_cmp(&b.1.peak));
            let Some((weakest, _)) = each.filter(|(weakest, _)| bounds[*weakest].is_none()) else { break };
            let point = view.points[weakest];
            let bounded = touched
                .build_plan_table_with_error_bounds_at_touched_place(
                    table.grid.point_position_m(point),
                    accuracy,
                    options,
                )?
                .keep_frequencies_between_if_any(*from_hz, *to_hz);
            let bounded = bounded.ok_or(PlanError::NoFrequencies)?;
            let space = ReachSpace::from_table(&bounded, &bounded.grid.shapes.select_rows(&[point]), |hz| {
                Measure::G.weight_per_m_per_s2(hz)
            });
            let own = strongest_drive_at_each_point_unless_stopped(&bounded, &space)
                .into_iter()
                .next()
                .flatten()
                .ok_or(PlanError::NoFrequencies)?;
            bounds[weakest] = bound_relative_peak_error_of_each_setting_at_its_point(
                &bounded,
                std::iter::once((point, own.setting.as_slice())),
            )
            .pop();
            found[weakest] = own;
        }
        let bounds = view.spread_view_values_over_table_grid(table, bounds);
        Ok(Self {
            error_bound: bounds.into_iter().map(|bound| bound.flatten().and_then(Bound::limit_if_known)).collect(),
            ..Self::without_contrasts(table, view, &found)
        })
    }

    fn without_contrasts(table: &PlanTable, view: &PointView, found: &[StrongestDrive]) -> Self {
        let grid = &table.grid;
        let mm = |lines: &[f64]| lines.iter().map(|line| line * 1e3).collect();
        let hz = |strongest: &StrongestDrive| strongest.setting.iter().map(|part| part.drive.frequency_hz).collect();
        Self {
            x_mm: mm(&grid.x_m),
            y_mm: mm(&grid.y_m),
            actuators: table.scene.actuators.iter().map(|actuator| actuator.id.clone()).collect(),
            strongest_g: view.spread_view_values_over_table_grid(table, found.iter().map(|strongest| strongest.peak)),
            strongest_hz: view.spread_view_values_over_table_grid(table, found.iter().map(hz)),
            error_bound: vec![None; grid.there.len()],
            contrast_db: vec![None; grid.there.len()],
            contrast_hz: vec![None; grid.there.len()],
        }
    }

    /// Lines of `x_mm,y_mm,strongest_g,contrast_db` and the frequency of each actuator for either; all but the place are empty
    /// where nothing is known.
    #[must_use]
    pub fn to_csv(&self) -> String {
        let mut text = String::from("x_mm,y_mm,strongest_g,contrast_db");
        for name in ["strongest", "contrast"] {
            self.actuators.iter().for_each(|id| text.push_str(&format!(",{name}_{id}_hz")));
        }
        text.push('\n');
        let places = self.y_mm.iter().flat_map(|y| self.x_mm.iter().map(move |x| (x, y)));
        let cell = |value: Option<f64>, digits: usize| {
            value.map_or_else(|| String::from(","), |value| format!(",{value:.digits$}"))
        };
        for (point, (x, y)) in places.enumerate() {
            let at = |values: &[Option<f64>]| cell(values.get(point).copied().flatten(), 4);
            let _ = write!(text, "{x:.3},{y:.3}{}{}", at(&self.strongest_g), at(&self.contrast_db));
            for frequencies in [&self.strongest_hz, &self.contrast_hz] {
                let hz = frequencies.get(point).and_then(Option::as_ref);
                for actuator in 0..self.actuators.len() {
                    text.push_str(&cell(hz.and_then(|hz| hz.get(actuator)).copied(), 2));
                }
            }
            text.push('\n');
        }
        text
    }
}
