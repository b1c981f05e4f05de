//! What is asked for: targets and what is around them, quiet zones.

pub(crate) mod around;
pub mod quiet;
pub mod request;
pub(crate) mod zone;
