//! The pulses that the self-test makes on each electrode alone, and what its rail shows of them.
//!
//! The pin is an output of its port, no timer reaches it, and all other electrodes are low; the rails stand at 50 V, the supply is
//! disabled. The break interrupt is enabled and takes the pin away like all others. For all of this the device waits, 3 ms for each
//! electrode: what switches off has a higher priority.

use crate::outputs::{PinName, await_high_pad, find_electrode_not_low, find_other_electrode_not_low, set_pin_level};
use crate::pins::ELECTRODES;
use crate::{sense, trip};
use embassy_time::{Duration, block_for};
use era_shared::limits::{TEST_PAUSE_MICROSECONDS, TEST_PULSE_MICROSECONDS, TEST_PULSES};
use era_shared::protocol::FaultCode;
use era_shared::safety::ElectrodePulses;
use era_shared::supply::{FaultFinding, rail_index_of_channel};
use era_shared::waveform::Electrode;

/// Measurements whose mean is a rail's voltage: 12 us each. Their noise moves the mean by less than a step of the converter.
const MEASUREMENTS: u32 = 8;

/// Makes the pulses and measures the rail; see [`era_shared::board::Board::pulse_electrode_and_get_rail_mv_after_first_and_last`].
///
/// # Errors
/// What has tripped, or [`FaultCode::ArmFailed`] with the pin that is not low, or that of the electrode if its pad does not become high.
pub fn pulse_electrode_and_get_rail_mv_after_first_and_last(
    channel: usize,
    electrode: Electrode,
) -> Result<ElectrodePulses, FaultFinding> {
    const FAILED: FaultFinding = (FaultCode::ArmFailed, 0);
    let [a, b] = ELECTRODES.get(channel).ok_or(FAILED)?;
    let pin = if electrode == Electrode::A { a.pin } else { b.pin };
    let mut pulses = ElectrodePulses { after_first_millivolts: 0, after_last_millivolts: 0 };
    for number in 0..TEST_PULSES {
        // With interrupts masked, so that a trip comes before all of it and is seen, or after it and takes the pin away.
        cortex_m::interrupt::free(|_| {
            take_trip_as_error()?;
            fail_arming_if_pin_not_low(find_electrode_not_low())?;
            set_pin_level(pin, true);
            // A pin that touches it keeps this pad from becoming high, or is high, too.
            let result = await_high_pad(pin)
                .map_err(|pin| (FaultCode::ArmFailed, pin))
                .and_then(|()| fail_arming_if_pin_not_low(find_other_electrode_not_low(pin)));
            if result.is_err() {
                set_pin_level(pin, false);
            }
            result
        })?;
        block_for(Duration::from_micros(TEST_PULSE_MICROSECONDS.into()));
        set_pin_level(pin, false);
        block_for(Duration::from_micros(TEST_PAUSE_MICROSECONDS.into()));
        if number == 0 {
            pulses.after_first_millivolts =
                measure_mean_rail_millivolts_or_max_if_unknown(rail_index_of_channel(channel));
        }
    }
    pulses.after_last_millivolts = measure_mean_rail_millivolts_or_max_if_unknown(rail_index_of_channel(channel));
    // A pulse that a trip has cut short says nothing of the electrode.
    take_trip_as_error()?;
    fail_arming_if_pin_not_low(find_electrode_not_low())?;
    Ok(pulses)
}

fn take_trip_as_error() -> Result<(), FaultFinding> {
    trip::take_trip().map_or(Ok(()), Err)
}

fn fail_arming_if_pin_not_low(not_low: Option<PinName>) -> Result<(), FaultFinding> {
    not_low.map_or(Ok(()), |pin| Err((FaultCode::ArmFailed, pin)))
}

/// The mean of some measurements; `u32::MAX` if the converter does not deliver.
fn measure_mean_rail_millivolts_or_max_if_unknown(rail: usize) -> u32 {
    let sum: u64 = (0..MEASUREMENTS)
        .map(|_| {
            u64::from(
                sense::measure_rails_loops_earth_bond_and_reference()
                    .rail_millivolts
                    .get(rail)
                    .copied()
                    .unwrap_or(u32::MAX),
            )
        })
        .sum();
    u32::try_from(sum / u64::from(MEASUREMENTS)).unwrap_or(u32::MAX)
}
