//! Which points of the unit cube are looked at.

mod adaptation;
mod evolution;
mod samples;

pub use evolution::Evolution;
pub use samples::{MOST_SOBOL, Samples, designs_of, latin_hypercube};
