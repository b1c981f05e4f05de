//! The simulated high-voltage rails: first-order, exact in time.

use era_shared::circuit::{
    BLEEDER_OHMS, DISCHARGE_OHMS, ELECTRODE_PICOFARADS, RAIL_PICOFARADS, SUPPLY_TIME_CONSTANT_MICROSECONDS,
};
use era_shared::supply::{RAILS, SupplyCommand};

/// Capacitance of a rail in F with the electrodes of two channels.
const LOADED_RAIL_F: f64 = (RAIL_PICOFARADS + 2 * (ELECTRODE_PICOFARADS[0] + ELECTRODE_PICOFARADS[2])) as f64 * 1e-12;
/// Time constant in s with which the supply brings a rail up to its set-point.
const RISE_S: f64 = SUPPLY_TIME_CONSTANT_MICROSECONDS as f64 * 1e-6;
/// Time constant of the closed discharge switch in s. 2 kV are below 60 V after 8 ms.
const DISCHARGE_S: f64 = DISCHARGE_OHMS as f64 * LOADED_RAIL_F;
/// Time constant of the two bleeders in s.
const BLEED_S: f64 = BLEEDER_OHMS as f64 / 2.0 * LOADED_RAIL_F;
/// Time constant of a short in s: the rail through 10 kohm of series resistor.
const SHORT_S: f64 = 1e4 * LOADED_RAIL_F;

/// A voltage on its way, exponentially, to where it is drawn.
#[derive(Clone, Copy, Debug)]
pub struct SimRail {
    from_s: f64,
    from_v: f64,
    target_v: f64,
    tau_s: f64,
}

impl SimRail {
    /// A rail that stands at `volts` from `time_s` on and discharges.
    #[must_use]
    pub const fn new_discharging_since(volts: f64, time_s: f64) -> Self {
        Self { from_s: time_s, from_v: volts, target_v: 0.0, tau_s: DISCHARGE_S }
    }

    /// Voltage at `time_s`, which must not be before the last change.
    #[must_use]
    pub fn volts_at(&self, time_s: f64) -> f64 {
        let left = (-(time_s - self.from_s).max(0.0) / self.tau_s).exp();
        self.target_v + (self.from_v - self.target_v) * left
    }

    /// Whether the supply feeds the rail, so that it replaces at once what is taken from it.
    #[must_use]
    pub const fn is_fed(&self) -> bool {
        self.tau_s == RISE_S
    }

    /// Something has taken charge from the rail's capacitance by `time_s`.
    pub fn lower_by(&mut self, time_s: f64, volts: f64) {
        *self = Self { from_s: time_s, from_v: (self.volts_at(time_s) - volts).max(0.0), ..*self };
    }

    /// From `time_s` on the rail follows what the supply was told; a short takes it to zero whatever that is.
    pub fn apply_supply_command(&mut self, time_s: f64, command: &SupplyCommand, rail_index: usize, shorted: bool) {
        let volts = self.volts_at(time_s);
        let of = |values: &[bool; RAILS]| values.get(rail_index).copied().unwrap_or(true);
        let set_v = f64::from(command.set_point_millivolts.get(rail_index).copied().unwrap_or(0)) / 1e3;
        let (target_v, tau_s) = match () {
            () if shorted => (0.0, SHORT_S),
            () if of(&command.discharge) || !command.permitted => (0.0, DISCHARGE_S),
            () if !command.enabled => (0.0, BLEED_S),
            // A supply can only push: downwards the bleeder has to do it.
            () if set_v < volts => (set_v, BLEED_S),
            () => (set_v, RISE_S),
        };
        if (target_v, tau_s) != (self.target_v, self.tau_s) {
            *self = Self { from_s: time_s, from_v: volts, target_v, tau_s };
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn supply(enabled: bool, discharge: bool, volts: u32) -> SupplyCommand {
        SupplyCommand {
            enabled,
            discharge: [discharge; RAILS],
            set_point_millivolts: [volts * 1000; RAILS],
            permitted: true,
        }
    }

    #[test]
    fn rails_rise_bleed_and_discharge() {
        let mut rail = SimRail::new_discharging_since(0.0, 0.0);
        rail.apply_supply_command(0.0, &supply(true, false, 1000), 0, false);
        assert!((rail.volts_at(RISE_S) - 1000.0 * (1.0 - (-1.0_f64).exp())).abs() < 1e-9);
        // Told the same again, it goes on as before.
        rail.apply_supply_command(RISE_S, &supply(true, false, 1000), 0, false);
        assert!((rail.volts_at(2.0 * RISE_S) - 1000.0 * (1.0 - (-2.0_f64).exp())).abs() < 1e-9);
        rail.apply_supply_command(1.0, &supply(true, false, 500), 0, false);
        assert!((rail.volts_at(1.0 + BLEED_S) - (500.0 + 500.0 * (-1.0_f64).exp())).abs() < 1e-6);
        rail.apply_supply_command(2.0, &supply(false, true, 0), 0, false);
        assert!(rail.volts_at(2.0 + 0.008) < 60.0);
        rail.apply_supply_command(3.0, &supply(true, false, 1000), 0, true);
        assert!(rail.volts_at(3.1) < 1e-3);
        // Without the permit it discharges, whatever the rest of the command says.
        rail.apply_supply_command(4.0, &supply(true, false, 1000), 0, false);
        let withdrawn = SupplyCommand { permitted: false, ..supply(true, false, 1000) };
        rail.apply_supply_command(5.0, &withdrawn, 0, false);
        assert!(rail.volts_at(5.0 + 0.008) < 60.0);
    }
}
