//! From a touch to drives: which actuator vibrates at which frequency, how strong.
//!
//! [`table`] holds what does not depend on the touch (response of every actuator at every frequency of a grid, energy
//! over the surface, force limits), [`limits`] the electrostatics behind the force limits, [`allocate`] the small convex
//! problem of how strong each actuator has to be, [`search`] the choice of frequencies, [`plan`] the result,
//! [`perception`] what a fingertip feels of it, [`rise`] how soon.
//!
//! The facts behind the search: at distinct frequencies peaks add (thesis, equation 23) and mean squares add, so that the
//! least energy elsewhere for a requested peak at the target separates by actuator. Frequencies of different actuators
//! stay [`MIN_SPACING_HZ`] apart, as slower beats are felt as a flutter.

pub mod allocate;
mod bound;
pub mod limits;
pub mod perception;
pub mod phased;
pub mod plan;
pub mod rise;
pub mod search;
pub mod softening;
pub mod table;

pub use plan::{Drive, Plan, PlanError, Predicted, Target, TargetResult};
pub use table::{PlanTable, TableOptions};

/// Standard gravity in m/s^2: intensities are given in g, as is usual in haptics.
pub const STANDARD_GRAVITY: f64 = 9.80665;
/// Least distance between the frequencies of two actuators in Hz.
pub const MIN_SPACING_HZ: f64 = 20.0;
/// Peak asked for when a request names none, in g: about 25 dB above the threshold of feeling at 50..200 Hz, clear but
/// not harsh.
pub const DEFAULT_INTENSITY_G: f64 = 0.5;
/// Radius around a target within which acceleration counts as "at the target" for the contrast, in m.
pub const TARGET_RADIUS_M: f64 = 0.010;
/// Part of its half period for which an electrode is on. At 2/3 the force has no third harmonic (sin(3 pi/2 * 2/3) = 0),
/// and its fundamental is still 0.87 of the most there is.
pub const PULSE_WIDTH: f64 = 2.0 / 3.0;
