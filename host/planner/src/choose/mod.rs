//! Which frequencies, and how much force: bounds, search, proof, refinement between the grid's frequencies.

pub mod allocate;
pub mod assignment;
pub mod candidates;
pub(crate) mod linear;
pub(crate) mod refine;
pub mod search;
pub mod shared_frequency;
