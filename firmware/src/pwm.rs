//! The advanced timers that make the electrode windows: TIM1 for ERA 1, TIM8 for ERA 2.
//!
//! Output 1 is electrode A, output 2 electrode B; [`era_shared::waveform`] explains the counting and holds the bits of
//! the registers. Only MOE lets a timer reach its pins. With OSSI and OSSR set, outputs that MOE or the channel
//! switches off are driven low rather than left floating (RM0440, section 28.3.16 and table of output control bits).

use crate::pins::CHANNELS;
use embassy_stm32::pac;
use embassy_stm32::pac::timer::{TimAdv, regs};
use era_shared::waveform::{TimerProgram, TimerRegisters};

const TIMERS: [TimAdv; CHANNELS] = [pac::TIM1, pac::TIM8];

/// BDTR.OSSI and OSSR, with MOE and everything else 0: outputs driven low.
const BDTR_OFF: u32 = (1 << 10) | (1 << 11);
/// CR1.CEN.
const CR1_CEN: u32 = 1;
/// CR1.UDIS: no update events.
const CR1_UDIS: u32 = 1 << 1;
/// CR1.DIR, which a centre-aligned timer sets by itself while it counts down.
const CR1_DIR: u32 = 1 << 4;

/// Starts the clocks of the timers, outputs off.
pub fn init() {
    pac::RCC.apb2enr().modify(|w| {
        w.set_tim1en(true);
        w.set_tim8en(true);
    });
    // A peripheral takes writes from the second clock after its enable (RM0440, section 7.2.18); the read waits for it.
    let _ = pac::RCC.apb2enr().read();
    stop_all();
}

/// Every timer stopped, outputs off.
pub fn stop_all() {
    for channel in 0..CHANNELS {
        stop(channel);
    }
}

/// One timer stopped, outputs off.
pub fn stop(channel: usize) {
    let Some(timer) = TIMERS.get(channel) else { return };
    timer.bdtr().write_value(regs::BdtrAdv(BDTR_OFF));
    timer.cr1().write_value(regs::Cr1Gp16(0));
}

/// Loads a stopped timer. Outputs stay off and the counter stands at the program's start.
pub fn load(channel: usize, program: &TimerProgram) {
    stop(channel);
    let Some(timer) = TIMERS.get(channel) else { return };
    let wanted = TimerRegisters::running(program);
    // Compare modes are not preloaded, so they are only ever written here, with the outputs off.
    timer.ccer().write_value(regs::CcerAdv(0));
    timer.ccmr_output(0).write_value(regs::CcmrOutputGp16(wanted.ccmr1));
    write_rhythm(*timer, &wanted);
    timer.cr1().write_value(regs::Cr1Gp16(wanted.cr1 & !CR1_CEN));
    // Takes the preloaded values over; the counter goes to zero and its direction to up.
    timer.egr().write(|w| w.set_ug(true));
    timer.cnt().write_value(regs::CntCore(u32::from(program.start_count)));
    timer.ccer().write_value(regs::CcerAdv(wanted.ccer));
}

/// Starts the timers whose entry is set, and lets them reach their pins.
///
/// Interrupts are masked between the first and the last start, so that the counters start within about ten core clocks
/// of each other: 0.06 us, or 0.02 degrees of phase at 1 kHz.
pub fn start(programs: &[Option<TimerProgram>; CHANNELS]) {
    let wanted = programs.map(|program| program.as_ref().map(TimerRegisters::running));
    cortex_m::interrupt::free(|_| {
        for (timer, registers) in TIMERS.iter().zip(&wanted) {
            if let Some(registers) = registers {
                timer.cr1().write_value(regs::Cr1Gp16(registers.cr1));
            }
        }
        for (timer, registers) in TIMERS.iter().zip(&wanted) {
            if let Some(registers) = registers {
                timer.bdtr().write_value(regs::BdtrAdv(BDTR_OFF | registers.bdtr));
            }
        }
    });
}

/// Whether a running timer can go over to another program at an update event, without a stop: when only the widths of
/// the windows differ. Another frequency or phase needs a start from a common origin.
pub fn can_retune(from: &TimerProgram, to: &TimerProgram) -> bool {
    *to == TimerProgram { compare_a: to.compare_a, compare_b: to.compare_b, ..*from }
}

/// Gives a running timer new windows, which it takes over together at its next update event.
pub fn retune(channel: usize, program: &TimerProgram) {
    let Some(timer) = TIMERS.get(channel) else { return };
    let wanted = TimerRegisters::running(program);
    // An update between two of the writes would take over one window and not the other.
    timer.cr1().write_value(regs::Cr1Gp16(wanted.cr1 | CR1_UDIS));
    write_rhythm(*timer, &wanted);
    timer.cr1().write_value(regs::Cr1Gp16(wanted.cr1));
}

/// The registers as they read back, without the bits that do not describe the windows.
pub fn read_back(channel: usize) -> TimerRegisters {
    let Some(timer) = TIMERS.get(channel) else { return TimerRegisters::default() };
    TimerRegisters {
        cr1: timer.cr1().read().0 & !CR1_DIR,
        ccmr1: timer.ccmr_output(0).read().0,
        ccer: timer.ccer().read().0,
        psc: u32::from(timer.psc().read()),
        arr: timer.arr().read().0,
        ccr1: timer.ccr(0).read().0,
        ccr2: timer.ccr(1).read().0,
        bdtr: timer.bdtr().read().0 & !BDTR_OFF,
    }
}

fn write_rhythm(timer: TimAdv, wanted: &TimerRegisters) {
    // The compiler cannot know that these fit; TimerRegisters::running made them from 16-bit numbers.
    timer.psc().write_value(wanted.psc as u16);
    timer.arr().write_value(regs::ArrCore(wanted.arr));
    timer.ccr(0).write_value(regs::Ccr1ch(wanted.ccr1));
    timer.ccr(1).write_value(regs::Ccr1ch(wanted.ccr2));
}
