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

use embassy_stm32::interrupt::{Interrupt, InterruptExt, Priority};

/// What switches off.
pub const PROTECTION: Priority = Priority::P0;
/// The device's executor.
pub const DEVICE: Priority = Priority::P5;

/// Puts the drivers' interrupts, which embassy leaves at the highest priority, below those that switch off. To be called
/// before the links are opened.
pub fn lower_time_and_link_interrupt_priorities() {
    Interrupt::TIM2.set_priority(Priority::P2);
    Interrupt::LPUART1.set_priority(Priority::P3);
    Interrupt::USB_LP.set_priority(Priority::P3);
}
