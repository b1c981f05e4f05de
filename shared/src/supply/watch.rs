//! Whether the readings are plausible and within the limits.

use super::{RAILS, SensorReadings, SupplyCommand};
use crate::limits::{
    COLLAPSE_FROM_MILLIVOLTS, COLLAPSE_PERCENT, DISCHARGE_LIMIT_MS, IMPLAUSIBLE_AFTER_MS, MAX_AVERAGE_MICROAMPS,
    OVER_CURRENT_AFTER_MS, OVER_VOLTAGE_MILLIVOLTS, RAIL_TOLERANCE_MILLIVOLTS, RAIL_TOLERANCE_PERCENT,
    RISING_TOLERANCE_MILLIVOLTS,
};
use crate::protocol::FaultCode;

/// A fault that was found, and its detail.
pub type FaultFinding = (FaultCode, u32);

/// Checks the readings once a ms while the board is live.
#[derive(Clone, Debug, Default)]
pub struct SupplyMonitor {
    last: Option<[u32; RAILS]>,
    last_set: [u32; RAILS],
    implausible_since_us: [Option<u64>; RAILS],
    discharging_since_us: [Option<u64>; RAILS],
    current_since_us: Option<u64>,
}

impl SupplyMonitor {
    /// A monitor that has not seen any readings.
    #[must_use]
    pub const fn new() -> Self {
        Self {
            last: None,
            last_set: [0; RAILS],
            implausible_since_us: [None; RAILS],
            discharging_since_us: [None; RAILS],
            current_since_us: None,
        }
    }

    /// Forgets earlier readings, for the next session.
    pub fn forget_history(&mut self) {
        *self = Self::new();
    }

    /// The first fault in the readings, if there is one. `supply` is the command that was in force when they were measured.
    pub fn check_readings(
        &mut self,
        now_us: u64,
        readings: &SensorReadings,
        supply: &SupplyCommand,
    ) -> Option<FaultFinding> {
        if !readings.interlock_closed {
            return Some((FaultCode::InterlockOpen, 0));
        }
        if !readings.stop_released {
            return Some((FaultCode::EmergencyStop, 0));
        }
        if !readings.earth_bonded {
            return Some((FaultCode::EarthOpen, 0));
        }
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
            if condition_has_lasted(since, discharging, now_us, DISCHARGE_LIMIT_MS) {
                return Some((FaultCode::DischargeFailed, detail));
            }
            // A rising rail is behind by the supply's own lag.
            let lag = if set > number(&last_set) { RISING_TOLERANCE_MILLIVOLTS } else { 0 };
            let tolerance = (set / 100 * RAIL_TOLERANCE_PERCENT).max(RAIL_TOLERANCE_MILLIVOLTS) + lag;
            let Some(since) = self.implausible_since_us.get_mut(rail) else { continue };
            // On its way down a rail may be above its set-point for as long as its discharge takes.
            let plausible = measured.abs_diff(set) <= tolerance || discharging;
            if condition_has_lasted(since, !plausible, now_us, IMPLAUSIBLE_AFTER_MS) {
                return Some((FaultCode::RailImplausible, detail));
            }
        }
        let too_much = readings.average_microamps > MAX_AVERAGE_MICROAMPS;
        if condition_has_lasted(&mut self.current_since_us, too_much, now_us, OVER_CURRENT_AFTER_MS) {
            return Some((FaultCode::OverCurrent, readings.average_microamps));
        }
        None
    }
}

/// Whether `condition` is true and has been true for `limit_ms`; `since_us` remembers since when.
fn condition_has_lasted(since_us: &mut Option<u64>, condition: bool, now_us: u64, limit_ms: u32) -> bool {
    if !condition {
        *since_us = None;
        return false;
    }
    now_us.saturating_sub(*since_us.get_or_insert(now_us)) >= u64::from(limit_ms) * 1000
}
