//! What the firmware is compiled for.

/// Cortex-M4 with single-precision floating point.
pub const TARGET: &str = "thumbv7em-none-eabihf";
