//! What switches off without asking the device: the breaks of the timers, and the interrupt that goes with them.
//!
//! A comparator that trips clears MOE of TIM1, TIM8 and TIM20 in some 10 ns, with no software in the way; so do a core that
//! has locked up, a flash or SRAM word that cannot be read, and a supply below the voltage detector's threshold (SYSCFG
//! CFGR2, locked until the next reset). TIM4 has no break: an over-current clears its outputs in hardware until its next
//! update event, and for that as for all other reasons the interrupt below takes its pins away within about a us. A
//! window begins at least half a guard time (100 us) after an update event, so that the outputs cannot be back before the
//! interrupt has run.
//!
//! The interrupt is at the highest priority and everything else below it; it does the same as [`force_outputs_off`] and leaves the
//! reason for the device ([`trip::take_trip`]). It is enabled while the supply is.

use crate::comparators::{COMPARATORS, Comparator, find_tripped_comparator};
use crate::outputs::force_outputs_off;
use crate::priorities::PROTECTION;
use crate::timers::{self, WITH_BREAK};
use crate::trip;
use embassy_stm32::interrupt;
use embassy_stm32::interrupt::{Interrupt, InterruptExt};
use embassy_stm32::pac::{PWR, SYSCFG};
use embassy_time::{Duration, Instant};
use era_shared::protocol::FaultCode;
use era_shared::supply::FaultFinding;

/// A comparator reaches the breaks within 0.1 us; waiting ends long after that.
const TRIP_WAIT: Duration = Duration::from_micros(100);

/// What is added to a comparator's number in the self-test's finding, by what went wrong.
const DETAIL_TIMER: u32 = 10;
const DETAIL_NOT_AT_REST: u32 = 100;
const DETAIL_SETTINGS: u32 = 1_000;

/// Connects the core's own failures to the breaks, and enables the break interrupt. To be called once, before the supply is enabled.
pub fn init_break_interrupt() {
    SYSCFG.cfgr2().modify(|w| {
        w.set_cll(true);
        w.set_spl(true);
        w.set_pvdl(true);
        w.set_eccl(true);
    });
    Interrupt::TIM1_BRK_TIM15.set_priority(PROTECTION);
    // SAFETY: the handler is ready. Critical sections mask it like all others; the longest takes some us.
    unsafe { Interrupt::TIM1_BRK_TIM15.enable() };
}

#[interrupt]
fn TIM1_BRK_TIM15() {
    // Off before anything is looked at; it disables this interrupt too, whose cause may last.
    force_outputs_off();
    let (code, detail) = find_trip_cause();
    trip::note_trip(code, detail);
}

/// The fault of what has tripped, as far as it can still be seen.
#[must_use]
pub fn find_trip_cause() -> FaultFinding {
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

/// Tests every comparator. With its polarity inverted it must trip, whatever its input carries, and clear MOE of all three timers; with its
/// polarity restored it must be released. This proves the comparator's output, its connection to the breaks and their effect. The
/// thresholds are only compared with their registers here; they are tested with real inputs when a board is brought up. The timers stand
/// still, no output is enabled, the pins are low.
///
/// # Errors
/// [`FaultCode::SelfTest`] with the comparator's number; +10, 20, 30 if MOE of TIM1, TIM8 or TIM20 did not fall, +100 if the
/// comparator or MOE did not go back, +1000 if a register does not hold its settings (number 0).
pub fn test_all_comparators() -> Result<(), FaultFinding> {
    let locked = SYSCFG.cfgr2().read();
    let led_here = locked.cll() && locked.spl() && locked.pvdl() && locked.eccl();
    if !crate::comparators::are_all_settings_intact()
        || !crate::brown_out::is_voltage_detector_configured()
        || !led_here
    {
        return Err((FaultCode::SelfTest, DETAIL_SETTINGS));
    }
    let result = COMPARATORS.iter().try_for_each(test_comparator);
    timers::set_main_outputs(false);
    timers::clear_break_flags();
    result.map_err(|detail| (FaultCode::SelfTest, detail))
}

fn test_comparator(comparator: &Comparator) -> Result<(), u32> {
    check_at_rest(comparator)?;
    comparator.configure_polarity(true);
    let tripped = wait_for(|| comparator.is_tripped() && !WITH_BREAK.into_iter().any(timers::is_main_output_enabled));
    let holding =
        (1..).zip(WITH_BREAK).find(|(_, timer)| timers::is_main_output_enabled(*timer)).map(|(number, _)| number);
    comparator.configure_polarity(false);
    if !tripped {
        return Err(comparator.number + DETAIL_TIMER * holding.unwrap_or(0));
    }
    if !wait_for(|| !comparator.is_tripped()) {
        return Err(comparator.number + DETAIL_NOT_AT_REST);
    }
    check_at_rest(comparator)
}

/// Checks that MOE of all three timers can be set, which an active break does not allow.
fn check_at_rest(comparator: &Comparator) -> Result<(), u32> {
    let all_enabled = wait_for(|| {
        timers::clear_break_flags();
        timers::set_main_outputs(true);
        WITH_BREAK.into_iter().all(timers::is_main_output_enabled)
    });
    if all_enabled { Ok(()) } else { Err(comparator.number + DETAIL_NOT_AT_REST) }
}

fn wait_for(mut condition: impl FnMut() -> bool) -> bool {
    let end = Instant::now() + TRIP_WAIT;
    loop {
        if condition() {
            return true;
        }
        if Instant::now() > end {
            return false;
        }
    }
}
