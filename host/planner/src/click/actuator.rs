//! What a click may ask of an actuator: the voltage and the force of its windows.

use super::realise::{SLOT_S, WIDEST_S, integrate_squared_relative_voltage_of_window_s, narrowest_window_s};
use crate::PlanTable;
use crate::physics::limits::{Electrodes, Limit, MAX_SOFTENING_FRACTION};
use crate::scene::ChargingTimes;
use era_shared::limits::MAX_RAIL_MILLIVOLTS;
use era_shared::supply::rail_index_of_channel;

/// Highest voltage in V of an actuator's windows, and what sets it: the scene's, the board's, what the gap holds that press and travel have closed,
/// and what leaves the mass enough of its stiffness, windows following each other.
#[must_use]
pub fn find_highest_allowed_window_voltage_v_and_limit(table: &PlanTable, actuator: usize) -> (f64, Limit) {
    let Some(electrodes) = table.electrodes.get(actuator) else { return (0.0, Limit::Voltage) };
    let own = electrodes.max_voltage_v.min(f64::from(MAX_RAIL_MILLIVOLTS) / 1e3);
    let held = electrodes.breakdown_voltage_of_remaining_gap_with_margin_v(electrodes.max_travel_m());
    let receptance = table.static_receptance.get(actuator).and_then(|row| row.get(actuator)).copied().unwrap_or(0.0);
    let counted = table.scene.actuators.get(actuator).map_or(0.0, crate::scene::Actuator::softening_n_per_m);
    // Per V^2: 2 k / g for the part of the time in which windows are on.
    let softening = 2.0 * electrodes.force_at_rest_n_per_v2() / electrodes.gap_m * WIDEST_S / SLOT_S
        * electrodes.softening_under_press_relative_to_rest();
    let left = if receptance > 0.0 { MAX_SOFTENING_FRACTION / receptance } else { f64::INFINITY };
    let pulled_in = ((left + counted) / softening).sqrt();
    [(own, Limit::Voltage), (held, Limit::Breakdown), (pulled_in, Limit::PullIn)]
        .into_iter()
        .fold((f64::INFINITY, Limit::Voltage), |least, now| if now.0 < least.0 { now } else { least })
}

/// An actuator as clicks use it.
#[derive(Clone, Copy, Debug)]
pub struct ClickActuator {
    pub charging: ChargingTimes,
    /// Highest voltage of its windows, by its rail, what sets it, and of which actuator.
    pub highest_v: f64,
    pub limit: Limit,
    pub limited_by: usize,
    /// Force in N of an electrode at that voltage, the mass at rest.
    pub plateau_n: f64,
    /// Mean force over a slot of the widest window.
    pub full_n: f64,
    /// Least part of that which a window makes.
    pub least_part: f64,
}

impl ClickActuator {
    pub fn new(table: &PlanTable, actuator: usize, electrodes: &Electrodes) -> Self {
        let rail = rail_index_of_channel(actuator);
        let on_rail = (0..table.electrodes.len()).filter(|other| rail_index_of_channel(*other) == rail);
        let each = on_rail.map(|other| (find_highest_allowed_window_voltage_v_and_limit(table, other), other));
        let lowest = each.min_by(|a, b| a.0.0.total_cmp(&b.0.0));
        let ((highest_v, limit), limited_by) = lowest.unwrap_or(((0.0, Limit::Voltage), actuator));
        let highest_v = highest_v.max(0.0);
        let plateau_n = electrodes.force_at_rest_n_per_v2() * highest_v * highest_v;
        let charging = electrodes.charging;
        let widest_s = integrate_squared_relative_voltage_of_window_s(charging, WIDEST_S);
        Self {
            charging,
            highest_v,
            limit,
            limited_by,
            plateau_n,
            full_n: plateau_n * widest_s / SLOT_S,
            least_part: integrate_squared_relative_voltage_of_window_s(charging, narrowest_window_s()) / widest_s,
        }
    }
}
