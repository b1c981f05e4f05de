//! Rail voltages and earth bond, measured by ADC1; the levels of the loops of interlock and emergency stop, measured by ADC3 and ADC4. The average
//! current is ADC2's (`average_current.rs`).
//!
//! First two regular conversions, then one injected sequence of three, started by software and waited for. The first conversion after more
//! than a ms may be wrong (errata sheet ES0430; its text was not at hand), so that its result is not used. ADC3 and ADC4 each have an injected sequence of
//! two conversions of one input, of which the second is used.
//!
//! Every code is relative to VREF+, the board's supply of 3.3 V, on which the set-points and the trips' thresholds depend as well: a supply
//! that is wrong would be wrong everywhere at once and agree with itself. The chip's own reference, VREFINT, does not depend on it. Its code
//! at 3.0 V was measured in the factory, so that its code now tells what VREF+ is.

use core::ops::Range;
use embassy_stm32::pac::adc::Adc;
use embassy_stm32::pac::adc::vals::{Exten, Ovrmod, SampleTime};
use embassy_stm32::pac::adccommon::vals::Ckmode;
use embassy_stm32::pac::{ADC1, ADC3, ADC4, ADC12_COMMON, ADC345_COMMON, RCC};
use era_shared::circuit::{PIN_FULL_SCALE_MILLIVOLTS, RAIL_FULL_SCALE_MILLIVOLTS};

/// Inputs in the order of the sequence: rail 1, rail 2, earth bond (DS12288, pin table).
const INPUTS: [usize; 3] = [1, 2, 6];

/// Converter and input of the interlock loop (PB13), then of the emergency stop loop (PB14) (DS12288, pin table).
const LOOP_INPUTS: [(Adc, usize); 2] = [(ADC3, 5), (ADC4, 4)];

/// The input whose first conversion is not used: rail 1.
const DISCARDED_INPUT: u8 = 1;
/// The input that carries VREFINT (RM0440, ADC1 connectivity).
const REFERENCE_INPUT: u8 = 18;
/// Code of VREFINT at a supply of 3.0 V and 30 degrees, in the upper half of this word (DS12288, internal voltage reference).
const REFERENCE_CALIBRATION: *const u32 = 0x1FFF_75A8 as *const u32;
/// The supply at that calibration, in mV.
const CALIBRATION_MILLIVOLTS: u32 = 3_000;

/// Largest code: 3.3 V at the input.
const FULL_CODE: u64 = 4095;
/// Codes at which the earth is bonded: 10 ohm and a bond of up to 17 ohm against 330 ohm are 0.097 to 0.25 V of 3.3 V. Less than 0.06 V is no
/// bond but a loop that is not fed, as with its resistor of 330 ohm open.
const BONDED: Range<u16> = 75..310;
/// Levels of a closed loop in mV. The resistor of 5.1 kohm at its far end and the 10 kohm at the pin divide 3.3 V to 2.185 V; 1 % for each resistor
/// and 500 ohm of wire and contacts make 2.10 to 2.20 V, and as much again on either side is permitted. A loop whose wires touch, or that touches
/// 3.3 V, is at 3.3 V.
const LOOP_CLOSED_MILLIVOLTS: Range<u32> = 1_980..2_380;

/// Reads of a status register before giving up: each takes some 10 clocks. A conversion of the sequence takes 60 ADC clocks
/// of 42.5 MHz, so the three take 4.3 us, the two regular ones 7.5 us, and the wait ends after 800 x 10 / 170 MHz = 47 us.
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
    /// Panel and masses are bonded.
    pub earth_bonded: bool,
    /// The supply at VREF+ in mV.
    pub reference_millivolts: u32,
    /// Levels of the loops of interlock and emergency stop in mV.
    pub loop_millivolts: [u32; 2],
}

/// Reported if the converter does not deliver: values outside of every limit.
const UNKNOWN: Measurement = Measurement {
    rail_millivolts: [u32::MAX; 2],
    earth_bonded: false,
    reference_millivolts: u32::MAX,
    loop_millivolts: [u32::MAX; 2],
};

/// Calibrates and starts the converters. If one does not follow, every measurement is implausible. To be called once.
pub fn init_adcs_of_rails_loops_earth_bond_and_reference() {
    RCC.ahb2enr().modify(|w| {
        w.set_adc12en(true);
        w.set_adc345en(true);
    });
    // A peripheral takes writes from the second clock after its enable (RM0440, section 7.2.18); the read waits for it.
    let _ = RCC.ahb2enr().read();
    // 170 MHz / 4 = 42.5 MHz; the converters take up to 60.
    ADC12_COMMON.ccr().write(|w| {
        w.set_ckmode(Ckmode::SYNC_DIV4);
        w.set_vrefen(true);
    });
    ADC345_COMMON.ccr().write(|w| w.set_ckmode(Ckmode::SYNC_DIV4));
    power_up_and_calibrate_converter(ADC1);
    for input in INPUTS {
        // 47.5 clocks, 1.1 us: the inputs' capacitors hold the charge that the converter's 5 pF take.
        ADC1.smpr().modify(|w| w.set_smp(input, SampleTime::CYCLES47_5));
    }
    // VREFINT needs 4 us (DS12288); 247.5 clocks are 5.8 us.
    ADC1.smpr2().modify(|w| w.set_smp(usize::from(REFERENCE_INPUT) - 10, SampleTime::CYCLES247_5));
    // The data register holds the last of the two regular conversions.
    ADC1.cfgr().modify(|w| w.set_ovrmod(Ovrmod::OVERWRITE));
    enable_converter(ADC1);
    ADC1.sqr1().write(|w| {
        w.set_l(1);
        w.set_sq(0, DISCARDED_INPUT);
        w.set_sq(1, REFERENCE_INPUT);
    });
    set_injected_sequence(ADC1, INPUTS);
    for (converter, input) in LOOP_INPUTS {
        power_up_and_calibrate_converter(converter);
        // As above; the loops have 100 nF at the pin.
        converter.smpr().modify(|w| w.set_smp(input, SampleTime::CYCLES47_5));
        enable_converter(converter);
        set_injected_sequence(converter, [input; 2]);
    }
}

