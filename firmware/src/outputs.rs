//! Everything that can energise something, as plain register writes.
//!
//! [`force_outputs_off_withdraw_permit_and_stop_timers`] needs nothing to have been set up and has no state, so the first line of `main`, the device, the break
//! interrupt and the panic, NMI and HardFault handlers all use the same one.

use crate::pins::{self, ELECTRODES, Pin};
use crate::poll::{PAD_SETTLING, poll_within};
use crate::{permit, rails, timers};
use cortex_m::interrupt::CriticalSection;
use embassy_stm32::pac::RCC;
use embassy_stm32::pac::gpio::vals::{Moder, Ot, Pupdr};
use embassy_stm32::pac::gpio::{Gpio, regs};

/// The pins of a port that can energise something.
struct HazardousPins {
    port: Gpio,
    /// One bit each.
    pins: u32,
    /// Their bits in registers that have two for each pin.
    pairs: u32,
    /// Those that make them outputs.
    outputs: u32,
}

/// Worked out beforehand: the break interrupt has no time for it.
const HAZARDOUS: [HazardousPins; pins::HAZARDOUS.len()] = {
    let mut ports = [const { HazardousPins { port: pins::HAZARDOUS[0].0, pins: 0, pairs: 0, outputs: 0 } }; _];
    let mut place = 0;
    while place < ports.len() {
        let (port, pins) = pins::HAZARDOUS[place];
        let ones = spread_to_even_bits(pins);
        ports[place] =
            HazardousPins { port, pins: pins as u32, pairs: ones * 0b11, outputs: ones * Moder::OUTPUT as u32 };
        place += 1;
    }
    ports
};

/// Bit n of `pins` as bit 2 n.
const fn spread_to_even_bits(pins: u16) -> u32 {
    let (mut word, mut number) = (0, 0);
    while number < u16::BITS {
        word |= ((pins >> number) as u32 & 1) << (2 * number);
        number += 1;
    }
    word
}

/// Switches everything off, at once and whatever state the chip is in: permit withdrawn, electrodes low, high voltage disabled,
/// discharge switches closed, then timers stopped and set-points at zero.
pub fn force_outputs_off_withdraw_permit_and_stop_timers() {
    // After a reset the ports have no clock yet, and a write without one would be lost.
    RCC.ahb2enr().modify(|w| {
        w.set_gpioaen(true);
        w.set_gpioben(true);
        w.set_gpiocen(true);
        w.set_gpioden(true);
    });
    let _ = RCC.ahb2enr().read();
    // The pins are taken from the timers, so that "off" does not depend on what a timer does.
    for HazardousPins { port, pins, pairs, outputs } in HAZARDOUS {
        // The upper half resets.
        port.bsrr().write_value(regs::Bsrr(pins << 16));
        port.moder().modify(|w| w.0 = w.0 & !pairs | outputs);
    }
    permit::mark_withdrawn_and_disable_main_output();
    timers::stop_timers_outputs_and_break_interrupt();
    rails::set_all_rails_to_zero();
}

/// Makes the pins that can energise something push-pull outputs without pulls, low. Their reset values are that too.
pub fn init_electrode_and_supply_pins_low() {
    force_outputs_off_withdraw_permit_and_stop_timers();
    for HazardousPins { port, pins, pairs, .. } in HAZARDOUS {
        port.otyper().modify(|w| w.0 &= !pins);
        port.pupdr().modify(|w| w.0 &= !pairs);
    }
}

/// Lets the timers reach the electrodes' pins, or takes the pins from them. Interrupts are masked, as `_masked` shows: the break interrupt must
/// not come between the read and the write of a port's mode.
pub fn set_timers_connected_to_electrodes(_masked: &CriticalSection, connected: bool) {
    for electrode in ELECTRODES.iter().flatten() {
        let Pin { port, number } = electrode.pin;
        port.bsrr().write(|w| w.set_br(number, true));
        port.afr(number / 8).modify(|w| w.set_afr(number % 8, electrode.function));
        let mode = if connected { Moder::ALTERNATE } else { Moder::OUTPUT };
        port.moder().modify(|w| w.set_moder(number, mode));
    }
}

