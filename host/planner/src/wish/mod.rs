//! What is asked for: targets, quiet zones, time windows.

pub mod quiet;
pub mod request;
pub mod schedule;
pub(crate) mod zone;
