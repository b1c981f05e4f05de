//! What keeps the daemon from the board, and what to do about it.
//!
//! [`facts`] is what can be known; [`machine`], [`board`] and [`daemon`] find it out; [`mod@judge`] says what it means, as
//! [`finding`]s, without looking at anything itself. [`reach`] reads why a daemon's address gives no answer. Nothing is driven or armed, and nothing is written to a port that is
//! neither the board's by its USB identity nor named by the user.

pub mod board;
pub mod daemon;
pub mod facts;
pub mod finding;
pub mod judge;
mod judge_board;
pub mod machine;
pub mod reach;

pub use facts::Facts;
pub use finding::{Finding, Verdict};
pub use judge::judge_facts;
