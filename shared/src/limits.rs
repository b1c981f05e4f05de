//! The limits that keep a person, the actuators and the air in their gaps whole, each with where its number comes from.
//!
//! The board holds to them whatever the host claims. Sources are named with each; "ERA" stands for the default design with a
//! gap of 0.5 mm, 50 mm electrodes and 100 pF of electrode and cable.

/// Highest rail voltage in mV. The gap of an ERA breaks down near 2.57 kV at rest and near 2.0 kV once its mass has moved
/// by 0.14 mm towards an electrode; 85 % of 2.57 kV is 2.18 kV, and 2.0 kV leaves the over-voltage trip room below that.
pub const MAX_RAIL_MILLIVOLTS: u32 = 2_000_000;
/// The comparators switch everything off above this, in mV: 5 % over the highest set-point, which covers the dividers'
/// tolerance (1 %), the converter's (0.5 %) and the supply's overshoot, and is still below 2.18 kV.
pub const OVER_VOLTAGE_MILLIVOLTS: u32 = 2_100_000;
const _: () = assert!(OVER_VOLTAGE_MILLIVOLTS > MAX_RAIL_MILLIVOLTS && OVER_VOLTAGE_MILLIVOLTS < 2_180_000);

/// Below this a rail counts as discharged, in mV: 60 V dc is not hazardous (IEC 61010-1, 6.3.1; IEC 62368-1, ES1).
pub const DISCHARGED_MILLIVOLTS: u32 = 60_000;
/// Longest time in ms until a rail is discharged. The active discharge takes less than 20 ms; the bleeder alone (1 nF and
/// 100 Mohm: 0.1 s) takes 0.35 s from 2 kV to 60 V. Access within 1 s of opening the interlock must be harmless.
pub const DISCHARGE_LIMIT_MS: u32 = 1_000;

/// The bleeder alone has discharged a rail after this many ms (1 nF and 100 Mohm, from 2 kV to 60 V: 0.35 s). When what is
/// measured cannot be believed, a rail is not called safe before.
pub const BLEEDER_MS: u32 = 400;

/// Soft start: the most that a set-point rises, in mV per ms. 20 V/ms charges 2 nF with 40 uA, a twelfth of what the supply
/// may deliver.
pub const RAIL_SLOPE_MILLIVOLTS_PER_MS: u32 = 20_000;
/// Set-point of the self-test before arming, in mV: enough to see a short, below [`DISCHARGED_MILLIVOLTS`].
pub const TEST_MILLIVOLTS: u32 = 50_000;
const _: () = assert!(TEST_MILLIVOLTS < DISCHARGED_MILLIVOLTS);
/// How far a rail may be from [`TEST_MILLIVOLTS`] when the self-test ends, in mV.
pub const TEST_TOLERANCE_MILLIVOLTS: u32 = 15_000;
/// Most that may flow at [`TEST_MILLIVOLTS`] with all electrodes off, in uA: dividers take 1, and an electrode that leaks
/// through its resistor of 1 Mohm takes 50.
pub const TEST_MICROAMPS: u32 = 20;
/// Longest time in ms for a rail to reach [`TEST_MILLIVOLTS`]: 3 ms of slope and ten times the supply's 5 ms.
pub const TEST_LIMIT_MS: u32 = 60;

/// Measured and set voltage may differ by this many parts in a hundred ...
pub const RAIL_TOLERANCE_PERCENT: u32 = 10;
/// ... or by this many mV if that is more (one part in fifty of full scale: converter and divider), ...
pub const RAIL_TOLERANCE_MILLIVOLTS: u32 = 40_000;
/// A rail that rises may be behind its set-point by as much more, in mV: the slope times the supply's 5 ms.
pub const RISING_TOLERANCE_MILLIVOLTS: u32 = RAIL_SLOPE_MILLIVOLTS_PER_MS * 5;
/// ... for this many ms, before the measurement or the supply counts as broken.
pub const IMPLAUSIBLE_AFTER_MS: u32 = 50;
/// A rail that loses more than this part of its voltage from one ms to the next, in per cent, has had an arc or a short.
pub const COLLAPSE_PERCENT: u32 = 20;
/// Below this set-point in mV a loss is not looked at, as noise is as large.
pub const COLLAPSE_FROM_MILLIVOLTS: u32 = 200_000;

/// Most that the supply may deliver on average, in uA: electrodes at 2 kV and 100 pF take 40 uA each at 200 Hz and 200 uA
/// at 1 kHz; a person's let-go threshold is 20 times this, the limit of IEC 61010-1 (2 mA dc) 4 times.
pub const MAX_AVERAGE_MICROAMPS: u32 = 500;
/// For how many ms the average may be above [`MAX_AVERAGE_MICROAMPS`].
pub const OVER_CURRENT_AFTER_MS: u32 = 10;
/// The comparator switches everything off above this momentary current, in uA: the edges of four electrodes that fall
/// together take 4 x 2 mA (2 kV x 100 pF in 100 us), and a quarter more.
pub const TRIP_MICROAMPS: u32 = 10_000;

/// Both electrodes of an ERA are off for at least this long between two windows, in ns, whatever is configured: three time
/// constants of an electrode's discharge by its lower switch take less (100 pF, 100 kohm: 30 us).
pub const LEAST_GUARD_NANOSECONDS: u32 = 50_000;
/// The guard time that the board keeps, in ns: the default between 50 us and 1 ms; it costs 0.07 dB of force at 200 Hz.
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
