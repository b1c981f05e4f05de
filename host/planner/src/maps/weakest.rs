//! The place of a surface where the least can be had, and what driving it takes.

use super::single_frequency::{self, Phases};
use super::strongest::{StrongestDrive, strongest_drive_at_each_point_unless_stopped};
use super::touched::TouchedReach;
use crate::PlanTable;
use crate::reach::max_min::max_min_setting_and_upper_bound_if_spacing_can_be_kept;
use crate::reach::setting::{compute_peak_of_setting_at_each_point, derate_setting_to_safe_fraction_if_any};
use crate::reach::{Measure, ReachSpace};
use crate::table::touched::{TouchedError, TouchedPanel};
use crate::table::{ActuatorSetting, PointView};

/// The weakest place.
#[derive(Clone, Debug)]
pub struct WeakestPlace {
    /// Its peak, in the measure's unit.
    pub peak: f64,
    /// Where it is, in m.
    pub at_m: (f64, f64),
    /// Electrical power in W that the drives take together: of the setting, or of the touch that takes the most.
    pub power_w: f64,
    /// The highest voltage among them, in V.
    pub voltage_v: f64,
}

/// With a setting of its own for every touch, on the table's grid. `None` where no frequencies are usable.
#[must_use]
pub fn weakest_place_with_setting_per_place_if_frequencies_usable(
    table: &PlanTable,
    measure: Measure,
) -> Option<WeakestPlace> {
    let view = PointView::new(table, None)?;
    let space = ReachSpace::from_table(table, &view.shapes, |hz| measure.weight_per_m_per_s2(hz));
    let touches =
        strongest_drive_at_each_point_unless_stopped(table, &space).into_iter().collect::<Option<Vec<_>>>()?;
    find_weakest_place_with_largest_power_and_voltage_of_all_touches(table, &view, &touches)
}

/// The same with the scene's finger on each place while it is looked at; `table` is that of the panel that nothing touches. `None` where there is no
/// place.
#[must_use]
pub fn find_weakest_place_of_touched_reach(table: &PlanTable, reach: &TouchedReach) -> Option<WeakestPlace> {
    find_weakest_place_with_largest_power_and_voltage_of_all_touches(table, &reach.view, &reach.touches)
}

fn find_weakest_place_with_largest_power_and_voltage_of_all_touches(
    table: &PlanTable,
    view: &PointView,
    touches: &[StrongestDrive],
) -> Option<WeakestPlace> {
    let (point, weakest) =
        view.points.iter().zip(touches).min_by(|a, b| a.1.peak.total_cmp(&b.1.peak).then(a.0.cmp(b.0)))?;
    let most =
        |of: &dyn Fn(&[ActuatorSetting]) -> f64| touches.iter().map(|touch| of(&touch.setting)).fold(0.0, f64::max);
    Some(WeakestPlace {
        peak: weakest.peak,
        at_m: table.grid.point_position_m(*point),
        power_w: most(&|setting| total_supply_power_of_setting_w(table, setting)),
        voltage_v: most(&highest_voltage_of_setting_v),
    })
}

/// The same with one frequency for all actuators at each touch, in phase or with phases chosen: the best that a search finds, without a
/// proof. Power and voltage are not told (NaN). `None` where no frequencies are usable.
#[must_use]
pub fn weakest_place_with_one_frequency_per_place_if_frequencies_usable(
    table: &PlanTable,
    measure: Measure,
    phases: Phases,
) -> Option<WeakestPlace> {
    let view = PointView::new(table, None)?;
    let found = search_single_frequency_for_all_and_each_point(table, &view, measure, phases)?;
    find_weakest_place_of_peaks_with_nan_power_and_voltage(table, &view, &found.each)
}

/// The same with the scene's finger on each place while it is looked at; `table` is that of the panel that nothing touches.
///
/// # Errors
/// [`TouchedError`].
pub fn weakest_touched_place_with_one_frequency_per_place_if_frequencies_usable(
    table: &PlanTable,
    touched: TouchedPanel<'_>,
    measure: Measure,
    phases: Phases,
) -> Result<Option<WeakestPlace>, TouchedError> {
    let Some(view) = PointView::new(table, None) else { return Ok(None) };
    let ask = |table: &PlanTable| {
        let own = PointView::new(table, None)?;
        search_single_frequency_for_all_and_each_point(table, &own, measure, phases)?.each.first().copied()
    };
    let each = touched.evaluate_with_finger_on_each_place(
        &view.place_of_each_point_m(table),
        |_| table.frequencies_hz.clone(),
        ask,
    )?;
    let each = each.into_iter().collect::<Option<Vec<f64>>>();
    Ok(each.and_then(|each| find_weakest_place_of_peaks_with_nan_power_and_voltage(table, &view, &each)))
}

