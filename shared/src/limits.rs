//! The limits that keep a person, the actuators and the air in their gaps whole, each with where its number comes from.
//!
//! The board holds to them whatever the host claims. Sources are named with each; "ERA" stands for the default design with a
//! gap of 0.5 mm, 50 mm electrodes and 100 pF of electrode and cable.

use crate::circuit::{
    self, longest_electrode_discharge_from_window_end_to_60_v_ns, longest_rail_discharge_from_2_kv_to_60_v_us,
};

/// Highest rail voltage in mV. The gap of an ERA breaks down near 2.57 kV at rest and near 2.0 kV once its mass has moved
/// by 0.14 mm towards an electrode; 85 % of 2.57 kV is 2.18 kV, and 2.0 kV leaves the over-voltage trip room below that.
pub const MAX_RAIL_MILLIVOLTS: u32 = 2_000_000;
/// The comparators switch everything off above this, in mV: 5 % over the highest set-point, which covers the dividers'
/// tolerance (1 %), the converter's (0.5 %) and the supply's overshoot, and is still below 2.18 kV.
pub const OVER_VOLTAGE_MILLIVOLTS: u32 = 2_100_000;
const _: () = assert!(OVER_VOLTAGE_MILLIVOLTS > MAX_RAIL_MILLIVOLTS && OVER_VOLTAGE_MILLIVOLTS < 2_180_000);

/// Below this a rail counts as discharged, in mV: 60 V dc is not hazardous (IEC 61010-1, 6.3.1; IEC 62368-1, ES1).
pub const DISCHARGED_MILLIVOLTS: u32 = 60_000;
/// Longest time in ms until a rail is discharged, whatever does it. Access within 1 s of opening the interlock must be harmless.
pub const DISCHARGE_LIMIT_MS: u32 = 1_000;
/// A rail whose discharge switch closes is below [`DISCHARGED_MILLIVOLTS`] after this many ms: the contact's time, the discharge
/// through the switch (2.26 nF and 1 Mohm from 2 kV to 60 V: 7.9 ms, with tolerances 9.5 ms), the divider's filter, and a ms until
/// the next measurement. A rail that takes longer has a broken discharge switch, or a supply that still feeds it.
pub const SWITCHED_DISCHARGE_MS: u32 = (circuit::CONTACT_MICROSECONDS
    + longest_rail_discharge_from_2_kv_to_60_v_us(circuit::DISCHARGE_OHMS)
    + 4 * circuit::DIVIDER_MICROSECONDS)
    .div_ceil(1000)
    + 1;
/// One bleeder alone has discharged a rail after this many ms (2.26 nF and 100 Mohm from 2 kV to 60 V: 0.79 s, with tolerances
/// 0.95 s). When what is measured cannot be believed, a rail is not called safe before.
pub const BLEEDER_MS: u32 = longest_rail_discharge_from_2_kv_to_60_v_us(circuit::BLEEDER_OHMS).div_ceil(1000);
const _: () = assert!(
    MAX_RAIL_MILLIVOLTS == 2_000_000 && DISCHARGED_MILLIVOLTS == 60_000,
    "circuit.rs has the logarithm of the ratio of these two voltages"
);
const _: () = assert!(SWITCHED_DISCHARGE_MS < 20 && BLEEDER_MS < DISCHARGE_LIMIT_MS);
// A rail whose set-point was lowered while its supply is enabled has as long as its discharge switch needs. The supply, which feeds the rail through
// less than the switch's resistance, has to be down to 40 V above any set-point by then: after ln(2000 V / 40 V) = 3.913 time constants.
const _: () = assert!(RAIL_TOLERANCE_MILLIVOLTS == 40_000);
const _: () = assert!(3_913 * (circuit::SUPPLY_TIME_CONSTANT_MICROSECONDS / 1_000 + 1) < 1_000 * SWITCHED_DISCHARGE_MS);

