//! What is said of a plan beside its drives: harmonics, bounds, limits, alternatives.

pub(crate) mod bound;
pub mod explain;
pub(crate) mod harmonics;
pub mod limitation;
pub(crate) mod near;
pub(crate) mod pressed;
pub(crate) mod report;
pub mod trade;
