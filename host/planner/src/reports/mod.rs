//! What is said of a plan beside its drives: alternatives, times, presses.

pub mod explain;
pub mod press;
pub(crate) mod pressed;
pub(crate) mod report;
pub mod schedule;
pub mod trade;