/// Switches a converter's regulator on and calibrates it. Its clock must have been set.
pub fn power_up_and_calibrate_converter(converter: Adc) {
    converter.cr().write(|w| w.set_deeppwd(false));
    converter.cr().write(|w| w.set_advregen(true));
    cortex_m::asm::delay(REGULATOR_CLOCKS);
    converter.cr().modify(|w| w.set_adcal(true));
    poll_until(START_READS, || !converter.cr().read().adcal());
    cortex_m::asm::delay(AFTER_CALIBRATION_CLOCKS);
}

/// Enables a calibrated converter.
pub fn enable_converter(converter: Adc) {
    converter.isr().write(|w| w.set_adrdy(true));
    converter.cr().modify(|w| w.set_aden(true));
    poll_until(START_READS, || converter.isr().read().adrdy());
}

fn set_injected_sequence<const LENGTH: usize>(converter: Adc, inputs: [usize; LENGTH]) {
    converter.jsqr().write(|w| {
        w.set_jl((LENGTH - 1) as u8);
        w.set_jexten(Exten::DISABLED);
        for (place, input) in inputs.into_iter().enumerate() {
            w.set_jsq(place, input as u8);
        }
    });
}

/// Starts a converter's injected sequence.
fn start_injected_sequence(converter: Adc) {
    converter.isr().write(|w| {
        w.set_jeoc(true);
        w.set_jeos(true);
    });
    converter.cr().modify(|w| w.set_jadstart(true));
}

/// Whether a loop of this level in mV is closed: neither open nor shorted.
#[must_use]
pub fn is_loop_level_closed(millivolts: u32) -> bool {
    LOOP_CLOSED_MILLIVOLTS.contains(&millivolts)
}

/// Measures all inputs now; takes 12 us.
pub fn measure_rails_loops_earth_bond_and_reference() -> Measurement {
    ADC1.isr().write(|w| {
        w.set_eoc(true);
        w.set_eos(true);
        w.set_ovr(true);
    });
    ADC1.cr().modify(|w| w.set_adstart(true));
    if !poll_until(CONVERSION_READS, || ADC1.isr().read().eos()) {
        return UNKNOWN;
    }
    let reference = u32::from(ADC1.dr().read().rdata());
    let converters = [ADC1, ADC3, ADC4];
    converters.into_iter().for_each(start_injected_sequence);
    if !poll_until(CONVERSION_READS, || converters.into_iter().all(|converter| converter.isr().read().jeos())) {
        return UNKNOWN;
    }
    let [rail_1, rail_2, bond] = core::array::from_fn(|place| ADC1.jdr(place).read().jdata());
    Measurement {
        rail_millivolts: [
            scale_adc_code(rail_1, RAIL_FULL_SCALE_MILLIVOLTS),
            scale_adc_code(rail_2, RAIL_FULL_SCALE_MILLIVOLTS),
        ],
        earth_bonded: BONDED.contains(&bond),
        reference_millivolts: convert_reference_code_to_supply_millivolts(reference),
        // The second of two conversions of the same input.
        loop_millivolts: LOOP_INPUTS
            .map(|(converter, _)| scale_adc_code(converter.jdr(1).read().jdata(), PIN_FULL_SCALE_MILLIVOLTS)),
    }
}

/// The supply at VREF+ at which VREFINT has this code.
fn convert_reference_code_to_supply_millivolts(code: u32) -> u32 {
    // SAFETY: a word of the chip's own memory that is there on every chip and never changes.
    let calibration = unsafe { REFERENCE_CALIBRATION.read_volatile() } >> 16;
    (CALIBRATION_MILLIVOLTS * calibration).checked_div(code).unwrap_or(u32::MAX)
}

fn scale_adc_code(code: u16, full_scale: u32) -> u32 {
    u32::try_from(u64::from(code) * u64::from(full_scale) / FULL_CODE).unwrap_or(u32::MAX)
}

/// Whether `condition` has become true within `max_reads` evaluations.
fn poll_until(max_reads: usize, mut condition: impl FnMut() -> bool) -> bool {
    (0..max_reads).any(|_| condition())
}
