//! What electrodes can do: voltage, travel, breakdown, a press.

pub mod limits;
pub mod press;
