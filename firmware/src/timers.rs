//! The timers that make the electrode windows: TIM1, TIM8, TIM20 and TIM4 for ERA 1 to 4, and TIM3 that starts them.
//!
//! [`era_shared::waveform`] explains the counting and holds the bits of the registers. All four get the core clock, are
//! loaded with a blank period while they stand, and start in the same clock: each is a slave in trigger mode of TIM3, whose
//! own start is the trigger (RM0440, timer synchronisation). From then on they only get new preload values.
//!
//! The routing of the breaks, the idle levels and the compare modes are written once, at boot, and locked until the next
//! reset (BDTR.LOCK = 3): firmware that has run astray cannot unhook them. Hence nothing may write BDTR before [`init_timers_and_lock_break_routing`].

use crate::pins::CHANNELS;
use cortex_m::interrupt::CriticalSection;
use embassy_stm32::pac;
use embassy_stm32::pac::RCC;
use embassy_stm32::pac::timer::{TimAdv, TimGp16, regs};
use era_shared::waveform::{IDLE, OutputPair, TimerPeriod, TimerRegisters};

/// Which of a timer's outputs are electrodes A and B: see the pin table.
const OUTPUTS: [OutputPair; CHANNELS] =
    [OutputPair { a: 1, b: 3 }, OutputPair { a: 1, b: 4 }, OutputPair { a: 1, b: 3 }, OutputPair { a: 1, b: 4 }];

/// The timers with a break input, in the order of the channels.
pub const WITH_BREAK: [TimAdv; 3] = [pac::TIM1, pac::TIM8, pac::TIM20];

/// CR1.CEN.
const CR1_CEN: u32 = 1;
/// CR1.UDIS: no update events.
const CR1_UDIS: u32 = 1 << 1;
/// CR2.MMS = 001: the trigger output tells CEN.
const CR2_TRIGGER_IS_ENABLE: u32 = 0b001 << 4;
/// SMCR.TS = ITR2, which is TIM3 for all four (RM0440, internal trigger connections), and SMS = 0110, trigger mode.
const SMCR_START_WITH_TIM3: u32 = 0b010 << 4 | 0b110;
/// AF2.OCRSEL = 011: comparator 4, the momentary current, clears the outputs of TIM4, which has no break. SMCR.OCCS is 0, so
/// that this input is used.
const AF2_CLEAR_BY_COMPARATOR_4: u32 = 0b011 << 16;
/// BDTR: LOCK = 3; OSSI and OSSR: what MOE or the channel switches off is driven low and not left floating; BKE and BKP: the
/// break is on and active high. Not in it: AOE, so that only software can set MOE again; filters, which would only cost time.
pub const BDTR_LOCKED: u32 = 0b11 << 8 | 1 << 10 | 1 << 11 | 1 << 12 | 1 << 13;
/// BDTR.MOE.
pub const BDTR_MOE: u32 = 1 << 15;
/// AF1.BKCMPxE of comparators 1, 3, 4, 5 and 7, not inverted, and not BKINE: no pin of the chip is a break input.
pub const AF1_COMPARATORS: u32 = 1 << 1 | 1 << 3 | 1 << 4 | 1 << 5 | 1 << 7;
/// DIER.BIE.
const DIER_BIE: u32 = 1 << 7;

/// A timer's registers other than BDTR. `None` if there is no such channel.
fn view_channel_timer_as_general_purpose(channel: usize) -> Option<TimGp16> {
    match (WITH_BREAK.get(channel), channel) {
        // SAFETY: an advanced timer has the registers of a general-purpose one at the same offsets (RM0440, register
        // maps).
        (Some(timer), _) => Some(unsafe { TimGp16::from_ptr(timer.as_ptr()) }),
        (None, 3) => Some(pac::TIM4),
        _ => None,
    }
}

fn channel_timers() -> impl Iterator<Item = (usize, TimGp16)> {
    (0..CHANNELS).filter_map(|channel| Some((channel, view_channel_timer_as_general_purpose(channel)?)))
}

/// The registers of a channel's timer while it makes `period`.
fn registers_for_period(channel: usize, period: &TimerPeriod) -> TimerRegisters {
    let outputs = OUTPUTS.get(channel).copied().unwrap_or(OutputPair { a: 1, b: 3 });
    let registers = TimerRegisters::for_running_timer(period, outputs);
    if has_break_input(channel) { registers } else { registers.with_output_clear_on_trip_enabled() }
}

