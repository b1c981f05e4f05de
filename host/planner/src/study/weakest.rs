//! The place of a surface where the least can be had, and what driving it takes.

use super::single_frequency::{self, Phases};
use super::strongest::{Strongest, strongest};
use super::touched::TouchedReach;
use crate::PlanTable;
use crate::reach::max_min::strongest_everywhere;
use crate::reach::setting::{command, peaks};
use crate::reach::{Measure, Space};
use crate::table::touched::{Touched, TouchedError};
use crate::table::{Part, View};

/// The weakest place.
#[derive(Clone, Debug)]
pub struct Weakest {
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
pub fn every_touch(table: &PlanTable, measure: Measure) -> Option<Weakest> {
    let view = View::new(table, None)?;
    let space = Space::of(table, &view.shapes, |hz| measure.weight(hz));
    let touches = strongest(table, &space).into_iter().collect::<Option<Vec<_>>>()?;
    weakest_of(table, &view, &touches)
}

/// The same with the scene's finger on each place while it is looked at; `table` is that of the panel that nothing touches. `None` where there is no
/// place.
#[must_use]
pub fn every_touch_touched(table: &PlanTable, reach: &TouchedReach) -> Option<Weakest> {
    weakest_of(table, &reach.view, &reach.touches)
}

fn weakest_of(table: &PlanTable, view: &View, touches: &[Strongest]) -> Option<Weakest> {
    let (point, weakest) =
        view.points.iter().zip(touches).min_by(|a, b| a.1.peak.total_cmp(&b.1.peak).then(a.0.cmp(b.0)))?;
    let most = |of: &dyn Fn(&[Part]) -> f64| touches.iter().map(|touch| of(&touch.setting)).fold(0.0, f64::max);
    Some(Weakest {
        peak: weakest.peak,
        at_m: table.grid.place_m(*point),
        power_w: most(&|setting| power_w(table, setting)),
        voltage_v: most(&voltage_v),
    })
}

/// The same with one frequency for all actuators at each touch, in phase or with phases chosen: the best that a search finds, without a
/// proof. Power and voltage are not told (NaN). `None` where no frequencies are usable.
#[must_use]
pub fn every_touch_at_one_frequency(table: &PlanTable, measure: Measure, phases: Phases) -> Option<Weakest> {
    let view = View::new(table, None)?;
    let found = at_one_frequency(table, &view, measure, phases)?;
    weakest_peak(table, &view, &found.each)
}

/// The same with the scene's finger on each place while it is looked at; `table` is that of the panel that nothing touches.
///
/// # Errors
/// [`TouchedError`].
pub fn every_touch_at_one_frequency_touched(
    table: &PlanTable,
    touched: Touched<'_>,
    measure: Measure,
    phases: Phases,
) -> Result<Option<Weakest>, TouchedError> {
    let Some(view) = View::new(table, None) else { return Ok(None) };
    let ask = |table: &PlanTable| {
        let own = View::new(table, None)?;
        at_one_frequency(table, &own, measure, phases)?.each.first().copied()
    };
    let each = touched.each(&view.grid_places_m(table), |_| table.frequencies_hz.clone(), ask)?;
    let each = each.into_iter().collect::<Option<Vec<f64>>>();
    Ok(each.and_then(|each| weakest_peak(table, &view, &each)))
}

fn at_one_frequency(
    table: &PlanTable,
    view: &View,
    measure: Measure,
    phases: Phases,
) -> Option<single_frequency::StrongestSetting> {
    let found = single_frequency::strongest(table, view, measure, phases)?;
    match phases {
        Phases::Equal => Some(found),
        // Equal phases are among those that can be chosen, and their search may have come further.
        Phases::Chosen => Some(found.or(&single_frequency::strongest(table, view, measure, Phases::Equal)?)),
    }
}

fn weakest_peak(table: &PlanTable, view: &View, each: &[f64]) -> Option<Weakest> {
    let (point, peak) = view.points.iter().zip(each).min_by(|a, b| a.1.total_cmp(b.1).then(a.0.cmp(b.0)))?;
    Some(Weakest { peak: *peak, at_m: table.grid.place_m(*point), power_w: f64::NAN, voltage_v: f64::NAN })
}

/// The strongest peak in g that can be had at every point of the table's grid, row by row; `None` in cut-outs. `None` where no
/// frequencies are usable.
#[must_use]
pub fn map_g(table: &PlanTable) -> Option<Vec<Option<f64>>> {
    let view = View::new(table, None)?;
    let space = Space::of(table, &view.shapes, |hz| Measure::G.weight(hz));
    let touches: Vec<_> = strongest(table, &space).into_iter().collect::<Option<_>>()?;
    Some(view.on_grid(table, touches.iter().map(|touch| touch.peak)))
}

/// With one setting for the whole surface, that with the largest minimum. `None` where no frequencies are usable.
#[must_use]
pub fn one_setting(table: &PlanTable, measure: Measure) -> Option<Weakest> {
    let view = View::new(table, None)?;
    let space = Space::of(table, &view.shapes, |hz| measure.weight(hz));
    let (mut setting, _) = strongest_everywhere(table, &view, measure, space)?;
    command(table, &mut setting)?;
    let finer = peaks(table, &view.finer, &setting, measure);
    let (peak, at_m) = finer.iter().zip(&view.places_m).min_by(|a, b| a.0.total_cmp(b.0))?;
    let (power_w, voltage_v) = (power_w(table, &setting), voltage_v(&setting));
    Some(Weakest { peak: *peak, at_m: *at_m, power_w, voltage_v })
}

/// Both electrodes of each actuator are charged from its rail once a period: 2 C V^2 f.
fn power_w(table: &PlanTable, setting: &[Part]) -> f64 {
    let each = setting.iter().zip(&table.electrodes);
    each.map(|(Part { drive, .. }, own)| drive.voltage_v * own.mean_current_a(drive.voltage_v, drive.frequency_hz))
        .sum()
}

fn voltage_v(setting: &[Part]) -> f64 {
    setting.iter().map(|part| part.drive.voltage_v).fold(0.0, f64::max)
}
