//! The resistors between rails and electrodes, and what they make of each actuator's capacitance.

use super::ChargingTimes;
use super::read::{AllowedNumbers, TomlSection};

/// A hundred times the resistors that the board's drive stage is designed for.
const MOST_OHM: f64 = 1e8;
/// Between switches of a half bridge.
const MOST_DELAY_US: f64 = 100.0;
/// Longest time constant in s with which an electrode may charge. What plans make of the voltage is tested up to it; it is four times that of
/// the board's drive stage.
const MOST_RISE_S: f64 = 0.5e-3;

/// The table `[electronics]`.
pub(super) struct Electronics<'r, 't> {
    section: TomlSection<'r, 't>,
    charging_ohm: f64,
    discharging_ohm: f64,
    delay_s: f64,
}

impl<'r, 't> Electronics<'r, 't> {
    /// Reads the table.
    pub(super) fn read(section: TomlSection<'r, 't>) -> Self {
        let most = AllowedNumbers::Within(0.0, MOST_OHM);
        let charging_ohm = section.read_required_number_or_nan("charging_resistance_ohm", most);
        let at_most_charging = AllowedNumbers::Within(0.0, if charging_ohm.is_nan() { MOST_OHM } else { charging_ohm });
        let discharging_ohm =
            section.read_optional_number_or_nan("discharging_resistance_ohm", charging_ohm, at_most_charging);
        let delay = AllowedNumbers::Within(0.0, MOST_DELAY_US);
        let delay_s = section.read_optional_number_or_nan("discharging_delay_us", 0.0, delay) * 1e-6;
        Self { section, charging_ohm, discharging_ohm, delay_s }
    }

    /// The times of an actuator's electrodes of `capacitance_f` in F; reports those that are too long.
    pub(super) fn compute_charging_times_and_report_too_long_ones(
        &self,
        actuator: &TomlSection<'_, '_>,
        id: &str,
        capacitance_f: f64,
    ) -> ChargingTimes {
        let times = ChargingTimes {
            rise_s: self.charging_ohm * capacitance_f,
            hold_s: self.delay_s,
            fall_s: self.discharging_ohm * capacitance_f,
        };
        // The cable's key is to be mended if it is there, otherwise the table.
        let at = if actuator.has_key_marking_known("cable_capacitance_pf") {
            actuator.byte_range_of_value_or_section("cable_capacitance_pf")
        } else {
            self.section.byte_range_of_value_or_section("charging_resistance_ohm")
        };
        let picofarads = capacitance_f * 1e12;
        if times.rise_s > MOST_RISE_S {
            let text = format!(
                "{} is {:e} ohm, but must be at most {:.2e} ohm: an electrode of actuator {id:?} and its cable have \
                 {picofarads:.0} pF, and with more resistance they charge too slowly",
                self.section.key_with_path("charging_resistance_ohm"),
                self.charging_ohm,
                MOST_RISE_S / capacitance_f
            );
            self.section.mistake_report().add_mistake_at(&at, text);
        }
        if times.hold_s > times.rise_s {
            // A window could make more force than one whose electrodes charge at once.
            let text = format!(
                "{} is {} us, but must be at most {:.3} us, the time constant with which an electrode of actuator \
                 {id:?} charges (the capacitance of the electrode with its cable is {picofarads:.0} pF)",
                self.section.key_with_path("discharging_delay_us"),
                self.delay_s * 1e6,
                times.rise_s * 1e6
            );
            self.section.mistake_report().add_mistake_at(&at, text);
        }
        times
    }

    /// To be called when everything has been read.
    pub(super) fn report_unknown_keys(self) {
        self.section.report_unknown_keys();
    }
}