fn has_break_input(channel: usize) -> bool {
    channel < WITH_BREAK.len()
}

/// Starts the timers' clocks and sets up what never changes afterwards, outputs off. To be called once.
pub fn init_timers_and_lock_break_routing() {
    RCC.apb2enr().modify(|w| {
        w.set_tim1en(true);
        w.set_tim8en(true);
        w.set_tim20en(true);
    });
    RCC.apb1enr1().modify(|w| {
        w.set_tim3en(true);
        w.set_tim4en(true);
    });
    // A peripheral takes writes from the second clock after its enable (RM0440, section 7.2.18); the reads wait for it.
    let _ = (RCC.apb2enr().read(), RCC.apb1enr1().read());
    for (channel, timer) in channel_timers() {
        let registers = registers_for_period(channel, &IDLE);
        timer.cr1().write_value(regs::Cr1Gp16(0));
        timer.ccer().write_value(regs::CcerGp16(0));
        timer.ccmr_output(0).write_value(regs::CcmrOutputGp16(registers.ccmr1));
        timer.ccmr_output(1).write_value(regs::CcmrOutputGp16(registers.ccmr2));
    }
    for timer in WITH_BREAK {
        timer.af1().write_value(regs::Af1Adv(AF1_COMPARATORS));
        // Last: it locks.
        timer.bdtr().write_value(regs::BdtrAdv(BDTR_LOCKED));
    }
    pac::TIM4.af2().write_value(regs::Af21chCmp(AF2_CLEAR_BY_COMPARATOR_4));
    pac::TIM3.cr2().write_value(regs::Cr2Gp16(CR2_TRIGGER_IS_ENABLE));
}

/// Outputs off, counters stopped, break interrupt off. Does nothing to timers that have no clock yet.
pub fn stop_timers_outputs_and_break_interrupt() {
    let clocks = RCC.apb2enr().read();
    if !(clocks.tim1en() && clocks.tim8en() && clocks.tim20en()) {
        return;
    }
    for timer in WITH_BREAK {
        timer.bdtr().modify(|w| w.0 &= !BDTR_MOE);
        timer.dier().write_value(regs::DierAdv(0));
    }
    for (_, timer) in channel_timers() {
        timer.ccer().write_value(regs::CcerGp16(0));
        timer.cr1().write_value(regs::Cr1Gp16(0));
        timer.smcr().write_value(regs::SmcrGp16(0));
    }
    pac::TIM3.cr1().write_value(regs::Cr1Gp16(0));
}

/// Loads all timers with [`IDLE`], sets the counters to zero, enables the break interrupt, and starts all timers together. Returns whether every
/// register held what was written; if not, nothing is started.
#[must_use]
pub fn enable_break_interrupt_and_start_timers_if_registers_hold() -> bool {
    stop_timers_outputs_and_break_interrupt();
    for (channel, timer) in channel_timers() {
        let registers = registers_for_period(channel, &IDLE).with_counter_stopped();
        timer.cr1().write_value(regs::Cr1Gp16(registers.cr1));
        write_period_registers(timer, &registers);
        // Takes the preloaded values over.
        timer.egr().write(|w| w.set_ug(true));
        timer.cnt().write_value(regs::CntCore(0));
        timer.ccer().write_value(regs::CcerGp16(registers.ccer));
        timer.smcr().write_value(regs::SmcrGp16(SMCR_START_WITH_TIM3));
    }
    clear_break_flags();
    set_break_interrupt(true);
    let holds = channel_timers().all(|(channel, timer)| {
        read_registers(channel, timer)
            == TimerRegisters { bdtr: 0, ..registers_for_period(channel, &IDLE).with_counter_stopped() }
            && is_trip_routing_intact(channel)
    });
    if holds {
        pac::TIM3.cr1().write_value(regs::Cr1Gp16(CR1_CEN));
    }
    holds
}

