//! The bits of the timer registers, in one place for the firmware that writes them, the simulated device and the tests
//! that read them back (RM0440, section 28.6: TIM1/TIM8/TIM20 registers).

use super::TimerProgram;

/// CR1.CEN: the counter counts.
const CR1_CEN: u32 = 1;
/// CR1.CMS = 01: centre-aligned mode 1.
const CR1_CMS_1: u32 = 1 << 5;
/// Mask of CR1.CMS.
const CR1_CMS: u32 = 0b11 << 5;
/// CR1.ARPE: the auto-reload register is preloaded.
const CR1_ARPE: u32 = 1 << 7;
/// CCMR1.OC1M = 0110: PWM mode 1, on while the counter is below the compare value.
const PWM_MODE_1: u32 = 0b0110;
/// CCMR1.OC1M = 0111: PWM mode 2, on while it is above.
const PWM_MODE_2: u32 = 0b0111;
/// CCMR1.OC1PE and OC2PE: compare values are preloaded.
const CCMR1_PRELOAD: u32 = (1 << 3) | (1 << 11);
/// CCER.CC1E and CC2E: both outputs enabled; active high as CC1P and CC2P stay 0.
const CCER_BOTH: u32 = 1 | (1 << 4);
/// CCER.CC1P and CC2P: active low.
const CCER_POLARITY: u32 = (1 << 1) | (1 << 5);
/// BDTR.MOE: main output enable.
const BDTR_MOE: u32 = 1 << 15;

/// The registers that decide what the two electrodes of one ERA do. Output 1 is electrode A, output 2 electrode B.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct TimerRegisters {
    /// Control register 1.
    pub cr1: u32,
    /// Capture/compare mode register 1.
    pub ccmr1: u32,
    /// Capture/compare enable register.
    pub ccer: u32,
    /// Prescaler.
    pub psc: u32,
    /// Auto-reload register.
    pub arr: u32,
    /// Compare value of electrode A.
    pub ccr1: u32,
    /// Compare value of electrode B.
    pub ccr2: u32,
    /// Break and dead-time register.
    pub bdtr: u32,
}

/// How one output compares.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum OutputMode {
    /// On below the compare value.
    Below,
    /// On above it.
    Above,
}

impl TimerRegisters {
    /// The registers of a running timer that carries out `program`, main output enabled.
    #[must_use]
    pub fn running(program: &TimerProgram) -> Self {
        Self {
            cr1: CR1_CEN | CR1_CMS_1 | CR1_ARPE,
            ccmr1: Self::ccmr1_for(program.swapped),
            ccer: CCER_BOTH,
            psc: u32::from(program.prescaler),
            arr: u32::from(program.auto_reload),
            ccr1: u32::from(program.compare_a),
            ccr2: u32::from(program.compare_b),
            bdtr: BDTR_MOE,
        }
    }

    /// CCMR1 with both outputs preloaded; `swapped` exchanges the modes of the two electrodes.
    #[must_use]
    pub const fn ccmr1_for(swapped: bool) -> u32 {
        let (one, two) = if swapped { (PWM_MODE_2, PWM_MODE_1) } else { (PWM_MODE_1, PWM_MODE_2) };
        CCMR1_PRELOAD | (one << 4) | (two << 12)
    }

    /// Whether the timer counts and its outputs reach the pins.
    #[must_use]
    pub const fn is_driving(&self) -> bool {
        self.cr1 & CR1_CEN != 0 && self.bdtr & BDTR_MOE != 0 && self.ccer & CCER_BOTH != 0
    }

    pub(super) const fn is_centre_aligned(&self) -> bool {
        self.cr1 & CR1_CMS != 0
    }

    pub(super) const fn is_active_high(&self) -> bool {
        self.ccer & CCER_POLARITY == 0
    }

    pub(super) const fn enabled(&self, output: usize) -> bool {
        self.ccer & (1 << (4 * output)) != 0
    }

    pub(super) const fn mode(&self, output: usize) -> Option<OutputMode> {
        let shift = 4 + 8 * output;
        // The fourth bit of the mode lies apart, at 16 and 24.
        let mode = (self.ccmr1 >> shift) & 0b111 | ((self.ccmr1 >> (16 + 8 * output)) & 1) << 3;
        match mode {
            PWM_MODE_1 => Some(OutputMode::Below),
            PWM_MODE_2 => Some(OutputMode::Above),
            _ => None,
        }
    }
}
