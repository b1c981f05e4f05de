//! The worst-case stack of an image, from the code that would be flashed: frames along the longest chain of calls, for
//! thread mode and, on top of it, for one handler of every interrupt priority, a panic, and a HardFault during that.
//!
//! It is an upper bound under these assumptions:
//! - A function's frame is the sum of all that it pushes and reserves, whichever way it is gone through.
//! - A call through a pointer may reach every function whose address is stored or computed anywhere, with two limits:
//!   tasks are only called by the executors (named in the budget), and formatting code only calls formatting code.
//! - Functions that may call one another in a circle do so as often as the budget says, which is as deep as formatting
//!   nests.
//! - A panic does not panic again: its handler writes the outputs off before it formats anything.
//! - Interrupts nest once per priority (the budget names those that are not 0; the emulated board is asked whether that
//!   is true), and every exception saves the floating-point registers too.
//!
//! Why a decoder of our own: the budget holds the worst case, and no run shows that. Of the image of 2026-11-27 the bound is
//! 23 068 bytes of the 32 768 allowed, 63 % of it for handlers of four priorities on top of each other, a panic and a HardFault. A session
//! that does everything uses 8 800 bytes of a painted stack on the emulated board ([`check_interrupt_priorities_and_measure_most_stack_bytes_in_use`]), because it never meets these together: the
//! painted stack checks the bound from below, and cannot replace it. `flip-link` gives no figure: it puts the stack below the
//! variables, so that an overflow faults and overwrites nothing. That would guard what the budget should never let happen. It was not
//! taken: the stack begins at the end of the RAM, 113 KiB above the variables, so that it reaches them only if the bound is wrong by a factor of
//! five; and flip-link would move the variables, among them the record that a reset keeps.

mod chain;
mod program;
mod seen;
mod thumb;

pub use chain::{Rules, find_deepest_call_chain_of_each_nesting_level};
pub use program::Program;
pub use seen::check_interrupt_priorities_and_measure_most_stack_bytes_in_use;

/// Why an image's stack cannot be bounded.
#[derive(Debug, thiserror::Error)]
pub enum StackError {
    /// It is no executable that this program reads.
    #[error("not a 32-bit ARM executable: {0}")]
    Malformed(#[from] object::read::Error),
    /// Code that changes the stack pointer in an unforeseen way.
    #[error(
        "at {address:#010x} in {function}: the effect of this instruction on the stack pointer, or the target of its \
         jump, is not known"
    )]
    Unclear {
        /// Names of the function.
        function: String,
        /// Of the instruction.
        address: u32,
    },
    /// The budget names a function that the image does not have.
    #[error("the image has no function named {0}, but firmware/budget.toml needs this function")]
    NoFunction(String),
    /// An interrupt has another priority than the one that was counted with.
    #[error(
        "interrupt {number} ({handler}) has priority {found} on the emulated board, but {budget} in \
         firmware/budget.toml"
    )]
    Priority {
        /// Names of its handler.
        handler: String,
        /// Of the interrupt.
        number: usize,
        /// On the board.
        found: u32,
        /// In the budget.
        budget: u8,
    },
    /// What the session with the emulated board leaves out.
    #[error("the session on the emulated board never sends {0}: add this request in tools/xtask/src/stack/seen.rs")]
    NotAsked(String),
    /// The emulated board could not be asked.
    #[error("the emulated board: {0}")]
    Board(String),
    /// More was in use than can be, so the analysis is wrong.
    #[error("{seen} bytes were in use on the emulated board, more than the computed bound of {bound} bytes")]
    BeyondBound {
        /// Bytes in use.
        seen: u32,
        /// Bytes that the analysis says.
        bound: u32,
    },
}
