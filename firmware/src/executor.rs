//! The two executors: one in thread mode for the links, one in an interrupt for the device, so that no link can hold up
//! the dead-man timer.
//!
//! They are embassy's raw executors with our own waking. Embassy's ready-made interrupt executor pends its interrupt
//! through the register STIR, which the emulator that runs this image does not have, while ISPR works on both; and with
//! an idle loop of our own the one place where the processor sleeps is known, which [`ERA_CPU_IDLE`] shows.

use crate::watchdog;
use core::ptr;
use core::sync::atomic::{AtomicBool, AtomicPtr, Ordering};
use cortex_m::peripheral::NVIC;
use embassy_executor::raw::Executor;
use embassy_executor::{SendSpawner, Spawner};
use embassy_stm32::interrupt;
use embassy_stm32::interrupt::{Interrupt, InterruptExt};
use static_cell::StaticCell;

/// The interrupt of a peripheral that this board does not use carries the device's executor.
const DEVICE_INTERRUPT: Interrupt = Interrupt::UART4;

/// Contexts given to the pender.
const THREAD: usize = 1;
const DEVICE: usize = 2;

static THREAD_EXECUTOR: StaticCell<Executor> = StaticCell::new();
static DEVICE_EXECUTOR: StaticCell<Executor> = StaticCell::new();
/// Set once, before the interrupt is enabled.
static DEVICE_EXECUTOR_POINTER: AtomicPtr<Executor> = AtomicPtr::new(ptr::null_mut());
/// There is work for thread mode.
static THREAD_WORK: AtomicBool = AtomicBool::new(true);

/// Whether neither executor has anything to do. A debugger can sum it up to the load of the processor; the emulator,
/// which cannot sleep, passes over the time until the next timer event while it is set. Both look its name up in the
/// ELF.
#[unsafe(no_mangle)]
pub static ERA_CPU_IDLE: AtomicBool = AtomicBool::new(false);

/// Embassy calls this when a task of the executor made with `context` has been woken.
#[unsafe(export_name = "__pender")]
fn pend_device_interrupt_or_mark_thread_work(context: *mut ()) {
    if context.addr() == THREAD {
        THREAD_WORK.store(true, Ordering::Release);
    } else {
        NVIC::pend(DEVICE_INTERRUPT);
    }
}

#[interrupt]
fn UART4() {
    let executor = DEVICE_EXECUTOR_POINTER.load(Ordering::Acquire);
    let idle = ERA_CPU_IDLE.swap(false, Ordering::Relaxed);
    // SAFETY: the pointer is null or that of the static executor, and this handler is the only place that polls it.
    if let Some(executor) = unsafe { executor.as_ref() } {
        unsafe { executor.poll() };
    }
    ERA_CPU_IDLE.store(idle, Ordering::Relaxed);
    // What the device has written has arrived when the handler ends (Cortex-M4 erratum 838869).
    cortex_m::asm::dsb();
}

/// Starts the device's executor.
pub fn start_device_executor() -> SendSpawner {
    let executor = DEVICE_EXECUTOR.init(Executor::new(ptr::without_provenance_mut(DEVICE)));
    DEVICE_EXECUTOR_POINTER.store(executor, Ordering::Release);
    DEVICE_INTERRUPT.set_priority(crate::priorities::DEVICE);
    // SAFETY: the handler is ready, and no critical section relies on this interrupt being masked.
    unsafe { DEVICE_INTERRUPT.enable() };
    executor.spawner().make_send()
}

/// Runs the thread-mode executor for ever, with the tasks that `spawn_tasks` starts.
pub fn run_thread_executor(spawn_tasks: impl FnOnce(Spawner)) -> ! {
    let executor: &'static Executor = THREAD_EXECUTOR.init(Executor::new(ptr::without_provenance_mut(THREAD)));
    spawn_tasks(executor.spawner());
    let mut knocked = 0;
    loop {
        // SAFETY: polled here only, in thread mode, not from within a task.
        unsafe { executor.poll() };
        ERA_CPU_IDLE.store(true, Ordering::Relaxed);
        while !take_thread_work_or_sleep() {
            watchdog::wake_watched_tasks_if_due(&mut knocked);
        }
        ERA_CPU_IDLE.store(false, Ordering::Relaxed);
    }
}

/// Whether thread mode has work; the mark is then cleared. Without work the processor sleeps until the next interrupt.
fn take_thread_work_or_sleep() -> bool {
    // With interrupts masked, WFI still wakes for one that is pending, so work that arrives between the test and the sleep is
    // not slept over. A plain load and store are enough: nothing can come between them.
    cortex_m::interrupt::disable();
    let work = THREAD_WORK.load(Ordering::Acquire);
    if work {
        THREAD_WORK.store(false, Ordering::Release);
    } else {
        cortex_m::asm::wfi();
        // Whatever was fetched before the sleep is fetched again: after a sleep with the debug bits set the first fetch from flash may be wrong
        // (errata sheet ES0430, 2.2.8; its text was not at hand). Shipped images do not set these bits. `cargo xtask firmware --budget` checks
        // that nothing stands between the two instructions.
        cortex_m::asm::isb();
    }
    // SAFETY: no critical section is open here.
    unsafe { cortex_m::interrupt::enable() };
    work
}
