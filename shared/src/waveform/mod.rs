//! From SI units to timer registers, and back from registers to electrode edges.
//!
//! One advanced timer drives both electrodes of an ERA, counting up and down between 0 and ARR (RM0440, section 28.3.4,
//! "center-aligned mode"), so that a period has 2 ARR ticks. Electrode A is on around the counter's zero, electrode B
//! around its top:
//!
//! ```text
//! counter  ARR          /\                /\
//!          compare_b --/--\--------------/--\--
//!          compare_a -/----\------------/----\-
//!            0    \  /      \          /      \
//! A       ######__            ______##########
//! B             ____##########____
//! ```
//!
//! While `compare_a <= compare_b` one counter cannot be in both windows: that the two are never on together is a
//! property of the counting, not of timing. The guard time is `compare_b - compare_a` ticks on both sides.
//!
//! A half turn of phase exchanges the two electrodes (`swapped`), the rest is the counter's start value: the force
//! F ~ V_A^2 - V_B^2 changes sign when A and B change places.

mod edges;
mod program;
mod registers;

pub use edges::{Electrode, Window, Windows, WindowsError};
pub use program::{ChannelProgram, DriveError, TimerProgram, program};
pub use registers::TimerRegisters;
