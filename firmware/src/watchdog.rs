//! The independent watchdog: it resets the chip unless every task has checked in lately.
//!
//! The counter runs on the chip's own 32 kHz oscillator (29.5 to 34 kHz) whatever happens to the other clocks, and nothing
//! but a reset stops it. It is fed in one place, [`feed`], and only when each task has checked in since it was last fed. When each last did
//! is kept over the reset.

use core::cell::UnsafeCell;
use core::fmt::Write;
use core::future::{Future, poll_fn};
use core::mem::MaybeUninit;
use core::pin::pin;
use core::sync::atomic::{AtomicU32, Ordering};
use embassy_stm32::pac::iwdg::vals::{Key, Pr};
use embassy_stm32::pac::{DBGMCU, IWDG};
use embassy_sync::waitqueue::AtomicWaker;
use embassy_time::Instant;
use era_shared::protocol::FAILURE_MESSAGE;
use heapless::String;

/// Who must check in; the number is the bit in the mask.
#[derive(Clone, Copy)]
pub enum Task {
    /// The device.
    Device,
    /// Receives from the UART.
    UartReceive,
    /// Transmits to the UART.
    UartTransmit,
    /// Answers the host's USB requests.
    Usb,
    /// Receives over USB.
    UsbReceive,
    /// Transmits over USB.
    UsbTransmit,
}

const NAMES: [&str; 6] = ["device", "uart-rx", "uart-tx", "usb", "usb-rx", "usb-tx"];
const ALL: u32 = (1 << NAMES.len()) - 1;

/// How often a task that waits for something else checks in, in units of [`now`].
const CHECK_IN: u32 = 20;

/// Who waits for a knock.
static WAITING: [AtomicWaker; NAMES.len()] = [const { AtomicWaker::new() }; NAMES.len()];

/// The counter runs at 32 kHz / 32 = 1 kHz from here to 0: in 94 to 109 ms, five times what the slowest task needs.
const RELOAD: u16 = 99;
/// A new reload value takes up to six clocks of the oscillator (RM0440, IWDG_RLR and IWDG_SR), 0.2 ms; each read takes some 10
/// clocks of 170 MHz.
const UPDATE_READS: usize = 20_000;

/// Tasks that have not checked in since the last feed, one bit each.
static MISSING: AtomicU32 = AtomicU32::new(ALL);

/// When the last feed was and when each task last checked in, in units of [`now`]; in memory that the start-up code does not
/// touch, for the run after a reset.
struct Record {
    fed: AtomicU32,
    seen: [AtomicU32; NAMES.len()],
}

struct RecordCell(UnsafeCell<MaybeUninit<Record>>);

// SAFETY: only used as the atomics that it consists of.
unsafe impl Sync for RecordCell {}

#[unsafe(link_section = ".uninit.watchdog_record")]
static RECORD: RecordCell = RecordCell(UnsafeCell::new(MaybeUninit::uninit()));

fn record() -> &'static Record {
    // SAFETY: every bit pattern is a valid Record, and nothing accesses it in another way than through this.
    unsafe { &*RECORD.0.get().cast::<Record>() }
}

/// Time in units of 1.024 ms.
fn now() -> u32 {
    // Wraps around after 50 days, which differences do not notice.
    (Instant::now().as_micros() >> 10) as u32
}

/// A task that has checked in so long after the last feed was alive when the reset came, 94 to 109 ms after that feed.
const ALIVE: u32 = 60;

/// The tasks that gave no sign when the watchdog reset the chip, and a text that names them. To be called after such a
/// reset, before [`start`].
pub fn missing_before_reset() -> (u32, String<FAILURE_MESSAGE>) {
    let fed = record().fed.load(Ordering::Relaxed);
    let (mut missing, mut text) = (0, String::new());
    // The text has room for all names.
    let _ = text.push_str("watchdog: no sign of");
    for ((bit, name), seen) in NAMES.iter().enumerate().zip(&record().seen) {
        let since_feed = seen.load(Ordering::Relaxed).wrapping_sub(fed).cast_signed();
        if since_feed < ALIVE.cast_signed() {
            missing |= 1 << bit;
            let _ = write!(text, " {name}");
        }
    }
    (missing, text)
}

/// Starts it; there is no way back. To be called once, right before the tasks start.
pub fn start() {
    fed();
    freeze_in_debug(true);
    IWDG.kr().write(|w| w.set_key(Key::START));
    IWDG.kr().write(|w| w.set_key(Key::ENABLE));
    IWDG.pr().write(|w| w.set_pr(Pr::DIVIDE_BY32));
    IWDG.rlr().write(|w| w.set_rl(RELOAD));
    // Until the values have arrived, 512 ms would be loaded; that comes true if they never do.
    let _ = (0..UPDATE_READS).any(|_| IWDG.sr().read().0 == 0);
    IWDG.kr().write(|w| w.set_key(Key::RESET));
}

/// Notes that a task still does its work.
pub fn check_in(task: Task) {
    MISSING.fetch_and(!(1 << task as u32), Ordering::Relaxed);
    if let Some(seen) = record().seen.get(task as usize) {
        seen.store(now(), Ordering::Relaxed);
    }
}

/// Feeds the watchdog if every task has checked in since it was last fed.
pub fn feed() {
    if MISSING.load(Ordering::Relaxed) == 0 {
        fed();
        IWDG.kr().write(|w| w.set_key(Key::RESET));
    }
}

fn fed() {
    MISSING.store(ALL, Ordering::Relaxed);
    record().fed.store(now(), Ordering::Relaxed);
}

/// Runs a task's work and checks in for it whenever it is polled. A task that waits is woken to that end by [`knock`].
pub async fn watched<F: Future>(task: Task, work: F) -> F::Output {
    let mut work = pin!(work);
    poll_fn(|context| {
        if let Some(waiting) = WAITING.get(task as usize) {
            waiting.register(context.waker());
        }
        check_in(task);
        work.as_mut().poll(context)
    })
    .await
}

/// Wakes every task whose work is watched, if it is time. To be called at least every ms or two, in thread mode.
pub fn knock(last: &mut u32) {
    if now().wrapping_sub(*last) >= CHECK_IN {
        *last = now();
        WAITING.iter().for_each(AtomicWaker::wake);
    }
}

/// Whether the watchdog stands still while a debugger has halted the processor. Not while the supply is on: a breakpoint
/// then ends in a reset, and everything is off 0.1 s later, while the breaks switch the electrodes off at once.
pub fn freeze_in_debug(frozen: bool) {
    DBGMCU.apb1lfzr().modify(|w| w.set_iwdg(frozen));
    DBGMCU.apb2fzr().modify(|w| {
        w.set_tim1(true);
        w.set_tim8(true);
        w.set_tim20(true);
    });
}
