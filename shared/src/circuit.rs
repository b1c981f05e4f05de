//! The high-voltage circuit outside the chip: the values of its parts, and the times, voltages and currents that follow from them.
//!
//! This is the one place for these values. Whoever designs a power stage changes them here; [`crate::limits`] derives the board's limits
//! from them, or checks while it is compiled that a sound board keeps its limits. The values are those of a simulated reference stage; no board with them has been built.

use crate::MAX_CHANNELS;

/// Rails of a board.
pub const RAILS: usize = 2;

/// Index of the rail that feeds a channel.
#[must_use]
pub const fn rail_index_of_channel(channel: usize) -> usize {
    channel % RAILS
}

/// Capacitance of one rail in pF: its capacitors and the output of its supply module. With less, electrodes that rise together take more
/// than a fifth of the rail's voltage (four of them, with the supply: 1 nF: 23 %; 1.8 nF: 15 %; simulated), which the board takes for an
/// arc ([`most_rail_dip_when_electrodes_rise_permille`]).
pub const RAIL_PICOFARADS: u32 = 1_800;
/// Capacitance of each electrode of a channel in pF: electrode and cable (100 pF), its two switches (19 nC per edge: 10 pF at 2 kV)
/// and the transformer of its gate (6 pF).
pub const ELECTRODE_PICOFARADS: [u32; MAX_CHANNELS] = [116; MAX_CHANNELS];
/// Resistance in ohm through which an electrode is charged from its rail.
pub const ELECTRODE_OHMS: u32 = 1_000_000;
/// Resistance of a closed discharge switch in ohm.
pub const DISCHARGE_OHMS: u32 = 1_000_000;
/// Resistance of one bleeder in ohm. Each rail has two that share no part: the divider that measures it, and one without a
/// measurement. One of them alone has to discharge the rail if the other breaks.
pub const BLEEDER_OHMS: u32 = 100_000_000;
/// Least resistance in ohm from one rail to earth besides its bleeders: 100 Mohm for the leakage of four switches (5 uA each at 2 kV, which
/// their data sheet allows at a higher voltage), and 100 Mohm for a probe that somebody measures the rail with.
pub const LEAKAGE_OHMS: u32 = 50_000_000;
/// Time in us until the contact of a discharge switch has closed.
pub const CONTACT_MICROSECONDS: u32 = 1_000;
/// The chip's supply in mV, which its converters refer to: the largest code of a converter is this voltage at its pin.
pub const PIN_FULL_SCALE_MILLIVOLTS: u32 = 3_300;
/// Lower resistor in ohm of the divider that measures a rail; the upper one is a bleeder.
pub const DIVIDER_TAP_OHMS: u32 = 132_000;
/// Capacitance in pF at the divider's tap.
pub const DIVIDER_TAP_PICOFARADS: u32 = 1_000;
/// Time constant in us of the filter between divider and converter: 132 kohm and 1 nF are 132 us.
pub const DIVIDER_MICROSECONDS: u32 = (DIVIDER_TAP_OHMS as u64 * DIVIDER_TAP_PICOFARADS as u64 / 1_000_000) as u32;
/// Rail voltage in mV at which a measurement is at its full scale: 3.3 V x 100 Mohm / 132 kohm are 2500 V.
pub const RAIL_FULL_SCALE_MILLIVOLTS: u32 =
    (PIN_FULL_SCALE_MILLIVOLTS as u64 * BLEEDER_OHMS as u64 / DIVIDER_TAP_OHMS as u64) as u32;
/// Shunt in ohm in the supply's return, for the average current.
pub const AVERAGE_SHUNT_OHMS: u32 = 1_650;
/// Average current in uA at full scale: 3.3 V / 1.65 kohm are 2 mA.
pub const AVERAGE_FULL_SCALE_MICROAMPS: u32 = PIN_FULL_SCALE_MILLIVOLTS * 1_000 / AVERAGE_SHUNT_OHMS;
/// Shunt in ohm between the rails' capacitors and the electrodes' return, for the momentary current.
pub const MOMENTARY_SHUNT_OHMS: u32 = 165;
/// Momentary current in uA at full scale: 3.3 V / 165 ohm are 20 mA.
pub const MOMENTARY_FULL_SCALE_MICROAMPS: u32 = PIN_FULL_SCALE_MILLIVOLTS * 1_000 / MOMENTARY_SHUNT_OHMS;
/// Resistance in ohm through which an electrode's lower switch discharges it.
pub const LOWER_SWITCH_OHMS: u32 = 100_000;
/// How long after the end of a window the lower switch is on, in ns at most. It is late on purpose, so that it never meets the upper one.
pub const LOWER_SWITCH_LATE_NANOSECONDS: u32 = 40_000;
/// How far a capacitance, or the product of a resistance and a capacitance, may be from its nominal value, in per cent: 5 % for the
/// resistor, 15 % for a ceramic capacitor over voltage and temperature; an electrode and its cable differ as much from one build to
/// the next.
pub const TOLERANCE_PERCENT: u32 = 20;
/// How far a resistance may be from its nominal value, in per cent.
pub const RESISTANCE_TOLERANCE_PERCENT: u32 = 5;

