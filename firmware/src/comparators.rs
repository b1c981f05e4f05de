//! The five comparators that switch everything off in hardware, and the two loops that two of them watch.
//!
//! | comparator | input | against   | trips when                                     |
//! |------------|-------|-----------|------------------------------------------------|
//! | 1          | PA1   | DAC3 ch 1 | rail 2 is above the over-voltage limit         |
//! | 3          | PA0   | DAC3 ch 1 | rail 1 is above the over-voltage limit         |
//! | 4          | PB0   | DAC3 ch 2 | the momentary current is above its limit       |
//! | 5          | PB13  | VREFINT   | the interlock loop is open (inverted)          |
//! | 7          | PB14  | VREFINT   | the emergency stop is pressed (inverted)       |
//!
//! The input is the first of the two that each has (INPSEL = 0), the thresholds are connected as RM0440 tells (inputs of the comparators).
//! A comparator's output is high when it trips; `timers.rs` leads it to the breaks.

use crate::rails::ABOVE_160_MHZ;
use embassy_stm32::pac::comp::Comp;
use embassy_stm32::pac::comp::regs::Csr;
use embassy_stm32::pac::comp::vals::{Hysteresis, Inm, Polarity};
use embassy_stm32::pac::dac::vals::Mode;
use embassy_stm32::pac::{COMP1, COMP3, COMP4, COMP5, COMP7, DAC3, RCC};
use era_shared::circuit::{MOMENTARY_FULL_SCALE_MICROAMPS, RAIL_FULL_SCALE_MILLIVOLTS};
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
    input: Inm,
    polarity: Polarity,
}

/// The loops are below the threshold of 1.2 V when they are open; closed, they are at 2.185 V (pin table).
const INTERLOCK: Comparator = Comparator {
    number: 5,
    fault: FaultCode::InterlockOpen,
    registers: COMP5,
    input: Inm::VREF,
    polarity: Polarity::INVERTED,
};
const EMERGENCY_STOP: Comparator = Comparator {
    number: 7,
    fault: FaultCode::EmergencyStop,
    registers: COMP7,
    input: Inm::VREF,
    polarity: Polarity::INVERTED,
};

const fn make_comparator_against_dac(number: u32, fault: FaultCode, registers: Comp) -> Comparator {
    Comparator { number, fault, registers, input: Inm::DACA, polarity: Polarity::NOT_INVERTED }
}

/// Those that watch rails 1 and 2.
pub const OVER_VOLTAGE: [Comparator; 2] = [
    make_comparator_against_dac(3, FaultCode::OverVoltage, COMP3),
    make_comparator_against_dac(1, FaultCode::OverVoltage, COMP1),
];

/// All that are used, those first whose reason says more if several have tripped: a person's stop before its consequences.
pub const COMPARATORS: [Comparator; 5] = [
    EMERGENCY_STOP,
    INTERLOCK,
    make_comparator_against_dac(4, FaultCode::OverCurrent, COMP4),
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

/// DAC3 and the voltage scaler settle within 200 us (DS12288, DAC and comparator characteristics); clocks of 170 MHz.
const SETTLING_CLOCKS: u32 = 170 * 250;
/// A converter that runs already settles within 10 us.
const THRESHOLD_SETTLING_CLOCKS: u32 = 170 * 10;

/// Starts DAC3 and the comparators, and waits until they have settled. To be called once.
pub fn init_comparators() {
    RCC.ahb2enr().modify(|w| w.set_dac3en(true));
    // The comparators' registers are clocked with SYSCFG.
    RCC.apb2enr().modify(|w| w.set_syscfgen(true));
    // A peripheral takes writes from the second clock after its enable (RM0440, section 7.2.18); the reads wait for it.
    let _ = (RCC.ahb2enr().read(), RCC.apb2enr().read());
    DAC3.mcr().write(|w| {
        w.set_mode(0, Mode::NORMAL_INT_BUFDIS);
        w.set_mode(1, Mode::NORMAL_INT_BUFDIS);
        w.set_hfsel(ABOVE_160_MHZ);
    });
    DAC3.dhr12r(0).write(|w| w.set_dhr(OVER_VOLTAGE_CODE));
    DAC3.dhr12r(1).write(|w| w.set_dhr(OVER_CURRENT_CODE));
    DAC3.cr().write(|w| {
        w.set_en(0, true);
        w.set_en(1, true);
    });
    for comparator in COMPARATORS {
        comparator.write_settings_with_trip_inverted(false);
    }
    cortex_m::asm::delay(SETTLING_CLOCKS);
}

/// Sets the threshold of the rails: that of the self-test, or that which protects.
pub fn set_over_voltage_threshold(for_test: bool) {
    DAC3.dhr12r(0).write(|w| w.set_dhr(if for_test { TEST_CODE } else { OVER_VOLTAGE_CODE }));
    // The converter without its buffer settles within some us (DS12288).
    cortex_m::asm::delay(THRESHOLD_SETTLING_CLOCKS);
}

/// Whether every comparator and threshold is as [`init_comparators`] has set it.
#[must_use]
pub fn are_all_settings_intact() -> bool {
    DAC3.dor(0).read().dor() == OVER_VOLTAGE_CODE
        && DAC3.dor(1).read().dor() == OVER_CURRENT_CODE
        && COMPARATORS.iter().all(Comparator::are_settings_intact)
}

/// The first comparator that is tripped now.
#[must_use]
pub fn find_tripped_comparator() -> Option<Comparator> {
    COMPARATORS.into_iter().find(Comparator::is_tripped)
}

/// Whether the enclosure is closed.
#[must_use]
pub fn is_interlock_closed() -> bool {
    INTERLOCK.are_settings_intact() && !INTERLOCK.is_tripped()
}

/// Whether the emergency stop is released.
#[must_use]
pub fn is_emergency_stop_released() -> bool {
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
        control.set_inmsel(self.input);
        control.set_polarity(self.polarity);
        // 20 mV: 15 V of a rail, 0.12 mA, and more than the noise at the pins.
        control.set_hyst(Hysteresis::HYST20M);
        // The scaler brings VREFINT to the comparator; its bridge stays off, as no fraction of it is used.
        control.set_scalen(self.input.to_bits() == Inm::VREF.to_bits());
        control
    }

    fn are_settings_intact(&self) -> bool {
        let mut now = self.registers.csr().read();
        now.set_value(false);
        now.0 == self.build_control_register().0
    }
}
