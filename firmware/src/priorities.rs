//! Who may interrupt whom.
//!
//! | priority | interrupt             | what                                              |
//! |----------|-----------------------|---------------------------------------------------|
//! | 0        | TIM1_BRK_TIM15        | a break: everything off (`breaks.rs`)             |
//! | 0        | PVD_PVM               | the supply fails: everything off (`brown_out.rs`) |
//! | 2        | TIM2                  | time: wakes tasks                                 |
//! | 3        | LPUART1, USB_LP       | links: move bytes, wake tasks                     |
//! | 5        | UART4, by software    | the device's executor                             |
//! | -        | thread mode           | the links' executor                               |
//!
//! Critical sections mask them all; the longest are those of the timers' start (20 us, nothing is connected then), of what the
//! drivers do with their queues (some us), and of the self-test that makes the over-voltage comparators trip (20 us, 0.4 ms if they do
//! not; the rails are at 50 V then) and waits for an electrode's pad (20 us).

use cortex_m::peripheral::NVIC;
use embassy_stm32::interrupt::{Interrupt, InterruptExt, Priority};

/// Words of the NVIC's enable registers that the chip's 102 interrupts need.
const ENABLE_REGISTERS: usize = 4;

/// What switches off.
pub const PROTECTION: Priority = Priority::P0;
/// The device's executor.
pub const DEVICE: Priority = Priority::P5;

/// Disables the interrupts that embassy enables at its start for drivers that this firmware does not use (EXTI and DMA), and puts those of the drivers
/// that it uses, which embassy leaves at the highest priority, below those that switch off. To be called before anything else enables an
/// interrupt.
pub fn disable_unused_interrupts_and_lower_time_and_link_priorities() {
    // SAFETY: the registers of the NVIC; an interrupt that is disabled does not run.
    let disable = |word: usize, interrupts: u32| unsafe { (*NVIC::PTR).icer[word].write(interrupts) };
    for word in 0..ENABLE_REGISTERS {
        disable(word, !0);
    }
    // SAFETY: the handler of the time driver is ready since its start.
    unsafe { Interrupt::TIM2.enable() };
    Interrupt::TIM2.set_priority(Priority::P2);
    Interrupt::LPUART1.set_priority(Priority::P3);
    Interrupt::USB_LP.set_priority(Priority::P3);
}
