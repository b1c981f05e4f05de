//! Entering the ROM bootloader on the host's request.
//!
//! The bootloader expects the chip as a reset leaves it (AN2606, section 4), so the request is noted in memory that
//! the start-up code does not touch, the chip is reset, and the note is obeyed before anything is set up.

use crate::outputs;
use core::cell::UnsafeCell;
use core::mem::MaybeUninit;
use cortex_m::peripheral::SCB;
use embassy_stm32::pac::{RCC, SYSCFG};
use embassy_sync::blocking_mutex::raw::CriticalSectionRawMutex;
use embassy_sync::signal::Signal;
use embassy_time::Timer;

/// The note. Its complement is stored too, as memory holds anything at all after power-on.
const ASKED: u32 = 0x4446_5521;

/// Value of MEM_MODE that puts the bootloader's memory at address 0 (RM0440, section 10.2.1).
const SYSTEM_FLASH: u8 = 1;

/// Address of the bootloader's vector table (RM0440, section 2.2; AN2606, section 4.1).
const BOOTLOADER: *const u32 = 0x1FFF_0000 as *const u32;

struct NoteCell(UnsafeCell<MaybeUninit<[u32; 2]>>);

// SAFETY: written only with interrupts masked on the way to a reset, read only at the start before anything else runs.
unsafe impl Sync for NoteCell {}

#[unsafe(link_section = ".kept.bootloader_note")]
static NOTE: NoteCell = NoteCell(UnsafeCell::new(MaybeUninit::uninit()));

/// Between the request and the reset, in ms: the answer goes out meanwhile. At 115 200 baud the short frame takes 2 ms,
/// and a host takes a USB packet within a few.
const ANSWER_MS: u64 = 50;

static REQUEST: Signal<CriticalSectionRawMutex, ()> = Signal::new();

/// Requests the restart into the bootloader; returns at once, so that the host's request can still be answered.
pub fn ask_task_to_reset_into_bootloader() {
    REQUEST.signal(());
}

/// Waits for [`ask_task_to_reset_into_bootloader`], then leaves the note and resets the chip.
#[embassy_executor::task]
pub async fn await_request_and_reset() {
    REQUEST.wait().await;
    Timer::after_millis(ANSWER_MS).await;
    cortex_m::interrupt::disable();
    // They are off already, as the request is refused otherwise; nothing depends on it.
    outputs::force_outputs_off_withdraw_permit_and_stop_timers();
    // SAFETY: nothing else runs, and nothing returns from here.
    unsafe { NOTE.0.get().cast::<[u32; 2]>().write_volatile([ASKED, !ASKED]) };
    SCB::sys_reset()
}

/// Jumps to the bootloader if the last run left the note. To be called once, before anything else.
pub fn enter_bootloader_if_requested() {
    let place = NOTE.0.get().cast::<[u32; 2]>();
    // SAFETY: every bit pattern is valid, and nothing else runs yet.
    let note = unsafe { place.read_volatile() };
    if note != [ASKED, !ASKED] {
        return;
    }
    // SAFETY: as above. Forgotten first: whatever happens next, the reset after it starts the firmware.
    unsafe { place.write_volatile([0; 2]) };
    RCC.apb2enr().modify(|w| w.set_syscfgen(true));
    // Read back, as the clock needs two cycles (RM0440, section 7.2.17).
    let _ = RCC.apb2enr().read();
    // The bootloader's own vectors at address 0, as after a start with BOOT0 high.
    SYSCFG.memrmp().modify(|w| w.set_mem_mode(SYSTEM_FLASH));
    // SAFETY: no interrupt is enabled, and the bootloader's vectors are what address 0 now holds; the stack pointer and
    // the entry that `bootload` takes from its table are those that a reset with BOOT0 high would take.
    unsafe {
        (*SCB::PTR).vtor.write(0);
        cortex_m::asm::dsb();
        cortex_m::asm::isb();
        cortex_m::asm::bootload(BOOTLOADER)
    }
}
