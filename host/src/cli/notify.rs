//! What the service manager is told: that the daemon serves, that it is well, that it stops.
//!
//! The protocol is that of systemd (`man sd_notify`): without the variable `NOTIFY_SOCKET` nothing is sent.

use sd_notify::NotifyState;
use std::time::Duration;
use tokio::runtime::Handle;

/// Tells that the daemon serves, and from then on, at half of the watchdog's time, that it is alive: while `runtime`
/// still runs tasks and `is_alive` says so. What is not alive is not told, so that the service manager starts the daemon anew.
pub fn notify_ready_and_start_watchdog_messages_while_alive(
    runtime: &Handle,
    status: &str,
    is_alive: impl Fn() -> bool + Send + 'static,
) {
    send_to_service_manager(&[NotifyState::Status(status), NotifyState::Ready]);
    if let Some(limit) = sd_notify::watchdog_enabled().filter(|limit| !limit.is_zero()) {
        runtime.spawn(notify_forever_skipping_periods_when_not_alive(limit / 2, is_alive, || {
            send_to_service_manager(&[NotifyState::Watchdog])
        }));
    }
}

/// Waits for `shutdown`, and tells that the daemon stops.
pub async fn notify_stopping_after(shutdown: impl Future<Output = ()>) {
    shutdown.await;
    send_to_service_manager(&[NotifyState::Stopping]);
}

async fn notify_forever_skipping_periods_when_not_alive(
    period: Duration,
    is_alive: impl Fn() -> bool,
    tell: impl Fn(),
) {
    let mut interval = tokio::time::interval(period);
    interval.set_missed_tick_behavior(tokio::time::MissedTickBehavior::Delay);
    let mut was_alive = true;
    loop {
        interval.tick().await;
        let alive = is_alive();
        if alive {
            tell();
        } else if was_alive {
            tracing::error!(
                "the device session has ended: the daemon sends no more watchdog messages to the service manager, \
                 which then restarts the daemon"
            );
        }
        was_alive = alive;
    }
}

fn send_to_service_manager(state: &[NotifyState<'_>]) {
    if let Err(error) = sd_notify::notify(state) {
        tracing::warn!(%error, "the service manager cannot be notified");
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::Arc;
    use std::sync::atomic::{AtomicU32, Ordering};

    /// Nothing is told of what is not alive; it is asked on, as it may come back.
    #[test]
    fn the_watchdog_gets_signs_of_life_only() {
        let runtime = tokio::runtime::Builder::new_current_thread().enable_time().build().unwrap();
        let (asked, told) = (Arc::new(AtomicU32::new(0)), Arc::new(AtomicU32::new(0)));
        let (asks, tells) = (Arc::clone(&asked), Arc::clone(&told));
        // Alive, dead for two ticks, alive again.
        let is_alive = move || !(1..3).contains(&asks.fetch_add(1, Ordering::Relaxed));
        runtime.block_on(async {
            let ticking =
                notify_forever_skipping_periods_when_not_alive(Duration::from_millis(5), is_alive, move || {
                    tells.fetch_add(1, Ordering::Relaxed);
                });
            assert!(tokio::time::timeout(Duration::from_millis(100), ticking).await.is_err());
        });
        let (asked, told) = (asked.load(Ordering::Relaxed), told.load(Ordering::Relaxed));
        assert!(asked > 3 && told == asked - 2, "{told} of {asked}");
    }
}
