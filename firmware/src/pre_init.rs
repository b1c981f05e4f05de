//! What runs before the start-up code has set up memory.
//!
//! * Every write arrives before the next instruction (ACTLR.DISDEFWBUF). With the write buffer, a handler that ends while a write waits may be
//!   followed by the handler of another interrupt than the one that is due (Cortex-M4 erratum 838869). Arm's errata notice names this setting
//!   for programs without a memory protection unit, as this one; so it holds for the handlers of the libraries too.
//! * The first write to SRAM after a reset may be lost (errata sheet ES0430; its text was not at hand). One that nobody needs comes first, to the
//!   CCM SRAM and to SRAM1: the start-up code's own first writes are a return address and variables.
//! * Memory holds anything at all after power-on. Where the option byte SRAM_PE has turned parity on, also after new option bytes have been loaded,
//!   reading a word that was never written is an NMI, which would be noted, and end in a reset, for ever. Parity covers the first 32 KiB of
//!   SRAM1 and the CCM SRAM (RM0440, section 2.4). In the first are the variables, all of which the start-up code writes. The second begins
//!   the stack, and is written here, as code may copy variables whose values do not matter: 8 clocks of 16 MHz for each 8 bytes, 2 ms. What
//!   outlasts a reset (`.kept`) is in neither.

use core::arch::global_asm;

// ACTLR is in PM0214, section 4.4.1, with DISDEFWBUF in bit 1. RCC_CSR is in RM0440, section 7.4.31, with BORRSTF in bit 27 and
// OBLRSTF in bit 25; FLASH_OPTR in 3.7.8, with SRAM_PE in bit 24, 1 = no parity.
global_asm!(
    ".section .text.era_pre_init, \"ax\", %progbits",
    ".p2align 2",
    ".thumb_func",
    ".global __pre_init",
    ".type __pre_init, %function",
    "__pre_init:",
    "    movs r0, #0",
    "    str r0, [sp, #-8]",
    "    ldr r1, =__sdata",
    "    str r0, [r1]",
    "    ldr r1, =0xE000E008", // ICB_ACTLR
    "    movs r2, #2",         // DISDEFWBUF
    "    str r2, [r1]",
    "    dsb",
    "    ldr r1, =0x40021094", // RCC_CSR
    "    ldr r1, [r1]",
    "    tst r1, #0x0A000000", // BORRSTF, OBLRSTF
    "    beq 2f",
    "    ldr r1, =0x40022020", // FLASH_OPTR
    "    ldr r1, [r1]",
    "    lsls r1, r1, #7", // SRAM_PE
    "    bmi 2f",
    "    ldr r1, =0x20018000", // CCM SRAM
    "    mov r2, sp",
    "    movs r3, #0",
    "1:  cmp r1, r2",
    "    bhs 2f",
    "    strd r0, r3, [r1], #8",
    "    b 1b",
    "2:  bx lr",
    "    .ltorg",
    ".size __pre_init, . - __pre_init",
    ".text",
);
