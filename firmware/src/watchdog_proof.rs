//! The proof that the watchdog resets the chip.
//!
//! Otherwise nothing would ever try it: a watchdog that does not work is noticed when it is needed. So the first run after power-on starts it
//! with its shortest time and waits. The reset must come; the run after it goes on, and says that power-on was the cause of the start. A note
//! in memory that the start-up code does not touch tells this reset from others. All outputs are low meanwhile.

use core::cell::UnsafeCell;
use core::mem::MaybeUninit;
use embassy_stm32::pac::IWDG;
use embassy_stm32::pac::iwdg::vals::{Key, Pr};
use era_shared::protocol::ResetCause;

/// The reset by the watchdog is expected; the lowest digit is the place in [`CAUSES`] of what started the run that expects it.
const EXPECTED: u32 = 0x4552_5750;
/// The watchdog has reset the chip since the power was switched on.
const PROVEN: u32 = 0x4552_5760;

/// What a run that tries the watchdog may have been started by.
const CAUSES: [ResetCause; 4] = [ResetCause::PowerOn, ResetCause::Pin, ResetCause::Software, ResetCause::Other];

/// Detail of a fault of the watchdog: it did not reset the chip when it was tried, or does not take its settings; beyond the bits of all tasks.
pub const DETAIL_UNPROVEN: u32 = 1_000;

struct NoteCell(UnsafeCell<MaybeUninit<[u32; 2]>>);

// SAFETY: accessed at boot only, before any task or interrupt.
unsafe impl Sync for NoteCell {}

/// The note and its complement: memory holds anything at all after power-on.
#[unsafe(link_section = ".kept.watchdog_proof")]
static NOTE: NoteCell = NoteCell(UnsafeCell::new(MaybeUninit::uninit()));

/// Reads of the status register before giving up, as in `watchdog.rs`; the clock is 16 MHz here, so that this is 12 ms.
const UPDATE_READS: usize = 20_000;
/// The longest wait for the reset, in clocks of 16 MHz: 10 ms. The oscillator starts within 0.13 ms (DS12288), and the shortest time is 4 of its
/// periods, which are 0.14 ms at 29.5 kHz; ten times as long as both together is a watchdog that does not work.
const WAIT_CLOCKS: u32 = 160_000;

/// Tries the watchdog if it has not been seen to work since power-on. The return value is what started the chip, not counting a reset by this
/// test, and whether the watchdog works. To be called once, at boot, with all outputs low.
pub fn prove_watchdog_and_tell_original_cause_and_success(reset_cause: ResetCause) -> (ResetCause, bool) {
    let note = read_note_or_zero();
    if reset_cause == ResetCause::Watchdog {
        // Any reset by the watchdog is a proof.
        write_note(PROVEN);
        let expected = note.checked_sub(EXPECTED).and_then(|place| CAUSES.get(place as usize));
        return (expected.copied().unwrap_or(reset_cause), true);
    }
    if note == PROVEN && reset_cause != ResetCause::PowerOn {
        return (reset_cause, true);
    }
    let place = CAUSES.iter().position(|cause| *cause == reset_cause).unwrap_or(CAUSES.len() - 1);
    write_note(EXPECTED + place as u32);
    start_watchdog_and_await_its_reset();
    write_note(0);
    (reset_cause, false)
}

/// Starts the watchdog with its shortest time and waits; returns only if the watchdog does not work.
fn start_watchdog_and_await_its_reset() {
    IWDG.kr().write(|w| w.set_key(Key::START));
    IWDG.kr().write(|w| w.set_key(Key::ENABLE));
    IWDG.pr().write(|w| w.set_pr(Pr::DIVIDE_BY4));
    IWDG.rlr().write(|w| w.set_rl(0));
    let _ = (0..UPDATE_READS).any(|_| IWDG.sr().read().0 == 0);
    // Loads the shortest time.
    IWDG.kr().write(|w| w.set_key(Key::RESET));
    cortex_m::asm::delay(WAIT_CLOCKS);
}

fn read_note_or_zero() -> u32 {
    // SAFETY: every bit pattern is valid, and nothing else accesses the memory at boot.
    let [note, complement] = unsafe { NOTE.0.get().cast::<[u32; 2]>().read_volatile() };
    if note == !complement { note } else { 0 }
}

fn write_note(note: u32) {
    // SAFETY: as above.
    unsafe { NOTE.0.get().cast::<[u32; 2]>().write_volatile([note, !note]) };
}
