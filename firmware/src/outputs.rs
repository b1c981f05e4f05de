//! Everything that can energise something, as plain register writes: electrodes, rails, high-voltage enable.
//!
//! [`force_off`] needs nothing to have been set up and has no state, so the first line of `main`, the device and the
//! panic and HardFault handlers all use the same one.

use crate::pins::{CHANNELS, ELECTRODES, HIGH_VOLTAGE_ENABLE, Pin};
use crate::pwm;
use embassy_stm32::pac::dac::vals::Mode;
use embassy_stm32::pac::gpio::vals::{Moder, Ot, Pupdr};
use embassy_stm32::pac::{DAC1, RCC};

/// Full scale of the rail set-point in mV: 3.3 V at the converter's pin asks the high-voltage supply for 2000 V, the
/// hard cap of an ERA whose gap of 0.5 mm breaks down near 2 kV once its mass has moved by 0.14 mm. The supply's own
/// limit must not be above it.
pub const RAIL_FULL_SCALE_MILLIVOLTS: u32 = 2_000_000;

/// Converters for supplies clocked above 160 MHz (RM0440, section 22.7.16, HFSEL).
const DAC_ABOVE_160_MHZ: u8 = 0b10;
/// Converter connected to its pin, output buffer off: the buffered output cannot go below 0.2 V, which would be a rail
/// of 120 V instead of none.
const DAC_MODE: Mode = Mode::NORMAL_EXT_BUFDIS;

/// Switches everything off, at once and whatever state the chip is in: electrodes low, rails to zero, high voltage
/// disabled.
pub fn force_off() {
    // After a reset the ports have no clock yet, and a write without one would be lost.
    RCC.ahb2enr().modify(|w| {
        w.set_gpioaen(true);
        w.set_gpiocen(true);
    });
    electrodes_off();
    set_low_output(HIGH_VOLTAGE_ENABLE);
    for channel in 0..CHANNELS {
        set_rail(channel, 0);
    }
}

/// Both electrodes of every ERA low. The pins are taken from the timers, so that "off" does not depend on what a timer
/// does.
pub fn electrodes_off() {
    for pins in &ELECTRODES {
        set_low_output(pins.a);
        set_low_output(pins.b);
    }
    pwm::stop_all();
}

/// Both electrodes of one ERA low.
pub fn electrode_pair_off(channel: usize) {
    if let Some(pins) = ELECTRODES.get(channel) {
        set_low_output(pins.a);
        set_low_output(pins.b);
    }
    pwm::stop(channel);
}

/// Starts the converters' clock and connects them to their pins, at zero.
pub fn init_rails() {
    RCC.ahb2enr().modify(|w| w.set_dac1en(true));
    // A peripheral takes writes from the second clock after its enable (RM0440, section 7.2.18); the read waits for it.
    let _ = RCC.ahb2enr().read();
    DAC1.mcr().write(|w| {
        w.set_mode(0, DAC_MODE);
        w.set_mode(1, DAC_MODE);
        w.set_hfsel(DAC_ABOVE_160_MHZ);
    });
    for channel in 0..CHANNELS {
        set_rail(channel, 0);
    }
    DAC1.cr().write(|w| {
        w.set_en(0, true);
        w.set_en(1, true);
    });
}

/// Sets the rail of one ERA: 0 to 4095 for 0 to [`RAIL_FULL_SCALE_MILLIVOLTS`].
pub fn set_rail(channel: usize, code: u16) {
    DAC1.dhr12r(channel).write(|w| w.set_dhr(code));
}

/// The set-point that the converter holds.
pub fn rail(channel: usize) -> u16 {
    DAC1.dhr12r(channel).read().dhr()
}

/// Enables or disables the high-voltage supply.
pub fn enable_high_voltage(on: bool) {
    let Pin { port, number } = HIGH_VOLTAGE_ENABLE;
    port.bsrr().write(|w| if on { w.set_bs(number, true) } else { w.set_br(number, true) });
}

/// Whether the pin that enables the high-voltage supply is told to be high.
pub fn high_voltage_enabled() -> bool {
    is_high(HIGH_VOLTAGE_ENABLE)
}

/// Connects the electrodes of one ERA to its timer.
pub fn connect_to_timer(channel: usize) {
    let Some(pins) = ELECTRODES.get(channel) else { return };
    for pin in [pins.a, pins.b] {
        let (half, place) = (pin.number / 8, pin.number % 8);
        pin.port.afr(half).modify(|w| w.set_afr(place, pins.alternate_function));
        pin.port.moder().modify(|w| w.set_moder(pin.number, Moder::ALTERNATE));
    }
}

/// Whether every electrode pin is held low by its port, with the timers disconnected.
pub fn electrodes_are_held_low() -> bool {
    ELECTRODES
        .iter()
        .flat_map(|pins| [pins.a, pins.b])
        .all(|pin| pin.port.moder().read().moder(pin.number) == Moder::OUTPUT && !is_high(pin))
}

/// Makes a pin a push-pull output, low from the first moment.
pub fn set_low_output(pin: Pin) {
    pin.port.bsrr().write(|w| w.set_br(pin.number, true));
    pin.port.otyper().modify(|w| w.set_ot(pin.number, Ot::PUSH_PULL));
    pin.port.pupdr().modify(|w| w.set_pupdr(pin.number, Pupdr::FLOATING));
    pin.port.moder().modify(|w| w.set_moder(pin.number, Moder::OUTPUT));
}

fn is_high(pin: Pin) -> bool {
    pin.port.odr().read().0 & (1 << pin.number) != 0
}
