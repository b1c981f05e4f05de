//! Rail voltages, average current and earth bond, measured by ADC1.
//!
//! One injected sequence of four conversions, started by software and waited for. The reference is the supply of 3.3 V at
//! VREF+, taken for what its regulator says (1 %); the limits that matter leave room for that.

use embassy_stm32::pac::adc::vals::{Exten, SampleTime};
use embassy_stm32::pac::adccommon::vals::Ckmode;
use embassy_stm32::pac::{ADC1, ADC12_COMMON, RCC};

/// Inputs in the order of the sequence: rail 1, rail 2, average current, earth bond (DS12288, pin table).
const INPUTS: [usize; 4] = [1, 2, 7, 6];

/// Largest code: 3.3 V at the input.
const FULL_CODE: u64 = 4095;
/// What that is at a rail, in mV; see the divider in the pin table.
const RAIL_FULL_SCALE_MILLIVOLTS: u64 = 2_500_000;
/// What that is as average current, in uA; see the shunt in the pin table.
const CURRENT_FULL_SCALE_MICROAMPS: u64 = 2_000;
/// Below this code the earth is bonded: 0.165 V of 3.3 V.
const BONDED_BELOW: u16 = 205;

/// Reads of a status register before giving up: each takes some 10 clocks. A conversion of the sequence takes 60 ADC clocks
/// of 42.5 MHz, so the four take 5.7 us, and the wait ends after 800 x 10 / 170 MHz = 47 us.
const CONVERSION_READS: usize = 800;
/// Likewise at boot: calibration takes 116 ADC clocks, or 2.7 us, and the start less.
const START_READS: usize = 10_000;
/// The regulator needs 20 us (DS12288, ADC characteristics); clocks of 170 MHz.
const REGULATOR_CLOCKS: u32 = 170 * 20;
/// Between the calibration and the enable there must be four ADC clocks (RM0440, ADC calibration), here of four clocks each.
const AFTER_CALIBRATION_CLOCKS: u32 = 16;

/// One measurement.
#[derive(Clone, Copy)]
pub struct Measurement {
    /// In mV.
    pub rail_millivolts: [u32; 2],
    /// In uA.
    pub average_microamps: u32,
    /// Panel and masses are bonded.
    pub earth_bonded: bool,
}

/// Reported if the converter does not deliver: values outside of every limit.
const UNKNOWN: Measurement =
    Measurement { rail_millivolts: [u32::MAX; 2], average_microamps: u32::MAX, earth_bonded: false };

/// Calibrates and starts the converter. If it does not follow, every measurement is implausible. To be called once.
pub fn init_adc() {
    RCC.ahb2enr().modify(|w| w.set_adc12en(true));
    // A peripheral takes writes from the second clock after its enable (RM0440, section 7.2.18); the read waits for it.
    let _ = RCC.ahb2enr().read();
    // 170 MHz / 4 = 42.5 MHz; the converter takes up to 60.
    ADC12_COMMON.ccr().write(|w| w.set_ckmode(Ckmode::SYNC_DIV4));
    ADC1.cr().write(|w| w.set_deeppwd(false));
    ADC1.cr().write(|w| w.set_advregen(true));
    cortex_m::asm::delay(REGULATOR_CLOCKS);
    ADC1.cr().modify(|w| w.set_adcal(true));
    poll_until(START_READS, || !ADC1.cr().read().adcal());
    cortex_m::asm::delay(AFTER_CALIBRATION_CLOCKS);
    for input in INPUTS {
        // 47.5 clocks, 1.1 us: the inputs' capacitors hold the charge that the converter's 5 pF take.
        ADC1.smpr().modify(|w| w.set_smp(input, SampleTime::CYCLES47_5));
    }
    ADC1.isr().write(|w| w.set_adrdy(true));
    ADC1.cr().modify(|w| w.set_aden(true));
    poll_until(START_READS, || ADC1.isr().read().adrdy());
    ADC1.jsqr().write(|w| {
        w.set_jl((INPUTS.len() - 1) as u8);
        w.set_jexten(Exten::DISABLED);
        for (place, input) in INPUTS.into_iter().enumerate() {
            w.set_jsq(place, input as u8);
        }
    });
}

/// Measures all four inputs now; takes 6 us.
pub fn measure_inputs() -> Measurement {
    ADC1.isr().write(|w| {
        w.set_jeoc(true);
        w.set_jeos(true);
    });
    ADC1.cr().modify(|w| w.set_jadstart(true));
    if !poll_until(CONVERSION_READS, || ADC1.isr().read().jeos()) {
        return UNKNOWN;
    }
    let [rail_1, rail_2, current, bond] = core::array::from_fn(|place| ADC1.jdr(place).read().jdata());
    Measurement {
        rail_millivolts: [
            scale_adc_code(rail_1, RAIL_FULL_SCALE_MILLIVOLTS),
            scale_adc_code(rail_2, RAIL_FULL_SCALE_MILLIVOLTS),
        ],
        average_microamps: scale_adc_code(current, CURRENT_FULL_SCALE_MICROAMPS),
        earth_bonded: bond < BONDED_BELOW,
    }
}

fn scale_adc_code(code: u16, full_scale: u64) -> u32 {
    u32::try_from(u64::from(code) * full_scale / FULL_CODE).unwrap_or(u32::MAX)
}

/// Whether `condition` has become true within `max_reads` evaluations.
fn poll_until(max_reads: usize, mut condition: impl FnMut() -> bool) -> bool {
    (0..max_reads).any(|_| condition())
}
