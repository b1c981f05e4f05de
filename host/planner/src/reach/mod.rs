//! How strong a panel can be shaken everywhere at once: the objective `reach`.
//!
//! [`space`] is what each actuator can do at each frequency, shared limits included, [`search`] the frequencies and forces whose
//! weakest place is the strongest, of some points, [`max_min`] of the whole surface; [`setting`] makes safe what any of them would
//! command, as of every plan, and `selection` makes it a plan.

pub mod max_min;
pub mod measure;
pub mod search;
pub(crate) mod selection;
pub mod setting;
pub mod space;

#[cfg(test)]
mod tests;

pub use max_min::{
    compute_and_cache_max_min_setting_of_whole_surface, max_min_setting_and_relative_gap_if_spacing_can_be_kept,
};
pub use measure::Measure;
pub use search::MaxMinCombination;
pub use space::{ReachCandidate, ReachSpace};
