//! What happens when the firmware itself fails: outputs off before anything else, then a note for the next start, then
//! a reset. Nothing here relies on the state of what has failed.
//!
//! Where not even these run (the stack is gone, the core locks up), the lock-up signal breaks the timers in hardware and
//! the watchdog resets the chip.

use crate::outputs::force_outputs_off_withdraw_permit_and_stop_timers;
use core::cell::UnsafeCell;
use core::fmt::{self, Write};
use core::mem::MaybeUninit;
use core::panic::PanicInfo;
use cortex_m::peripheral::SCB;
use cortex_m_rt::{ExceptionFrame, exception};
use embassy_stm32::pac::FLASH;
use era_shared::protocol::{FAILURE_MESSAGE, FaultCode};
use heapless::String;

/// Marks a note as written by this code and not left over from power-on.
const MAGIC: u32 = 0x4552_4146;

/// [`FailureNote::kind`] of a panic; everything else counts as a HardFault.
const PANIC: u32 = 0;
const EXCEPTION: u32 = 1;

/// A note that survives a reset, in memory that the start-up code does not touch.
#[derive(Clone, Copy)]
#[repr(C)]
struct FailureNote {
    magic: u32,
    kind: u32,
    detail: u32,
    length: u32,
    message: [u8; FAILURE_MESSAGE],
    /// Bitwise complement of the sum of the words above, as memory decays slowly without supply.
    check: u32,
}

struct NoteCell(UnsafeCell<MaybeUninit<FailureNote>>);

// SAFETY: written only with interrupts masked on the way to a reset, read only at boot before any task runs.
unsafe impl Sync for NoteCell {}

#[unsafe(link_section = ".kept.fault_note")]
static NOTE: NoteCell = NoteCell(UnsafeCell::new(MaybeUninit::uninit()));

impl FailureNote {
    fn compute_checksum(&self) -> u32 {
        let words = [self.magic, self.kind, self.detail, self.length];
        let bytes = self.message.iter().map(|byte| u32::from(*byte));
        !words.into_iter().chain(bytes).fold(0_u32, |sum, word| sum.rotate_left(5).wrapping_add(word))
    }
}

/// Takes the note that the previous run left and forgets it: code, detail, message. To be called once, at boot.
pub fn take_failure_note() -> Option<(FaultCode, u32, String<FAILURE_MESSAGE>)> {
    let place = NOTE.0.get().cast::<FailureNote>();
    // SAFETY: every bit pattern is a valid Note, and nothing else touches the memory at boot.
    let note = unsafe { place.read_volatile() };
    if note.magic != MAGIC || note.check != note.compute_checksum() {
        return None;
    }
    // SAFETY: as above.
    unsafe { (&raw mut (*place).magic).write_volatile(0) };
    let length = usize::try_from(note.length).unwrap_or(0);
    let message = note.message.get(..length).and_then(|bytes| core::str::from_utf8(bytes).ok()).unwrap_or("");
    let code = if note.kind == PANIC { FaultCode::Panic } else { FaultCode::HardFault };
    // The note's message is as long as the text can be.
    Some((code, note.detail, String::try_from(message).unwrap_or_default()))
}

struct MessageBuffer {
    bytes: [u8; FAILURE_MESSAGE],
    length: usize,
}

impl Write for MessageBuffer {
    fn write_str(&mut self, text: &str) -> fmt::Result {
        for byte in text.bytes() {
            let Some(place) = self.bytes.get_mut(self.length) else { return Ok(()) };
            // ASCII only, so that cutting off cannot split a character.
            *place = if byte.is_ascii() { byte } else { b'?' };
            self.length += 1;
        }
        Ok(())
    }
}

fn write_note_and_reset(kind: u32, detail: u32, arguments: fmt::Arguments<'_>) -> ! {
    let mut text = MessageBuffer { bytes: [0; FAILURE_MESSAGE], length: 0 };
    // Text takes everything, so there is no error to look at.
    let _ = text.write_fmt(arguments);
    let mut note =
        FailureNote { magic: MAGIC, kind, detail, length: text.length as u32, message: text.bytes, check: 0 };
    note.check = note.compute_checksum();
    // SAFETY: interrupts are masked and nothing returns from here.
    unsafe { NOTE.0.get().cast::<FailureNote>().write_volatile(note) };
    SCB::sys_reset()
}

#[panic_handler]
fn panic(info: &PanicInfo<'_>) -> ! {
    // One instruction, so that no interrupt can switch on again what the next line switches off.
    cortex_m::interrupt::disable();
    force_outputs_off_withdraw_permit_and_stop_timers();
    let (file, line) = info.location().map_or(("", 0), |location| (location.file(), location.line()));
    // The folders would leave no room for what happened.
    let file = file.rsplit('/').next().unwrap_or(file);
    write_note_and_reset(PANIC, line, format_args!("{file}:{line}: {}", info.message()))
}

#[exception(trampoline = true)]
unsafe fn HardFault(frame: &ExceptionFrame) -> ! {
    // Only an NMI can interrupt this, and it ends here too.
    force_outputs_off_withdraw_permit_and_stop_timers();
    let status = read_fault_status_register();
    write_note_and_reset(
        EXCEPTION,
        frame.pc(),
        format_args!("HardFault at {:#010x}, lr {:#010x}, CFSR {status:#010x}", frame.pc(), frame.lr()),
    )
}

/// A flash word that cannot be corrected, or SRAM parity: the clock security system is not used (RM0440, section 3.3.4).
#[exception]
unsafe fn NonMaskableInt() -> ! {
    force_outputs_off_withdraw_permit_and_stop_timers();
    let flash = FLASH.eccr().read().0;
    write_note_and_reset(EXCEPTION, flash, format_args!("NMI, FLASH_ECCR {flash:#010x}"))
}

/// An interrupt that nobody has enabled.
#[exception]
unsafe fn DefaultHandler(number: i16) -> ! {
    cortex_m::interrupt::disable();
    force_outputs_off_withdraw_permit_and_stop_timers();
    write_note_and_reset(EXCEPTION, number.unsigned_abs().into(), format_args!("unexpected interrupt {number}"))
}

fn read_fault_status_register() -> u32 {
    // SAFETY: reading the fault status register has no effect; its address is fixed by the architecture.
    unsafe { (*SCB::PTR).cfsr.read() }
}
