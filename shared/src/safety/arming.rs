//! The self-test before arming: nothing is live that has not just been seen to work.

use crate::limits::{
    DISCHARGE_LIMIT_MS, DISCHARGED_MILLIVOLTS, TEST_LIMIT_MS, TEST_MICROAMPS, TEST_MILLIVOLTS,
    TEST_TOLERANCE_MILLIVOLTS,
};
use crate::protocol::FaultCode;
use crate::supply::{Finding, RAILS, Senses, Supply, charged};

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Step {
    /// Rails discharged, loops closed.
    Low,
    /// Comparators and breaks can trip.
    Trips,
    /// The rails follow a small set-point and nothing draws current.
    Charge,
}

/// What to do next.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Verdict {
    /// Tell the supply this and come again in a ms.
    Going(Supply),
    /// Try the comparators and breaks ([`crate::board::Board::test_trips`]), then come again.
    TryTrips,
    /// Everything is as it should be.
    Passed,
    /// Something is not.
    Failed(Finding),
}

/// A self-test on its way. It takes as long as the rails need, some 10 ms, and a second at most.
#[derive(Clone, Copy, Debug)]
pub struct SelfTest {
    step: Step,
    since_us: u64,
}

impl SelfTest {
    /// Begins.
    #[must_use]
    pub const fn new(now_us: u64) -> Self {
        Self { step: Step::Low, since_us: now_us }
    }

    /// To be called every ms with fresh senses.
    pub fn step(&mut self, now_us: u64, senses: &Senses) -> Verdict {
        if !senses.interlock_closed {
            return Verdict::Failed((FaultCode::InterlockOpen, 0));
        }
        if !senses.stop_released {
            return Verdict::Failed((FaultCode::EmergencyStop, 0));
        }
        if !senses.earth_bonded {
            return Verdict::Failed((FaultCode::EarthOpen, 0));
        }
        let elapsed_us = now_us.saturating_sub(self.since_us);
        let highest = senses.rail_millivolts.iter().copied().max().unwrap_or(u32::MAX);
        match self.step {
            Step::Low if highest < DISCHARGED_MILLIVOLTS => {
                (self.step, self.since_us) = (Step::Trips, now_us);
                Verdict::TryTrips
            }
            Step::Low if elapsed_us > u64::from(DISCHARGE_LIMIT_MS) * 1000 => {
                Verdict::Failed((FaultCode::DischargeFailed, charged(senses).unwrap_or(0)))
            }
            Step::Low => Verdict::Going(Supply { discharge: [true; RAILS], ..Supply::default() }),
            Step::Trips => {
                // Whoever tried them has raised a fault if they cannot.
                (self.step, self.since_us) = (Step::Charge, now_us);
                Verdict::Going(CHARGE)
            }
            Step::Charge => {
                let there = |rail: &u32| rail.abs_diff(TEST_MILLIVOLTS) <= TEST_TOLERANCE_MILLIVOLTS;
                if senses.rail_millivolts.iter().all(there) && senses.average_microamps <= TEST_MICROAMPS {
                    return Verdict::Passed;
                }
                if elapsed_us > u64::from(TEST_LIMIT_MS) * 1000 {
                    let wrong = senses.rail_millivolts.iter().position(|rail| !there(rail));
                    // The rail, or 0 for the current.
                    let detail = wrong.map_or(0, |rail| u32::try_from(rail + 1).unwrap_or(0));
                    return Verdict::Failed((FaultCode::ShortCircuit, detail));
                }
                Verdict::Going(CHARGE)
            }
        }
    }
}

const CHARGE: Supply =
    Supply { enabled: true, discharge: [false; RAILS], set_point_millivolts: [TEST_MILLIVOLTS; RAILS] };
