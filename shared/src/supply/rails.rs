//! Set-points in time.

use super::{RAILS, SensorReadings, SupplyCommand};
use crate::limits::{
    DISCHARGED_MILLIVOLTS, MAX_RAIL_MILLIVOLTS, RAIL_SLOPE_MILLIVOLTS_PER_MS, RAIL_TOLERANCE_MILLIVOLTS,
};

/// Largest code of the 12-bit converters that set the rails: [`MAX_RAIL_MILLIVOLTS`].
const RAIL_STEPS: u64 = 4095;
/// Longest step in time that a set-point's rise is worked out for, in us: after a pause it goes on slowly.
const LONGEST_STEP_US: u64 = 5_000;

/// The converter's code for a set-point, rounded down, so that a rail never gets more than was asked for.
#[must_use]
pub fn rail_dac_code(millivolts: u32) -> u16 {
    let code = u64::from(millivolts.min(MAX_RAIL_MILLIVOLTS)) * RAIL_STEPS / u64::from(MAX_RAIL_MILLIVOLTS);
    u16::try_from(code).unwrap_or(0)
}

/// The voltage in mV of the converter's step at or below `millivolts`.
#[must_use]
pub fn round_down_to_dac_step_millivolts(millivolts: u32) -> u32 {
    let exact = u64::from(rail_dac_code(millivolts)) * u64::from(MAX_RAIL_MILLIVOLTS);
    // Rounded up, so that the code of the result is the code it came from.
    u32::try_from(exact.div_ceil(RAIL_STEPS)).unwrap_or(0).min(millivolts)
}

/// Whether a rail is so far above its set-point that its discharge switch is to be closed.
#[must_use]
pub(crate) fn is_rail_far_enough_above_set_point_to_discharge(
    measured_millivolts: u32,
    set_point_millivolts: u32,
) -> bool {
    let margin = (set_point_millivolts / 20).max(RAIL_TOLERANCE_MILLIVOLTS / 2);
    measured_millivolts > set_point_millivolts.saturating_add(margin) && measured_millivolts > DISCHARGED_MILLIVOLTS
}

/// Brings the set-points of the rails to their targets: they rise by a slope, and fall at once.
#[derive(Clone, Debug, Default)]
pub struct RailControl {
    wanted: [u32; RAILS],
    now: [u32; RAILS],
    last_us: u64,
}

impl RailControl {
    /// Both rails at zero.
    #[must_use]
    pub const fn new() -> Self {
        Self { wanted: [0; RAILS], now: [0; RAILS], last_us: 0 }
    }

    /// Sets the targets in mV, cut off at the limit.
    pub fn set_targets(&mut self, target_millivolts: [u32; RAILS]) {
        self.wanted = target_millivolts.map(|millivolts| millivolts.min(MAX_RAIL_MILLIVOLTS));
    }

    /// Continues from set-points that are already in force.
    pub const fn resume_from_set_points(&mut self, set_point_millivolts: [u32; RAILS], now_us: u64) {
        (self.now, self.last_us) = (set_point_millivolts, now_us);
    }

    /// Targets of the rails in mV.
    #[must_use]
    pub const fn target_millivolts(&self) -> [u32; RAILS] {
        self.wanted
    }

    /// Set-points in force, in mV.
    #[must_use]
    pub const fn set_point_millivolts(&self) -> [u32; RAILS] {
        self.now
    }

    /// Sets targets and set-points of both rails to zero at once.
    pub fn zero_targets_and_set_points(&mut self) {
        (self.wanted, self.now) = ([0; RAILS], [0; RAILS]);
    }

    /// Moves the set-points towards their targets, and returns the command for the supply. Set-points rise by the slope and fall at once. A
    /// rail whose voltage is clearly above its set-point gets its discharge switch closed.
    pub fn ramp_up_or_drop_set_points_and_build_supply_command(
        &mut self,
        now_us: u64,
        readings: &SensorReadings,
    ) -> SupplyCommand {
        let elapsed_us = now_us.saturating_sub(self.last_us).min(LONGEST_STEP_US);
        self.last_us = now_us;
        let rise = u64::from(RAIL_SLOPE_MILLIVOLTS_PER_MS) * elapsed_us / 1000;
        let rise = u32::try_from(rise).unwrap_or(0);
        let mut discharge = [false; RAILS];
        for (rail, now) in self.now.iter_mut().enumerate() {
            let wanted = self.wanted.get(rail).copied().unwrap_or(0);
            *now = wanted.min(now.saturating_add(rise));
            let measured = readings.rail_millivolts.get(rail).copied().unwrap_or(u32::MAX);
            if let Some(switch) = discharge.get_mut(rail) {
                *switch = is_rail_far_enough_above_set_point_to_discharge(measured, *now);
            }
        }
        SupplyCommand { enabled: true, discharge, set_point_millivolts: self.now, permitted: true }
    }
}