/// Time in ms in which the supply follows a step of its set-point from 10 to 90 %.
pub const SUPPLY_RISE_MS: u32 = 5;
/// The same as a time constant, in us: 5 ms / ln 9. It falls as fast. A slower one would feed a rail against its closed discharge switch when the
/// set-point is lowered, with up to 2 kV / 1 Mohm, which the board takes for an over-current.
pub const SUPPLY_TIME_CONSTANT_MICROSECONDS: u32 = SUPPLY_RISE_MS * 1_000 * 1_000 / 2_197;

/// 1000 ln(2000 V / 60 V): how many time constants a rail takes from its highest voltage to a harmless one.
const FULL_DISCHARGE_PERMILLE: u64 = 3_507;
/// 1000 ln 2.
const HALVING_PERMILLE: u64 = 693;

/// Capacitance in pF that hangs on a rail while all of its electrodes are charged.
const LOADED_RAIL_PICOFARADS: u32 = RAIL_PICOFARADS + largest_total_electrode_picofarads_of_a_rail();

/// Capacitance in pF of all electrodes of the rail that feeds most.
const fn largest_total_electrode_picofarads_of_a_rail() -> u32 {
    let (mut sums, mut most, mut channel) = ([0; RAILS], 0, 0);
    while channel < MAX_CHANNELS {
        let rail = rail_index_of_channel(channel);
        // Two electrodes.
        sums[rail] += 2 * ELECTRODE_PICOFARADS[channel];
        if sums[rail] > most {
            most = sums[rail];
        }
        channel += 1;
    }
    most
}

/// Capacitance in pF of the largest electrode.
const fn largest_electrode_picofarads() -> u32 {
    let (mut largest, mut channel) = (0, 0);
    while channel < MAX_CHANNELS {
        if ELECTRODE_PICOFARADS[channel] > largest {
            largest = ELECTRODE_PICOFARADS[channel];
        }
        channel += 1;
    }
    largest
}

/// `value` with a tolerance of `percent` per cent added.
#[must_use]
pub const fn add_percent(value: u64, percent: u32) -> u64 {
    value + value * percent as u64 / 100
}

/// `value` with a tolerance of `percent` per cent taken away.
#[must_use]
pub const fn subtract_percent(value: u64, percent: u32) -> u64 {
    value - value * percent as u64 / 100
}

/// Longest time in us until a rail has fallen from 2 kV to 60 V through `ohms`, all tolerances against it.
#[must_use]
pub const fn longest_rail_discharge_from_2_kv_to_60_v_us(ohms: u32) -> u32 {
    let time_constant_us = ohms as u64 * LOADED_RAIL_PICOFARADS as u64 / 1_000_000;
    (time_constant_us * (100 + TOLERANCE_PERCENT as u64) / 100 * FULL_DISCHARGE_PERMILLE / 1000) as u32
}

/// What divider and bleeder take from a rail of `millivolts`, in uA, rounded up.
#[must_use]
pub const fn both_bleeders_of_one_rail_microamps(millivolts: u32) -> u32 {
    // Two bleeders in parallel; mV over ohm is mA.
    (millivolts as u64 * 2 * 1_000).div_ceil(BLEEDER_OHMS as u64) as u32
}

/// What may leak from a rail of `millivolts` besides, in uA, rounded up.
#[must_use]
pub const fn most_leakage_microamps(millivolts: u32) -> u32 {
    (millivolts as u64 * 1_000).div_ceil(LEAKAGE_OHMS as u64) as u32
}