/// Soft start: the most that a set-point rises, in mV per ms. 20 V/ms charges 2.26 nF with 45 uA, an eleventh of what the supply
/// may deliver.
pub const RAIL_SLOPE_MILLIVOLTS_PER_MS: u32 = 20_000;
/// Set-point of the self-test before arming, in mV: enough to see a short, below [`DISCHARGED_MILLIVOLTS`].
pub const TEST_MILLIVOLTS: u32 = 50_000;
const _: () = assert!(TEST_MILLIVOLTS < DISCHARGED_MILLIVOLTS);
/// How far a rail may be from [`TEST_MILLIVOLTS`] when the self-test ends, in mV.
pub const TEST_TOLERANCE_MILLIVOLTS: u32 = 15_000;
/// Most that may flow at [`TEST_MILLIVOLTS`] with all electrodes off, in uA: bleeders take 1 for each rail, leakage up to 1, and an
/// electrode that leaks through its resistor of 1 Mohm takes 50.
pub const TEST_MICROAMPS: u32 = 20;
const _: () = assert!(
    TEST_MICROAMPS
        > CURRENT_OFFSET_MICROAMPS
            + circuit::RAILS as u32
                * (circuit::both_bleeders_of_one_rail_microamps(TEST_MILLIVOLTS + TEST_TOLERANCE_MILLIVOLTS)
                    + circuit::most_leakage_microamps(TEST_MILLIVOLTS + TEST_TOLERANCE_MILLIVOLTS)),
    "TEST_MICROAMPS, the current limit of the self-test, is too low: a board without faults takes more"
);
/// A rail that is not charged shows no more than this during the self-test, in mV.
pub const TEST_ABSENT_MILLIVOLTS: u32 = 15_000;
/// For how long the self-test looks at the rails with the supply disabled and the discharge switches open, in ms ...
pub const TEST_BLEED_MS: u32 = 10;
/// ... in which the bleeders take at least this much from each rail, in mV: 10 ms of 0.136 s (2.26 nF and 50 Mohm, with tolerances)
/// take 7 % of the 35 V that a rail has at least, or 2.4 V; the converter's step is 0.6 V.
pub const TEST_BLEED_MILLIVOLTS: u32 = 1_800;
const _: () = assert!(
    circuit::least_fall_by_bleeders_millivolts(TEST_MILLIVOLTS - TEST_TOLERANCE_MILLIVOLTS, TEST_BLEED_MS * 1_000)
        >= TEST_BLEED_MILLIVOLTS + circuit::RAIL_FULL_SCALE_MILLIVOLTS / 4_095,
    "the bleeders of a rail without faults lower its voltage by less than the self-test requires"
);
/// Pulses that the self-test makes on each electrode alone, from a rail whose supply is disabled. The rail's fall from after the first to
/// after the last tells what the electrode takes ([`crate::safety::judge_electrode_pulses`]).
pub const TEST_PULSES: u32 = 4;
/// For how long the electrode is on in each pulse, in us: 3.4 of its time constants, with tolerances 2.9.
pub const TEST_PULSE_MICROSECONDS: u32 = 400;
/// For how long it is off after each, in us: its lower switch has discharged it after 90 us, with all tolerances against it, and the
/// filter of the rail's measurement has followed.
pub const TEST_PAUSE_MICROSECONDS: u32 = 200;
const _: () = assert!(TEST_PAUSE_MICROSECONDS * 1_000 > LEAST_GUARD_NANOSECONDS);
/// Longest time in ms for a rail to reach [`TEST_MILLIVOLTS`]: 3 ms of slope, and ten times what the supply takes to follow.
pub const TEST_LIMIT_MS: u32 = 60;
const _: () = assert!(TEST_LIMIT_MS >= TEST_MILLIVOLTS / RAIL_SLOPE_MILLIVOLTS_PER_MS + 10 * circuit::SUPPLY_RISE_MS);

