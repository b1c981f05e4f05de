//! Three ways to drive a panel, side by side: what each can do everywhere at once, and touch by touch.
//!
//! All are held to the same limits, that of every plan: pulse widths as wide as the table has them, room for harmonics and for
//! switching on, shared rails, and the nonlinear motion as the last word ([`crate::reach::setting`]). What differs is that at one
//! frequency phasors add, of motion at a point and of travel, and at distinct ones moduli do.

use super::rigid;
use super::single_frequency::{self, Phases};
use super::spread::{Spread, area_fraction_below};
use super::strongest::strongest_drive_at_each_point_unless_stopped;
use crate::PlanError;
use crate::reach::max_min::{EQUAL_MINIMA, max_min_setting_and_upper_bound_if_spacing_can_be_kept};
use crate::reach::setting::{compute_peak_of_setting_at_each_point, derate_setting_to_safe_fraction_if_any};
use crate::reach::{Measure, ReachSpace};
use crate::table::{ActuatorSetting, PlanTable, PointView, Region};
use serde::Serialize;

/// A way to drive.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Scheme {
    /// One frequency for all actuators, in phase.
    OneFrequencyInPhase,
    /// One frequency for all actuators, with phases.
    OneFrequencyWithPhases,
    /// A frequency for each actuator.
    DistinctFrequencies,
}

impl Scheme {
    /// All of them, in the order in which they are compared.
    pub const ALL: [Scheme; 3] =
        [Scheme::OneFrequencyInPhase, Scheme::OneFrequencyWithPhases, Scheme::DistinctFrequencies];

    /// In words.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Scheme::OneFrequencyInPhase => "one frequency, in phase",
            Scheme::OneFrequencyWithPhases => "one frequency, phases chosen",
            Scheme::DistinctFrequencies => "distinct frequencies",
        }
    }
}

/// One scheme on one panel. Peaks are in the unit of the comparison's measure.
#[derive(Clone, Debug, Serialize)]
pub struct SchemeReach {
    /// Which.
    pub scheme: Scheme,
    /// The one setting with the largest minimum over the surface, as it is commanded.
    pub setting: Vec<ActuatorSetting>,
    /// Fraction of the forces of masses at rest that their motion has left.
    pub scale: f64,
    /// Fraction of the setting's mean square acceleration that is motion as a rigid body.
    pub rigid: Option<f64>,
    /// What it does; the minimum is that of a grid up to four times as fine as the table's.
    pub one_setting: Spread,
    /// No setting of the scheme at the table's frequencies has a larger minimum; `None` where the best found is not proven.
    pub one_setting_at_most: Option<f64>,
    /// Fraction of the surface where it does less than the one setting at distinct frequencies at its weakest place.
    pub one_setting_weaker: f64,
    /// With a setting of its own for every point: the largest peak there.
    pub per_touch: Spread,
    /// Fraction of the surface where that is less than with distinct frequencies at their weakest place.
    pub per_touch_weaker: f64,
    /// The field of the one setting, row by row.
    #[serde(skip)]
    pub one_setting_field: Vec<Option<f64>>,
    /// The largest peak at every point, row by row.
    #[serde(skip)]
    pub per_touch_field: Vec<Option<f64>>,
}

