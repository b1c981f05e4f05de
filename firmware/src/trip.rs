//! Why everything was switched off without asking the device: noted by interrupts, handed over once.

use core::sync::atomic::{AtomicU32, Ordering};
use era_shared::protocol::FaultCode;
use era_shared::supply::Finding;

/// Why everything was switched off: 0 for no reason, else the code's number plus 1, and the detail in the upper half.
static TRIP: AtomicU32 = AtomicU32::new(0);

/// Notes a reason, unless there is one already: the first says most.
pub fn note(code: FaultCode, detail: u32) {
    let packed = (u32::from(code.number()) + 1) | (detail << 16);
    // The other outcome is the one that is wanted too.
    let _ = TRIP.compare_exchange(0, packed, Ordering::AcqRel, Ordering::Acquire);
}

/// Whether a reason waits to be taken.
#[must_use]
pub fn waits() -> Option<FaultCode> {
    unpack(TRIP.load(Ordering::Acquire)).map(|(code, _)| code)
}

/// Hands over why everything was switched off, once.
pub fn take() -> Option<Finding> {
    unpack(TRIP.swap(0, Ordering::AcqRel))
}

fn unpack(packed: u32) -> Option<Finding> {
    let number = (packed & 0xFFFF).checked_sub(1)?;
    let code = FaultCode::ALL.into_iter().find(|code| u32::from(code.number()) == number)?;
    Some((code, packed >> 16))
}