/// Measured and set voltage may differ by this many parts in a hundred ...
pub const RAIL_TOLERANCE_PERCENT: u32 = 10;
/// ... or by this many mV if that is more (one part in fifty of full scale: converter and divider), ...
pub const RAIL_TOLERANCE_MILLIVOLTS: u32 = 40_000;
/// A rail that rises may be behind its set-point by as much more, in mV: what the slope makes while the supply follows.
pub const RISING_TOLERANCE_MILLIVOLTS: u32 = RAIL_SLOPE_MILLIVOLTS_PER_MS * circuit::SUPPLY_RISE_MS;
/// ... for this many ms, before the measurement or the supply counts as broken. A ms in which they agree takes back a quarter of a ms
/// in which they do not, so that a measurement that is right only now and then does not pass.
pub const IMPLAUSIBLE_AFTER_MS: u32 = 50;
/// How many agreeing ms take back one that does not agree.
pub const FORGIVING_RATIO: u32 = 4;
/// A rail that loses more than this part of its voltage from one ms to the next, in per cent, has had an arc or a short.
pub const COLLAPSE_PERCENT: u32 = 20;
const _: () = assert!(
    COLLAPSE_PERCENT * 10 > circuit::most_rail_dip_when_electrodes_rise_permille(),
    "electrodes that charge together lower the rail's voltage like an arc: the rail's capacitance is too small"
);
/// Below this set-point in mV a loss is not looked at, as noise is as large.
pub const COLLAPSE_FROM_MILLIVOLTS: u32 = 200_000;

/// The supply that set-points, measurements and trips refer to, in mV.
pub const REFERENCE_MILLIVOLTS: u32 = circuit::PIN_FULL_SCALE_MILLIVOLTS;
/// How far it may be from that, in per cent: its regulator has 1 %, the chip's own reference 1 % over temperature.
pub const REFERENCE_TOLERANCE_PERCENT: u32 = 3;

/// Most that drives may take from the supply on average, in uA: electrodes at 2 kV and 100 pF take 40 uA each at 200 Hz and 200 uA
/// at 1 kHz.
pub const MAX_AVERAGE_MICROAMPS: u32 = 500;
/// Over any time of so many ms the windows of a sequence take no more than that on average.
pub const SEQUENCE_CURRENT_SPAN_MS: u32 = 10;
/// The mean of the measured average current above which the board switches off, in uA: a person's let-go threshold is 14 times this, the limit of
/// IEC 61010-1 (2 mA dc) nearly 3 times.
pub const OVER_CURRENT_MICROAMPS: u32 = 700;
/// That mean is over this time, in us, of which the older part counts less (exponentially). Electrodes that are charged together take in some ms
/// several times what they take on average: 4 ERAs at 200 Hz 0.9 mA in each third ms. Shorter than [`ELECTRODE_FAULT_AFTER_MS`], so that a
/// current of 0.8 mA is told as an over-current.
pub const OVER_CURRENT_MEAN_MICROSECONDS: u64 = 1 << 13;
/// Most that a charge of all electrodes adds to that mean, in uA.
const CHARGE_RIPPLE_MICROAMPS: u64 =
    circuit::add_percent(total_charge_of_one_electrode_of_every_channel_picocoulombs(), circuit::TOLERANCE_PERCENT)
        / OVER_CURRENT_MEAN_MICROSECONDS;
/// What both rails take while they rise, in uA.
const RISING_MICROAMPS: u64 =
    circuit::RAILS as u64 * circuit::RAIL_PICOFARADS as u64 * RAIL_SLOPE_MILLIVOLTS_PER_MS as u64 / 1_000_000;
const _: () = assert!(
    circuit::add_percent(MAX_AVERAGE_MICROAMPS as u64, CURRENT_TOLERANCE_PERCENT)
        + CURRENT_OFFSET_MICROAMPS as u64
        + circuit::add_percent(RISING_MICROAMPS, circuit::TOLERANCE_PERCENT)
        // Half of what a charge adds is above the mean.
        + CHARGE_RIPPLE_MICROAMPS / 2
        <= OVER_CURRENT_MICROAMPS as u64,
    "the over-current limit is too low: drives that the board accepts can exceed this limit"
);

/// Charge of one electrode of every channel at the highest voltage, in pC.
const fn total_charge_of_one_electrode_of_every_channel_picocoulombs() -> u64 {
    let (mut picofarads, mut channel) = (0, 0);
    while channel < circuit::ELECTRODE_PICOFARADS.len() {
        picofarads += circuit::ELECTRODE_PICOFARADS[channel] as u64;
        channel += 1;
    }
    picofarads * MAX_RAIL_MILLIVOLTS as u64 / 1_000
}

