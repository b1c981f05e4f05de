//! The pin table, and what is outside. Every pin of the chip that the board uses is named here and nowhere else.
//!
//! | pin  | function                  | direction  | outside; at reset and when off                              |
//! |------|---------------------------|------------|-------------------------------------------------------------|
//! | PA0  | voltage of rail 1         | analogue   | ADC1 input 1 and comparator 3; divider                      |
//! | PA1  | voltage of rail 2         | analogue   | ADC1 input 2 and comparator 1; divider                      |
//! | PA2  | LPUART1 TX                | out        | to the ST-LINK's virtual COM port                           |
//! | PA3  | LPUART1 RX                | in         | from the ST-LINK's virtual COM port, pulled up inside       |
//! | PA4  | set-point of rail 1       | analogue   | DAC1 channel 1; 1 Mohm to ground, then a follower           |
//! | PA5  | set-point of rail 2       | analogue   | DAC1 channel 2; 1 Mohm to ground, then a follower           |
//! | PA6  | permit                    | out        | TIM16 channel 1; high: given; 10 kohm to ground              |
//! | PA8  | ERA 1 electrode A         | out        | TIM1 channel 1; 10 kohm to ground                           |
//! | PA10 | ERA 1 electrode B         | out        | TIM1 channel 3; 10 kohm to ground                           |
//! | PA11 | USB D-                    | in and out | wired to a USB connector; the NUCLEO has none for it        |
//! | PA12 | USB D+                    | in and out | wired to a USB connector; the NUCLEO has none for it        |
//! | PB0  | momentary current         | analogue   | comparator 4; shunt of 165 ohm                              |
//! | PB2  | ERA 3 electrode A         | out        | TIM20 channel 1; 10 kohm to ground                          |
//! | PB6  | ERA 4 electrode A         | out        | TIM4 channel 1; 10 kohm to ground                           |
//! | PB9  | ERA 4 electrode B         | out        | TIM4 channel 4; 10 kohm to ground                           |
//! | PB11 | accelerometer (reserved) | analogue   | ADC1 and ADC2 input 14; 10 kohm to ground while it is missing |
//! | PB13 | interlock loop            | analogue   | comparator 5 and ADC3 input 5; 10 kohm to ground             |
//! | PB14 | emergency stop loop       | analogue   | comparator 7 and ADC4 input 4; 10 kohm to ground             |
//! | PC0  | earth bond                | analogue   | ADC1 input 6; 330 ohm to 3.3 V, 10 ohm to the bond          |
//! | PC1  | average current           | analogue   | ADC2 input 7; shunt of 1.65 kohm                            |
//! | PC2  | discharge switch, rail 1  | out        | high: open; low or floating: closed; 10 kohm to ground      |
//! | PC3  | high-voltage enable       | out        | high: supply on; 10 kohm to ground                          |
//! | PC6  | ERA 2 electrode A         | out        | TIM8 channel 1; 10 kohm to ground                           |
//! | PC8  | ERA 3 electrode B         | out        | TIM20 channel 3; 10 kohm to ground                          |
//! | PC9  | ERA 2 electrode B         | out        | TIM8 channel 4; 10 kohm to ground                           |
//! | PC12 | heartbeat LED             | out        | high: on                                                    |
//! | PD2  | discharge switch, rail 2  | out        | high: open; low or floating: closed; 10 kohm to ground      |
//!
//! The resistors to ground matter: from reset until the first lines of `main`, and for as long as the chip has no supply,
//! every pin floats, and "low" must then mean "off" all the same. None of the outputs is on a pin that has a pull-up at
//! reset (the debug pins PA13 to PA15, PB3, PB4) or that selects the boot mode (PB8). The converters drive their pins
//! without a buffer, as the buffer cannot go below 0.2 V (a rail of 120 V instead of none), so a follower with a
//! high-impedance input comes first. A converter without its buffer has 10 to 15 kohm at its output, so that even the 1 Mohm
//! to ground lower a set-point by 1 to 1.5 %, and nothing else may load it. No analogue input may float while its part of the
//! circuit is missing: 10 kohm to ground takes its place. The user LED of the NUCLEO-G474RE is on PA5, which is a converter's
//! output here: open its solder bridge (UM2505) and fit the LED to PC12.
//!
//! PB11 is reserved: nothing reads it yet, and it stays as the reset leaves it, analogue. Its input is that of the pin data of stm32-metapac
//! (ADC1 and ADC2, signal IN14); no other part of the board uses the pin.
//!
//! What the inputs carry, with 3.3 V as full scale and a clamp to 3.3 V at each:
//!
//! * Rails: a divider of 100 Mohm over 132 kohm, 3.30 V for 2500 V, with 1 nF at the tap: 0.13 ms.
//! * Average current: 1.65 kohm in the supply's return, 3.3 V for 2 mA, behind 10 kohm and 100 nF: 1 ms.
//! * Momentary current: 165 ohm between the rails' capacitors and the electrodes' return, 3.3 V for 20 mA; not filtered but
//!   by the 100 pF at the pin.
//! * Interlock and emergency stop: 3.3 V through normally closed contacts and then 5.1 kohm at the far end of the loop; 10 kohm to ground, 1 kohm
//!   and 100 nF at the pin. Closed is 2.185 V. A broken wire reads 0 V, and a loop that touches 3.3 V, or whose two wires touch, reads 3.3 V:
//!   both are not closed.
//! * Earth bond: 330 ohm from 3.3 V, then 10 ohm to one terminal on the panel, earth on another one. Through bonds of less than 17 ohm in
//!   all, the pin, between the two resistors, is at 0.097 to 0.25 V; 0 V is a loop that is not fed.
//! * Each electrode is charged through 1 Mohm, so that a fault to earth draws 2 mA at 2 kV even if everything else fails, and
//!   discharged through 100 kohm by its own lower switch: 116 pF take 0.12 ms and 0.012 ms.
//!
//! * The lower switch is on unless the electrode's pin is high. An upper switch closes only if its own pin is high, its partner's pin is
//!   low and its partner is below 100 V, which a monitor at each electrode tells: a lower switch that stays open would otherwise leave both
//!   electrodes charged. Nothing of this has a line to the chip; bring-up tests it.
//!
//! What the permit (PA6) does outside, in gates that share no part with the chip:
//!
//! * Supply enabled = PC3 AND PA6.
//! * Discharge switch of a rail open = its pin (PC2, PD2) AND PA6.
//! * Electrodes of ERA 4 = their pins (PB6, PB9) AND PA6, because TIM4 has no break.
//!
//! What a rail has besides; the values are those of `era_shared::circuit`, from which the limits of the discharge follow:
//!
//! * 1.8 nF to ground: capacitors and the output of the supply module.
//! * Two bleeders that share no part: the divider, and a resistor of 100 Mohm without a measurement. Each of them alone discharges
//!   the rail within a second if the other breaks.
//! * A discharge switch in series with 1 Mohm. It is closed unless its pin is high, within 1 ms.

