//! What runs first after a reset, from the first 4 KiB of the flash: it starts the firmware, or the ROM bootloader where
//! there is no whole firmware.
//!
//! The STM32G474 does not by itself start its bootloader when the flash is empty, as other families do (AN2606, section
//! 4.1: its pattern, 14, has no empty check); a board whose update was cut off would lock up at the next power-up. So
//! these few instructions are kept when the firmware is replaced, and `era flash` erases the firmware's first page before
//! all others and writes its first eight bytes after all others. What they look for at the start of the firmware is
//! therefore there only if everything else is:
//!
//! - the initial stack pointer, which erased flash (all ones) does not hold, in RAM;
//! - the magic of the image header.
//!
//! A power cut within the last write, or while the page is being erased, can leave words that the error correction of
//! the flash cannot read: that raises an NMI (RM0440, section 3.3.4), which starts the bootloader as well, as does a
//! HardFault.
//!
//! The bootloader jumps here too, to start what it has written, with its clocks running, the 48 MHz oscillator for USB
//! among them. Then the chip is reset once more, so that the firmware always starts on the registers' reset values.
//!
//! Nothing of this may differ from one version to the next without need: a changed first stage must be replaced, and
//! for the 30 ms that this takes a power cut leaves a board which only a debug probe or the pin BOOT0 brings back.

use core::arch::global_asm;

// The addresses are those of RM0440: RCC_CRRCR (section 7.4.30) has HSI48ON in bit 0,
// RCC_APB2ENR (7.4.21) SYSCFGEN in bit 0, SYSCFG_MEMRMP (10.2.1) MEM_MODE, 1 = system flash. FLASH_ECCR
// is in 3.7.7. SCB_VTOR and SCB_AIRCR are the architecture's.
global_asm!(
    ".section .first_stage, \"ax\", %progbits",
    ".p2align 2",
    // Its own vector table: initial stack pointer, reset, NMI, HardFault. Nothing else can happen here.
    "    .word 0x20020000",
    "    .word era_first_stage",
    "    .word era_first_stage_fault",
    "    .word era_first_stage_fault",
    "    .thumb",
    "    .thumb_func",
    "    .global era_first_stage",
    "    .type era_first_stage, %function",
    "era_first_stage:",
    "    ldr r0, =0x40021098", // RCC_CRRCR
    "    ldr r1, [r0]",
    "    lsls r1, r1, #31", // HSI48ON
    "    beq 1f",
    "    ldr r0, =0xE000ED0C", // SCB_AIRCR
    "    ldr r1, =0x05FA0004", // SYSRESETREQ
    "    dsb",
    "    str r1, [r0]",
    "    dsb",
    "0:  b 0b",
    "1:  ldr r0, =0x08001000", // the firmware's vector table, ORIGIN(FLASH)
    "    ldr r1, [r0]",
    "    ldr r2, =0x20000008", // its stack pointer is in RAM: 8 bytes above the start to the end
    "    subs r2, r1, r2",
    "    ldr r3, =0x0001FFF8",
    "    cmp r2, r3",
    "    bhi era_start_bootloader",
    "    ldr r2, [r0, #0x200]", // the image header's magic
    "    ldr r3, =0x49415245",  // "ERAI"
    "    cmp r2, r3",
    "    bne era_start_bootloader",
    "    ldr r2, [r0, #0x204]",
    "    ldr r3, =0x4547414D", // "MAGE"
    "    cmp r2, r3",
    "    bne era_start_bootloader",
    "    ldr r3, =0xE000ED08", // SCB_VTOR
    "    str r0, [r3]",
    "    dsb",
    "    msr msp, r1",
    "    ldr r2, [r0, #4]",
    "    bx r2",
    // The bootloader needs its interrupts, so it must not be entered from within an exception: the exception returns to
    // its start instead of to what it came from. The stacked words are PC at 24 and xPSR, of which only the Thumb bit
    // is wanted, at 28.
    "    .thumb_func",
    "    .type era_first_stage_fault, %function",
    "era_first_stage_fault:",
    "    ldr r0, =0x40022018", // FLASH_ECCR
    "    ldr r1, =0xA0000000", // ECCD and ECCD2, cleared by writing 1, or the NMI would come again
    "    str r1, [r0]",
    "    dsb",
    "    ldr r0, =era_start_bootloader",
    "    bic r0, r0, #1",
    "    str r0, [sp, #24]",
    "    mov r1, #0x01000000",
    "    str r1, [sp, #28]",
    "    bx lr",
    "    .thumb_func",
    "    .global era_start_bootloader",
    "    .type era_start_bootloader, %function",
    "era_start_bootloader:",
    "    ldr r0, =0x40021060", // RCC_APB2ENR
    "    ldr r1, [r0]",
    "    movs r2, #1",
    "    orrs r1, r2",
    "    str r1, [r0]",
    "    ldr r1, [r0]",        // the clock needs two cycles (RM0440, section 7.2.17)
    "    ldr r0, =0x40010000", // SYSCFG_MEMRMP
    "    str r2, [r0]",
    "    movs r1, #0",
    "    ldr r0, =0xE000ED08", // SCB_VTOR
    "    str r1, [r0]",
    "    dsb",
    "    isb",
    "    ldr r0, =0x1FFF0000", // the bootloader's vector table
    "    ldr r1, [r0]",
    "    msr msp, r1",
    "    ldr r1, [r0, #4]",
    "    bx r1",
    "    .ltorg",
    ".text",
);
