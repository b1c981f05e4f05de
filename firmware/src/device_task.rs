//! The one owner of the outputs: it carries out what arrives on the links and notices their silence.

use crate::board::Stm32Board;
use crate::heartbeat::Heartbeat;
use crate::links::{INBOX, LINKS, uart};
use crate::watchdog::{self, WatchedTask};
use embassy_futures::select::{Either, select};
use embassy_time::{Instant, Timer};
use era_shared::device::{Device, LinkReceiver};
use era_shared::log_limit::CountReport;

/// How long the device sleeps at most, in us, whatever it wants: silence is looked for this often. The dead-man time is at
/// least 50 ms, so this adds 2 % to it at most.
const LONGEST_SLEEP_US: u64 = 1_000;
/// How long it sleeps at least: thread mode gets its turn, whatever the device wants.
const SHORTEST_SLEEP_US: u64 = 10;

/// Runs the device for ever. Lives on the interrupt executor: no link, and nothing in thread mode, can hold it up.
#[embassy_executor::task]
pub async fn run_device(mut board: Stm32Board) -> ! {
    let mut device = Device::new();
    device.restore_credit_and_complete_boot_to_discharging_or_fault(&mut board);
    let mut ports = LinkReceiver::new_for_each_link::<{ LINKS.len() }>();
    let mut heartbeat = Heartbeat::new();
    let mut line_errors = CountReport::new();
    let mut state = device.state();
    defmt::info!("device task started, state {}", state.name());
    loop {
        // First in every turn, so that a flood of bytes cannot starve it; what a frame has changed is done at once too.
        let due_us = device.do_due_work_and_tell_next_due_us(&mut board);
        if device.take_tick_done() {
            watchdog::record_check_in(WatchedTask::Device);
        }
        watchdog::feed_if_all_checked_in();
        let now_us = Instant::now().as_micros();
        heartbeat.update_led(device.state(), now_us);
        uart::log_line_errors_if_due(&mut line_errors, now_us);
        if device.state() != state {
            state = device.state();
            defmt::info!("state {}", state.name());
        }
        let due_us = due_us.clamp(now_us + SHORTEST_SLEEP_US, now_us + LONGEST_SLEEP_US);
        if let Either::Second((link, arrival)) = select(Timer::at(Instant::from_micros(due_us)), INBOX.receive()).await
        {
            let (Some(port), Some(outbox)) = (ports.get_mut(link), LINKS.get(link)) else { continue };
            device.handle_received_bytes_or_link_reopening(&mut board, port, &arrival, |answer| {
                outbox.queue_answer_or_drop_if_full(answer)
            });
        }
    }
}
