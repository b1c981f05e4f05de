//! What switches off without asking the device: the breaks of the timers, and the interrupt that goes with them.
//!
//! A comparator that trips clears MOE of TIM1, TIM8, TIM20, and of TIM16, which makes the permit ([`permit`]), in some 10 ns, with no software in
//! the way; so do a core that has locked up, a flash word that cannot be read, an SRAM word with the wrong parity (where the option byte SRAM_PE
//! turns parity on), and a supply below the voltage detector's threshold (SYSCFG CFGR2, locked until the next reset). TIM4 has no break: without
//! the permit a gate outside holds its electrodes low. Beside that, an over-current clears its outputs in hardware until its next update event, and
//! the interrupt below takes its pins away within about a us.
//!
//! The interrupt is at the highest priority and everything else below it; it does the same as [`force_outputs_off_withdraw_permit_and_stop_timers`] and leaves the
//! reason for the device ([`trip::take_trip`]). It is enabled while the supply is.

use crate::comparators::{COMPARATORS, Comparator, LOOPS, OVER_VOLTAGE, find_tripped_comparator};
use crate::outputs::{find_output_not_low, force_outputs_off_withdraw_permit_and_stop_timers, set_pin_level};
use crate::permit;
use crate::pins::DISCHARGE_OPEN;
use crate::poll::poll_within;
use crate::priorities::PROTECTION;
use crate::timers::{self, WITH_BREAK};
use crate::trip;
use embassy_stm32::interrupt;
use embassy_stm32::interrupt::{Interrupt, InterruptExt};
use embassy_stm32::pac::timer::TimAdv;
use embassy_stm32::pac::{PWR, SYSCFG};
use embassy_time::Duration;
use era_shared::protocol::FaultCode;
use era_shared::supply::{FaultFinding, RAILS};

/// A comparator reaches the breaks within 0.1 us; waiting ends long after that.
const TRIP_WAIT: Duration = Duration::from_micros(100);

/// What the self-test has found: a comparator's number, and what is added to it by what went wrong.
type SelfTestDetail = u32;

/// What is added to a comparator's number in the self-test's finding, by what went wrong.
const DETAIL_TIMER: SelfTestDetail = 10;
const DETAIL_NOT_AT_REST: SelfTestDetail = 100;
const DETAIL_SETTINGS: SelfTestDetail = 1_000;
const DETAIL_NO_TRIP: SelfTestDetail = 3_000;
const DETAIL_FOREIGN_TRIP: SelfTestDetail = 3_010;
const DETAIL_NOT_RELEASED: SelfTestDetail = 3_020;
const DETAIL_INTERRUPT: SelfTestDetail = 4_000;
/// Likewise in a finding about the permit: it stays although the comparator has tripped.
const DETAIL_PERMIT_STAYS: SelfTestDetail = 10;

/// Every timer whose outputs a break switches off: those of the electrodes, in the order of the channels, and that of the permit.
const BREAKABLE: [TimAdv; 4] = {
    let [first, second, third] = WITH_BREAK;
    [first, second, third, permit::TIMER]
};

/// Connects the core's own failures to the breaks, and enables the break interrupt. To be called once, before the supply is enabled.
pub fn connect_core_failures_to_breaks_and_enable_interrupt() {
    SYSCFG.cfgr2().modify(|w| {
        w.set_cll(true);
        w.set_spl(true);
        w.set_pvdl(true);
        w.set_eccl(true);
    });
    Interrupt::TIM1_BRK_TIM15.set_priority(PROTECTION);
    // SAFETY: the handler is ready. Critical sections mask it like all others (`priorities.rs`).
    unsafe { Interrupt::TIM1_BRK_TIM15.enable() };
}

#[interrupt]
fn TIM1_BRK_TIM15() {
    // Off before anything is looked at; it disables this interrupt too, whose cause may last.
    force_outputs_off_withdraw_permit_and_stop_timers();
    let (code, detail) = find_trip_cause_or_assume_over_current();
    trip::note_trip_unless_one_is_noted(code, detail);
    // The writes have arrived when the handler ends, or another handler might run in place of the next one (Cortex-M4 erratum 838869).
    cortex_m::asm::dsb();
}

/// The fault of what has tripped, as far as it can still be seen.
#[must_use]
pub fn find_trip_cause_or_assume_over_current() -> FaultFinding {
    match find_tripped_comparator() {
        Some(comparator) => (comparator.fault, 0),
        None if PWR.sr2().read().pvdo() => (FaultCode::BrownOut, 0),
        // Only a current can come and go within the interrupt's latency: all other inputs have filters.
        None => (FaultCode::OverCurrent, 0),
    }
}