/// The most in uA that the electrodes which can rise together take in their first moment from rails of `millivolts`: one of each ERA, as
/// the two of an ERA are never on together. 4 x 2 kV / 1 Mohm are 8 mA, with the resistors' tolerance 8.4 mA.
#[must_use]
pub const fn peak_microamps_when_one_electrode_of_each_actuator_rises(millivolts: u32) -> u32 {
    let ohms = subtract_percent(ELECTRODE_OHMS as u64, RESISTANCE_TOLERANCE_PERCENT);
    (MAX_CHANNELS as u64 * millivolts as u64 * 1_000 / ohms) as u32
}

/// The most that a rail loses to electrodes that rise together, in thousandths of its voltage, with all tolerances against it and without
/// any help of the supply: one electrode of each channel of the rail. 2 x 116 pF take 11 % from 1.8 nF, with tolerances 16 %.
#[must_use]
pub const fn most_rail_dip_when_electrodes_rise_permille() -> u32 {
    let rising = add_percent(largest_total_electrode_picofarads_of_a_rail() as u64 / 2, TOLERANCE_PERCENT);
    let rail = subtract_percent(RAIL_PICOFARADS as u64, TOLERANCE_PERCENT);
    (rising * 1_000).div_ceil(rising + rail) as u32
}

/// What both bleeders take at least in `elapsed_us` from a rail that stands at `from_millivolts` without its supply, in mV: 1 - exp(-x) is
/// more than x - x^2 / 2 after x time constants.
#[must_use]
pub const fn least_fall_by_bleeders_millivolts(from_millivolts: u32, elapsed_us: u32) -> u32 {
    let nominal_us = BLEEDER_OHMS as u64 / 2 * LOADED_RAIL_PICOFARADS as u64 / 1_000_000;
    let time_constant_us = add_percent(nominal_us, TOLERANCE_PERCENT);
    let x_ppm = elapsed_us as u64 * 1_000_000 / time_constant_us;
    (from_millivolts as u64 * (x_ppm - x_ppm * x_ppm / 2_000_000) / 1_000_000) as u32
}

/// Longest time in ns from the end of a window's command until the electrode has fallen from 2 kV to 60 V, all tolerances against it.
#[must_use]
pub const fn longest_electrode_discharge_from_window_end_to_60_v_ns() -> u32 {
    let time_constant_ns = LOWER_SWITCH_OHMS as u64 * largest_electrode_picofarads() as u64 / 1_000;
    let falling_ns = time_constant_ns * (100 + TOLERANCE_PERCENT as u64) / 100 * FULL_DISCHARGE_PERMILLE / 1000;
    LOWER_SWITCH_LATE_NANOSECONDS + falling_ns as u32
}

/// Shortest time in us until a rail that stands at `from_millivolts` has fallen below `to_millivolts` with its discharge switch
/// closed, without charged electrodes and all tolerances in favour. Counted in whole halvings, so that it is never too long.
#[must_use]
pub const fn shortest_discharge_us(from_millivolts: u32, to_millivolts: u32) -> u32 {
    let time_constant_us = DISCHARGE_OHMS as u64 * RAIL_PICOFARADS as u64 / 1_000_000;
    let halving_us = time_constant_us * (100 - TOLERANCE_PERCENT as u64) / 100 * HALVING_PERMILLE / 1000;
    match from_millivolts.checked_div(to_millivolts) {
        Some(ratio) if ratio > 0 => halving_us as u32 * ratio.ilog2(),
        _ => 0,
    }
}

/// The part of its full charge, in thousandths, that every electrode has taken at least after being on for `on_ns`: 1 - exp(-n) after n
/// time constants, rounded down. In between the chord counts, which is below the curve.
#[must_use]
pub const fn least_electrode_charge_permille(on_ns: u64) -> u32 {
    let nominal_ns = ELECTRODE_OHMS as u64 * largest_electrode_picofarads() as u64 / 1_000;
    let time_constant_ns = nominal_ns * (100 + TOLERANCE_PERCENT as u64) / 100;
    let (from, to) = match on_ns / time_constant_ns {
        0 => (0, 632),
        1 => (632, 864),
        2 => (864, 950),
        3 => (950, 981),
        4 => (981, 993),
        _ => return 993,
    };
    (from + (to - from) * (on_ns % time_constant_ns) / time_constant_ns) as u32
}