use embassy_stm32::pac;
use embassy_stm32::pac::gpio::Gpio;
use era_shared::MAX_CHANNELS;

/// ERA channels of this board.
pub const CHANNELS: usize = MAX_CHANNELS;

/// One pin by its registers.
#[derive(Clone, Copy)]
pub struct Pin {
    /// Registers of the port.
    pub port: Gpio,
    /// Number in the port.
    pub number: usize,
}

const fn make_pin(port: Gpio, number: usize) -> Pin {
    Pin { port, number }
}

/// A pin that carries a timer's output.
#[derive(Clone, Copy)]
pub struct TimerPin {
    /// The pin.
    pub pin: Pin,
    /// Number of the alternate function that connects it to the timer (DS12288, table 13).
    pub function: u8,
}

const fn make_timer_pin(port: Gpio, number: usize, alternate_function: u8) -> TimerPin {
    TimerPin { pin: make_pin(port, number), function: alternate_function }
}

/// Electrodes A and B of each ERA, in the order of the channels.
pub const ELECTRODES: [[TimerPin; 2]; CHANNELS] = [
    [make_timer_pin(pac::GPIOA, 8, 6), make_timer_pin(pac::GPIOA, 10, 6)],
    [make_timer_pin(pac::GPIOC, 6, 4), make_timer_pin(pac::GPIOC, 9, 4)],
    [make_timer_pin(pac::GPIOB, 2, 3), make_timer_pin(pac::GPIOC, 8, 6)],
    [make_timer_pin(pac::GPIOB, 6, 2), make_timer_pin(pac::GPIOB, 9, 2)],
];

/// High, as an output of TIM16: supply, discharge switches and ERA 4 follow their own lines. Low: they are off, whatever these say.
pub const PERMIT: TimerPin = make_timer_pin(pac::GPIOA, 6, 1);

/// High: the high-voltage supply is on. Like the discharge switches on a pin that the chip's ROM bootloader leaves alone:
/// its USART3 would drive PC10 high (AN2606, section "STM32G47xxx/48xxx devices").
pub const HIGH_VOLTAGE_ENABLE: Pin = make_pin(pac::GPIOC, 3);

/// High: the discharge switch of the rail is open.
pub const DISCHARGE_OPEN: [Pin; 2] = [make_pin(pac::GPIOC, 2), make_pin(pac::GPIOD, 2)];

/// High: the LED is on.
pub const HEARTBEAT: Pin = make_pin(pac::GPIOC, 12);

/// Every pin that can energise something, by port: low means off for all of them. The electrodes of ERA 4, whose timer has
/// no break, are on the port that comes first.
pub const HAZARDOUS: [(Gpio, u16); 4] = [
    (pac::GPIOB, 1 << 2 | 1 << 6 | 1 << 9),
    (pac::GPIOA, 1 << 6 | 1 << 8 | 1 << 10),
    (pac::GPIOC, 1 << 2 | 1 << 3 | 1 << 6 | 1 << 8 | 1 << 9),
    (pac::GPIOD, 1 << 2),
];
