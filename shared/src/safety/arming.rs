//! The self-test before arming: nothing is live that has not just been seen to work.

use crate::limits::{
    DISCHARGE_LIMIT_MS, DISCHARGED_MILLIVOLTS, TEST_LIMIT_MS, TEST_MICROAMPS, TEST_MILLIVOLTS,
    TEST_TOLERANCE_MILLIVOLTS,
};
use crate::protocol::FaultCode;
use crate::supply::{FaultFinding, RAILS, SensorReadings, SupplyCommand, charged_rail_fault_detail};

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum SelfTestPhase {
    /// Rails discharged, loops closed.
    Discharge,
    /// Comparators and breaks can trip.
    Trips,
    /// The rails follow a small set-point and nothing draws current.
    Charge,
}

/// What the caller has to do next.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SelfTestVerdict {
    /// Send this command to the supply, and call again in a ms.
    Continue(SupplyCommand),
    /// Test the comparators and breaks ([`crate::board::Board::test_trip_circuits`]), then call again.
    TryTrips,
    /// The test has passed.
    Passed,
    /// The test has failed.
    Failed(FaultFinding),
}

/// A self-test under way. It takes as long as the rails need: some 10 ms, and a second at most.
#[derive(Clone, Copy, Debug)]
pub struct SelfTest {
    step: SelfTestPhase,
    since_us: u64,
}

impl SelfTest {
    /// A self-test that begins at `now_us`.
    #[must_use]
    pub const fn new(now_us: u64) -> Self {
        Self { step: SelfTestPhase::Discharge, since_us: now_us }
    }

    /// Takes the next step of the self-test. To be called every ms with fresh readings.
    pub fn advance(&mut self, now_us: u64, readings: &SensorReadings) -> SelfTestVerdict {
        if !readings.interlock_closed {
            return SelfTestVerdict::Failed((FaultCode::InterlockOpen, 0));
        }
        if !readings.stop_released {
            return SelfTestVerdict::Failed((FaultCode::EmergencyStop, 0));
        }
        if !readings.earth_bonded {
            return SelfTestVerdict::Failed((FaultCode::EarthOpen, 0));
        }
        let elapsed_us = now_us.saturating_sub(self.since_us);
        let highest = readings.rail_millivolts.iter().copied().max().unwrap_or(u32::MAX);
        match self.step {
            SelfTestPhase::Discharge if highest < DISCHARGED_MILLIVOLTS => {
                (self.step, self.since_us) = (SelfTestPhase::Trips, now_us);
                SelfTestVerdict::TryTrips
            }
            SelfTestPhase::Discharge if elapsed_us > u64::from(DISCHARGE_LIMIT_MS) * 1000 => {
                SelfTestVerdict::Failed((FaultCode::DischargeFailed, charged_rail_fault_detail(readings).unwrap_or(0)))
            }
            SelfTestPhase::Discharge => {
                SelfTestVerdict::Continue(SupplyCommand { discharge: [true; RAILS], ..SupplyCommand::default() })
            }
            SelfTestPhase::Trips => {
                // Whoever tried them has raised a fault if they cannot.
                (self.step, self.since_us) = (SelfTestPhase::Charge, now_us);
                SelfTestVerdict::Continue(CHARGE)
            }
            SelfTestPhase::Charge => {
                let there = |rail: &u32| rail.abs_diff(TEST_MILLIVOLTS) <= TEST_TOLERANCE_MILLIVOLTS;
                if readings.rail_millivolts.iter().all(there) && readings.average_microamps <= TEST_MICROAMPS {
                    return SelfTestVerdict::Passed;
                }
                if elapsed_us > u64::from(TEST_LIMIT_MS) * 1000 {
                    let wrong = readings.rail_millivolts.iter().position(|rail| !there(rail));
                    // The rail, or 0 for the current.
                    let detail = wrong.map_or(0, |rail| u32::try_from(rail + 1).unwrap_or(0));
                    return SelfTestVerdict::Failed((FaultCode::ShortCircuit, detail));
                }
                SelfTestVerdict::Continue(CHARGE)
            }
        }
    }
}

const CHARGE: SupplyCommand =
    SupplyCommand { enabled: true, discharge: [false; RAILS], set_point_millivolts: [TEST_MILLIVOLTS; RAILS] };