/// The first pin that can energise something and is not low: not held low by its port, or its pad is high all the same.
#[must_use]
pub fn find_output_not_low() -> Option<PinName> {
    HAZARDOUS.iter().find_map(|HazardousPins { port, pins, pairs, outputs }| {
        find_pin_not_low(*port, *pins, port.moder().read().0 & pairs != *outputs)
    })
}

/// The same of the electrodes' pins alone.
#[must_use]
pub fn find_electrode_not_low() -> Option<PinName> {
    ELECTRODES.iter().flatten().find_map(|electrode| name_electrode_pin_if_not_low(electrode.pin))
}

/// The same of all electrodes' pins but this one.
#[must_use]
pub fn find_other_electrode_not_low(high: Pin) -> Option<PinName> {
    let others = ELECTRODES.iter().flatten().filter(|electrode| !is_same_pin(electrode.pin, high));
    { others }.find_map(|electrode| name_electrode_pin_if_not_low(electrode.pin))
}

fn is_same_pin(one: Pin, other: Pin) -> bool {
    one.port == other.port && one.number == other.number
}

/// This pin of an electrode, if it is not low.
fn name_electrode_pin_if_not_low(Pin { port, number }: Pin) -> Option<PinName> {
    find_pin_not_low(port, 1 << number, port.moder().read().moder(number) != Moder::OUTPUT)
}

/// A pin for a person: 100 x the number of its port (1 for A) + its number.
pub type PinName = u32;

/// The first of a port's pins that is not low: all of them, if `has_wrong_mode`, those that are set high or whose pad is high otherwise.
fn find_pin_not_low(port: Gpio, pins: u32, has_wrong_mode: bool) -> Option<PinName> {
    // What the pads show, not only what they were told.
    let high = (port.odr().read().0 | port.idr().read().0) & pins;
    let wrong = if has_wrong_mode { pins } else { high };
    (wrong != 0).then(|| encode_port_and_pin_number(port, wrong.trailing_zeros()))
}

fn encode_port_and_pin_number(port: Gpio, number: u32) -> PinName {
    // The ports' registers are 1 KiB apart, from port A on (RM0440, section 2.2.2).
    ((port.as_ptr().addr() >> 10 & 0xF) as u32 + 1) * 100 + number
}

/// Makes a pin a push-pull output, low from the first moment.
pub fn configure_as_low_output(pin: Pin) {
    pin.port.bsrr().write(|w| w.set_br(pin.number, true));
    pin.port.otyper().modify(|w| w.set_ot(pin.number, Ot::PUSH_PULL));
    pin.port.pupdr().modify(|w| w.set_pupdr(pin.number, Pupdr::FLOATING));
    pin.port.moder().modify(|w| w.set_moder(pin.number, Moder::OUTPUT));
}

/// Sets an output high or low.
pub fn set_pin_level(pin: Pin, high: bool) {
    pin.port.bsrr().write(|w| if high { w.set_bs(pin.number, true) } else { w.set_br(pin.number, true) });
}

/// Whether an output is set high.
#[must_use]
pub fn is_pin_set_high(pin: Pin) -> bool {
    pin.port.odr().read().0 & (1 << pin.number) != 0
}

/// Waits until the pad of an output that has been set high is high, for [`PAD_SETTLING`] at most.
///
/// # Errors
/// The pin, if its pad stays low.
pub fn await_high_pad(pin: Pin) -> Result<(), PinName> {
    let Pin { port, number } = pin;
    let is_high = poll_within(PAD_SETTLING, || port.idr().read().0 & (1 << number) != 0);
    if is_high { Ok(()) } else { Err(encode_port_and_pin_number(port, number as u32)) }
}
