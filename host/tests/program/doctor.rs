//! The doctor: every trouble is planted and has to be found, and what is well is not complained of.

mod asked;
mod judged;
mod machine;