/// Clears the flags of breaks that are over and lets breaks raise the interrupt; one that lasts raises it at once.
pub fn arm_break_interrupt() {
    timers::clear_break_flags();
    timers::set_break_interrupt(true);
}

/// Tests the permit's line, every comparator, and the break interrupt. With its polarity inverted a comparator must trip, whatever its input
/// carries, clear MOE of all four timers and withdraw the permit; with its polarity restored it must be released. This proves the comparator's
/// output, its connection to the breaks and their effect. Those of the loops are tested with their inputs as well: with the threshold above the level
/// of a closed loop they must trip. The other thresholds are only compared with their registers here. The timers stand still, the supply is
/// disabled, the rails are discharged, and the pins other than the permit's are low.
///
/// # Errors
/// [`FaultCode::SelfTest`] with the comparator's number; +10, 20, 30, 40 if MOE of TIM1, TIM8, TIM20 or TIM16 did not fall, +100 if the
/// comparator or MOE did not go back, +1000 if a register does not hold its settings (number 0), +3000 if it does not see its closed loop, +3020 if
/// it is not released after that, +4000 if the interrupt did not run or did not switch off. [`FaultCode::Permit`] as in
/// [`permit::check_line_level_matches_permit`], or 10 + the comparator's number if the line stayed high.
pub fn test_permit_line_comparators_and_break_interrupt() -> Result<(), FaultFinding> {
    let locked = SYSCFG.cfgr2().read();
    let led_here = locked.cll() && locked.spl() && locked.pvdl() && locked.eccl();
    if !crate::comparators::are_all_settings_intact()
        || !crate::brown_out::is_voltage_detector_configured()
        || !led_here
        || !permit::are_permit_timer_settings_intact()
    {
        return Err((FaultCode::SelfTest, DETAIL_SETTINGS));
    }
    let result = test_line_level_follows_permit_and_leave_permit_given()
        .and_then(|()| COMPARATORS.iter().try_for_each(test_that_comparator_clears_outputs_and_permit))
        .and_then(|()| test_interlock_and_stop_loop_comparators())
        .and_then(|()| test_break_interrupt_notes_trip_and_switches_off());
    cortex_m::interrupt::free(|masked| permit::set_permit(masked, false));
    timers::set_main_outputs(false);
    timers::clear_break_flags();
    result
}

/// Tests that the permit's line is low without the permit and high with it. The permit is left given.
fn test_line_level_follows_permit_and_leave_permit_given() -> Result<(), FaultFinding> {
    permit::check_line_level_matches_permit()?;
    cortex_m::interrupt::free(|masked| permit::set_permit(masked, true));
    match permit::check_line_level_matches_permit() {
        // A comparator that is tripped: the tests of the comparators find which.
        Err(_) if permit::is_withdrawn_by_break() => Ok(()),
        result => result,
    }
}

/// Lets a comparator trip with the interrupt enabled: the handler must note the reason and pull every pin low.
fn test_break_interrupt_notes_trip_and_switches_off() -> Result<(), FaultFinding> {
    let [comparator, ..] = &COMPARATORS;
    // A pin that the handler has to pull low. The rails are discharged, and the switch needs a ms to open.
    let [pin, _] = DISCHARGE_OPEN;
    set_pin_level(pin, true);
    arm_break_interrupt();
    comparator.write_settings_with_trip_inverted(true);
    let has_run = poll_within(TRIP_WAIT, || trip::peek_trip_code().is_some());
    let switches_off = poll_within(TRIP_WAIT, || find_output_not_low().is_none());
    comparator.write_settings_with_trip_inverted(false);
    force_outputs_off_withdraw_permit_and_stop_timers();
    match trip::take_trip() {
        Some((code, detail)) if code != comparator.fault => Err((code, detail)),
        _ if has_run && switches_off => Ok(()),
        _ => Err((FaultCode::SelfTest, comparator.number + DETAIL_INTERRUPT)),
    }
}

