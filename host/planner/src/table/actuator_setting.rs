//! The drive of one actuator in a setting of all actuators, at a frequency of the table.

use crate::drive::Drive;
use serde::Serialize;

/// The drive of one actuator in a setting of all actuators.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ActuatorSetting {
    /// What it does.
    #[serde(flatten)]
    pub drive: Drive,
    /// Its frequency as an index of the table's.
    #[serde(skip)]
    pub frequency: usize,
}
