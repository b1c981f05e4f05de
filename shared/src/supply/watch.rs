//! Whether the readings are plausible and within the limits.

use super::{RAILS, SensorReadings, SupplyCommand};
use crate::circuit::{AVERAGE_FULL_SCALE_MICROAMPS, DISCHARGE_OHMS, RESISTANCE_TOLERANCE_PERCENT, subtract_percent};
use crate::limits::{
    COLLAPSE_FROM_MILLIVOLTS, COLLAPSE_PERCENT, DISCHARGE_LIMIT_MS, FORGIVING_RATIO, IMPLAUSIBLE_AFTER_MS,
    OVER_CURRENT_MEAN_MICROSECONDS, OVER_CURRENT_MICROAMPS, OVER_VOLTAGE_MILLIVOLTS, RAIL_TOLERANCE_MILLIVOLTS,
    RAIL_TOLERANCE_PERCENT, REFERENCE_MILLIVOLTS, REFERENCE_TOLERANCE_PERCENT, RISING_TOLERANCE_MILLIVOLTS,
    SWITCHED_DISCHARGE_MS,
};
use crate::protocol::FaultCode;

/// A fault that was found, and its detail.
pub type FaultFinding = (FaultCode, u32);

/// Checks the readings once a ms while the board is live.
#[derive(Clone, Debug, Default)]
pub struct SupplyMonitor {
    last: Option<[u32; RAILS]>,
    last_set: [u32; RAILS],
    last_us: Option<u64>,
    implausible: [ConditionTime; RAILS],
    /// Per rail since when its discharge switch is closed.
    discharging_since_us: [Option<u64>; RAILS],
    /// Per rail when its set-point was last lowered.
    lowered_us: [Option<u64>; RAILS],
    /// The most that flowed through discharge switches of late in uA, and when that was.
    through_switches: Option<(u32, u64)>,
    /// Mean of the average current in nA.
    mean_nanoamps: u64,
}

impl SupplyMonitor {
    /// A monitor that has not seen any readings.
    #[must_use]
    pub const fn new() -> Self {
        Self {
            last: None,
            last_set: [0; RAILS],
            last_us: None,
            implausible: [ConditionTime::NONE; RAILS],
            discharging_since_us: [None; RAILS],
            lowered_us: [None; RAILS],
            through_switches: None,
            mean_nanoamps: 0,
        }
    }

    /// Forgets earlier readings, for the next session.
    pub fn forget_history(&mut self) {
        *self = Self::new();
    }

    /// Whether a rail is, or was lately, not where it was set. What is measured of it then may be wrong.
    #[must_use]
    pub fn is_any_rail_off_set_point_or_was_lately(&self) -> bool {
        self.implausible.iter().any(ConditionTime::is_met_or_not_yet_forgiven)
    }

