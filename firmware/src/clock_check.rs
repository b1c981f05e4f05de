//! The processor's clock against that of the watchdog.
//!
//! Every time and every frequency of the board follows from one oscillator and one PLL: a wrong one would be wrong everywhere at once. The watchdog
//! has an oscillator of its own (LSI, 32 kHz). TIM5, which counts the processor's clock, captures its count at each edge of that oscillator and begins
//! anew, so that its capture register always holds the last period. The comparison is as good as that oscillator: an error of more than a quarter is
//! found, one of less than a tenth is not.
//!
//! What the processor's clock is divided by for the board's time (TIM2) would not show there: its register is compared with its value.

use crate::clocks::TIMER_CLOCK_HZ;
use core::ops::Range;
use embassy_stm32::pac::timer::regs;
use embassy_stm32::pac::{RCC, TIM2, TIM5};
use embassy_time::{Duration, Instant};
use era_shared::protocol::FaultCode;
use era_shared::supply::FaultFinding;

/// TISEL.TI1SEL = 0001: input 1 of TIM5 is LSI (RM0440, TIM5 input connections; the same in the register descriptions of ST's driver library).
const TISEL_LSI: u32 = 0b0001;
/// CCMR1.CC1S = 01: channel 1 captures input 1, every edge, not filtered.
const CCMR1_CAPTURE_INPUT_1: u32 = 0b01;
/// CCER.CC1E: rising edges.
const CCER_CC1E: u32 = 1;
/// SMCR: SMS = 0100, an edge of the trigger sets the counter to zero; TS = 00101, the trigger is input 1.
const SMCR_RESET_BY_INPUT_1: u32 = 0b101 << 4 | 0b100;
/// CR1.CEN; SR.CC1IF.
const CR1_CEN: u32 = 1;
const SR_CC1IF: u32 = 1 << 1;

/// What the watchdog's clock may be in Hz, measured with the processor's: 29.5 to 34 kHz over voltage and temperature (DS12288, LSI), 2 % for the
/// processor's oscillator (HSI16), and 3 % for the jitter of a single period.
const LSI_HZ: Range<u32> = 28_000..36_000;
/// The least time between two looks: some thirty periods, so that there is a new one.
const LOOK_INTERVAL: Duration = Duration::from_micros(900);
/// This many wrong looks in succession are a fault: a single period may be off.
const WRONG_LOOKS: u32 = 5;
/// Reads of the status until the oscillator runs: each takes some 10 clocks of 170 MHz, and it starts within 130 us (DS12288).
const START_READS: usize = 10_000;

/// Starts the watchdog's oscillator, which the watchdog itself keeps running later, and its measurement. To be called once, after the clocks have
/// been set up.
pub fn init_clock_check() {
    RCC.csr().modify(|w| w.set_lsion(true));
    // One that does not start is found by the first looks.
    let _ = (0..START_READS).any(|_| RCC.csr().read().lsirdy());
    RCC.apb1enr1().modify(|w| w.set_tim5en(true));
    // A peripheral takes writes from the second clock after its enable (RM0440, section 7.2.18); the read waits for it.
    let _ = RCC.apb1enr1().read();
    TIM5.tisel().write_value(regs::TiselGp16(TISEL_LSI));
    TIM5.ccmr_input(0).write_value(regs::CcmrInput2ch(CCMR1_CAPTURE_INPUT_1));
    TIM5.ccer().write_value(regs::CcerGp16(CCER_CC1E));
    TIM5.smcr().write_value(regs::SmcrGp16(SMCR_RESET_BY_INPUT_1));
    TIM5.cr1().write_value(regs::Cr1Gp16(CR1_CEN));
}

/// TIM2's prescaler: one tick of the board's time is a us (the time driver of embassy-stm32, with the feature `time-driver-tim2`).
const TIME_PRESCALER: u16 = (TIMER_CLOCK_HZ as u64 / embassy_time::TICK_HZ - 1) as u16;

/// Whether the board's time runs at its rate. Every time-out, dead-man time and discharge time comes from it.
#[must_use]
pub fn is_time_base_prescaler_intact() -> bool {
    TIM2.psc().read() == TIME_PRESCALER
}

/// Looks at the measurement from time to time.
pub struct ClockCheck {
    looked_at: Instant,
    /// 32 bits wide, because the emulator that runs this image gets saturating additions of bytes wrong.
    wrong_looks: u32,
    lsi_hz: u32,
}

impl ClockCheck {
    /// Begins now.
    pub fn new() -> Self {
        Self { looked_at: Instant::now(), wrong_looks: 0, lsi_hz: 0 }
    }

    /// Looks again if it is time, and returns the fault if the clocks have disagreed for some looks. To be called every ms.
    pub fn look_if_due_and_find_lasting_clock_fault(&mut self) -> Option<FaultFinding> {
        let now = Instant::now();
        if now.saturating_duration_since(self.looked_at) >= LOOK_INTERVAL {
            self.looked_at = now;
            self.lsi_hz = take_new_lsi_hz_or_zero();
            self.wrong_looks = if LSI_HZ.contains(&self.lsi_hz) { 0 } else { self.wrong_looks.saturating_add(1) };
        }
        (self.wrong_looks >= WRONG_LOOKS).then_some((FaultCode::Clock, self.lsi_hz))
    }
}

/// The frequency of the watchdog's clock in Hz by its last period; 0 if there was none since the last call.
fn take_new_lsi_hz_or_zero() -> u32 {
    let is_new = TIM5.sr().read().0 & SR_CC1IF != 0;
    let clocks = TIM5.ccr(0).read();
    // Flags are cleared by writing 0, and writing 1 leaves them.
    TIM5.sr().write_value(regs::SrGp16(!SR_CC1IF));
    if is_new { TIMER_CLOCK_HZ.checked_div(clocks).unwrap_or(0) } else { 0 }
}