/// All schemes on a panel or a region of it.
///
/// # Errors
/// [`PlanError::NoActuators`], and [`PlanError::NoFrequencies`] where no frequencies are usable, or the region has no point of
/// the table's grid.
pub fn compare_schemes(
    table: &PlanTable,
    region: Option<Region>,
    measure: Measure,
) -> Result<Vec<SchemeReach>, PlanError> {
    if table.electrodes.is_empty() {
        return Err(PlanError::NoActuators);
    }
    let view = PointView::new(table, region).ok_or(PlanError::NoFrequencies)?;
    let compared = SchemeComparison { table, view, measure };
    let together = |phases| {
        single_frequency::strongest_for_all_and_each_point_if_frequencies_usable(table, &compared.view, measure, phases)
            .ok_or(PlanError::NoFrequencies)
    };
    let in_phase = together(Phases::Equal)?;
    let chosen = together(Phases::Chosen)?.keep_better_of_both(&in_phase);
    let distinct =
        compared.find_one_distinct_frequency_setting_and_best_peak_of_each_point().ok_or(PlanError::NoFrequencies)?;
    let found = [SchemeResult::from(in_phase), SchemeResult::from(chosen), distinct];
    let mut schemes: Vec<SchemeReach> = Scheme::ALL
        .into_iter()
        .zip(found)
        .map(|(scheme, found)| {
            compared.compute_fields_and_spreads_of_scheme(scheme, found).ok_or(PlanError::NoFrequencies)
        })
        .collect::<Result<_, _>>()?;
    let distinct = schemes.iter().find(|scheme| scheme.scheme == Scheme::DistinctFrequencies);
    let levels = distinct.map(|distinct| (distinct.one_setting.least, distinct.per_touch.least));
    for (scheme, (one, each)) in schemes.iter_mut().zip(levels.into_iter().cycle()) {
        scheme.one_setting_weaker =
            area_fraction_below(&table.grid, &scheme.one_setting_field, one * (1.0 - EQUAL_MINIMA));
        scheme.per_touch_weaker =
            area_fraction_below(&table.grid, &scheme.per_touch_field, each * (1.0 - EQUAL_MINIMA));
    }
    Ok(schemes)
}

/// How many amplitude ratios and phases the schemes with one frequency try at each, before refinement.
#[must_use]
pub fn count_trial_force_ratios_in_phase_and_with_phases(table: &PlanTable) -> [usize; 2] {
    [Phases::Equal, Phases::Chosen]
        .map(|phases| single_frequency::count_trial_force_ratios(table.electrodes.len(), phases))
}

struct SchemeComparison<'a> {
    table: &'a PlanTable,
    view: PointView,
    measure: Measure,
}

struct SchemeResult {
    setting: Vec<ActuatorSetting>,
    scale: f64,
    at_most: Option<f64>,
    /// At each of the view's points.
    per_touch: Vec<f64>,
}

impl From<single_frequency::StrongestForAllAndEachPoint> for SchemeResult {
    fn from(found: single_frequency::StrongestForAllAndEachPoint) -> Self {
        Self { setting: found.one, scale: found.scale, at_most: None, per_touch: found.each }
    }
}

impl SchemeComparison<'_> {
    fn find_one_distinct_frequency_setting_and_best_peak_of_each_point(&self) -> Option<SchemeResult> {
        let space = ReachSpace::from_table(self.table, &self.view.shapes, |hz| self.measure.weight_per_m_per_s2(hz));
        let touches = strongest_drive_at_each_point_unless_stopped(self.table, &space);
        let per_touch = touches.into_iter().map(|touch| Some(touch?.peak)).collect::<Option<_>>()?;
        let (mut setting, at_most) =
            max_min_setting_and_upper_bound_if_spacing_can_be_kept(self.table, &self.view, self.measure, space)?;
        let scale = derate_setting_to_safe_fraction_if_any(self.table, &mut setting)?;
        Some(SchemeResult { setting, scale, at_most: Some(at_most), per_touch })
    }

    fn compute_fields_and_spreads_of_scheme(&self, scheme: Scheme, found: SchemeResult) -> Option<SchemeReach> {
        let SchemeResult { setting, scale, at_most, per_touch } = found;
        let (table, view) = (self.table, &self.view);
        let one_setting_field = view.spread_view_values_over_table_grid(
            table,
            compute_peak_of_setting_at_each_point(table, &view.shapes, &setting, self.measure),
        );
        let per_touch_field = view.spread_view_values_over_table_grid(table, per_touch);
        let mut one_setting = Spread::compute(&table.grid, &one_setting_field)?;
        let finer = compute_peak_of_setting_at_each_point(table, &view.finer, &setting, self.measure);
        let (least, (x_m, y_m)) = finer.iter().zip(&view.places_m).min_by(|a, b| a.0.total_cmp(b.0))?;
        one_setting.least = *least;
        one_setting.least_at_mm = [x_m * 1e3, y_m * 1e3];
        Some(SchemeReach {
            scheme,
            scale,
            rigid: rigid::rigid_fraction_of_mean_square_unless_at_rest(table, &setting),
            one_setting,
            one_setting_at_most: at_most,
            one_setting_weaker: 0.0,
            per_touch: Spread::compute(&table.grid, &per_touch_field)?,
            per_touch_weaker: 0.0,
            setting,
            one_setting_field,
            per_touch_field,
        })
    }
}
