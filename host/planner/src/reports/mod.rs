//! What is said of a plan beside its drives: alternatives, times, presses.

pub mod explain;
pub mod press_bounds;
pub mod press_report;
pub mod report;
pub mod schedule;
pub mod trade;
