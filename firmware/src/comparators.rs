//! The five comparators that switch everything off in hardware, and the two loops that two of them watch.
//!
//! | comparator | input | against   | trips when                                     |
//! |------------|-------|-----------|------------------------------------------------|
//! | 1          | PA1   | DAC3 ch 1 | rail 2 is above the over-voltage limit         |
//! | 3          | PA0   | DAC3 ch 1 | rail 1 is above the over-voltage limit         |
//! | 4          | PB0   | DAC3 ch 2 | the momentary current is above its limit       |
//! | 5          | PB13  | DAC4 ch 1 | the interlock loop is open (inverted)          |
//! | 7          | PB14  | DAC4 ch 1 | the emergency stop is pressed (inverted)       |
//!
//! The input is the first of the two that each has (INPSEL = 0), the thresholds are connected as RM0440 tells (inputs of the comparators).
//! A comparator's output is high when it trips; `timers.rs` leads it to the breaks.

use crate::rails::ABOVE_160_MHZ;
use embassy_stm32::pac::comp::Comp;
use embassy_stm32::pac::comp::regs::Csr;
use embassy_stm32::pac::comp::vals::{Hysteresis, Inm, Polarity};
use embassy_stm32::pac::dac::Dac;
use embassy_stm32::pac::dac::regs::{Cr, Mcr};
use embassy_stm32::pac::dac::vals::Mode;
use embassy_stm32::pac::{COMP1, COMP3, COMP4, COMP5, COMP7, DAC3, DAC4, RCC};
use era_shared::circuit::{MOMENTARY_FULL_SCALE_MICROAMPS, PIN_FULL_SCALE_MILLIVOLTS, RAIL_FULL_SCALE_MILLIVOLTS};
use era_shared::limits::{OVER_VOLTAGE_MILLIVOLTS, TRIP_MICROAMPS};
use era_shared::protocol::FaultCode;

/// One comparator.
#[derive(Clone, Copy)]
pub struct Comparator {
    /// Its number in the chip.
    pub number: u32,
    /// What it means when it trips.
    pub fault: FaultCode,
    registers: Comp,
    polarity: Polarity,
}

/// The loops are below their threshold when they are open; closed, they are at 2.185 V (pin table).
const INTERLOCK: Comparator =
    Comparator { number: 5, fault: FaultCode::InterlockOpen, registers: COMP5, polarity: Polarity::INVERTED };
const EMERGENCY_STOP: Comparator =
    Comparator { number: 7, fault: FaultCode::EmergencyStop, registers: COMP7, polarity: Polarity::INVERTED };

/// Those that watch the loops.
pub const LOOPS: [Comparator; 2] = [EMERGENCY_STOP, INTERLOCK];

/// A comparator that trips above its threshold.
const fn make_overload_comparator(number: u32, fault: FaultCode, registers: Comp) -> Comparator {
    Comparator { number, fault, registers, polarity: Polarity::NOT_INVERTED }
}

/// Those that watch rails 1 and 2.
pub const OVER_VOLTAGE: [Comparator; 2] = [
    make_overload_comparator(3, FaultCode::OverVoltage, COMP3),
    make_overload_comparator(1, FaultCode::OverVoltage, COMP1),
];

/// All that are used, those first whose reason says more if several have tripped: a person's stop before its consequences.
pub const COMPARATORS: [Comparator; 5] = [
    EMERGENCY_STOP,
    INTERLOCK,
    make_overload_comparator(4, FaultCode::OverCurrent, COMP4),
    OVER_VOLTAGE[0],
    OVER_VOLTAGE[1],
];

/// CSR.POL.
const POLARITY: u32 = 1 << 15;

/// Steps of the converter.
const FULL_CODE: u64 = 4095;
/// Threshold of the rails.
const OVER_VOLTAGE_CODE: u16 = (OVER_VOLTAGE_MILLIVOLTS as u64 * FULL_CODE / RAIL_FULL_SCALE_MILLIVOLTS as u64) as u16;
/// Threshold of the rails during the self-test: 25 V. With half of the hysteresis of 15 V on either side, a rail that counts as charged (35 V or
/// more) is above it and one that does not (15 V or less) below.
const TEST_CODE: u16 = (25_000 * FULL_CODE / RAIL_FULL_SCALE_MILLIVOLTS as u64) as u16;
/// Threshold of the momentary current.
const OVER_CURRENT_CODE: u16 = (TRIP_MICROAMPS as u64 * FULL_CODE / MOMENTARY_FULL_SCALE_MICROAMPS as u64) as u16;
const _: () = assert!(OVER_VOLTAGE_CODE < 4095 && OVER_CURRENT_CODE < 4095);
/// Threshold of the loops: 1.9 V, below every level of a closed loop (`sense.rs`: 1.98 V or more), and above 1.63 V, to which both fall if their wires
/// touch and one of them opens (two ends of 10 kohm below one resistor of 5.1 kohm).
const LOOP_CODE: u16 = convert_pin_millivolts_to_code(1_900);
/// Threshold of the loops during the self-test: 2.6 V, above every level of a closed loop (2.38 V or less), so that a comparator trips that sees its loop.
const LOOP_TEST_CODE: u16 = convert_pin_millivolts_to_code(2_600);

const fn convert_pin_millivolts_to_code(millivolts: u64) -> u16 {
    (millivolts * FULL_CODE / PIN_FULL_SCALE_MILLIVOLTS as u64) as u16
}

/// The converters settle within 200 us of their enable (DS12288, DAC characteristics); clocks of 170 MHz.
const SETTLING_CLOCKS: u32 = 170 * 250;
/// A converter that runs already settles within 10 us.
const THRESHOLD_SETTLING_CLOCKS: u32 = 170 * 10;

