//! What the next start must know of this run: whether high voltage may be on, whether rails are measured wrongly, and the channels' credit.
//!
//! It is in memory that the start-up code does not touch. A reset from outside while the board is live is a fault, and no reset gives a
//! channel new credit, as long as memory has kept it.

use crate::pins::CHANNELS;
use core::cell::UnsafeCell;
use core::mem::MaybeUninit;
use era_shared::board::KeptRun;

/// Marks a record that was written by this code.
const MAGIC: u32 = 0x4552_4152;

#[derive(Clone, Copy)]
#[repr(C)]
struct RunRecord {
    magic: u32,
    is_live: u32,
    is_measurement_distrusted: u32,
    credit_ms: [u32; CHANNELS],
    /// Bitwise complement of the sum of the words above.
    check: u32,
}

impl RunRecord {
    fn compute_checksum(&self) -> u32 {
        let words = [self.magic, self.is_live, self.is_measurement_distrusted].into_iter().chain(self.credit_ms);
        !words.fold(0_u32, |sum, word| sum.rotate_left(5).wrapping_add(word))
    }
}

/// Two copies: a reset while one is written leaves the other.
struct RecordCell(UnsafeCell<MaybeUninit<[RunRecord; 2]>>);

// SAFETY: written by the device task alone, read at boot before it starts.
unsafe impl Sync for RecordCell {}

#[unsafe(link_section = ".kept.run_record")]
static RECORDS: RecordCell = RecordCell(UnsafeCell::new(MaybeUninit::uninit()));

fn pointers_to_record_copies() -> [*mut RunRecord; 2] {
    let first = RECORDS.0.get().cast::<RunRecord>();
    [first, first.wrapping_add(1)]
}

/// Writes the record.
pub fn keep_run_record(run: KeptRun) {
    let mut record = RunRecord {
        magic: MAGIC,
        is_live: u32::from(run.is_live),
        is_measurement_distrusted: u32::from(run.is_measurement_distrusted),
        credit_ms: run.credit_ms,
        check: 0,
    };
    record.check = record.compute_checksum();
    for place in pointers_to_record_copies() {
        // SAFETY: within the memory above; only the device task writes it, and nobody reads it meanwhile.
        unsafe { place.write_volatile(record) };
    }
}

/// What the previous run left; `None` if memory has not kept it. Where the copies differ, the one that says live, or distrusts, counts. To be called once, at
/// boot.
pub fn read_run_record_of_previous_run() -> Option<KeptRun> {
    let records = pointers_to_record_copies().map(|place| {
        // SAFETY: within the memory above; every bit pattern is a valid record, and nothing else accesses the memory at boot.
        let record = unsafe { place.read_volatile() };
        (record.magic == MAGIC && record.check == record.compute_checksum()).then_some(KeptRun {
            is_live: record.is_live != 0,
            is_measurement_distrusted: record.is_measurement_distrusted != 0,
            credit_ms: record.credit_ms,
        })
    });
    KeptRun::choose_copy_preferring_live_then_distrusted(records)
}