    /// The first fault in the readings, if there is one. `supply` is the command that was in force when they were measured.
    pub fn update_and_find_first_fault_in_readings(
        &mut self,
        now_us: u64,
        readings: &SensorReadings,
        supply: &SupplyCommand,
    ) -> Option<FaultFinding> {
        if !readings.interlock_closed {
            return Some((FaultCode::InterlockOpen, readings.interlock_millivolts));
        }
        if !readings.stop_released {
            return Some((FaultCode::EmergencyStop, readings.stop_millivolts));
        }
        if !readings.earth_bonded {
            return Some((FaultCode::EarthOpen, 0));
        }
        let elapsed_us = now_us.saturating_sub(self.last_us.replace(now_us).unwrap_or(now_us)).min(LONGEST_STEP_US);
        let last = self.last.replace(readings.rail_millivolts);
        let last_set = core::mem::replace(&mut self.last_set, supply.set_point_millivolts);
        for rail in 0..RAILS {
            let number = |values: &[u32; RAILS]| values.get(rail).copied().unwrap_or(0);
            let (measured, set) = (number(&readings.rail_millivolts), number(&supply.set_point_millivolts));
            // The rail in thousands, the voltage in the rest.
            let detail = u32::try_from(rail + 1).unwrap_or(0) * 10_000 + measured / 1000;
            if measured > OVER_VOLTAGE_MILLIVOLTS {
                return Some((FaultCode::OverVoltage, detail));
            }
            let discharging = supply.discharge.get(rail).copied().unwrap_or(false);
            if let Some(before) = last.map(|last| number(&last))
                && set >= COLLAPSE_FROM_MILLIVOLTS
                && !discharging
                && u64::from(measured) * 100 < u64::from(before.min(set)) * u64::from(100 - COLLAPSE_PERCENT)
                // Something that was never there has not collapsed.
                && before >= COLLAPSE_FROM_MILLIVOLTS
            {
                return Some((FaultCode::RailCollapsed, detail));
            }
            let Some(since) = self.discharging_since_us.get_mut(rail) else { continue };
            let discharging_us = match (discharging, &since) {
                (false, _) => None,
                (true, Some(since)) => Some(now_us.saturating_sub(*since)),
                (true, None) => Some(0),
            };
            *since = discharging_us.map(|lasted| now_us - lasted);
            if discharging_us.is_some_and(|lasted| lasted >= u64::from(DISCHARGE_LIMIT_MS) * 1000) {
                return Some((FaultCode::DischargeFailed, detail));
            }
            // A rising rail is behind by the supply's own lag.
            let lag = if set > number(&last_set) { RISING_TOLERANCE_MILLIVOLTS } else { 0 };
            let tolerance = (set / 100 * RAIL_TOLERANCE_PERCENT).max(RAIL_TOLERANCE_MILLIVOLTS) + lag;
            let within = measured.abs_diff(set) <= tolerance;
            let switched_us = u64::from(SWITCHED_DISCHARGE_MS) * 1000;
            if !within && measured > set && discharging_us.is_some_and(|lasted| lasted >= switched_us) {
                return Some((FaultCode::DischargeSlow, detail));
            }
            let (Some(implausible), Some(lowered_us)) = (self.implausible.get_mut(rail), self.lowered_us.get_mut(rail))
            else {
                continue;
            };
            if set < number(&last_set) {
                *lowered_us = Some(now_us);
            }
            // After its set-point was lowered a rail may be above it for as long as its discharge switch needs. That tells nothing of the
            // measurement: it is neither counted nor forgiven. A switch that closes because a reading is too high is no excuse.
            let is_falling = lowered_us.is_some_and(|lowered| now_us.saturating_sub(lowered) < switched_us);
            if discharging && measured > set && is_falling && !within {
                continue;
            }
            if implausible.count_or_forgive_time_and_has_lasted(!within, elapsed_us, IMPLAUSIBLE_AFTER_MS) {
                return Some((FaultCode::RailImplausible, detail));
            }
        }
        let through_switches_microamps = self.update_most_current_through_discharge_switches_microamps(
            now_us,
            most_current_through_closed_discharge_switches_microamps(readings, supply),
        );
        let mean_microamps =
            self.update_mean_current_microamps(readings.average_microamps, through_switches_microamps, elapsed_us);
        (mean_microamps > OVER_CURRENT_MICROAMPS).then_some((FaultCode::OverCurrent, mean_microamps))
    }

    /// The most that the measured current has of what flows through discharge switches, in uA: its filter and its mean keep what flowed before
    /// they opened.
    fn update_most_current_through_discharge_switches_microamps(&mut self, now_us: u64, microamps: u32) -> u32 {
        let recent = self.through_switches.filter(|(_, at_us)| now_us.saturating_sub(*at_us) < SWITCH_CURRENT_FADES_US);
        let most = recent.filter(|(before, _)| *before > microamps).unwrap_or((microamps, now_us));
        self.through_switches = Some(most);
        most.0
    }

    /// The mean of the average current after a reading that stands for the time since the one before, without what flows through discharge
    /// switches.
    fn update_mean_current_microamps(
        &mut self,
        microamps: u32,
        through_switches_microamps: u32,
        elapsed_us: u64,
    ) -> u32 {
        // A current that is not measured counts as the largest.
        let counted_microamps = match microamps {
            0..=AVERAGE_FULL_SCALE_MICROAMPS => microamps.saturating_sub(through_switches_microamps),
            _ => AVERAGE_FULL_SCALE_MICROAMPS,
        };
        let measured_nanoamps = u64::from(counted_microamps) * 1_000;
        let older_us = OVER_CURRENT_MEAN_MICROSECONDS.saturating_sub(elapsed_us);
        self.mean_nanoamps =
            (self.mean_nanoamps * older_us + measured_nanoamps * elapsed_us) / OVER_CURRENT_MEAN_MICROSECONDS;
        u32::try_from(self.mean_nanoamps / 1_000).unwrap_or(u32::MAX)
    }
}

