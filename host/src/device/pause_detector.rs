//! Notices that this program did not run for a while: the computer slept, or the process was held. What comes in first afterwards was asked
//! for long ago. [`std::time::Instant`] does not count a sleep on Linux.

use rustix::time::{ClockId, clock_gettime};
use std::time::Duration;

/// A clock that counts while the computer sleeps, where the system has one.
#[cfg(any(target_os = "linux", target_os = "android"))]
const COUNTS_SLEEP: ClockId = ClockId::Boottime;
#[cfg(not(any(target_os = "linux", target_os = "android")))]
const COUNTS_SLEEP: ClockId = ClockId::Monotonic;

/// A shorter sleep is none: what two readings of the clocks may differ by.
const SHORTEST: Duration = Duration::from_millis(100);

/// Notices pauses of the program between two times that it is asked.
#[derive(Clone, Copy, Debug)]
pub struct PauseDetector {
    /// Longest time between two questions while the program runs.
    longest: Duration,
    asked: Duration,
    /// How long the computer has slept since it was started.
    asleep: Duration,
}

impl PauseDetector {
    /// A detector whose owner calls [`Self::take_time_since_last_call_if_host_slept_or_process_suspended`] at least every `longest` while the program runs.
    #[must_use]
    pub fn new(longest: Duration) -> Self {
        let [asked, asleep] = read_uptime_including_sleep_and_time_asleep();
        Self { longest, asked, asleep }
    }

    /// How long the program has not run since the last call; `None` if it has run.
    pub fn take_time_since_last_call_if_host_slept_or_process_suspended(&mut self) -> Option<Duration> {
        self.take_time_since_last_call_if_host_slept_or_process_suspended_at(
            read_uptime_including_sleep_and_time_asleep(),
        )
    }

    fn take_time_since_last_call_if_host_slept_or_process_suspended_at(
        &mut self,
        [uptime, total_asleep]: [Duration; 2],
    ) -> Option<Duration> {
        let since = uptime.saturating_sub(self.asked);
        let slept = total_asleep.saturating_sub(self.asleep);
        self.asked = uptime;
        // Readings are too small where something came between them, never too large.
        self.asleep = self.asleep.max(total_asleep);
        (slept > SHORTEST || since > self.longest).then_some(since)
    }
}

/// Time since the computer was started, and how much of it it has slept.
fn read_uptime_including_sleep_and_time_asleep() -> [Duration; 2] {
    let read = |clock| Duration::try_from(clock_gettime(clock)).unwrap_or_default();
    let all = read(COUNTS_SLEEP);
    [all, all.saturating_sub(read(ClockId::Monotonic))]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_sleep_and_a_hold_are_pauses_and_a_late_thread_is_none() {
        let ms = Duration::from_millis;
        let mut awake = PauseDetector { longest: ms(3000), asked: ms(50_000), asleep: ms(7000) };
        assert_eq!(awake.take_time_since_last_call_if_host_slept_or_process_suspended_at([ms(50_030), ms(7000)]), None);
        assert_eq!(
            awake.take_time_since_last_call_if_host_slept_or_process_suspended_at([ms(52_930), ms(7000)]),
            None,
            "a thread that came late"
        );
        // Something came between the two readings, and the next are right again.
        assert_eq!(awake.take_time_since_last_call_if_host_slept_or_process_suspended_at([ms(52_960), ms(6500)]), None);
        assert_eq!(awake.take_time_since_last_call_if_host_slept_or_process_suspended_at([ms(52_990), ms(7000)]), None);
        assert_eq!(
            awake.take_time_since_last_call_if_host_slept_or_process_suspended_at([ms(53_500), ms(7480)]),
            Some(ms(510)),
            "a short sleep"
        );
        assert_eq!(
            awake.take_time_since_last_call_if_host_slept_or_process_suspended_at([ms(53_530), ms(7480)]),
            None,
            "told once"
        );
        assert_eq!(
            awake.take_time_since_last_call_if_host_slept_or_process_suspended_at([ms(60_000), ms(7480)]),
            Some(ms(6470)),
            "a hold"
        );
    }
}
