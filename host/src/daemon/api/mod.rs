//! What every request and every answer has in common: problems, objects read from JSON, queries, whole numbers in
//! JSON, helpers for schemas.
//!
//! Uses no other folder of the daemon.

pub mod json;
pub mod kinds;
pub mod problem;
pub mod query;
pub mod schema;
