//! The average current of the supply, as the mean of a whole ms, measured by ADC2 without the processor.
//!
//! The electrodes take their charges in lumps, 0.5 to some ms apart, and the filter at the pin only has 1 ms: a single conversion in each ms
//! would see the same place of every lump at a drive of 500 Hz or 1 kHz, and be wrong by up to a half. ADC2 therefore converts without a pause
//! and adds 64 conversions of 15.4 us in hardware (RM0440, oversampler): each result is the mean of 0.98 ms.

use crate::sense::{enable_converter, power_up_and_calibrate_converter};
use core::sync::atomic::{AtomicU32, Ordering};
use embassy_stm32::pac::ADC2;
use embassy_stm32::pac::adc::vals::{Ovrmod, SampleTime};
use embassy_time::Instant;
use era_shared::circuit::AVERAGE_FULL_SCALE_MICROAMPS;

/// PC1 (DS12288, pin table: ADC12_IN7).
const INPUT: u8 = 7;
/// CFGR2.OVSR = 101: 64 conversions; OVSS = 2: their sum is shifted down to 16 bits.
const RATIO_64: u8 = 0b101;
const SHIFT: u8 = 2;
/// Largest result: 64 times 4095, shifted.
const FULL_RESULT: u64 = 65_520;
/// A result that is older than this, in us, is none: a new one comes every 0.98 ms.
const LONGEST_AGE_US: u32 = 3_000;

/// The last result and when it was taken, in us.
static RESULT: AtomicU32 = AtomicU32::new(0);
static TAKEN_US: AtomicU32 = AtomicU32::new(0);

/// Calibrates and starts the converter. If it does not follow, the current is unknown. To be called once, after `sense::init_adcs_of_rails_loops_earth_bond_and_reference`, which
/// sets the clock of both converters.
pub fn init_average_current() {
    power_up_and_calibrate_converter(ADC2);
    ADC2.smpr().modify(|w| w.set_smp(usize::from(INPUT), SampleTime::CYCLES640_5));
    ADC2.cfgr().modify(|w| {
        w.set_cont(true);
        w.set_ovrmod(Ovrmod::OVERWRITE);
    });
    ADC2.cfgr2().write(|w| {
        w.set_rovse(true);
        w.set_ovsr(RATIO_64);
        w.set_ovss(SHIFT);
    });
    enable_converter(ADC2);
    ADC2.sqr1().write(|w| w.set_sq(0, INPUT));
    ADC2.cr().modify(|w| w.set_adstart(true));
}

/// The mean of the last ms in uA; `u32::MAX`, which is outside of every limit, if the converter does not deliver.
pub fn read_average_microamps_or_max_if_stale() -> u32 {
    // Differences of 32 bits wrap around after more than an hour.
    let now_us = Instant::now().as_micros() as u32;
    if ADC2.isr().read().eoc() {
        ADC2.isr().write(|w| w.set_eoc(true));
        RESULT.store(u32::from(ADC2.dr().read().rdata()), Ordering::Relaxed);
        TAKEN_US.store(now_us, Ordering::Relaxed);
    }
    if now_us.wrapping_sub(TAKEN_US.load(Ordering::Relaxed)) > LONGEST_AGE_US {
        return u32::MAX;
    }
    let result = u64::from(RESULT.load(Ordering::Relaxed));
    u32::try_from(result * u64::from(AVERAGE_FULL_SCALE_MICROAMPS) / FULL_RESULT).unwrap_or(u32::MAX)
}