/// Starts DAC3, DAC4 and the comparators, and waits until they have settled. To be called once.
pub fn init_comparators_and_await_settling() {
    RCC.ahb2enr().modify(|w| {
        w.set_dac3en(true);
        w.set_dac4en(true);
    });
    // The comparators' registers are clocked with SYSCFG.
    RCC.apb2enr().modify(|w| w.set_syscfgen(true));
    // A peripheral takes writes from the second clock after its enable (RM0440, section 7.2.18); the reads wait for it.
    let _ = (RCC.ahb2enr().read(), RCC.apb2enr().read());
    for converter in [DAC3, DAC4] {
        converter.mcr().write_value(build_threshold_dac_mode_register());
    }
    DAC3.dhr12r(0).write(|w| w.set_dhr(OVER_VOLTAGE_CODE));
    DAC3.dhr12r(1).write(|w| w.set_dhr(OVER_CURRENT_CODE));
    DAC4.dhr12r(0).write(|w| w.set_dhr(LOOP_CODE));
    for converter in [DAC3, DAC4] {
        converter.cr().write_value(build_threshold_dac_control_register());
    }
    for comparator in COMPARATORS {
        comparator.write_settings_with_trip_inverted(false);
    }
    cortex_m::asm::delay(SETTLING_CLOCKS);
}

/// The converters' modes: both channels go to the comparators, and not to a pin.
fn build_threshold_dac_mode_register() -> Mcr {
    let mut modes = Mcr(0);
    modes.set_mode(0, Mode::NORMAL_INT_BUFDIS);
    modes.set_mode(1, Mode::NORMAL_INT_BUFDIS);
    modes.set_hfsel(ABOVE_160_MHZ);
    modes
}

/// The converters' enables: both channels, without trigger, wave and DMA. The second one of DAC4 leads to nothing.
fn build_threshold_dac_control_register() -> Cr {
    let mut control = Cr(0);
    control.set_en(0, true);
    control.set_en(1, true);
    control
}

/// Sets the threshold of the rails: that of the self-test, or that which protects.
pub fn set_over_voltage_threshold_and_await_settling(for_test: bool) {
    DAC3.dhr12r(0).write(|w| w.set_dhr(if for_test { TEST_CODE } else { OVER_VOLTAGE_CODE }));
    // The converter without its buffer settles within some us (DS12288).
    cortex_m::asm::delay(THRESHOLD_SETTLING_CLOCKS);
}

/// Sets the threshold of the loops: that of the self-test, at which closed loops trip, or that which protects.
pub fn set_loop_threshold_and_await_settling(for_test: bool) {
    DAC4.dhr12r(0).write(|w| w.set_dhr(if for_test { LOOP_TEST_CODE } else { LOOP_CODE }));
    cortex_m::asm::delay(THRESHOLD_SETTLING_CLOCKS);
}

/// Whether every comparator and threshold, and the way of the thresholds to the comparators, is as [`init_comparators_and_await_settling`] has set it. Without that way
/// a threshold floats, and the comparator's test, which inverts its polarity, does not see it.
#[must_use]
pub fn are_all_settings_intact() -> bool {
    let is_connected_and_enabled = |converter: Dac| {
        converter.mcr().read().0 == build_threshold_dac_mode_register().0
            && converter.cr().read().0 == build_threshold_dac_control_register().0
    };
    is_connected_and_enabled(DAC3)
        && is_connected_and_enabled(DAC4)
        && DAC3.dor(0).read().dor() == OVER_VOLTAGE_CODE
        && DAC3.dor(1).read().dor() == OVER_CURRENT_CODE
        && DAC4.dor(0).read().dor() == LOOP_CODE
        && COMPARATORS.iter().all(Comparator::are_settings_intact)
}

/// The first comparator that is tripped now.
#[must_use]
pub fn find_tripped_comparator() -> Option<Comparator> {
    COMPARATORS.into_iter().find(Comparator::is_tripped)
}

/// Whether the enclosure is closed.
#[must_use]
pub fn is_interlock_comparator_intact_and_not_tripped() -> bool {
    INTERLOCK.are_settings_intact() && !INTERLOCK.is_tripped()
}

/// Whether the emergency stop is released.
#[must_use]
pub fn is_emergency_stop_comparator_intact_and_not_tripped() -> bool {
    EMERGENCY_STOP.are_settings_intact() && !EMERGENCY_STOP.is_tripped()
}

impl Comparator {
    /// Writes the comparator's settings; `trip_inverted` exchanges trip and release, for the self-test.
    pub fn write_settings_with_trip_inverted(&self, trip_inverted: bool) {
        let mut control = self.build_control_register();
        if trip_inverted {
            control.0 ^= POLARITY;
        }
        self.registers.csr().write_value(control);
    }

    /// Whether the comparator is tripped now.
    #[must_use]
    pub fn is_tripped(&self) -> bool {
        self.registers.csr().read().value()
    }

    fn build_control_register(&self) -> Csr {
        let mut control = Csr(0);
        control.set_en(true);
        // The converter's channel: DAC3's first one for comparators 1 and 3, its second one for 4, DAC4's first one for 5 and 7.
        control.set_inmsel(Inm::DACA);
        control.set_polarity(self.polarity);
        // 20 mV: 15 V of a rail, 0.12 mA, and more than the noise at the pins.
        control.set_hyst(Hysteresis::HYST20M);
        control
    }

    fn are_settings_intact(&self) -> bool {
        let mut now = self.registers.csr().read();
        now.set_value(false);
        now.0 == self.build_control_register().0
    }
}
