//! What electrodes and masses do, of which no table knows: forces, limits, closing gaps, rails that rise.

pub mod charging;
pub mod limits;
pub mod rise;
mod secants;
pub mod softening;

use crate::scene::MAX_ACTUATORS;
use num_complex::Complex64;

/// One complex number per actuator.
pub type Phasors = [Complex64; MAX_ACTUATORS];
/// One complex number per pair of actuators, row by row; of travels per force the row is the actuator whose travel it is, the column that
/// with the force.
pub type PerPair = [Phasors; MAX_ACTUATORS];
