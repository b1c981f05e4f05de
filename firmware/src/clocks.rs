//! The clock tree: 170 MHz from the internal 16 MHz oscillator, so that no crystal is needed, and 48 MHz for USB.

use embassy_stm32::pac::PWR;
use embassy_stm32::rcc::{
    APBPrescaler, Hsi48Config, LsConfig, Pll, PllMul, PllPreDiv, PllRDiv, PllSource, Sysclk, mux, reinit,
};
use embassy_stm32::{Config, Peripherals};

/// Clock of the electrodes' timers in Hz: equal to the core clock, as both APB prescalers are 1 (RM0440, section 7.2.16).
pub const TIMER_CLOCK_HZ: u32 = 170_000_000;

/// PWR_CR5.R1MODE (RM0440, section 6.4.5): the regulator is in normal mode, for at most 150 MHz.
const CR5_R1MODE: u32 = 1 << 8;

/// Sets up the chip with its clocks. To be called once.
///
/// First with the 16 MHz of a reset: the library's own way into boost mode clears bit 0 of PWR_CR5 instead of R1MODE (stm32-metapac 21.0.0), and
/// its start resets PWR, so that what is done before is lost.
pub fn init_chip_and_clocks() -> Peripherals {
    let mut config = Config::default();
    // Sleep with the debugger's clocks running can fetch wrong instructions from flash (errata sheet ES0430, 2.2.8).
    config.enable_debug_during_sleep = false;
    config.rcc.hsi48 = None;
    config.rcc.ls = LsConfig::off();
    let mut peripherals = embassy_stm32::init(config);
    // Above 150 MHz the core needs range 1 boost (RM0440, section 6.1.5).
    PWR.cr5().modify(|w| w.0 &= !CR5_R1MODE);
    reinit(build_clock_config(), &mut peripherals.RCC);
    peripherals
}

/// Clock configuration: HSI 16 MHz / 4 x 85 / 2 = 170 MHz core clock, the most the chip allows.
///
/// The internal oscillator is within 1 % over temperature, which moves every frequency alike; a board that needs
/// better replaces the source by a crystal here and nowhere else. [`crate::clock_check`] compares it with the watchdog's clock.
fn build_clock_config() -> embassy_stm32::rcc::Config {
    let mut config = embassy_stm32::rcc::Config::new();
    // PLL input 4 MHz (allowed 2.66 to 16 MHz), VCO 340 MHz (allowed 96 to 344 MHz).
    config.pll = Some(Pll {
        source: PllSource::HSI,
        prediv: PllPreDiv::DIV4,
        mul: PllMul::MUL85,
        divp: None,
        divq: None,
        divr: Some(PllRDiv::DIV2),
    });
    config.sys = Sysclk::PLL1_R;
    config.apb1_pre = APBPrescaler::DIV1;
    config.apb2_pre = APBPrescaler::DIV1;
    // The AHB is divided by 2 for the switch, and the flash gets its wait states (RM0440, section 6.1.5).
    config.boost = true;
    // The 48 MHz oscillator is trimmed to the host's start-of-frame packets by the clock recovery system; USB needs
    // 0.25 %, untrimmed it has 3 %. It also clocks the random number generator.
    config.hsi48 = Some(Hsi48Config { sync_from_usb: true });
    config.mux.clk48sel = mux::Clk48sel::HSI48;
    // No real-time clock, and no low-speed oscillator here: `clock_check` starts it without waiting for ever.
    config.ls = LsConfig::off();
    config
}
