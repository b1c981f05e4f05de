//! How strong a panel can be shaken everywhere at once: the objective `reach`.
//!
//! [`space`] is what each actuator can do at each frequency, shared limits included, [`search`] the frequencies and forces whose
//! weakest place is the strongest, of some points, [`mod@everywhere`] of the whole surface; [`setting`] makes safe what any of them would
//! command, as of every plan, and `evened` makes it a plan.

mod evened;
pub mod everywhere;
pub mod measure;
pub mod search;
pub mod setting;
pub mod space;

#[cfg(test)]
mod tests;

pub use everywhere::everywhere;
pub use measure::Measure;
pub use search::Best;
pub use space::{Choice, Space};
