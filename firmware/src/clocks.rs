//! The clock tree: 170 MHz from the internal 16 MHz oscillator, so that no crystal is needed, and 48 MHz for USB.

use embassy_stm32::Config;
use embassy_stm32::rcc::{
    APBPrescaler, Hsi48Config, LsConfig, Pll, PllMul, PllPreDiv, PllRDiv, PllSource, Sysclk, mux,
};

/// Clock of the electrodes' timers in Hz: equal to the core clock, as both APB prescalers are 1 (RM0440, section 7.2.16).
pub const TIMER_CLOCK_HZ: u32 = 170_000_000;

/// Clock configuration: HSI 16 MHz / 4 x 85 / 2 = 170 MHz core clock, the most the chip allows.
///
/// The internal oscillator is within 1 % over temperature, which moves every frequency alike; a board that needs
/// better replaces the source by a crystal here and nowhere else. [`crate::clock_check`] compares it with the watchdog's clock.
pub fn build_clock_config() -> Config {
    let mut config = Config::default();
    // PLL input 4 MHz (allowed 2.66 to 16 MHz), VCO 340 MHz (allowed 96 to 344 MHz).
    config.rcc.pll = Some(Pll {
        source: PllSource::HSI,
        prediv: PllPreDiv::DIV4,
        mul: PllMul::MUL85,
        divp: None,
        divq: None,
        divr: Some(PllRDiv::DIV2),
    });
    config.rcc.sys = Sysclk::PLL1_R;
    config.rcc.apb1_pre = APBPrescaler::DIV1;
    config.rcc.apb2_pre = APBPrescaler::DIV1;
    // Above 150 MHz the core needs range 1 boost (RM0440, section 6.1.5).
    config.rcc.boost = true;
    // The 48 MHz oscillator is trimmed to the host's start-of-frame packets by the clock recovery system; USB needs
    // 0.25 %, untrimmed it has 3 %. It also clocks the random number generator.
    config.rcc.hsi48 = Some(Hsi48Config { sync_from_usb: true });
    config.rcc.mux.clk48sel = mux::Clk48sel::HSI48;
    // Sleep with the debugger's clocks running can fetch wrong instructions from flash (errata sheet ES0430, 2.2.8).
    config.enable_debug_during_sleep = false;
    // No real-time clock, and no low-speed oscillator here: `clock_check` starts it without waiting for ever.
    config.rcc.ls = LsConfig::off();
    config
}
