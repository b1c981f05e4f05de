//! The bits of the timer registers, in one place for the firmware that writes them, the emulator's report and the tests that
//! read them back (RM0440, sections 28.6 and 29.5: TIM1/TIM8/TIM20 and TIM2 to TIM5 have them in common but for BDTR).

use super::period::{CompareWindow, TimerPeriod};

/// CR1.CEN: the counter counts.
const CR1_CEN: u32 = 1;
/// CR1.DIR: downwards.
const CR1_DIR: u32 = 1 << 4;
/// Mask of CR1.CMS: centre-aligned modes.
const CR1_CMS: u32 = 0b11 << 5;
/// CR1.ARPE: the auto-reload register is preloaded.
const CR1_ARPE: u32 = 1 << 7;
/// OCxM = 0110: PWM mode 1, on while the counter is below the compare value.
const PWM_MODE_1: u32 = 0b0110;
/// OCxM = 1101: combined PWM mode 2, on while the counter is not below this compare value and the pair's other channel is
/// on too.
const COMBINED_PWM_MODE_2: u32 = 0b1101;
/// OCxPE of one channel: the compare value is preloaded.
const PRELOAD: u32 = 1 << 3;
/// OCxCE of one channel: a trip clears the output until the next update event, where the timer has no break.
const CLEAR_ENABLE: u32 = 1 << 7;
/// BDTR.MOE: main output enable.
const BDTR_MOE: u32 = 1 << 15;

/// Which of a timer's four channels reach the electrodes' pins. Each electrode takes a pair of channels for its two compare
/// values, and either of the pair can carry the output.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct OutputPair {
    /// Electrode A: channel 1 or 2.
    pub a: u8,
    /// Electrode B: channel 3 or 4.
    pub b: u8,
}

/// The registers that decide what the two electrodes of one ERA do.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct TimerRegisters {
    /// Control register 1.
    pub cr1: u32,
    /// Capture/compare mode register 1: channels 1 and 2.
    pub ccmr1: u32,
    /// Capture/compare mode register 2: channels 3 and 4.
    pub ccmr2: u32,
    /// Capture/compare enable register.
    pub ccer: u32,
    /// Prescaler.
    pub psc: u32,
    /// Auto-reload register.
    pub arr: u32,
    /// Compare values of channels 1 to 4.
    pub ccr: [u32; 4],
    /// Break and dead-time register.
    pub bdtr: u32,
}

impl TimerRegisters {
    /// The registers of a running timer that carries out `period`, main output enabled.
    #[must_use]
    pub const fn for_running_timer(period: &TimerPeriod, outputs: OutputPair) -> Self {
        let [first, second] = pair_compare_values(period.a, outputs.a == 2);
        let [third, fourth] = pair_compare_values(period.b, outputs.b == 4);
        Self {
            cr1: CR1_CEN | CR1_ARPE,
            ccmr1: ccmr_bits_for_pair(outputs.a == 2),
            ccmr2: ccmr_bits_for_pair(outputs.b == 4),
            ccer: ccer_output_enable_bit(outputs.a) | ccer_output_enable_bit(outputs.b),
            psc: period.divider - 1,
            arr: period.ticks - 1,
            ccr: [first, second, third, fourth],
            bdtr: BDTR_MOE,
        }
    }

    /// The same registers, with the counter stopped.
    #[must_use]
    pub const fn with_counter_stopped(mut self) -> Self {
        self.cr1 &= !CR1_CEN;
        self
    }

    /// The same registers for a timer without break input: a trip clears its outputs until the next update event.
    #[must_use]
    pub const fn with_output_clear_on_trip_enabled(mut self) -> Self {
        self.ccmr1 |= CLEAR_ENABLE | CLEAR_ENABLE << 8;
        self.ccmr2 |= CLEAR_ENABLE | CLEAR_ENABLE << 8;
        self
    }

    /// Whether the timer counts and its outputs reach the pins. A timer without a break has no main output enable; its
    /// BDTR must then be given as with MOE set.
    #[must_use]
    pub const fn is_counting_with_outputs_enabled(&self) -> bool {
        self.cr1 & CR1_CEN != 0 && self.bdtr & BDTR_MOE != 0 && self.ccer & 0x1111 != 0
    }

    /// Whether the main output is enabled.
    #[must_use]
    pub const fn is_main_output_enabled(&self) -> bool {
        self.bdtr & BDTR_MOE != 0
    }

    pub(super) const fn counts_up(&self) -> bool {
        self.cr1 & (CR1_CMS | CR1_DIR) == 0
    }

    pub(super) const fn is_preload_enabled(&self) -> bool {
        let both = PRELOAD | PRELOAD << 8;
        self.cr1 & CR1_ARPE != 0 && self.ccmr1 & both == both && self.ccmr2 & both == both
    }

    /// CCER.CCxE of a channel, counted from 1.
    pub(super) const fn is_channel_output_enabled(&self, channel: u8) -> bool {
        self.ccer & ccer_output_enable_bit(channel) != 0
    }

    /// CCER.CCxP and CCxNE: anything but a plain, active-high output.
    pub(super) const fn has_only_active_high_outputs(&self) -> bool {
        self.ccer & !0x1111 == 0
    }

    /// OCxM, whose fourth bit lies apart, and the compare value of a channel, counted from 1.
    pub(super) fn channel_mode_and_compare(&self, channel: u8) -> (u32, u32) {
        let register = if channel <= 2 { self.ccmr1 } else { self.ccmr2 };
        let shift = if channel % 2 == 1 { 0 } else { 8 };
        let mode = (register >> (4 + shift)) & 0b111 | ((register >> (16 + shift)) & 1) << 3;
        let compare = self.ccr.get(usize::from(channel - 1)).copied().unwrap_or(0) & 0xFFFF;
        (mode, compare)
    }

    /// Whether `mode` opens a window, as [`Self::for_running_timer`] sets it, and closes it on the pair's other channel.
    pub(super) const fn mode_opens_window(mode: u32) -> bool {
        mode == COMBINED_PWM_MODE_2
    }

    /// Whether `mode` closes a window.
    pub(super) const fn mode_closes_window(mode: u32) -> bool {
        mode == PWM_MODE_1
    }
}

const fn ccer_output_enable_bit(channel: u8) -> u32 {
    1 << (4 * (channel - 1))
}

/// Modes of a pair of channels; `output_on_second` if its second channel carries the output.
const fn ccmr_bits_for_pair(output_on_second: bool) -> u32 {
    let (one, two) =
        if output_on_second { (PWM_MODE_1, COMBINED_PWM_MODE_2) } else { (COMBINED_PWM_MODE_2, PWM_MODE_1) };
    ccmr_bits_for_channel(one) | ccmr_bits_for_channel(two) << 8
}

/// OCxM and OCxPE of the lower channel of a register.
const fn ccmr_bits_for_channel(mode: u32) -> u32 {
    PRELOAD | (mode & 0b111) << 4 | (mode >> 3) << 16
}

/// Compare values of a pair: the channel with the output opens the window, the other closes it.
const fn pair_compare_values(window: CompareWindow, output_on_second: bool) -> [u32; 2] {
    let (on, off) = (window.on as u32, window.off as u32);
    if output_on_second { [off, on] } else { [on, off] }
}
