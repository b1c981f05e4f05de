//! What is fuzzed, as plain functions from bytes to a panic or none, so that any engine, and any test, can run them.
//!
//! `fuzz_targets` puts libFuzzer over them; `cargo xtask fuzz` builds and runs that on the project's own toolchain.
//! `corpus` holds the seeds, which are those of [`seeds`] and whatever inputs ever found something.

pub mod board;
pub mod decoder;
pub mod handle_frame;
pub mod seeds;
pub mod step;
