//! The option bytes: settings of the chip that outlast everything, and that a debug probe or another program may have changed.
//!
//! The firmware does not set them; it reads at its start what the chip has loaded (FLASH_OPTR; RM0440, section 3.7.8). A board with one of
//! these does not arm:
//!
//! | option     | needed | otherwise                                                                             |
//! |------------|--------|---------------------------------------------------------------------------------------|
//! | IWDG_STOP  | 1      | the watchdog stands still in stop mode: an accidental one would keep all outputs       |
//! | IWDG_STDBY | 1      | likewise in standby mode                                                              |
//! | BFB2       | 0      | each start goes through the ROM bootloader, which drives pins by itself                |
//!
//! All others may have any value with which this firmware runs at all; the log tells where they differ from what it recommends:
//!
//! * BOR_LEV: 4, so that the chip resets below 2.8 V. It is delivered with 0 (1.7 V); the voltage detector switches off at 2.9 V in any case.
//! * nRST_STOP, nRST_STDBY, nRST_SHDW: the firmware uses none of these modes. 1 as delivered; 0 would reset the chip, which is as safe.
//! * IWDG_SW, WWDG_SW: 1. A watchdog that the hardware starts is set up by the firmware all the same.
//! * nSWBOOT0, nBOOT0, nBOOT1: 1. With others, the pin BOOT0 does not lead to the ROM bootloader, which repairs an update that was cut off.
//! * SRAM_PE: 0, so that parity is on. All variables are in the first 32 KiB of SRAM1, and all of the stack that is used in the CCM SRAM: a bit of
//!   them that changes by itself is then noticed when it is read, and everything switched off (`breaks.rs`). It is delivered with 1.
//! * DBANK, CCMSRAM_RST, RDP, NRST_MODE, IRHEN: the firmware works with each (`memory.x`).

use embassy_stm32::pac::FLASH;

/// IWDG_STOP, IWDG_STDBY, BFB2.
const NEEDED_MASK: u32 = 1 << 17 | 1 << 18 | 1 << 20;
const NEEDED: u32 = 1 << 17 | 1 << 18;
/// BOR_LEV, nRST_STOP, nRST_STDBY, nRST_SHDW, IWDG_SW, WWDG_SW, nBOOT1, SRAM_PE, nSWBOOT0, nBOOT0.
const RECOMMENDED_MASK: u32 = 0b111 << 8 | 0b111 << 12 | 1 << 16 | 1 << 19 | 1 << 23 | 1 << 24 | 1 << 26 | 1 << 27;
const RECOMMENDED: u32 = 4 << 8 | 0b111 << 12 | 1 << 16 | 1 << 19 | 1 << 23 | 1 << 26 | 1 << 27;

/// The option bytes, if one of them takes a protection away. What differs from the recommendation is logged.
pub fn read_option_bytes_if_unsafe_logging_deviations() -> Option<u32> {
    let options = FLASH.optr().read().0;
    let differing = (options ^ RECOMMENDED) & RECOMMENDED_MASK;
    if differing != 0 {
        defmt::warn!(
            "option bytes {=u32:#010x} differ from the recommended values in the bits {=u32:#010x}",
            options,
            differing
        );
    }
    (options & NEEDED_MASK != NEEDED).then_some(options)
}
