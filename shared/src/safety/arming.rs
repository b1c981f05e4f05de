//! The self-test before arming: nothing is live that has not just been seen to work.

use crate::limits::{
    DISCHARGE_LIMIT_MS, DISCHARGED_MILLIVOLTS, SWITCHED_DISCHARGE_MS, TEST_ABSENT_MILLIVOLTS, TEST_BLEED_MILLIVOLTS,
    TEST_BLEED_MS, TEST_LIMIT_MS, TEST_MICROAMPS, TEST_MILLIVOLTS, TEST_TOLERANCE_MILLIVOLTS,
};
use crate::protocol::FaultCode;
use crate::supply::{
    FaultFinding, RAILS, SensorReadings, SupplyCommand, encode_first_charged_rail_as_fault_detail_if_any,
};
use crate::waveform::Electrode;

/// Detail of [`FaultCode::SelfTest`]: a rail that was not charged shows a voltage; plus the rail's number, from 1.
const DETAIL_CROSSED: u32 = 2_000;
/// Likewise: a rail keeps its voltage although the supply is disabled.
const DETAIL_ENABLE: u32 = 2_010;
/// Detail of [`FaultCode::Permit`]: a rail keeps its voltage although the permit is withdrawn; plus the rail's number, from 1.
const DETAIL_NOT_WITHDRAWN: u32 = 20;

/// More than this has no rail in the self-test, in mV.
const HIGHEST_TEST_MILLIVOLTS: u32 = TEST_MILLIVOLTS + TEST_TOLERANCE_MILLIVOLTS;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum SelfTestPhase {
    /// Rails discharged, loops closed.
    Discharge,
    /// Comparators and breaks can trip; then the rails fall below what the over-voltage comparators are tried with.
    Trips,
    /// The over-voltage comparators see no rail.
    OverVoltageInputs,
    /// Rail 1 follows a small set-point, and rail 2 does not.
    FirstRail,
    /// Rail 2 is to be charged as well.
    ChargeSecond,
    /// Both rails follow, and nothing draws current.
    BothRails,
    /// The supply is disabled.
    Disable,
    /// The rails fall by their bleeders when the supply is disabled, whatever their set-points.
    Enable {
        /// Where they began, in mV.
        from_millivolts: [u32; RAILS],
    },
    /// The rails fall quickly when their discharge switches close by their own lines.
    DischargeSwitches,
    /// Both rails are brought up for the next step.
    RechargeForPermit,
    /// The permit is withdrawn, and the rails fall although all other lines say that they should stay.
    Permit,
    /// Both rails are brought up again, before the electrode at this place is tried, or after the last one.
    Recharge {
        /// First electrode A of every channel, then electrode B, so that the rails take turns and recover meanwhile.
        place: usize,
    },
}

const fn is_absent(rail_millivolts: u32) -> bool {
    rail_millivolts <= TEST_ABSENT_MILLIVOLTS
}

/// The first rail that is still charged: 10 000 x its number, from 1, plus V; 0 if none is.
fn encode_first_rail_not_absent(readings: &SensorReadings) -> u32 {
    let mut rails = (1_u32..).zip(readings.rail_millivolts);
    rails.find(|(_, rail)| !is_absent(*rail)).map_or(0, |(number, millivolts)| number * 10_000 + millivolts / 1000)
}

/// What the caller has to do next.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SelfTestVerdict {
    /// Send this command to the supply, and call again in a ms.
    Continue(SupplyCommand),
    /// Test the comparators and breaks ([`crate::board::Board::test_trip_circuits`]), then call again.
    TryTrips,
    /// Test the inputs of the over-voltage comparators with these rails charged to [`TEST_MILLIVOLTS`]
    /// ([`crate::board::Board::test_over_voltage_inputs`]), then call again.
    TryOverVoltageInputs([bool; RAILS]),
    /// With the supply disabled, make the pulses on this electrode ([`crate::board::Board::pulse_electrode_and_get_rail_mv_after_first_and_last`]), recharge the rails, judge the
    /// pulses ([`super::judge_electrode_pulses`]), then call again.
    TryElectrode {
        /// From 0.
        channel: usize,
        /// Which of its electrodes.
        electrode: Electrode,
    },
    /// The test has passed.
    Passed,
    /// The test has failed.
    Failed(FaultFinding),
}

/// A self-test under way. It takes as long as the rails need, and 3 ms for each electrode: some 70 ms, and two seconds at most.
#[derive(Clone, Copy, Debug)]
pub struct SelfTest {
    phase: SelfTestPhase,
    since_us: u64,
    /// Channels that the board has.
    channels: usize,
    /// Whether a rail was too high at the look before.
    was_excessive: bool,
}

impl SelfTest {
    /// A self-test of a board with so many channels that begins at `now_us`.
    #[must_use]
    pub const fn new(now_us: u64, channels: usize) -> Self {
        Self { phase: SelfTestPhase::Discharge, since_us: now_us, channels, was_excessive: false }
    }

