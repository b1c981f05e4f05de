//! The independent watchdog: it resets the chip unless every task has checked in lately.
//!
//! The counter runs on the chip's own 32 kHz oscillator (29.5 to 34 kHz) whatever happens to the other clocks, and nothing
//! but a reset stops it. It is fed in one place, [`feed_if_all_checked_in`], and only when each task has checked in since it was last fed. When each last did
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
pub enum WatchedTask {
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
    /// Watches whether a program has the USB port open.
    UsbLine,
}

const NAMES: [&str; 7] = ["device", "uart-rx", "uart-tx", "usb", "usb-rx", "usb-tx", "usb-line"];
const ALL: u32 = (1 << NAMES.len()) - 1;

/// How often a task that waits for something else checks in, in units of [`now_in_1024_us`].
const CHECK_IN: u32 = 20;

/// Wakes each watched task.
static WAITING: [AtomicWaker; NAMES.len()] = [const { AtomicWaker::new() }; NAMES.len()];

/// The counter runs at 32 kHz / 32 = 1 kHz from here to 0: in 94 to 109 ms, five times what the slowest task needs.
const RELOAD: u16 = 99;
/// A new reload value takes up to six clocks of the oscillator (RM0440, IWDG_RLR and IWDG_SR), 0.2 ms; each read takes some 10
/// clocks of 170 MHz.
const UPDATE_READS: usize = 20_000;

/// Tasks that have not checked in since the last feed, one bit each.
static MISSING: AtomicU32 = AtomicU32::new(ALL);

/// When the last feed was and when each task last checked in, in units of [`now_in_1024_us`]; in memory that the start-up code does not
/// touch, for the run after a reset.
struct CheckInRecord {
    fed: AtomicU32,
    seen: [AtomicU32; NAMES.len()],
}

struct RecordCell(UnsafeCell<MaybeUninit<CheckInRecord>>);

// SAFETY: only used as the atomics that it consists of.
unsafe impl Sync for RecordCell {}

#[unsafe(link_section = ".kept.watchdog_record")]
static RECORD: RecordCell = RecordCell(UnsafeCell::new(MaybeUninit::uninit()));

fn get_record_of_check_in_times() -> &'static CheckInRecord {
    // SAFETY: every bit pattern is a valid Record, and nothing accesses it in another way than through this.
    unsafe { &*RECORD.0.get().cast::<CheckInRecord>() }
}

/// Time in units of 1.024 ms.
fn now_in_1024_us() -> u32 {
    // Wraps around after 50 days, which differences do not notice.
    (Instant::now().as_micros() >> 10) as u32
}

/// A task that has checked in so long after the last feed was alive when the reset came, 94 to 109 ms after that feed.
const ALIVE: u32 = 60;

/// The tasks that had not checked in when the watchdog reset the chip, as a mask and as a text that names them. To be called after such a
/// reset, before [`start_watchdog_and_tell_whether_settings_hold`].
pub fn find_mask_and_names_of_tasks_missing_before_reset() -> (u32, String<FAILURE_MESSAGE>) {
    let fed = get_record_of_check_in_times().fed.load(Ordering::Relaxed);
    let (mut missing, mut text) = (0, String::new());
    // The text has room for all names.
    let _ = text.push_str("watchdog: unresponsive tasks:");
    for ((bit, name), seen) in NAMES.iter().enumerate().zip(&get_record_of_check_in_times().seen) {
        let since_feed = seen.load(Ordering::Relaxed).wrapping_sub(fed).cast_signed();
        if since_feed < ALIVE.cast_signed() {
            missing |= 1 << bit;
            let _ = write!(text, " {name}");
        }
    }
    (missing, text)
}

/// Starts the watchdog, which cannot be stopped again, and returns whether its settings read back as they were written: its time would otherwise
/// be up to that of the reset, 512 ms. To be called once, right before the tasks start.
#[must_use]
pub fn start_watchdog_and_tell_whether_settings_hold() -> bool {
    record_feed_and_mark_all_missing();
    set_watchdog_frozen_in_debug_and_freeze_timers(true);
    IWDG.kr().write(|w| w.set_key(Key::START));
    IWDG.kr().write(|w| w.set_key(Key::ENABLE));
    IWDG.pr().write(|w| w.set_pr(Pr::DIVIDE_BY32));
    IWDG.rlr().write(|w| w.set_rl(RELOAD));
    // Until the values have arrived they cannot be read, and 512 ms would be loaded; that comes true if they never do.
    let have_arrived = (0..UPDATE_READS).any(|_| IWDG.sr().read().0 == 0);
    let are_as_written = IWDG.pr().read().pr() == Pr::DIVIDE_BY32 && IWDG.rlr().read().rl() == RELOAD;
    IWDG.kr().write(|w| w.set_key(Key::RESET));
    have_arrived && are_as_written
}

/// Notes that a task still does its work.
pub fn record_check_in(task: WatchedTask) {
    MISSING.fetch_and(!(1 << task as u32), Ordering::Relaxed);
    if let Some(seen) = get_record_of_check_in_times().seen.get(task as usize) {
        seen.store(now_in_1024_us(), Ordering::Relaxed);
    }
}

/// Feeds the watchdog if every task has checked in since it was last fed.
pub fn feed_if_all_checked_in() {
    if MISSING.load(Ordering::Relaxed) == 0 {
        record_feed_and_mark_all_missing();
        IWDG.kr().write(|w| w.set_key(Key::RESET));
    }
}

fn record_feed_and_mark_all_missing() {
    MISSING.store(ALL, Ordering::Relaxed);
    get_record_of_check_in_times().fed.store(now_in_1024_us(), Ordering::Relaxed);
}

/// Runs a task's work and checks in for it whenever it is polled. [`wake_watched_tasks_if_due`] wakes a task that waits, so that it is polled.
pub async fn run_watched<F: Future>(task: WatchedTask, work: F) -> F::Output {
    let mut work = pin!(work);
    poll_fn(|context| {
        if let Some(waiting) = WAITING.get(task as usize) {
            waiting.register(context.waker());
        }
        record_check_in(task);
        work.as_mut().poll(context)
    })
    .await
}

/// Wakes all watched tasks if they have not been woken for [`CHECK_IN`]. To be called at least every ms or two, in thread mode.
pub fn wake_watched_tasks_if_due(last_wake: &mut u32) {
    if now_in_1024_us().wrapping_sub(*last_wake) >= CHECK_IN {
        *last_wake = now_in_1024_us();
        WAITING.iter().for_each(AtomicWaker::wake);
    }
}

/// Sets whether the watchdog stands still while a debugger has halted the processor. It does not while the supply is on: a breakpoint then
/// ends in a reset, and everything is off 0.1 s later, while the breaks switch the electrodes off at once.
pub fn set_watchdog_frozen_in_debug_and_freeze_timers(frozen: bool) {
    DBGMCU.apb1lfzr().modify(|w| w.set_iwdg(frozen));
    DBGMCU.apb2fzr().modify(|w| {
        w.set_tim1(true);
        w.set_tim8(true);
        w.set_tim16(true);
        w.set_tim20(true);
    });
}
