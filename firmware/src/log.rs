//! The firmware's log: defmt frames in a ring in RAM, which the host drains over the link (`Request::Log`) or a debug
//! probe reads through RTT, whoever comes first.
//!
//! Unlike the usual RTT logger this one never waits for a reader, not even if a probe has asked for that and then gone
//! away: a log line must not hold up what switches high voltage off.

use core::cell::UnsafeCell;
use core::sync::atomic::{AtomicU8, AtomicU32, Ordering::Relaxed};
use critical_section::RestoreState;
use defmt::Encoder;
use era_shared::log_ring::LogRing;

/// Bytes of log kept: some 100 lines of the usual 15 to 20 bytes.
const SIZE: usize = 2048;

/// Longest frame; the text of a panic (120 bytes) and its surroundings fit.
const FRAME: usize = 256;

/// SEGGER's control block for one up-channel, as a probe searches for it (by its symbol, or by its first 16 bytes).
#[repr(C)]
struct ControlBlock {
    id: [u8; 16],
    up_channels: u32,
    down_channels: u32,
    name: *const u8,
    buffer: *const AtomicU8,
    size: u32,
    write: AtomicU32,
    read: AtomicU32,
    flags: AtomicU32,
}

// SAFETY: the pointers are for the probe only and point to statics; the rest is atomic.
unsafe impl Sync for ControlBlock {}

static NAME: [u8; 6] = *b"defmt\0";
static BUFFER: [AtomicU8; SIZE] = [const { AtomicU8::new(0) }; SIZE];

// SAFETY of the name: a probe looks for it, and nothing else in the image has it.
#[unsafe(no_mangle)]
static _SEGGER_RTT: ControlBlock = ControlBlock {
    id: *b"SEGGER RTT\0\0\0\0\0\0",
    up_channels: 1,
    down_channels: 0,
    name: NAME.as_ptr(),
    buffer: BUFFER.as_ptr(),
    size: SIZE as u32,
    write: AtomicU32::new(0),
    read: AtomicU32::new(0),
    // The writer does not wait; what a probe writes here is not looked at.
    flags: AtomicU32::new(0),
};

/// Frames lost since the last look.
static LOST: AtomicU32 = AtomicU32::new(0);

fn log_ring() -> LogRing<'static> {
    LogRing { bytes: &BUFFER, read: &_SEGGER_RTT.read, write: &_SEGGER_RTT.write }
}

/// Takes log bytes, oldest first, and says in the log how many frames were lost for lack of a reader.
pub fn take_log_bytes(buffer: &mut [u8]) -> usize {
    let count = critical_section::with(|_| log_ring().take_bytes(buffer));
    let lost = critical_section::with(|_| {
        let lost = LOST.load(Relaxed);
        LOST.store(0, Relaxed);
        lost
    });
    if lost > 0 {
        defmt::warn!("{=u32} older log lines were lost, because no program read the log in time", lost);
    }
    count
}

/// A frame in the making.
struct FrameDraft {
    encoder: Encoder,
    bytes: [u8; FRAME],
    length: usize,
    too_long: bool,
    restore: RestoreState,
}

impl FrameDraft {
    /// Lets `encode` add bytes to the frame.
    fn append_encoded(&mut self, encode: impl FnOnce(&mut Encoder, &mut dyn FnMut(&[u8]))) {
        let Self { encoder, bytes, length, too_long, .. } = self;
        encode(encoder, &mut |piece| {
            let end = *length + piece.len();
            match bytes.get_mut(*length..end) {
                Some(place) => {
                    place.copy_from_slice(piece);
                    *length = end;
                }
                None => *too_long = true,
            }
        });
    }
}

struct DraftCell(UnsafeCell<FrameDraft>);

// SAFETY: used only within the critical section that `acquire` begins and `release` ends.
unsafe impl Sync for DraftCell {}

static DRAFT: DraftCell = DraftCell(UnsafeCell::new(FrameDraft {
    encoder: Encoder::new(),
    bytes: [0; FRAME],
    length: 0,
    too_long: false,
    restore: RestoreState::invalid(),
}));

#[defmt::global_logger]
struct Logger;

// SAFETY: between `acquire` and `release` interrupts are masked, so that nothing else writes. What comes in between
// nevertheless is a fault handler that does not return; it throws the half frame away and writes its own.
unsafe impl defmt::Logger for Logger {
    fn acquire() {
        // SAFETY: released in `release`, which defmt calls in pair with this.
        let restore = unsafe { critical_section::acquire() };
        // SAFETY: within the critical section.
        let draft = unsafe { &mut *DRAFT.0.get() };
        draft.restore = restore;
        draft.encoder = Encoder::new();
        draft.length = 0;
        draft.too_long = false;
        draft.append_encoded(|encoder, put| encoder.start_frame(put));
    }

    // Nothing to flush: `release` writes the frame.
    unsafe fn flush() {}

    unsafe fn release() {
        // SAFETY: within the critical section that `acquire` began.
        let draft = unsafe { &mut *DRAFT.0.get() };
        draft.append_encoded(|encoder, put| encoder.end_frame(put));
        let lost = match draft.bytes.get(..draft.length) {
            Some(frame) if !draft.too_long => log_ring().push_frame_dropping_oldest_and_count_lost_by_it(frame),
            _ => 1,
        };
        LOST.store(LOST.load(Relaxed).saturating_add(lost), Relaxed);
        let restore = draft.restore;
        // SAFETY: in pair with `acquire`.
        unsafe { critical_section::release(restore) };
    }

    unsafe fn write(bytes: &[u8]) {
        // SAFETY: within the critical section that `acquire` began.
        let draft = unsafe { &mut *DRAFT.0.get() };
        draft.append_encoded(|encoder, put| encoder.write(bytes, put));
    }
}