/// The average current and what the drives should take are compared as means over this time, in us, of which the older part counts less
/// (exponentially). A power of two, as the board computes it every ms. Longer than the pauses between two charges at 10 Hz.
pub const ELECTRODE_MEAN_MICROSECONDS: u64 = 1 << 17;
/// They may differ for this many ms.
pub const ELECTRODE_FAULT_AFTER_MS: u32 = 20;
/// How far the measured average current may be off by an offset, in uA: 8 of the converter's steps, which are 3.9 uA (DS12288, total
/// unadjusted error of the converter: 6.5 steps at most), and what is cut off of each number.
pub const CURRENT_OFFSET_MICROAMPS: u32 = 5;
/// ... and by a factor, in per cent: 1 % for the shunt, 1 % for the dividers of the rails, and a half for the converter. The converter's
/// reference changes rails and current alike.
pub const CURRENT_TOLERANCE_PERCENT: u32 = 3;

/// The comparator switches everything off above this momentary current, in uA: the edges of four electrodes that rise
/// together take 4 x 2 mA (2 kV behind 1 Mohm each), and a quarter more.
pub const TRIP_MICROAMPS: u32 = 10_000;
/// The threshold and its comparator may be off by this much, in per cent: 1 % for the shunt, 2 % for the converter, and 10 mV of
/// 1.65 V for the comparator's offset and half of its hysteresis.
const TRIP_TOLERANCE_PERCENT: u32 = 5;
const _: () = assert!(
    circuit::peak_microamps_when_one_electrode_of_each_actuator_rises(MAX_RAIL_MILLIVOLTS) as u64
        <= circuit::subtract_percent(TRIP_MICROAMPS as u64, TRIP_TOLERANCE_PERCENT),
    "simultaneous rising edges trip the over-current comparator"
);

/// No window of an electrode begins sooner than this after the end of one of the other, in ns, whatever is configured. What is never on
/// together are the commands: the two upper switches of an ERA. The electrodes follow them: with this guard the one that was on is below
/// 60 V, which is harmless, when the other one begins to rise (the lower switch 40 us late, then 116 pF through 100 kohm from 2 kV: 41 us,
/// with tolerances 49 us).
pub const LEAST_GUARD_NANOSECONDS: u32 = longest_electrode_discharge_from_window_end_to_60_v_ns();
/// The guard time that the board keeps, in ns: the default between the least and 1 ms; it costs 0.07 dB of force at 200 Hz.
pub const GUARD_NANOSECONDS: u32 = 200_000;
const _: () = assert!(GUARD_NANOSECONDS >= LEAST_GUARD_NANOSECONDS);

/// Longest time in ms for which a channel drives without a rest, if the host names none: a burst.
pub const BURST_DEFAULT_MS: u16 = 2_000;
/// Most that a host may ask for, in ms; a drive that is meant to last longer is a mistake or a stuck program.
pub const BURST_MAX_MS: u16 = 10_000;
/// A channel that drove for as long as it may must rest for this long, in ms.
pub const REST_MS: u32 = 100;
/// In the long run a channel gets this many parts in a hundred of the exposure that its largest force makes, by the square of the
/// force and the time ([`crate::safety::CreditCharge`]): a finger that lies on a surface of 4 g all day would otherwise get more than
/// 2.5 m/s^2 A(8) (EU 2002/44/EC).
pub const DUTY_PERCENT: u32 = 10;
/// What a channel may drive in advance of that at its largest force, in ms: a minute of play.
pub const DUTY_CREDIT_MS: u32 = 60_000;

/// Dead-man time if `Arm` names none: the longest silence of the arming host in ms. 250 ms is short against the time a
/// person needs to reach into a machine and long against a busy desktop's scheduling.
pub const DEADMAN_DEFAULT_MS: u16 = 250;
/// Least dead-man time in ms: two of the keep-alives that a desktop host can send without effort.
pub const DEADMAN_MIN_MS: u16 = 50;
/// Most in ms; beyond a second, silence is no longer noticed before a person is hurt.
pub const DEADMAN_MAX_MS: u16 = 1_000;
