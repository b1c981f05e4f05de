//! The chip's own supply: the programmable voltage detector, and how a start after a dip is told from one after a rest.
//!
//! Below 2.9 V the detector clears the breaks' MOE in hardware (SYSCFG CFGR2.PVDL) and its interrupt switches off what the
//! breaks do not. At the brown-out level the chip resets; that level is an option byte (BOR_LEV, delivered as 0: 1.7 V),
//! to be set to 4, 2.8 V, when a board is brought up.

use crate::outputs::force_outputs_off_withdraw_permit_and_stop_timers;
use crate::priorities::PROTECTION;
use crate::trip;
use core::cell::UnsafeCell;
use core::mem::MaybeUninit;
use embassy_stm32::interrupt;
use embassy_stm32::interrupt::{Interrupt, InterruptExt};
use embassy_stm32::pac::exti::regs::Lines;
use embassy_stm32::pac::{EXTI, PWR, RCC};
use era_shared::protocol::{FaultCode, ResetCause};

/// PWR_CR2.PLS: 2.9 V, the highest that a supply of 3.3 V less 5 % does not come near (DS12288, reset and power control block).
const LEVEL: u8 = 6;
/// Line of the detector (RM0440, EXTI lines connections).
const LINE: usize = 16;

/// What the note holds while the firmware runs, with its complement: memory keeps it over a dip that resets the chip, and
/// loses it while the supply is away.
const RUNNING: u32 = 0x4552_4152;

struct NoteCell(UnsafeCell<MaybeUninit<[u32; 2]>>);

// SAFETY: accessed at boot only, before any task or interrupt.
unsafe impl Sync for NoteCell {}

#[unsafe(link_section = ".kept.running_note")]
static NOTE: NoteCell = NoteCell(UnsafeCell::new(MaybeUninit::uninit()));

/// Whether a dip of the supply that memory has survived has reset the chip. Power that was off for a moment counts as a dip: the chip cannot
/// tell them apart. Leaves the note for the next start. To be called once, at boot.
pub fn detect_supply_dip_reset_and_mark_running(reset_cause: ResetCause) -> bool {
    let place = NOTE.0.get().cast::<[u32; 2]>();
    // SAFETY: every bit pattern is valid, and nothing else accesses the memory.
    let ran_before = unsafe { place.read_volatile() } == [RUNNING, !RUNNING];
    // SAFETY: as above.
    unsafe { place.write_volatile([RUNNING, !RUNNING]) };
    // The flag of a brown-out reset is that of a power-on too.
    reset_cause == ResetCause::PowerOn && ran_before
}

/// Starts the detector and its interrupt. To be called once.
pub fn init_voltage_detector() {
    RCC.apb1enr1().modify(|w| w.set_pwren(true));
    // A peripheral takes writes from the second clock after its enable (RM0440, section 7.2.18); the read waits for it.
    let _ = RCC.apb1enr1().read();
    PWR.cr2().modify(|w| {
        w.set_pls(LEVEL);
        w.set_pvde(true);
    });
    // Its output rises when the supply falls.
    EXTI.rtsr(0).modify(|w| w.set_line(LINE, true));
    EXTI.imr(0).modify(|w| w.set_line(LINE, true));
    Interrupt::PVD_PVM.set_priority(PROTECTION);
    // SAFETY: the handler is ready.
    unsafe { Interrupt::PVD_PVM.enable() };
}

/// Whether the detector is on and at its level.
#[must_use]
pub fn is_voltage_detector_configured() -> bool {
    let control = PWR.cr2().read();
    control.pvde() && control.pls() == LEVEL
}

#[interrupt]
fn PVD_PVM() {
    force_outputs_off_withdraw_permit_and_stop_timers();
    trip::note_trip_unless_one_is_noted(FaultCode::BrownOut, 0);
    let mut line = Lines(0);
    line.set_line(LINE, true);
    EXTI.pr(0).write_value(line);
    // As in the handler of the breaks.
    cortex_m::asm::dsb();
}
