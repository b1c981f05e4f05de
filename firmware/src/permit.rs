//! The permit: a line without which nothing outside the chip is energised, whatever the other lines say.
//!
//! TIM16 holds its output (PA6) active by its compare mode, without counting, while its main output enable (MOE) is set. Its break has the sources of
//! the electrodes' timers: a comparator that trips, a core that has locked up, a supply that fails. So each of them takes the permit away in hardware,
//! even if the processor hangs. Outside, the permit gates the supply's enable, the discharge switches, and the electrodes of ERA 4, whose timer
//! has no break (pin table). Every ms the level of the line is read back.

use crate::pins::{PERMIT, Pin, TimerPin};
use crate::poll::{PAD_SETTLING, poll_within};
use crate::timers::{AF1_COMPARATORS, BDTR_LOCKED, BDTR_MOE};
use core::sync::atomic::{AtomicBool, Ordering};
use cortex_m::interrupt::CriticalSection;
use embassy_stm32::pac;
use embassy_stm32::pac::RCC;
use embassy_stm32::pac::gpio::vals::Moder;
use embassy_stm32::pac::timer::{TimAdv, regs};
use era_shared::protocol::FaultCode;
use era_shared::supply::FaultFinding;

/// TIM16. Its only output is the permit.
// SAFETY: TIM16 has the registers that are used here at the offsets of an advanced timer (RM0440, register maps of TIM1 and TIM16).
pub const TIMER: TimAdv = unsafe { TimAdv::from_ptr(pac::TIM16.as_ptr()) };

/// CCMR1: OC1M = 0101, the output is forced active. The lock keeps it.
const CCMR1_FORCED_ACTIVE: u32 = 0b101 << 4;
/// CCER.CC1E, active high. With OSSI set, the output is driven low while MOE is clear.
const CCER_CC1E: u32 = 1;

/// Details of [`FaultCode::Permit`]: the line is high although the permit is not given ...
const DETAIL_STUCK_HIGH: u32 = 1;
/// ... or low although it is given.
const DETAIL_STUCK_LOW: u32 = 2;

/// Whether the permit has been given and not been withdrawn, by software.
static GIVEN: AtomicBool = AtomicBool::new(false);

/// Sets up TIM16, with the permit withdrawn. To be called once.
pub fn init_permit_timer_with_permit_withdrawn() {
    RCC.apb2enr().modify(|w| w.set_tim16en(true));
    // A peripheral takes writes from the second clock after its enable (RM0440, section 7.2.18); the read waits for it.
    let _ = RCC.apb2enr().read();
    TIMER.ccmr_output(0).write_value(regs::CcmrOutputGp16(CCMR1_FORCED_ACTIVE));
    TIMER.ccer().write_value(regs::CcerAdv(CCER_CC1E));
    TIMER.af1().write_value(regs::Af1Adv(AF1_COMPARATORS));
    // Last: it locks.
    TIMER.bdtr().write_value(regs::BdtrAdv(BDTR_LOCKED));
}

/// Gives or withdraws the permit. A permit that a break has withdrawn is not given again before software has withdrawn it too. Interrupts are
/// masked, as `_masked` shows: the break interrupt must not come between the read and the write of the port's mode, nor between the look
/// at a waiting trip and the permit.
pub fn set_permit(_masked: &CriticalSection, given: bool) {
    if given == GIVEN.load(Ordering::Relaxed) {
        return;
    }
    let TimerPin { pin: Pin { port, number }, function } = PERMIT;
    port.bsrr().write(|w| w.set_br(number, true));
    if given {
        set_main_output_enable_of_permit_timer(true);
        port.afr(number / 8).modify(|w| w.set_afr(number % 8, function));
        port.moder().modify(|w| w.set_moder(number, Moder::ALTERNATE));
    } else {
        port.moder().modify(|w| w.set_moder(number, Moder::OUTPUT));
        set_main_output_enable_of_permit_timer(false);
    }
    GIVEN.store(given, Ordering::Relaxed);
}

/// Notes that the permit's pin was taken from its timer, and clears the timer's main output enable. Does nothing to a timer that has no clock yet.
pub fn mark_withdrawn_and_disable_main_output() {
    GIVEN.store(false, Ordering::Relaxed);
    if RCC.apb2enr().read().tim16en() {
        set_main_output_enable_of_permit_timer(false);
    }
}

/// Sets the main output enable of the permit's timer. While a break is active it does not keep it.
pub fn set_main_output_enable_of_permit_timer(enabled: bool) {
    TIMER.bdtr().modify(|w| w.0 = if enabled { w.0 | BDTR_MOE } else { w.0 & !BDTR_MOE });
}

/// Whether the line is high, at its pin.
#[must_use]
pub fn is_line_high() -> bool {
    let Pin { port, number } = PERMIT.pin;
    port.idr().read().0 & (1 << number) != 0
}

/// Whether software has given the permit.
#[must_use]
pub fn is_given() -> bool {
    GIVEN.load(Ordering::Relaxed)
}

/// Whether a break has withdrawn the permit that software has given.
#[must_use]
pub fn is_withdrawn_by_break() -> bool {
    GIVEN.load(Ordering::Relaxed) && TIMER.bdtr().read().0 & BDTR_MOE == 0
}

/// Whether what withdraws the permit in hardware is set up as [`init_permit_timer_with_permit_withdrawn`] has done it.
#[must_use]
pub fn are_permit_timer_settings_intact() -> bool {
    TIMER.af1().read().0 == AF1_COMPARATORS
        && TIMER.bdtr().read().0 & !BDTR_MOE == BDTR_LOCKED
        && TIMER.ccmr_output(0).read().0 == CCMR1_FORCED_ACTIVE
        && TIMER.ccer().read().0 == CCER_CC1E
}

/// Compares the line with what it was set to.
///
/// # Errors
/// [`FaultCode::Permit`] with 1 if the line is high without the permit, and 2 if it is low with it.
pub fn check_line_level_matches_permit() -> Result<(), FaultFinding> {
    let is_as_set = || is_line_high() == GIVEN.load(Ordering::Relaxed);
    if is_as_set() || poll_within(PAD_SETTLING, is_as_set) {
        return Ok(());
    }
    let detail = if GIVEN.load(Ordering::Relaxed) { DETAIL_STUCK_LOW } else { DETAIL_STUCK_HIGH };
    Err((FaultCode::Permit, detail))
}
