//! One actuator's part of a setting of all, at a frequency of the table.

use crate::drive::Drive;
use serde::Serialize;

/// One actuator's part of a setting.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Part {
    /// What it does.
    #[serde(flatten)]
    pub drive: Drive,
    /// Its frequency as an index of the table's.
    #[serde(skip)]
    pub frequency: usize,
}
