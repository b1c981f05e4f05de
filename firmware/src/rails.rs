//! Set-points of the two rails, from DAC1.

use cortex_m::interrupt::CriticalSection;
use embassy_stm32::pac::dac::vals::Mode;
use embassy_stm32::pac::{DAC1, RCC};
use era_shared::supply::RAILS;

/// Converters for supplies clocked above 160 MHz (RM0440, section 22.7.16, HFSEL).
pub const ABOVE_160_MHZ: u8 = 0b10;
/// Converter connected to its pin, output buffer off: the buffered output cannot go below 0.2 V, which would be a rail
/// of 120 V instead of none.
const TO_PIN: Mode = Mode::NORMAL_EXT_BUFDIS;

/// Starts the converters' clock and connects them to their pins, at zero.
pub fn init_rail_dac_at_zero() {
    RCC.ahb2enr().modify(|w| w.set_dac1en(true));
    // A peripheral takes writes from the second clock after its enable (RM0440, section 7.2.18); the read waits for it.
    let _ = RCC.ahb2enr().read();
    DAC1.mcr().write(|w| {
        for rail in 0..RAILS {
            w.set_mode(rail, TO_PIN);
        }
        w.set_hfsel(ABOVE_160_MHZ);
    });
    set_all_rails_to_zero();
    DAC1.cr().write(|w| {
        for rail in 0..RAILS {
            w.set_en(rail, true);
        }
    });
}

/// Sets a rail: 0 to 4095 for 0 to 3.3 V at the pin, which asks the supply for the highest rail voltage
/// ([`era_shared::supply::rail_dac_code`]). The supply's own limit must not be above that. Interrupts are masked, as `_masked` shows: a trip must
/// not come between the look at a waiting trip and the set-point.
pub fn set_rail_code(_masked: &CriticalSection, rail: usize, code: u16) {
    DAC1.dhr12r(rail).write(|w| w.set_dhr(code));
}

/// Both at zero. Does nothing to converters that have no clock yet.
pub fn set_all_rails_to_zero() {
    if RCC.ahb2enr().read().dac1en() {
        for rail in 0..RAILS {
            DAC1.dhr12r(rail).write(|w| w.set_dhr(0));
        }
    }
}
