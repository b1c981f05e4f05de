//! Whether what is measured can be believed and borne.

use super::{RAILS, Senses, Supply};
use crate::limits::{
    COLLAPSE_FROM_MILLIVOLTS, COLLAPSE_PERCENT, DISCHARGE_LIMIT_MS, IMPLAUSIBLE_AFTER_MS, MAX_AVERAGE_MICROAMPS,
    OVER_CURRENT_AFTER_MS, OVER_VOLTAGE_MILLIVOLTS, RAIL_TOLERANCE_MILLIVOLTS, RAIL_TOLERANCE_PERCENT,
    RISING_TOLERANCE_MILLIVOLTS,
};
use crate::protocol::FaultCode;

/// What was found, and the number that goes with it.
pub type Finding = (FaultCode, u32);

/// Looks at the senses once a ms while the board is live.
#[derive(Clone, Debug, Default)]
pub struct Watch {
    last: Option<[u32; RAILS]>,
    last_set: [u32; RAILS],
    implausible_since_us: [Option<u64>; RAILS],
    discharging_since_us: [Option<u64>; RAILS],
    current_since_us: Option<u64>,
}

impl Watch {
    /// Has seen nothing.
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

    /// Forgets what it has seen: for the next session.
    pub fn reset(&mut self) {
        *self = Self::new();
    }

    /// The first thing that is wrong, if any. `supply` is what the supply was told before these senses were measured.
    pub fn look(&mut self, now_us: u64, senses: &Senses, supply: &Supply) -> Option<Finding> {
        if !senses.interlock_closed {
            return Some((FaultCode::InterlockOpen, 0));
        }
        if !senses.stop_released {
            return Some((FaultCode::EmergencyStop, 0));
        }
        if !senses.earth_bonded {
            return Some((FaultCode::EarthOpen, 0));
        }
        let last = self.last.replace(senses.rail_millivolts);
        let last_set = core::mem::replace(&mut self.last_set, supply.set_point_millivolts);
        for rail in 0..RAILS {
            let number = |values: &[u32; RAILS]| values.get(rail).copied().unwrap_or(0);
            let (measured, set) = (number(&senses.rail_millivolts), number(&supply.set_point_millivolts));
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
            if lasts(since, discharging, now_us, DISCHARGE_LIMIT_MS) {
                return Some((FaultCode::DischargeFailed, detail));
            }
            // A rising rail is behind by the supply's own lag.
            let lag = if set > number(&last_set) { RISING_TOLERANCE_MILLIVOLTS } else { 0 };
            let tolerance = (set / 100 * RAIL_TOLERANCE_PERCENT).max(RAIL_TOLERANCE_MILLIVOLTS) + lag;
            let Some(since) = self.implausible_since_us.get_mut(rail) else { continue };
            // On its way down a rail may be above its set-point for as long as its discharge takes.
            let plausible = measured.abs_diff(set) <= tolerance || discharging;
            if lasts(since, !plausible, now_us, IMPLAUSIBLE_AFTER_MS) {
                return Some((FaultCode::RailImplausible, detail));
            }
        }
        let too_much = senses.average_microamps > MAX_AVERAGE_MICROAMPS;
        if lasts(&mut self.current_since_us, too_much, now_us, OVER_CURRENT_AFTER_MS) {
            return Some((FaultCode::OverCurrent, senses.average_microamps));
        }
        None
    }
}

/// Whether something is so and has been for `limit_ms`.
fn lasts(since_us: &mut Option<u64>, is_so: bool, now_us: u64, limit_ms: u32) -> bool {
    if !is_so {
        *since_us = None;
        return false;
    }
    now_us.saturating_sub(*since_us.get_or_insert(now_us)) >= u64::from(limit_ms) * 1000
}
