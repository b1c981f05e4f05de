//! Masses that move in closing gaps under a plan's drives: steadily, while rails rise, and with what is left of earlier drives.

pub(crate) mod driven_panel;
pub(crate) mod harmonics;
pub(crate) mod harmonics_at;
pub mod plan_motion;
pub(crate) mod quiet_limits;
pub mod residual;
pub(crate) mod settle;
pub(crate) mod strong_softening;
