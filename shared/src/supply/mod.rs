//! The high-voltage supply: set-points that rise slowly, rails that are watched, and discharge that is measured.
//!
//! The reference board has two rails. Rail 1 feeds the odd ERAs, rail 2 the even ones, so that two ERAs have a voltage each;
//! with more, two share a rail, which stands at the higher voltage that they ask for, and the other one gets narrower
//! windows of the same fundamental force.

mod current;
mod electrode_current;
mod rails;
mod watch;

use crate::limits::DISCHARGED_MILLIVOLTS;

pub use crate::circuit::{RAILS, rail_index_of_channel};
pub use current::mean_current_of_drives_and_bleeders_microamps;
pub use electrode_current::ElectrodeCurrentMonitor;
pub(crate) use rails::is_rail_far_enough_above_set_point_to_discharge;
pub use rails::{RailControl, rail_dac_code, round_down_to_dac_step_millivolts};
pub use watch::{FaultFinding, ReferenceMonitor, SupplyMonitor};

/// The first rail that is not harmless, as the detail of a fault: 10 000 x the rail's number, from 1, + its volts. `None` if all rails are
/// discharged.
#[must_use]
pub fn encode_first_charged_rail_as_fault_detail_if_any(readings: &SensorReadings) -> Option<u32> {
    let mut rails = (1_u32..).zip(readings.rail_millivolts);
    rails
        .find(|(_, millivolts)| *millivolts >= DISCHARGED_MILLIVOLTS)
        .map(|(rail, millivolts)| rail * 10_000 + millivolts / 1000)
}

/// What the supply has to do.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct SupplyCommand {
    /// Whether it may deliver.
    pub enabled: bool,
    /// Whether the discharge switch of each rail is closed.
    pub discharge: [bool; RAILS],
    /// Set-point of each rail in mV.
    pub set_point_millivolts: [u32; RAILS],
    /// Whether the permit is given. Without it the supply is off and all discharge switches are closed by a circuit outside the chip,
    /// whatever the other lines say.
    pub permitted: bool,
}

impl SupplyCommand {
    /// Everything off, all discharge switches closed.
    pub const OFF: Self =
        Self { enabled: false, discharge: [true; RAILS], set_point_millivolts: [0; RAILS], permitted: false };

    /// Whether a rail may be charged under this command.
    #[must_use]
    pub fn is_enabled_or_any_discharge_open(&self) -> bool {
        self.enabled || self.discharge.contains(&false)
    }
}

/// What is measured of the supply and seen of the loops that must be closed.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct SensorReadings {
    /// Voltage of each rail in mV.
    pub rail_millivolts: [u32; RAILS],
    /// What the supply delivers on average, in uA.
    pub average_microamps: u32,
    /// The enclosure is closed.
    pub interlock_closed: bool,
    /// The emergency stop is not pressed.
    pub stop_released: bool,
    /// Levels of these two loops in mV, for the detail of their faults: a loop that is open is near 0, one that is shorted to its supply near
    /// 3300.
    pub interlock_millivolts: u32,
    /// As above.
    pub stop_millivolts: u32,
    /// Panel and moving masses are bonded to protective earth.
    pub earth_bonded: bool,
    /// What the chip's own reference shows of the supply that set-points, measurements and trips refer to, in mV.
    pub reference_millivolts: u32,
    /// Why the hardware, or an interrupt, has switched everything off since the last reading.
    pub trip: Option<FaultFinding>,
    /// What the board finds wrong with itself, for as long as it is.
    pub standing_fault: Option<FaultFinding>,
}
