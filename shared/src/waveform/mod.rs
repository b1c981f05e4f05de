//! From SI units to timer registers, from registers to electrode edges, and from one drive to the next without a runt.
//!
//! One timer drives both electrodes of an ERA. It counts up from 0 to ARR and begins anew; a period has ARR + 1 ticks.
//! Each electrode is on while the counter is in a window of its own, which two compare values bound (RM0440, section
//! 28.3.13, "combined PWM mode"): electrode A in the middle of the first half period, electrode B in the middle of the
//! second:
//!
//! ```text
//! counter            ______        ______        ______        ______
//!           0 ______/      \______/      \______/      \______/       period  0
//!             guard    A     guard   B     guard    A    guard   B   guard
//!             ^ boundary                  ^ boundary                 ^ boundary
//! ```
//!
//! While the windows are disjoint no value of the counter is in both, so that the electrodes are never on together is a
//! property of the counting, not of timing. The registers are preloaded and change together at the period's boundary,
//! which lies in the middle of a guard: no window is ever cut short, and a guard that spans a change is the mean of two
//! that are long enough.
//!
//! [`compute_channel_program()`] turns a drive into numbers for the timer, [`Sequencer`] brings running timers from one drive to the next
//! at their boundaries, in phase where frequencies are equal, or through windows that are given one by one ([`SequenceWindow`]), [`Envelope`] shapes the force in time, [`ElectrodeWindows`] reads
//! registers as edges.

mod drive_error;
mod edges;
mod envelope;
mod model;
mod period;
mod program;
mod registers;
mod sequencer;
pub(crate) mod sine;
mod window_sequence;

pub use drive_error::DriveError;
pub use edges::{Electrode, ElectrodeWindows, TickWindow, WindowsError};
pub use envelope::{Effect, Envelope, FULL_LEVEL, FULL_STRENGTH, SEGMENTS, Segment};
pub use model::{ModelError, ModelTimers, Pulse, PulseCheck, TimerModel};
pub use period::{CompareWindow, IDLE, TimerPeriod};
pub use program::{ChannelProgram, compute_channel_program};
pub use registers::{OutputPair, TimerRegisters};
pub use sequencer::{ChannelGoal, ElectrodeCharges, Sequencer, TimerPreload};
pub use window_sequence::{
    LEAST_WIDTH_TICKS, MAX_WINDOWS, MOST_WAIT_TICKS, PlacedWindows, SEQUENCE_TICK_CLOCKS, SequenceError, SequenceWindow,
};