/// Tests the inputs and the threshold of the over-voltage comparators: with the threshold lowered to 25 V, those of the rails that are
/// `charged` to the self-test's voltage must trip, and the others must not; with the threshold restored, none may be tripped. The timers stand
/// still, no output is enabled, the electrodes' pins are low.
///
/// # Errors
/// [`FaultCode::SelfTest`] with the comparator's number + 3000 if it does not trip, + 3010 if it trips without its rail, + 3020 if it is not
/// released.
pub fn test_over_voltage_inputs(charged: [bool; RAILS]) -> Result<(), FaultFinding> {
    // With interrupts masked and that of the breaks off: the trip is on purpose.
    let result = cortex_m::interrupt::free(|_| {
        timers::set_break_interrupt(false);
        crate::comparators::set_over_voltage_threshold_and_await_settling(true);
        let tripped = OVER_VOLTAGE.into_iter().zip(charged).try_for_each(|(comparator, charged)| {
            let is_right = poll_within_trip_time(|| comparator.is_tripped() == charged);
            let detail = if charged { DETAIL_NO_TRIP } else { DETAIL_FOREIGN_TRIP };
            if is_right { Ok(()) } else { Err(comparator.number + detail) }
        });
        crate::comparators::set_over_voltage_threshold_and_await_settling(false);
        let mut both = OVER_VOLTAGE.into_iter();
        let stuck = both.find(|comparator| !poll_within_trip_time(|| !comparator.is_tripped()));
        timers::clear_break_flags();
        // The trip has withdrawn the permit, if it was given, for less than a contact or the supply needs to follow.
        permit::set_main_output_enable_of_permit_timer(permit::is_given());
        timers::set_break_interrupt(true);
        tripped.and(stuck.map_or(Ok(()), |comparator| Err(comparator.number + DETAIL_NOT_RELEASED)))
    });
    result.map_err(|detail| (FaultCode::SelfTest, detail))
}

/// Tests that the comparators of the loops see their loops: closed ones are below the threshold of the self-test, and above that which protects.
fn test_interlock_and_stop_loop_comparators() -> Result<(), FaultFinding> {
    crate::comparators::set_loop_threshold_and_await_settling(true);
    let blind = LOOPS.into_iter().find(|comparator| !poll_within_trip_time(|| comparator.is_tripped()));
    crate::comparators::set_loop_threshold_and_await_settling(false);
    let stuck = LOOPS.into_iter().find(|comparator| !poll_within_trip_time(|| !comparator.is_tripped()));
    let blind = blind.map(|comparator| comparator.number + DETAIL_NO_TRIP);
    match blind.or(stuck.map(|comparator| comparator.number + DETAIL_NOT_RELEASED)) {
        Some(detail) => Err((FaultCode::SelfTest, detail)),
        None => Ok(()),
    }
}

fn test_that_comparator_clears_outputs_and_permit(comparator: &Comparator) -> Result<(), FaultFinding> {
    enable_main_outputs_or_blame_comparator(comparator)?;
    comparator.write_settings_with_trip_inverted(true);
    let are_all_cleared = || !BREAKABLE.into_iter().any(timers::is_main_output_enabled);
    let tripped = poll_within_trip_time(|| comparator.is_tripped() && are_all_cleared());
    let holding =
        (1..).zip(BREAKABLE).find(|(_, timer)| timers::is_main_output_enabled(*timer)).map(|(number, _)| number);
    let withdrawn = poll_within_trip_time(|| !permit::is_line_high());
    comparator.write_settings_with_trip_inverted(false);
    if !tripped {
        return Err((FaultCode::SelfTest, comparator.number + DETAIL_TIMER * holding.unwrap_or(0)));
    }
    if !withdrawn {
        return Err((FaultCode::Permit, comparator.number + DETAIL_PERMIT_STAYS));
    }
    if !poll_within_trip_time(|| !comparator.is_tripped()) {
        return Err((FaultCode::SelfTest, comparator.number + DETAIL_NOT_AT_REST));
    }
    enable_main_outputs_or_blame_comparator(comparator)
}

/// Checks that MOE of all four timers can be set, which an active break does not allow. If one cannot, the error names `blamed_comparator`.
fn enable_main_outputs_or_blame_comparator(blamed_comparator: &Comparator) -> Result<(), FaultFinding> {
    let all_enabled = poll_within_trip_time(|| {
        timers::clear_break_flags();
        timers::set_main_outputs(true);
        permit::set_main_output_enable_of_permit_timer(true);
        BREAKABLE.into_iter().all(timers::is_main_output_enabled)
    });
    if all_enabled { Ok(()) } else { Err((FaultCode::SelfTest, blamed_comparator.number + DETAIL_NOT_AT_REST)) }
}

fn poll_within_trip_time(condition: impl FnMut() -> bool) -> bool {
    poll_within(TRIP_WAIT, condition)
}