/// Writes a period to a running timer's preload registers, which take effect together, and returns whether they hold it. Interrupts are masked,
/// as `_masked` shows.
#[must_use]
pub fn write_preload_and_check_read_back(_masked: &CriticalSection, channel: usize, period: &TimerPeriod) -> bool {
    let Some(timer) = view_channel_timer_as_general_purpose(channel) else { return false };
    let registers = registers_for_period(channel, period);
    // Should an update event come after all in between, it must not take over half of it.
    timer.cr1().write_value(regs::Cr1Gp16(registers.cr1 | CR1_UDIS));
    write_period_registers(timer, &registers);
    timer.cr1().write_value(regs::Cr1Gp16(registers.cr1));
    let now = read_registers(channel, timer);
    now == TimerRegisters { bdtr: now.bdtr, ..registers }
}

/// Whether all registers of a running timer hold what they should: `period` in the preload registers, and MOE, where there is one, as
/// `connected` says.
#[must_use]
pub fn are_registers_intact(channel: usize, period: &TimerPeriod, connected: bool) -> bool {
    let Some(timer) = view_channel_timer_as_general_purpose(channel) else { return false };
    let bdtr = if connected && has_break_input(channel) { BDTR_MOE } else { 0 };
    read_registers(channel, timer) == TimerRegisters { bdtr, ..registers_for_period(channel, period) }
        && is_trip_routing_intact(channel)
}

/// The counter of a channel's timer.
#[must_use]
pub fn read_counter(channel: usize) -> u16 {
    view_channel_timer_as_general_purpose(channel).map_or(0, |timer| timer.cnt().read().cnt())
}

/// Whether a channel's timer has been started and not been stopped.
#[must_use]
pub fn is_counting(channel: usize) -> bool {
    view_channel_timer_as_general_purpose(channel).is_some_and(|timer| timer.cr1().read().0 & CR1_CEN != 0)
}

/// Sets the main output enable of the timers that have one. While a break is active they do not keep it.
pub fn set_main_outputs(enabled: bool) {
    for timer in WITH_BREAK {
        timer.bdtr().modify(|w| w.0 = if enabled { w.0 | BDTR_MOE } else { w.0 & !BDTR_MOE });
    }
}

/// Whether the outputs of a timer with break reach its pins.
#[must_use]
pub fn is_main_output_enabled(timer: TimAdv) -> bool {
    timer.bdtr().read().0 & BDTR_MOE != 0
}

/// Clears the flags of breaks that are over.
pub fn clear_break_flags() {
    for timer in WITH_BREAK {
        timer.sr().write_value(regs::SrAdv(0));
    }
}

/// Lets a break of TIM1 raise its interrupt; all three timers have the same breaks.
pub fn set_break_interrupt(enabled: bool) {
    pac::TIM1.dier().write_value(regs::DierAdv(if enabled { DIER_BIE } else { 0 }));
}

/// The registers as they read back; of BDTR only MOE.
fn read_registers(channel: usize, timer: TimGp16) -> TimerRegisters {
    TimerRegisters {
        cr1: timer.cr1().read().0,
        ccmr1: timer.ccmr_output(0).read().0,
        ccmr2: timer.ccmr_output(1).read().0,
        ccer: timer.ccer().read().0,
        psc: u32::from(timer.psc().read()),
        arr: timer.arr().read().0,
        ccr: core::array::from_fn(|place| timer.ccr(place).read().0),
        bdtr: WITH_BREAK.get(channel).map_or(0, |timer| timer.bdtr().read().0 & BDTR_MOE),
    }
}

/// Whether the hardware that switches a timer's outputs off is still connected to it.
fn is_trip_routing_intact(channel: usize) -> bool {
    match WITH_BREAK.get(channel) {
        Some(timer) => timer.af1().read().0 == AF1_COMPARATORS && timer.bdtr().read().0 & !BDTR_MOE == BDTR_LOCKED,
        None => {
            pac::TIM4.af2().read().0 == AF2_CLEAR_BY_COMPARATOR_4 && pac::TIM4.smcr().read().0 == SMCR_START_WITH_TIM3
        }
    }
}

fn write_period_registers(timer: TimGp16, registers: &TimerRegisters) {
    // Made from 16-bit numbers by TimerRegisters::for_running_timer, so nothing is cut off.
    timer.psc().write_value(registers.psc as u16);
    timer.arr().write_value(regs::ArrCore(registers.arr));
    for (place, value) in registers.ccr.into_iter().enumerate() {
        timer.ccr(place).write_value(regs::Ccr1ch(value));
    }
}
