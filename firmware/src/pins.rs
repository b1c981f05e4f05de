//! The pin table. Every pin of the chip that the board uses is named here and nowhere else.
//!
//! | pin  | function               | direction  | at reset and when off                                    |
//! |------|------------------------|------------|----------------------------------------------------------|
//! | PA2  | LPUART1 TX             | out        | to the ST-LINK's virtual COM port                        |
//! | PA3  | LPUART1 RX             | in         | from the ST-LINK's virtual COM port, pulled up           |
//! | PA4  | DAC1 channel 1         | analogue   | rail set-point of ERA 1; 1 Mohm to ground outside        |
//! | PA5  | DAC1 channel 2         | analogue   | rail set-point of ERA 2; 1 Mohm to ground outside        |
//! | PA8  | ERA 1 electrode A      | out        | TIM1 channel 1; 10 kohm to ground outside                |
//! | PA9  | ERA 1 electrode B      | out        | TIM1 channel 2; 10 kohm to ground outside                |
//! | PA11 | USB D-                 | in and out |                                                          |
//! | PA12 | USB D+                 | in and out |                                                          |
//! | PC6  | ERA 2 electrode A      | out        | TIM8 channel 1; 10 kohm to ground outside                |
//! | PC7  | ERA 2 electrode B      | out        | TIM8 channel 2; 10 kohm to ground outside                |
//! | PC10 | high-voltage enable    | out        | high: supply on; 10 kohm to ground outside               |
//! | PC12 | heartbeat LED          | out        | high: on                                                 |
//!
//! The resistors outside matter: from reset until the first lines of `main`, and for as long as the chip has no
//! supply, every pin floats. None of the outputs is on a pin that has a pull-up at reset (the debug pins PA13 to PA15,
//! PB3, PB4) or that selects the boot mode (PB8). The converters drive their pins without a buffer, as the buffer cannot
//! go below 0.2 V, so they need a follower with a high-impedance input. The user LED of the NUCLEO-G474RE is on PA5,
//! which is needed as the second converter output: disconnect it (see the board's manual UM2505, solder bridges) and
//! fit the heartbeat LED to PC12.

use embassy_stm32::pac;
use embassy_stm32::pac::gpio::Gpio;

/// ERA channels of this board.
pub const CHANNELS: usize = 2;

/// One pin by its registers.
#[derive(Clone, Copy)]
pub struct Pin {
    /// Registers of the port.
    pub port: Gpio,
    /// Number in the port.
    pub number: usize,
}

/// The pins of one ERA: they carry the timer's outputs 1 (electrode A) and 2 (electrode B).
#[derive(Clone, Copy)]
pub struct ElectrodePins {
    /// Electrode A.
    pub a: Pin,
    /// Electrode B.
    pub b: Pin,
    /// Number of the alternate function that connects both to the timer (DS12288, table 13).
    pub alternate_function: u8,
}

/// Electrodes of both ERAs, in the order of the channels.
pub const ELECTRODES: [ElectrodePins; CHANNELS] = [
    // TIM1 channels 1 and 2.
    ElectrodePins {
        a: Pin { port: pac::GPIOA, number: 8 },
        b: Pin { port: pac::GPIOA, number: 9 },
        alternate_function: 6,
    },
    // TIM8 channels 1 and 2.
    ElectrodePins {
        a: Pin { port: pac::GPIOC, number: 6 },
        b: Pin { port: pac::GPIOC, number: 7 },
        alternate_function: 4,
    },
];

/// High: the high-voltage supply is on.
pub const HIGH_VOLTAGE_ENABLE: Pin = Pin { port: pac::GPIOC, number: 10 };

/// High: the LED is on.
pub const HEARTBEAT: Pin = Pin { port: pac::GPIOC, number: 12 };
