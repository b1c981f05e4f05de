//! The high-voltage supply: permit, enable, discharge switches, set-points.

use crate::outputs::{is_pin_set_high, set_pin_level};
use crate::pins::{DISCHARGE_OPEN, HIGH_VOLTAGE_ENABLE};
use crate::{breaks, permit, rails, trip, watchdog};
use era_shared::supply::{SupplyCommand, rail_dac_code};

/// Carries out a command to the supply. The supply stays off after a trip that the device has not taken yet: the command was decided before
/// the trip.
pub fn apply_supply_command_or_off_if_tripped(command: &SupplyCommand) {
    // With interrupts masked, so that a trip comes before or after all of it.
    cortex_m::interrupt::free(|masked| {
        let tripped = trip::peek_trip_code().is_some();
        let enabled = command.enabled && !tripped;
        if enabled && !is_pin_set_high(HIGH_VOLTAGE_ENABLE) {
            // What switches off is awake before there is something to switch off.
            breaks::arm_break_interrupt();
            watchdog::set_watchdog_frozen_in_debug_and_freeze_timers(false);
        }
        if !enabled {
            set_pin_level(HIGH_VOLTAGE_ENABLE, false);
            watchdog::set_watchdog_frozen_in_debug_and_freeze_timers(true);
        }
        permit::set_permit(masked, command.permitted && !tripped);
        for (rail, (pin, closed)) in DISCHARGE_OPEN.into_iter().zip(command.discharge).enumerate() {
            let millivolts = command.set_point_millivolts.get(rail).copied().unwrap_or(0);
            // The self-test opens the switch and keeps the set-point with the supply disabled or the permit withdrawn, to see that each of
            // them is enough.
            set_pin_level(pin, !tripped && !closed);
            rails::set_rail_code(masked, rail, if tripped { 0 } else { rail_dac_code(millivolts) });
        }
        if enabled {
            set_pin_level(HIGH_VOLTAGE_ENABLE, true);
        }
    });
}
