//! Which points of the unit cube are looked at.

mod adaptation;
mod evolution;
mod samples;

pub use evolution::Evolution;
pub use samples::{KnownPoints, MOST_SOBOL, count_designs_of_method};
