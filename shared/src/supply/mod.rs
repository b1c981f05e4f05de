//! The high-voltage supply: set-points that rise slowly, rails that are watched, and discharge that is measured.
//!
//! The reference board has two rails. Rail 1 feeds the odd ERAs, rail 2 the even ones, so that two ERAs have a voltage each;
//! with more, two share a rail, which stands at the higher voltage that they ask for, and the other one gets narrower
//! windows of the same fundamental force.

mod rails;
mod watch;

use crate::limits::DISCHARGED_MILLIVOLTS;

pub use rails::{RailControl, quantise_rail_millivolts, rail_dac_code};
pub use watch::{FaultFinding, SupplyMonitor};

/// Rails of a board.
pub const RAILS: usize = 2;

/// Index of the rail that feeds a channel.
#[must_use]
pub const fn rail_index_of_channel(channel: usize) -> usize {
    channel % RAILS
}

/// The first rail that is not harmless, as the detail of a fault: 10 000 x the rail's number, from 1, + its volts. `None` if all rails are
/// discharged.
#[must_use]
pub fn charged_rail_fault_detail(readings: &SensorReadings) -> Option<u32> {
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
    /// Panel and moving masses are bonded to protective earth.
    pub earth_bonded: bool,
    /// Why the hardware, or an interrupt, has switched everything off since the last reading.
    pub trip: Option<(crate::protocol::FaultCode, u32)>,
}
