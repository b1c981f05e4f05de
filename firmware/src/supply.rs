//! The high-voltage supply: enable, discharge switches, set-points.

use crate::outputs::{is_high, set_level};
use crate::pins::{DISCHARGE_OPEN, HIGH_VOLTAGE_ENABLE};
use crate::{breaks, rails, trip, watchdog};
use era_shared::supply::{Supply, rail_code};

/// Carries out what the supply is told. After a trip that has not been taken yet the supply stays off: what is told was
/// decided before it.
pub fn set(supply: &Supply) {
    // With interrupts masked, so that a trip comes before or after all of it.
    cortex_m::interrupt::free(|_| {
        let enabled = supply.enabled && trip::waits().is_none();
        if enabled && !is_high(HIGH_VOLTAGE_ENABLE) {
            // What switches off is awake before there is something to switch off.
            breaks::watch();
            watchdog::freeze_in_debug(false);
        }
        if !enabled {
            set_level(HIGH_VOLTAGE_ENABLE, false);
            watchdog::freeze_in_debug(true);
        }
        for (rail, (pin, closed)) in DISCHARGE_OPEN.into_iter().zip(supply.discharge).enumerate() {
            let millivolts = supply.set_point_millivolts.get(rail).copied().unwrap_or(0);
            // The switch stays closed over an enabled supply only where the device lets a rail down on purpose.
            set_level(pin, enabled && !closed);
            rails::set(rail, if enabled { rail_code(millivolts) } else { 0 });
        }
        if enabled {
            set_level(HIGH_VOLTAGE_ENABLE, true);
        }
    });
}
