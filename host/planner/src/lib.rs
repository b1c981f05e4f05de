//! From a touch to drives: which actuator vibrates at which frequency, how strong.
//!
//! Rooms, in the order in which they use each other: `physics` is what electrodes and masses do ([`limits`], [`softening`] in closing
//! gaps, [`rise`]); [`table`] what does not depend on the touch (response of every actuator at every frequency of a grid, energy over
//! the surface, force limits); [`request`] what is asked for; `choose` frequencies ([`search`]) and forces
//! ([`allocate`]); `motion` masses under a plan's drives; [`reach`] one setting for a whole surface; [`plan`] the result; `reports` what
//! is said of it ([`explain`], [`trade`]). Beside them [`perception`], what a fingertip feels of it, and [`cache`], tables kept on disk.
//! [`effects`] and [`maps`] build on all of that.
//!
//! The facts behind the search: at distinct frequencies peaks add (thesis, equation 23) and mean squares add, so that the
//! least energy elsewhere for a requested peak at the target separates by actuator. Frequencies of different actuators
//! stay [`MIN_SPACING_HZ`] apart, as slower beats are felt as a flutter.
//!
//! From a touch to a plan:
//!
//! ```
//! use era_model::model::{Accuracy, levels::ReducedLevels};
//! use era_model::scene::{EXAMPLE_PLATE, Scene};
//! use era_planner::{PlanTable, TableOptions, Target};
//!
//! # fn main() -> Result<(), Box<dyn std::error::Error>> {
//! let scene = Scene::parse("plate.toml", EXAMPLE_PLATE)?;
//! let grid = TableOptions::default();
//! let levels = ReducedLevels::build(&scene, Accuracy::BALANCED, grid.to_hz)?;
//! let table = PlanTable::from_levels(&scene, levels, grid)?;
//! let plan = table.plan(&[Target { x_m: 0.1, y_m: 0.05, intensity_g: Some(0.3) }])?;
//! for drive in &plan.drives {
//!     println!("{}: {:.1} Hz, {:.0} V", drive.actuator, drive.frequency_hz, drive.voltage_v);
//! }
//! assert!(plan.limited_by.is_none() && plan.predicted.target_peak_g >= 0.3 * (1.0 - 1e-6));
//! # Ok(())
//! # }
//! ```

pub mod cache;
mod choose;
pub mod chosen_drive;
pub mod click;
pub mod drive;
pub mod effects;
pub mod maps;
mod millimetres;
mod motion;
pub mod perception;
mod physics;
pub mod plan;
pub mod quick;
pub mod reach;
mod reports;
pub mod request;
pub mod table;

pub use choose::{allocate, assignment, candidates, search, shared_frequency};
use era_model::{model, response, scene, stop, transient};
pub use motion::{plan_motion, residual};
pub use physics::{Phasors, charging, limits, rise, softening};
pub use plan::limitation;
pub use reports::{explain, press_bounds, press_report, report, schedule, trade};
pub use table::press;

pub use drive::Drive;
pub use plan::{Plan, Planned, Predicted, TargetResult};
pub use reports::press_report::{PressReport, PressedActuator};
pub use reports::report::{FirstTargetReport, Times};
pub use request::quiet_zones::QuietResult;
pub use request::{Grouping, Objective, PlanError, QuietZone, Request, SearchEffort, Target, Weigh};
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
/// Part of its half period for which an electrode is on. At 2/3 the force of electrodes that charge at once has no third harmonic
/// (sin(3 pi/2 * 2/3) = 0),
/// and its fundamental is still 0.87 of the most there is.
pub const PULSE_WIDTH: f64 = 2.0 / 3.0;
/// Highest frequency in Hz that is felt as vibration: odd harmonics count up to it.
pub const HIGHEST_FELT_HZ: f64 = 1000.0;
/// Most quiet zones of a request.
pub const MAX_QUIET_ZONES: usize = 8;
/// Part of each actuator's mean square by which the products of all are made definite: two that act alike would otherwise have
/// a difference that costs nothing.
const MOST_CONDITION: f64 = 1e-9;
