//! How strong a panel can be shaken: everywhere at once, and at every point.
//!
//! [`space`] is what each actuator can do at each frequency, shared limits included, [`search`] the
//! objective `reach`: the frequencies and forces whose weakest place is the strongest, proven by branch and cut over
//! small linear programs ([`simplex`]). [`maps`] is the same for every point by itself. [`shared`] is what one frequency for
//! all actuators can do, and [`schemes`] compares: the thesis' removal of dead zones in numbers.

pub mod maps;
pub mod schemes;
pub mod search;
pub mod shared;
pub mod simplex;
pub mod space;
pub mod spread;

#[cfg(test)]
mod tests;

pub use maps::Maps;
pub use schemes::{Scheme, SchemeReach};
pub use search::{Best, Options};
pub use space::{Choice, Space};
pub use spread::Spread;
