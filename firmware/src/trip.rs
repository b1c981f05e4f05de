//! Why everything was switched off without asking the device: noted by interrupts, handed over once.

use core::sync::atomic::{AtomicU32, Ordering};
use era_shared::protocol::FaultCode;
use era_shared::supply::FaultFinding;

/// Why everything was switched off: 0 for no reason, else the code's number plus 1, and the detail in the upper half.
static TRIP: AtomicU32 = AtomicU32::new(0);

/// Notes why everything was switched off, unless a reason is noted already: the first one says most.
pub fn note_trip_unless_one_is_noted(code: FaultCode, detail: u32) {
    let packed = (u32::from(code.number()) + 1) | (detail << 16);
    // The other outcome is the one that is wanted too.
    let _ = TRIP.compare_exchange(0, packed, Ordering::AcqRel, Ordering::Acquire);
}

/// The noted reason's fault, which stays noted.
#[must_use]
pub fn peek_trip_code() -> Option<FaultCode> {
    unpack_trip(TRIP.load(Ordering::Acquire)).map(|(code, _)| code)
}

/// Takes the noted reason: each is handed over once.
pub fn take_trip() -> Option<FaultFinding> {
    unpack_trip(TRIP.swap(0, Ordering::AcqRel))
}

fn unpack_trip(packed: u32) -> Option<FaultFinding> {
    let number = (packed & 0xFFFF).checked_sub(1)?;
    let code = FaultCode::ALL.into_iter().find(|code| u32::from(code.number()) == number)?;
    Some((code, packed >> 16))
}