fn search_single_frequency_for_all_and_each_point(
    table: &PlanTable,
    view: &PointView,
    measure: Measure,
    phases: Phases,
) -> Option<single_frequency::StrongestForAllAndEachPoint> {
    let found = single_frequency::strongest_for_all_and_each_point_if_frequencies_usable(table, view, measure, phases)?;
    match phases {
        Phases::Equal => Some(found),
        // Equal phases are among those that can be chosen, and their search may have come further.
        Phases::Chosen => {
            Some(found.keep_better_of_both(&single_frequency::strongest_for_all_and_each_point_if_frequencies_usable(
                table,
                view,
                measure,
                Phases::Equal,
            )?))
        }
    }
}

fn find_weakest_place_of_peaks_with_nan_power_and_voltage(
    table: &PlanTable,
    view: &PointView,
    peaks: &[f64],
) -> Option<WeakestPlace> {
    let (point, peak) = view.points.iter().zip(peaks).min_by(|a, b| a.1.total_cmp(b.1).then(a.0.cmp(b.0)))?;
    Some(WeakestPlace {
        peak: *peak,
        at_m: table.grid.point_position_m(*point),
        power_w: f64::NAN,
        voltage_v: f64::NAN,
    })
}

/// The strongest peak in g that can be had at every point of the table's grid, row by row; `None` in cut-outs. `None` where no
/// frequencies are usable.
#[must_use]
pub fn strongest_peak_at_each_grid_point_if_frequencies_usable_g(table: &PlanTable) -> Option<Vec<Option<f64>>> {
    let view = PointView::new(table, None)?;
    let space = ReachSpace::from_table(table, &view.shapes, |hz| Measure::G.weight_per_m_per_s2(hz));
    let touches: Vec<_> =
        strongest_drive_at_each_point_unless_stopped(table, &space).into_iter().collect::<Option<_>>()?;
    Some(view.spread_view_values_over_table_grid(table, touches.iter().map(|touch| touch.peak)))
}

/// With one setting for the whole surface, that with the largest minimum. `None` where no frequencies are usable.
#[must_use]
pub fn weakest_place_with_one_setting_for_surface_if_frequencies_usable(
    table: &PlanTable,
    measure: Measure,
) -> Option<WeakestPlace> {
    let view = PointView::new(table, None)?;
    let space = ReachSpace::from_table(table, &view.shapes, |hz| measure.weight_per_m_per_s2(hz));
    let (mut setting, _) = max_min_setting_and_upper_bound_if_spacing_can_be_kept(table, &view, measure, space)?;
    derate_setting_to_safe_fraction_if_any(table, &mut setting)?;
    let finer = compute_peak_of_setting_at_each_point(table, &view.finer, &setting, measure);
    let (peak, at_m) = finer.iter().zip(&view.places_m).min_by(|a, b| a.0.total_cmp(b.0))?;
    let (power_w, voltage_v) =
        (total_supply_power_of_setting_w(table, &setting), highest_voltage_of_setting_v(&setting));
    Some(WeakestPlace { peak: *peak, at_m: *at_m, power_w, voltage_v })
}

/// Both electrodes of each actuator are charged from its rail once a period: 2 C V^2 f.
fn total_supply_power_of_setting_w(table: &PlanTable, setting: &[ActuatorSetting]) -> f64 {
    let each = setting.iter().zip(&table.electrodes);
    each.map(|(ActuatorSetting { drive, .. }, own)| own.mean_power_w(drive.voltage_v, drive.frequency_hz)).sum()
}

fn highest_voltage_of_setting_v(setting: &[ActuatorSetting]) -> f64 {
    setting.iter().map(|part| part.drive.voltage_v).fold(0.0, f64::max)
}
