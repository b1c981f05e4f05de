//! Masses that move in closing gaps: steadily, while rails rise, and with what is left of earlier drives.

pub(crate) mod closer;
pub mod plan_motion;
pub mod residual;
pub mod rise;
pub(crate) mod safe;
pub mod softening;
pub(crate) mod weaker;
