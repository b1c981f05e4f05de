//! How strong a panel can be shaken: everywhere at once, and at every point.
//!
//! [`space`] is what each actuator can do at each frequency, shared limits included, [`search`] the
//! objective `reach`: the frequencies and forces whose weakest place is the strongest, proven by branch and cut over
//! small linear programs. [`maps`] is the same for every point by itself. [`shared`] is what one frequency for all
//! actuators can do, and [`schemes`] compares: the thesis' removal of dead zones in numbers. [`setting`] makes safe what any of
//! them would command, as of every plan; [`rigid`] tells how much of it leaves the panel unbent.

pub mod maps;
pub mod measure;
pub mod part;
pub mod rigid;
pub mod schemes;
pub mod search;
pub mod setting;
pub mod shared;
pub mod space;
pub mod spread;

#[cfg(test)]
mod tests;

pub use maps::Maps;
pub use measure::{Measure, Region};
pub use part::Part;
pub use schemes::{Scheme, SchemeReach};
pub use search::Best;
pub use space::{Choice, Space};
pub use spread::Spread;
