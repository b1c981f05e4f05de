//! The ways out when the firmware itself fails: outputs off before anything else, then a note for the next start, then
//! a reset. Nothing here relies on what failed having been in order.

use crate::outputs::force_off;
use core::cell::UnsafeCell;
use core::fmt::{self, Write};
use core::mem::MaybeUninit;
use core::panic::PanicInfo;
use cortex_m::peripheral::SCB;
use cortex_m_rt::{ExceptionFrame, exception};
use era_shared::protocol::FaultCode;

/// Longest message kept over the reset.
const MESSAGE: usize = 120;

/// Marks a note as written by this code and not left over from power-on.
const MAGIC: u32 = 0x4552_4146;

/// A note that survives a reset, in memory that the start-up code does not touch.
#[derive(Clone, Copy)]
#[repr(C)]
struct Note {
    magic: u32,
    /// 0: panic; 1: HardFault.
    kind: u32,
    detail: u32,
    length: u32,
    message: [u8; MESSAGE],
    /// Bitwise complement of the sum of the words above, as memory decays slowly without supply.
    check: u32,
}

struct NoteCell(UnsafeCell<MaybeUninit<Note>>);

// SAFETY: written only with interrupts masked on the way to a reset, read only at boot before any task runs.
unsafe impl Sync for NoteCell {}

#[unsafe(link_section = ".uninit.fault_note")]
static NOTE: NoteCell = NoteCell(UnsafeCell::new(MaybeUninit::uninit()));

impl Note {
    fn sum(&self) -> u32 {
        let words = [self.magic, self.kind, self.detail, self.length];
        let bytes = self.message.iter().map(|byte| u32::from(*byte));
        !words.into_iter().chain(bytes).fold(0_u32, |sum, word| sum.rotate_left(5).wrapping_add(word))
    }
}

/// Takes the note that the previous run left, logs it and forgets it. To be called once, at boot.
pub fn take_note() -> Option<(FaultCode, u32)> {
    let place = NOTE.0.get().cast::<Note>();
    // SAFETY: every bit pattern is a valid Note, and nothing else touches the memory at boot.
    let note = unsafe { place.read_volatile() };
    if note.magic != MAGIC || note.check != note.sum() {
        return None;
    }
    // SAFETY: as above.
    unsafe { (&raw mut (*place).magic).write_volatile(0) };
    let message = note.message.get(..note.length as usize).and_then(|bytes| core::str::from_utf8(bytes).ok());
    defmt::error!("the previous run ended in a failure: {}", message.unwrap_or("(no message)"));
    let code = if note.kind == 0 { FaultCode::Panic } else { FaultCode::HardFault };
    Some((code, note.detail))
}

struct Text {
    bytes: [u8; MESSAGE],
    length: usize,
}

impl Write for Text {
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

fn leave(kind: u32, detail: u32, arguments: fmt::Arguments<'_>) -> ! {
    let mut text = Text { bytes: [0; MESSAGE], length: 0 };
    // Text takes everything, so there is no error to look at.
    let _ = text.write_fmt(arguments);
    let mut note = Note { magic: MAGIC, kind, detail, length: text.length as u32, message: text.bytes, check: 0 };
    note.check = note.sum();
    // SAFETY: interrupts are masked and nothing returns from here.
    unsafe { NOTE.0.get().cast::<Note>().write_volatile(note) };
    defmt::error!("{}", core::str::from_utf8(text.bytes.get(..text.length).unwrap_or(&[])).unwrap_or(""));
    SCB::sys_reset()
}

#[panic_handler]
fn panic(info: &PanicInfo<'_>) -> ! {
    // One instruction, so that the device's interrupt cannot switch on again what the next line switches off.
    cortex_m::interrupt::disable();
    force_off();
    let line = info.location().map_or(0, |location| location.line());
    leave(0, line, format_args!("{info}"))
}

#[exception(trampoline = true)]
unsafe fn HardFault(frame: &ExceptionFrame) -> ! {
    // Nothing but NMI can interrupt a HardFault, and NMI is not used.
    force_off();
    // SAFETY: reading the fault status register has no effect; its address is fixed by the architecture.
    let status = unsafe { (*SCB::PTR).cfsr.read() };
    leave(
        1,
        frame.pc(),
        format_args!("HardFault at {:#010x}, lr {:#010x}, CFSR {status:#010x}", frame.pc(), frame.lr()),
    )
}