    /// Takes the next step of the self-test. To be called every ms with fresh readings. While `rails_trusted` is false, a rail that
    /// is measured to be harmless does not count as harmless.
    pub fn advance(&mut self, now_us: u64, readings: &SensorReadings, rails_trusted: bool) -> SelfTestVerdict {
        if !readings.interlock_closed {
            return SelfTestVerdict::Failed((FaultCode::InterlockOpen, readings.interlock_millivolts));
        }
        if !readings.stop_released {
            return SelfTestVerdict::Failed((FaultCode::EmergencyStop, readings.stop_millivolts));
        }
        if !readings.earth_bonded {
            return SelfTestVerdict::Failed((FaultCode::EarthOpen, 0));
        }
        let elapsed_us = now_us.saturating_sub(self.since_us);
        let has_lasted = |ms: u32| elapsed_us > u64::from(ms) * 1000;
        let is_charged = |rail: u32| rail.abs_diff(TEST_MILLIVOLTS) <= TEST_TOLERANCE_MILLIVOLTS;
        let [first, second] = readings.rail_millivolts;
        let are_both_charged = is_charged(first) && is_charged(second);
        let draws_nothing = readings.average_microamps <= TEST_MICROAMPS;
        let is_first_or_last = |place: usize| place == 0 || place == 2 * self.channels;
        // A set-point that is stuck high: before the over-voltage comparators have been tried, nothing else ends it.
        let excessive = (1_u32..).zip(readings.rail_millivolts).find(|(_, rail)| *rail > HIGHEST_TEST_MILLIVOLTS);
        // Twice, so that one disturbed conversion is none.
        let was_excessive = core::mem::replace(&mut self.was_excessive, excessive.is_some());
        if let Some((rail, millivolts)) = excessive
            && was_excessive
            && !matches!(self.phase, SelfTestPhase::Discharge)
        {
            return SelfTestVerdict::Failed((FaultCode::RailImplausible, rail * 10_000 + millivolts / 1000));
        }
        match self.phase {
            SelfTestPhase::Discharge if first.max(second) < DISCHARGED_MILLIVOLTS && rails_trusted => {
                self.enter_phase(SelfTestPhase::Trips, now_us);
                SelfTestVerdict::TryTrips
            }
            SelfTestPhase::Discharge if has_lasted(DISCHARGE_LIMIT_MS) => SelfTestVerdict::Failed((
                FaultCode::DischargeFailed,
                encode_first_charged_rail_as_fault_detail_if_any(readings).unwrap_or(0),
            )),
            SelfTestPhase::Discharge => SelfTestVerdict::Continue(SupplyCommand::OFF),
            SelfTestPhase::Trips if is_absent(first) && is_absent(second) => {
                self.enter_phase(SelfTestPhase::OverVoltageInputs, now_us);
                SelfTestVerdict::TryOverVoltageInputs([false, false])
            }
            SelfTestPhase::Trips if has_lasted(SWITCHED_DISCHARGE_MS) => {
                SelfTestVerdict::Failed((FaultCode::DischargeSlow, encode_first_rail_not_absent(readings)))
            }
            SelfTestPhase::Trips => SelfTestVerdict::Continue(SupplyCommand::OFF),
            SelfTestPhase::OverVoltageInputs => {
                // Whoever tried them has raised a fault if they cannot.
                self.enter_phase(SelfTestPhase::FirstRail, now_us);
                SelfTestVerdict::Continue(CHARGE_FIRST)
            }
            SelfTestPhase::FirstRail if is_charged(first) && is_absent(second) => {
                self.enter_phase(SelfTestPhase::ChargeSecond, now_us);
                SelfTestVerdict::TryOverVoltageInputs([true, false])
            }
            SelfTestPhase::FirstRail if has_lasted(TEST_LIMIT_MS) => {
                let fault = if is_charged(first) || !is_absent(second) {
                    (FaultCode::SelfTest, DETAIL_CROSSED + 2)
                } else {
                    (FaultCode::ShortCircuit, 1)
                };
                SelfTestVerdict::Failed(fault)
            }
            SelfTestPhase::FirstRail => SelfTestVerdict::Continue(CHARGE_FIRST),
            SelfTestPhase::ChargeSecond => {
                // The rail has its time from the command on, however late this is called.
                self.enter_phase(SelfTestPhase::BothRails, now_us);
                SelfTestVerdict::Continue(CHARGE)
            }
            SelfTestPhase::BothRails if are_both_charged && draws_nothing => {
                self.enter_phase(SelfTestPhase::Disable, now_us);
                SelfTestVerdict::TryOverVoltageInputs([true, true])
            }
            SelfTestPhase::RechargeForPermit if are_both_charged && draws_nothing => {
                self.enter_phase(SelfTestPhase::Permit, now_us);
                SelfTestVerdict::Continue(WITHDRAW_PERMIT)
            }
            // From one electrode to the next the rails are still charged with some current.
            SelfTestPhase::Recharge { place } if are_both_charged && (draws_nothing || !is_first_or_last(place)) => {
                let Some(channel) = place.checked_rem(self.channels).filter(|_| place < 2 * self.channels) else {
                    return SelfTestVerdict::Passed;
                };
                self.enter_phase(SelfTestPhase::Recharge { place: place + 1 }, now_us);
                let electrode = if place < self.channels { Electrode::A } else { Electrode::B };
                SelfTestVerdict::TryElectrode { channel, electrode }
            }
            SelfTestPhase::BothRails | SelfTestPhase::RechargeForPermit | SelfTestPhase::Recharge { .. }
                if has_lasted(TEST_LIMIT_MS) =>
            {
                // The rail, or 0 for the current.
                let rail = if !is_charged(first) { 1 } else { u32::from(!is_charged(second)) * 2 };
                SelfTestVerdict::Failed((FaultCode::ShortCircuit, rail))
            }
            SelfTestPhase::BothRails | SelfTestPhase::RechargeForPermit | SelfTestPhase::Recharge { .. } => {
                SelfTestVerdict::Continue(CHARGE)
            }
            SelfTestPhase::Disable => {
                // The rails may still have risen until now.
                self.enter_phase(SelfTestPhase::Enable { from_millivolts: readings.rail_millivolts }, now_us);
                SelfTestVerdict::Continue(BLEED)
            }
            SelfTestPhase::Enable { from_millivolts } if has_lasted(TEST_BLEED_MS) => {
                let keeps = |(from, now): (u32, u32)| now.saturating_add(TEST_BLEED_MILLIVOLTS) > from;
                let rails = (1..).zip(from_millivolts.into_iter().zip(readings.rail_millivolts));
                if let Some((rail, _)) = { rails }.find(|(_, rail)| keeps(*rail)) {
                    return SelfTestVerdict::Failed((FaultCode::SelfTest, DETAIL_ENABLE + rail));
                }
                self.enter_phase(SelfTestPhase::DischargeSwitches, now_us);
                SelfTestVerdict::Continue(DISCHARGE)
            }
            SelfTestPhase::Enable { .. } => SelfTestVerdict::Continue(BLEED),
            SelfTestPhase::DischargeSwitches if is_absent(first) && is_absent(second) => {
                self.enter_phase(SelfTestPhase::RechargeForPermit, now_us);
                SelfTestVerdict::Continue(CHARGE)
            }
            SelfTestPhase::DischargeSwitches if has_lasted(SWITCHED_DISCHARGE_MS) => {
                SelfTestVerdict::Failed((FaultCode::DischargeSlow, encode_first_rail_not_absent(readings)))
            }
            SelfTestPhase::DischargeSwitches => SelfTestVerdict::Continue(DISCHARGE),
            SelfTestPhase::Permit if is_absent(first) && is_absent(second) => {
                self.enter_phase(SelfTestPhase::Recharge { place: 0 }, now_us);
                SelfTestVerdict::Continue(CHARGE)
            }
            SelfTestPhase::Permit if has_lasted(SWITCHED_DISCHARGE_MS) => {
                let rail = if is_absent(first) { 2 } else { 1 };
                SelfTestVerdict::Failed((FaultCode::Permit, DETAIL_NOT_WITHDRAWN + rail))
            }
            SelfTestPhase::Permit => SelfTestVerdict::Continue(WITHDRAW_PERMIT),
        }
    }

    const fn enter_phase(&mut self, phase: SelfTestPhase, now_us: u64) {
        (self.phase, self.since_us) = (phase, now_us);
    }
}

/// Both rails are charged to [`TEST_MILLIVOLTS`].
pub(crate) const CHARGE: SupplyCommand = SupplyCommand {
    enabled: true,
    discharge: [false; RAILS],
    set_point_millivolts: [TEST_MILLIVOLTS; RAILS],
    permitted: true,
};
/// Rail 2 is held down by its discharge switch.
const CHARGE_FIRST: SupplyCommand =
    SupplyCommand { discharge: [false, true], set_point_millivolts: [TEST_MILLIVOLTS, 0], ..CHARGE };
/// The supply is disabled, and would keep the rails where they are if it were not.
pub(crate) const BLEED: SupplyCommand = SupplyCommand { enabled: false, ..CHARGE };
/// The discharge switches close. The permit stays: without it they would close whatever their own lines say, and the next step but one tests that.
const DISCHARGE: SupplyCommand = SupplyCommand { permitted: true, ..SupplyCommand::OFF };
/// All lines say that the rails stay up, and the permit that they may not.
const WITHDRAW_PERMIT: SupplyCommand = SupplyCommand { permitted: false, ..CHARGE };