/// How long a current is still measured after it has ended, in us: 8 time constants of the filter of 1 ms, the converter's mean of 1 ms, and a ms
/// until the next look.
const SWITCH_CURRENT_FADES_US: u64 = 10_000;

/// The most that flows through the discharge switches that are closed, in uA: a supply whose set-point was lowered falls more slowly than its
/// rail, and feeds it against its switch. That lasts for as long as a rail may be above its set-point, 13 ms, and is none of the current of the
/// drives or of a fault. The current is that of some ms before, so the rail counts with what it has lost since; a half more covers that.
fn most_current_through_closed_discharge_switches_microamps(readings: &SensorReadings, supply: &SupplyCommand) -> u32 {
    let ohms = subtract_percent(u64::from(DISCHARGE_OHMS), RESISTANCE_TOLERANCE_PERCENT);
    let through = |(millivolts, is_closed): (u32, bool)| {
        let microamps = u64::from(millivolts.min(OVER_VOLTAGE_MILLIVOLTS)) * 1_000 / ohms;
        if is_closed { microamps + microamps / 2 } else { 0 }
    };
    let sum: u64 = readings.rail_millivolts.into_iter().zip(supply.discharge).map(through).sum();
    u32::try_from(sum).unwrap_or(u32::MAX)
}

/// Longest time in us between two readings that counts: after a pause nobody knows what was in between.
const LONGEST_STEP_US: u64 = 5_000;

/// For how long the reference must be wrong, in ms, so that noise is none.
const REFERENCE_AFTER_MS: u32 = 5;

/// Checks the reference of the converters once a ms, in every state.
#[derive(Clone, Debug, Default)]
pub struct ReferenceMonitor {
    last_us: Option<u64>,
    wrong: ConditionTime,
}

impl ReferenceMonitor {
    /// A monitor that has not seen any readings.
    #[must_use]
    pub const fn new() -> Self {
        Self { last_us: None, wrong: ConditionTime::NONE }
    }

    /// The fault in the reference, if there is one.
    pub fn update_and_find_lasting_reference_fault(
        &mut self,
        now_us: u64,
        readings: &SensorReadings,
    ) -> Option<FaultFinding> {
        let elapsed_us = now_us.saturating_sub(self.last_us.replace(now_us).unwrap_or(now_us)).min(LONGEST_STEP_US);
        let off = readings.reference_millivolts.abs_diff(REFERENCE_MILLIVOLTS);
        let is_wrong = u64::from(off) * 100 > u64::from(REFERENCE_MILLIVOLTS) * u64::from(REFERENCE_TOLERANCE_PERCENT);
        let has_lasted = self.wrong.count_or_forgive_time_and_has_lasted(is_wrong, elapsed_us, REFERENCE_AFTER_MS);
        has_lasted.then_some((FaultCode::Reference, readings.reference_millivolts))
    }
}

/// For how long a condition has been met, less a part of the time in which it was not.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct ConditionTime {
    /// In us; `None` while nothing is counted.
    lasted_us: Option<u64>,
}

impl ConditionTime {
    pub(super) const NONE: Self = Self { lasted_us: None };

    const fn is_met_or_not_yet_forgiven(&self) -> bool {
        self.lasted_us.is_some()
    }

    /// Takes note of whether the condition is met now, `elapsed_us` after the last call, and returns whether it has been met for
    /// `limit_ms`.
    pub(super) fn count_or_forgive_time_and_has_lasted(
        &mut self,
        is_met: bool,
        elapsed_us: u64,
        limit_ms: u32,
    ) -> bool {
        self.lasted_us = match (self.lasted_us, is_met) {
            (None, false) => None,
            // A reading stands for the time since the one before, the first one too: a condition that is met every other ms would never
            // last otherwise. No more than the limit, so that it is forgiven in time that is known however long it has lasted.
            (lasted, true) => Some((lasted.unwrap_or(0) + elapsed_us).min(u64::from(limit_ms) * 1000)),
            (Some(lasted), false) => lasted.checked_sub(elapsed_us / u64::from(FORGIVING_RATIO)),
        };
        self.lasted_us.is_some_and(|lasted| lasted >= u64::from(limit_ms) * 1000)
    }
}
